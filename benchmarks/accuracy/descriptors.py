# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Compares all descriptors: towns, rooms, a real flight and pairs of KITTI, into docs/results.

    python -m benchmarks.accuracy.descriptors            # what is missing; prints the tables
    python -m benchmarks.accuracy.descriptors --write    # and puts them into the docs
    python -m benchmarks.accuracy.descriptors --worlds town-1 house -d m2dp iris  # a part
    python -m benchmarks.accuracy.descriptors --verify town-1  # prove loops here alone

Runs are kept below ``--runs``, so that an interrupted call goes on where it stopped, and only what
a new program would compute otherwise is computed again. The flight and the pairs need the test
data, which FUSIONSLAM_TEST_DATA names.
"""

import argparse
import logging
import os
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np

from benchmarks.accuracy.all_round_color import ABOVE_ROAD
from benchmarks.accuracy.data import ROOT, data_folder
from benchmarks.accuracy.descriptor_pairs import pairs_table
from benchmarks.accuracy.descriptor_worlds import record_flight, record_rooms, record_town
from benchmarks.accuracy.markdown import write_between
from fusionslam import PipelineConfig
from fusionslam.base.progress import Step
from fusionslam.config import merged
from fusionslam.descriptors import DESCRIPTORS, find_descriptor, needs_up
from fusionslam.errors import FusionSlamError
from fusionslam.evaluation import Evaluation, evaluate_verified
from fusionslam.pipelines.compare_descriptors import time_and_evaluate
from fusionslam.pipelines.describe import describable
from fusionslam.pipelines.recording import Recording
from fusionslam.pipelines.reusable_runs import describe_recording
from fusionslam.pipelines.shared_verification import verify_each
from fusionslam.report.loops import comparison
from fusionslam.report.loops.comparison import Compared, draw_costs, pair_up, table_over
from fusionslam.report.page.figures import use_style
from fusionslam.report.page.images import write_png

PAGE = ROOT / "docs" / "results" / "descriptors.md"
PICTURE = ROOT / "docs" / "images" / "descriptor_costs.png"
RUNS = ROOT / "out" / "descriptors"
SEEDS = (1, 2, 3, 5, 7)
ROOMS = ("house", "hospital", "warehouse")
PROTOCOL = "revisit"
VARIANTS = tuple(
    f"{kind.name}:{preset}" if preset else kind.name
    for kind in DESCRIPTORS.values()
    for preset in kind.presets or (None,)
)
REFINED = 1
"""Candidates that are registered: of each descriptor's ten the one whose image correlates most."""
ROOM_M = 20.0
"""Cells around a robot indoors."""

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class CloudKind:
    """A kind of clouds that each world is described by.

    Attributes:
        name: of its runs' folder, and of its table.
        title: in words.
        source: of the clouds.
        takes: whether it shows a descriptor.
        is_recorded: whether a world has it.
        drive: which recording of the world it is made from.
        fusion: changes to how clouds are made.
        verifies: whether loops are proven. Registration takes the whole scan, whatever the cameras
            see of it: what they colour changes the candidates alone.
    """

    name: str
    title: str
    source: str
    takes: Callable[[str], bool]
    is_recorded: Callable[[str], bool] = lambda world: True
    drive: str = "front"
    fusion: Mapping[str, Any] = field(default_factory=dict)
    verifies: bool = True


def is_colored(name: str) -> bool:
    """Whether a descriptor needs colours, or is what one with colours extends."""
    plain = {kind.extends for kind in DESCRIPTORS.values() if kind.needs_colors}
    kind = find_descriptor(name)
    return kind.needs_colors or kind.name in plain


KINDS = (
    CloudKind(
        "circle",
        "LiDAR, full circle",
        "cloud",
        lambda name: not find_descriptor(name).needs_colors,
        lambda world: world != "flight",
    ),
    CloudKind(
        "camera",
        "LiDAR-camera",
        "lidar",
        is_colored,
        lambda world: world != "flight",
        verifies=False,
    ),
    CloudKind(
        "ring",
        "LiDAR and four cameras, above the road",
        "lidar",
        lambda name: True,
        lambda world: world.startswith("town"),
        drive="ring",
        fusion=ABOVE_ROAD,
        verifies=False,
    ),
    CloudKind("stereo", "stereo", "cloud", lambda name: True, lambda world: world == "flight"),
)
"""One table for each, and for each group of worlds."""
KIND_NAMES = tuple(each.name for each in KINDS)


