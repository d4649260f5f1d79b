# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How long do databases of up to a million places take to build, to open and to query?

    python -m benchmarks.fleet.million [--places 10000,100000] [--data made,real] [--write]

Vectors come in driving order: "made" are islands of fifty alike, of length 576; "real" are M2DP
vectors of a drive of KITTI, of length 192, driven again and again with noise. Each phase runs in a
process of its own, whose peak of memory is printed. FAISS on the same vectors is the peer. A
million made places take 6 GB on the disk for a time.
"""

import json
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from benchmarks.accuracy.data import ROOT
from benchmarks.accuracy.markdown import table, write_between
from benchmarks.fleet.drives import DATA
from benchmarks.fleet.phases import FILTERS, PHASES, Figures

PAGE = ROOT / "docs" / "results" / "fleet.md"
PICTURE = ROOT / "docs" / "images" / "fleet_growth.png"
STORES = {
    "query": ("index", "fusionslam"),
    "lance query": ("lance index", "LanceDB alone"),
    "faiss sq": ("faiss sq", "FAISS alone"),
}
"""Phases that query, those that build what is queried, and what it is called."""

Results = dict[str, dict[int, dict[str, Figures]]]
"""Figures by data, places and phase."""

app = typer.Typer(add_completion=False)


@app.command()
def measure(
    places: Annotated[str, typer.Option(help="Numbers of places, with commas.")] = (
        "10000,30000,100000,300000,1000000"
    ),
    data: Annotated[str, typer.Option(help=f"{' or '.join(DATA)}, or both with commas.")] = "made",
    phases: Annotated[
        str, typer.Option(help=f"Of {', '.join(PHASES)}; with commas, in this order.")
    ] = ",".join(PHASES),
    queries: Annotated[int, typer.Option(help="Number of queries.")] = 1000,
    folder: Annotated[
        Path | None, typer.Option(help="Where databases stay; a temporary one if not given.")
    ] = None,
    results: Annotated[
        Path, typer.Option(help="File of all figures, to which these are added.")
    ] = Path("out/fleet/million.json"),
    write: Annotated[bool, typer.Option("--write", help="Put tables into the docs.")] = False,
) -> None:
    """Measure; print tables, exponents of growth and missed bounds of all figures so far."""
    figures = _read(results)
    wanted = [name for name in PHASES if name in phases.split(",")]
    for name in filter(None, data.split(",")):
        for count in map(int, filter(None, places.split(","))):
            known = figures.setdefault(name, {}).setdefault(count, {})
            with tempfile.TemporaryDirectory() as temporary:
                home = (folder or Path(temporary)) / f"{name}-{count}"
                home.mkdir(parents=True, exist_ok=True)
                for phase in wanted:
                    known[phase] = _run(phase, home, name, count, queries)
                    _save(results, figures)
    text = tables(figures)
    print(text)
    if "made" in figures:
        draw(figures["made"], PICTURE)
    if write:
        write_between(PAGE, "million places", text)
    for line in (lines := missed(figures)):
        print(f"missed: {line}")
    if lines:
        raise typer.Exit(1)


def tables(figures: Results) -> str:
    """All figures in Markdown."""
    parts = []
    for name, sizes in figures.items():
        parts.append(f"**{name}**\n\n{_build_table(sizes)}\n\n{_query_table(sizes)}")
        parts += [_change_table(sizes), _filter_table(sizes)]
        grown = [exponent_text(sizes, *one) for one in GROWN]
        parts.append("Exponents of growth: " + ", ".join(filter(None, grown)) + ".")
    return "\n\n".join(parts)


GROWN = [("query", "p50 ms"), ("index", "index s"), ("add", "add s"), ("index", "peak MB")]
"""Phases and figures that a growth is fitted to."""


def exponent(sizes: dict[int, dict[str, Figures]], phase: str, figure: str) -> float:
    """Slope of a figure's logarithm by that of the places; NaN for fewer than two sizes."""
    found = [(n, known[phase][figure]) for n, known in sizes.items() if phase in known]
    if len(found) < 2:
        return math.nan
    counts, values = np.log(np.array(found, float)).T
    return float(np.polyfit(counts, values, 1)[0])