@dataclass(frozen=True)
class World:
    """A recording, what it is called, and how it is described and judged.

    Attributes:
        name: of its runs' folder.
        group: worlds whose mean and range one table shows.
        record: returns the folder of a drive, which it records if it is missing.
        changes: to the configuration.
    """

    name: str
    group: str
    record: Callable[[str, int], Path]
    changes: Mapping[str, Any]


_ROOMS: Mapping[str, Any] = {
    "fusion": {"frame": "robot"},
    "evaluation": {"radius": 0.8, "window": 20},
    "loop_closure": {"window": 20},
    "descriptors": {"scan_context": {"max_range": ROOM_M}},
}
_FLIGHT: Mapping[str, Any] = {
    "evaluation": {"radius": 1.0, "window": 22},
    "loop_closure": {"window": 22, "candidates": 2},
    "registration": {"gravity": False},
}
WORLDS = {
    each.name: each
    for each in (
        *(World(f"town-{seed}", "towns", partial(record_town, seed), {}) for seed in SEEDS),
        *(World(name, "rooms", partial(record_rooms, name), _ROOMS) for name in ROOMS),
        World("flight", "flight", record_flight, _FLIGHT),
    )
}
GROUPS = {
    "towns": f"Five simulated towns (seeds {', '.join(map(str, SEEDS))}); radius 10 m, window 50 "
    "frames.",
    "rooms": f"Three simulated interiors ({', '.join(ROOMS)}), a small robot's 16 rings, one scan "
    "a second; radius 0.8 m, window 20 frames.",
    "flight": "EuRoC V1_01, 100 stereo keyframes of a drone; radius 1 m, window 22 keyframes. No "
    "axis points up: descriptors that need one are left out, two candidates are registered.",
}


@dataclass(frozen=True)
class Bench:
    """One world's clouds of one kind, described and verified below a folder."""

    world: World
    kind: CloudKind
    names: Sequence[str]
    folder: Path
    jobs: int
    refined: int
    verifies: bool = True
    step: Step | None = None

    @cached_property
    def config(self) -> PipelineConfig:
        given = {"loop_closure": {"refined": self.refined, "voters": ()}}
        config = merged(merged(PipelineConfig(), given), self.world.changes)
        return merged(config, {"fusion": {"source": self.kind.source, **self.kind.fusion}})

    def evaluate(self) -> tuple[list[Evaluation], dict[str, str]]:
        """Return the evaluations, and why descriptors are left out or describe a part, by name."""
        recording = Recording.at(self.world.record(self.kind.drive, self.jobs))
        dataset = recording.open(self.kind.source)
        names, left = self._usable(dataset)
        common: dict[str, Any] = {"jobs": self.jobs, "bad_frames": "skip", "step": self.step}
        runs = describe_recording(
            recording, dataset, self.folder, names, config=self.config, **common
        )
        for run in runs:
            if lacking := int((~run.descriptors.any(axis=1)).sum()):
                left[run.name] = f"{lacking} of {len(run.descriptors)} frames match nothing"
        rule = self.config.evaluation
        found = [time_and_evaluate(run, self.config) for run in runs]
        if not self.verifies:
            return found, left
        proven = verify_each(recording, dataset, self.folder, runs, config=self.config, **common)
        found += [evaluate_verified(run, radius=rule.radius, window=rule.window) for run in proven]
        return found, left

    def _usable(self, dataset: Any) -> tuple[list[str], dict[str, str]]:
        """Return the descriptors that take the clouds, and why the others do not."""
        left: dict[str, str] = {}
        names = [name for name in self.names if self.kind.takes(name)]
        if not self.config.registration.gravity:
            upright = [name for name in names if needs_up(name, self.config.descriptors)]
            left |= dict.fromkeys(upright, "needs an axis that points up")
            names = [name for name in names if name not in left]
        allowed = describable(dataset, names, self.config, "skip")
        missing = [name for name in names if name not in allowed]
        return allowed, left | dict.fromkeys(missing, "needs what the clouds do not have")


Tables = dict[str, str]
"""Texts by the name of their markers."""