def exponent_text(sizes: dict[int, dict[str, Figures]], phase: str, figure: str) -> str:
    slope = exponent(sizes, phase, figure)
    return "" if math.isnan(slope) else f"{figure} of {phase} {slope:.2f}"


def draw(sizes: dict[int, dict[str, Figures]], path: Path) -> None:
    """Draw times of queries and of building by places."""
    from matplotlib.figure import Figure

    shown = sorted(n for n, known in sizes.items() if {"query", "index"} <= known.keys())
    if len(shown) < 2:
        return
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    colors = {label: f"C{row}" for row, (_, label) in enumerate(STORES.values())}
    for phase, (_, label) in STORES.items():
        for quantile, style in (("p50 ms", "-"), ("p95 ms", ":")):
            points = [(n, sizes[n][phase][quantile]) for n in shown if phase in sizes[n]]
            if points:
                left.plot(
                    *zip(*points, strict=True),
                    style,
                    marker="o",
                    color=colors[label],
                    label=f"{label}, {quantile.removesuffix(' ms')}",
                )
    for phase, label in STORES.values():
        points = [(n, sizes[n][phase]["index s"]) for n in shown if phase in sizes[n]]
        if points:
            right.plot(*zip(*points, strict=True), marker="o", color=colors[label], label=label)
    for axes, unit, title in ((left, "ms", "a query"), (right, "s", "building the index")):
        axes.set(xscale="log", yscale="log", xlabel="places", ylabel=unit, title=title)
        axes.grid(alpha=0.3, which="both")
    left.legend(fontsize=6, loc="lower right")
    right.legend(fontsize=7)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=80)


def _build_table(sizes: dict[int, dict[str, Figures]]) -> str:
    rows = []
    for n, known in sorted(sizes.items()):
        if "add" in known:
            added = known["add"]
            row = [
                f"{n:,}",
                "LanceDB, the rows",
                f"{added['add s']:.1f}",
                "",
                f"{added['cpu s']:.1f}",
            ]
            rows.append([*row, f"{added['peak MB']:,.0f}", f"{added['disk MB']:,.0f}"])
        for phase, label in STORES.values():
            if phase in known:
                rows.append(_row(n, f"{label}, the index", known[phase]))
    head = "places, store, added (s), index built (s), processor time (s), memory (MB), disk (MB)"
    return table(head.split(", "), rows)


def _row(n: int, store: str, built: Figures) -> list[str]:
    seconds = [f"{built[name]:.1f}" for name in ("index s", "cpu s")]
    disk = "" if store.startswith("FAISS") else f"{built['disk MB']:,.0f}"
    return [f"{n:,}", store, "", *seconds, f"{built['peak MB']:,.0f}", disk]


def _query_table(sizes: dict[int, dict[str, Figures]]) -> str:
    rows = []
    for n, known in sorted(sizes.items()):
        for phase, (built, label) in STORES.items():
            if (one := known.get(phase)) is None:
                continue
            searched = known.get(built, {})
            lists = f"{searched.get('nprobes', 0):.0f} of {searched.get('partitions', 0):.0f}"
            opened = f"{one['open s']:.2f}" if "open s" in one else ""
            shares = [f"{one['recall']:.4f}", f"{100 * one['top-1']:.2f} %"]
            first = f"{one['first query ms']:.0f}" if "first query ms" in one else ""
            checked = f"{one['check s']:.1f}" if "check s" in one else ""
            start = [f"{n:,}", label, opened, first, lists]
            rows.append([*start, *_times(one), *shares, checked])
    head = (
        "places, store, opened (s), first query (ms), lists searched, p50 / p95 (ms), "
        "processor time (ms), recall@10, first is exact, all rows checked (s of processor time)"
    )
    return table(head.split(", "), rows)