def measure(
    worlds: Sequence[str],
    names: Sequence[str],
    runs: Path,
    jobs: int,
    refined: int,
    verified: Sequence[str] = tuple(WORLDS),
    kinds: Sequence[str] = KIND_NAMES,
) -> tuple[dict[tuple[str, str], dict[str, list[Compared]]], dict[str, dict[str, str]]]:
    """Evaluate worlds: (group, kind) -> world -> descriptors; and place -> descriptor -> why it is
    left out there.

    A world that cannot be recorded or used is left out, and the log says so.
    """
    found: dict[tuple[str, str], dict[str, list[Compared]]] = {}
    left: dict[str, dict[str, str]] = {}
    for name in worlds:
        for kind in (each for each in KINDS if each.name in kinds and each.is_recorded(name)):
            place, started = f"{name}, {kind.title}", (time.perf_counter(), time.process_time())
            folder = runs / f"{name}-{kind.name}"
            step = partial(_show, place, {})
            verifies = kind.verifies and name in verified
            bench = Bench(WORLDS[name], kind, names, folder, jobs, refined, verifies, step)
            try:
                evaluations, missing = bench.evaluate()
            except FusionSlamError as error:
                logger.error("%s is left out: %s", place, error)
                continue
            group = found.setdefault((WORLDS[name].group, kind.name), {})
            group[name] = pair_up(evaluations)
            left[place] = missing
            wall, work = time.perf_counter() - started[0], time.process_time() - started[1]
            print(f"{place}: {wall:.0f} s, {work:.0f} s of processor time", flush=True)
    return found, left


def _show(place: str, last: dict[str, float], label: str, done: int, total: int) -> None:
    """Print a line when a step begins, and one every 30 seconds."""
    if label not in last or time.monotonic() - last[label] > 30:
        last[label] = time.monotonic()
        print(f"{place}: {label}: {done} of {total}", flush=True)


def tables_of(
    found: Mapping[tuple[str, str], Mapping[str, Sequence[Compared]]], refined: int
) -> Tables:
    """Tables by marker, such as "towns-circle"."""
    texts = {}
    for (group, kind), worlds in found.items():
        recordings = [*worlds.values()]
        alone = table_over(recordings, PROTOCOL, comparison.accuracy_columns(PROTOCOL))
        proven = [name for name, each in worlds.items() if any(one.verified for one in each)]
        others = comparison.verified_columns(PROTOCOL) if proven else []
        verified = table_over(recordings, PROTOCOL, [*others, *comparison.cost_columns()])
        title = next(each.title for each in KINDS if each.name == kind)
        about = fill(f"{title}. {GROUPS[group]} {_describe(worlds)}", 100)
        how = (
            f"Verified in {', '.join(proven)}: the candidate"
            f"{f's, {refined},' if refined > 1 else ''} most alike from above, of each "
            "descriptor's own ten nearest, registered by one verifier; and cost."
        )
        if group == "flight":
            how = (
                "Verified: each descriptor's own two nearest, registered by one verifier; and cost."
            )
        if not proven:
            how = "Cost."
        texts[f"{group}-{kind}"] = (
            f"{about}\n\n{alone.markdown('descriptor')}\n\n{fill(how, 100)}\n\n"
            f"{verified.markdown('descriptor')}"
        )
    return texts


def _describe(worlds: Mapping[str, Sequence[Compared]]) -> str:
    """Say how many frames and revisits there are, and what a cell is."""
    curves = [compared[0].plain.curves[PROTOCOL] for compared in worlds.values() if compared]
    frames, revisits = (
        sum(getattr(curve, each) for curve in curves) for each in ("n_queries", "n_revisits")
    )
    text = f"{frames} frames, {revisits} of them revisits."
    if len(worlds) > 1:
        text += f" Mean (lowest to highest) over {', '.join(worlds)}."
    return text


def verdict(found: Mapping[tuple[str, str], Mapping[str, Sequence[Compared]]]) -> str:
    """List the best of each figure, and by how much the best of ours loses where it is not ours."""
    lines = []
    for (group, kind), worlds in found.items():
        title = next(each.title for each in KINDS if each.name == kind)
        rows: dict[str, list[Compared]] = {}
        for each in (each for compared in worlds.values() for each in compared):
            rows.setdefault(each.plain.run.name, []).append(each)
        ours = {name for name in rows if is_ours(name)}
        for column in _decisive():
            means = {
                name: float(np.mean(values))
                for name, row in rows.items()
                if (values := [v for v in map(column.read, row) if v is not None])
            }
            if means:
                lines.append(f"- {title}, {group}, {_compare(column, means, ours)}")
    return "\n".join(lines)


def with_other_tables(verdicts: str, found: Collection[tuple[str, str]]) -> str:
    """Add the lines of the page's verdict on (group, kind) that were not measured now."""
    kept = [
        line
        for line in _shown("verdict")
        for kind in KINDS
        for group in GROUPS
        if (group, kind.name) not in found and line.startswith(f"- {kind.title}, {group}, ")
    ]
    return "\n".join([*verdicts.splitlines(), *kept])


def is_ours(name: str) -> bool:
    """Whether a descriptor, or the preset that it has, is this project's own."""
    kind, preset = find_descriptor(name), name.partition(":")[2]
    if kind.presets:
        return preset in ("", "robust", "upright")
    return kind.source.startswith("ours")


def _decisive() -> Iterator[Any]:
    every = [*comparison.accuracy_columns(PROTOCOL), *comparison.verified_columns(PROTOCOL)]
    every += comparison.cost_columns()
    wanted = ("top-1", "opposite", "R@100P", "R@100P ver.", "make ms")
    return (column for column in every if column.title in wanted)


def _compare(column: Any, means: Mapping[str, float], ours: set[str]) -> str:
    best = column.best(means, key=means.__getitem__)
    text = f"{column.title}: `{best}` {column.show.format(means[best])}"
    own = [name for name in means if name in ours]
    if best not in ours and own:
        second = column.best(own, key=means.__getitem__)
        text += f"; the best of ours, `{second}`, {column.show.format(means[second])}"
    return text + (" (ours)" if best in ours else "")


def describe_left(left: Mapping[str, Mapping[str, str]]) -> str:
    """Say which descriptors are left out where, and why, or describe only a part of the frames.

    Lines of the page on places that were not measured now stay.
    """
    lines = [
        f"- {place}: {'; '.join(f'`{name}` {why}' for name, why in names.items())}"
        for place, names in left.items()
        if names
    ]
    lines += [line for line in _shown("left-out") if line[2:].partition(":")[0] not in left]
    return "\n".join(sorted(lines)) or "None."


def _shown(marker: str) -> list[str]:
    """List the items between two markers of the page."""
    text = PAGE.read_text(encoding="utf-8").partition(f"<!-- {marker}: ")[2]
    lines = text.partition("<!-- end")[0].splitlines()
    return [line for line in lines if line.startswith("- ")]


def draw(found: Mapping[tuple[str, str], Mapping[str, Sequence[Compared]]]) -> bool:
    """Draw accuracy over cost of the clouds that all describe; return whether there are any."""
    worlds = found.get(("towns", "ring"), {})
    with use_style():
        figure = draw_costs([*worlds.values()], PROTOCOL) if worlds else None
        if figure is not None:
            write_png(PICTURE, figure)
    return figure is not None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="put the tables into the docs")
    parser.add_argument(
        "--worlds", nargs="+", choices=[*WORLDS, "pairs"], default=[*WORLDS, "pairs"]
    )
    parser.add_argument("-d", "--descriptors", nargs="+", choices=VARIANTS, default=VARIANTS)
    parser.add_argument(
        "--kinds", nargs="+", choices=KIND_NAMES, default=KIND_NAMES, help="of clouds"
    )
    parser.add_argument(
        "--verify",
        nargs="*",
        choices=WORLDS,
        default=[*WORLDS],
        help="worlds whose loops are proven",
    )
    parser.add_argument("--refined", type=int, default=REFINED, help="candidates registered")
    parser.add_argument("--runs", type=Path, default=RUNS)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    arguments = parser.parse_args()
    worlds = [name for name in arguments.worlds if name != "pairs"]
    found, left = measure(
        worlds,
        arguments.descriptors,
        arguments.runs,
        arguments.jobs,
        arguments.refined,
        arguments.verify,
        arguments.kinds,
    )
    texts = tables_of(found, arguments.refined)
    if found:
        texts["verdict"] = verdict(found)
        texts["left-out"] = describe_left(left)
    if "pairs" in arguments.worlds:
        texts["pairs"] = pairs_table(data_folder(), arguments.descriptors)
    print("\n\n".join(texts.values()))
    if arguments.write:
        if "verdict" in texts:
            texts["verdict"] = with_other_tables(texts["verdict"], found)
        for name, text in texts.items():
            write_between(PAGE, name, text)
        draw(found)


if __name__ == "__main__":
    main()