def _change_table(sizes: dict[int, dict[str, Figures]]) -> str:
    rows = []
    for n, known in sorted(sizes.items()):
        if (one := known.get("change")) is not None:
            done = [f"{one[name]:.2f}" for name in ("add 1000 s", "delete s", "compact s")]
            times = [_times(one, f"{when} ")[0] for when in ("added", "deleted", "compacted")]
            rows.append([f"{n:,}", *done, *times])
    head = (
        "places, 1000 added and found (s), robot deleted (s), compacted (s), "
        "p50 / p95 after adding (ms), after deleting (ms), after compaction (ms)"
    )
    return table(head.split(", "), rows)


def _filter_table(sizes: dict[int, dict[str, Figures]]) -> str:
    rows = []
    for n, known in sorted(sizes.items()):
        for name in FILTERS:
            if (one := known.get("change")) is not None:
                shares = [one[f"{name} recall"], one[f"{name} top-1"]]
                times = [_times(one, f"{name} ")[0], f"{one[f'{name} first ms']:.0f}"]
                rows.append(
                    [f"{n:,}", name, *times, f"{shares[0]:.4f}", f"{100 * shares[1]:.1f} %"]
                )
    head = "places, of one, p50 / p95 (ms), the first query (ms), recall@10, first is exact"
    return table(head.split(", "), rows)


BOUNDS = [
    ("index", "index s", 600, -1),
    ("index", "peak MB", 8000, -1),
    ("query", "open s", 1, -1),
    ("query", "p95 ms", 20, -1),
    ("query", "recall", 0.99, 1),
    ("query", "top-1", 0.999, 1),
    ("change", "add 1000 s", 1, -1),
    ("change", "delete s", 1, -1),
    ("change", "added p95 ms", 20, -1),
    ("change", "deleted p95 ms", 20, -1),
    ("change", "compacted p95 ms", 20, -1),
]
"""Phases and figures with what they are to be at most (-1) or at least (1), of a million places."""
MILLION = 1_000_000


def missed(figures: Results) -> list[str]:
    """What does not keep its bound, among a million places or more."""
    return [
        f"{name}, {n:,} places: {phase}, {figure} is {known[phase][figure]:.4g}, not {limit:g}"
        for name, sizes in figures.items()
        for n, known in sizes.items()
        if n >= MILLION
        for phase, figure, limit, sign in BOUNDS
        if phase in known and not sign * (known[phase][figure] - limit) >= 0
    ]


def _times(one: Figures, when: str = "") -> list[str]:
    """Both quantiles, and the time of processors."""
    wall = f"{one[f'{when}p50 ms']:.1f} / {one[f'{when}p95 ms']:.1f}"
    return [wall, f"{one[f'{when}cpu ms']:.1f}"]


def _run(phase: str, home: Path, data: str, places: int, queries: int) -> Figures:
    """Run a phase; return its figures and the disk that the database takes."""
    print(f"{data}, {places:,} places: {phase}; load {os.getloadavg()[0]:.1f}", file=sys.stderr)
    command = [sys.executable, "-m", "benchmarks.fleet.phases", phase, str(home), data]
    found = subprocess.run(
        [*command, str(places), str(queries)], stdout=subprocess.PIPE, text=True, check=True
    )
    figures: Figures = json.loads(found.stdout.splitlines()[-1])
    files = [path for path in (home / "database").rglob("*") if path.is_file()]
    figures |= {"disk MB": sum(path.stat().st_size for path in files) / 1e6}
    figures["load"] = os.getloadavg()[0]
    print(
        "  " + ", ".join(f"{name} {value:.4g}" for name, value in figures.items()), file=sys.stderr
    )
    return figures


def _read(path: Path) -> Results:
    if not path.exists():
        return {}
    stored = json.loads(path.read_text())
    return {name: {int(n): known for n, known in sizes.items()} for name, sizes in stored.items()}


def _save(path: Path, figures: Results) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(figures, indent=1))


if __name__ == "__main__":
    app()
