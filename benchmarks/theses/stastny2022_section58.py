# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Section 5.8 of Stastny 2022 as tables and pictures: its statements on maps beside ours."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.theses.conclusions import Claim, Operand, decide
from benchmarks.theses.config import OURS
from benchmarks.theses.document import Chapter
from benchmarks.theses.map_study import MapStudy
from benchmarks.theses.stastny2022_chapter5 import title_of
from fusionslam.evaluation import MapReport
from fusionslam.pipelines.methods import find_method
from fusionslam.report.maps.map_figures import map_figure
from fusionslam.report.page.images import Picture, keep
from fusionslam.report.page.tables import Column, Table, build_table

SAID = {
    "first stage": dict.fromkeys(("warehouse", "house", "hospital"), "satisfactory"),
    "both stages": dict.fromkeys(("warehouse", "house", "hospital"), "as 1st stage"),
    "RatSLAM": {"hospital": "failed"},
}
"""Section 5.8 in a word, by the thesis's name of a method and by world; it has no figures."""
SETUPS = {
    "truth": "the thesis's set-up: perfect odometry",
    "truth+noise": "not tried in the thesis: odometry off by 2 % of the distance and 1 % of the "
    "turns",
}
_MAPS = {
    "openratslam": "RatSLAM as the thesis used it",
    "robust": "our map of the same views",
}
_FIGURES = {"warehouse": "5.13", "house": "5.14", "hospital": "5.15"}

Value = Callable[[MapReport], float | None]


def maps_chapter(study: MapStudy, folder: Path) -> Chapter:
    """Build the tables for every odometry, then figures 5.13 to 5.15 and similar ones."""
    chapter = Chapter("Stastny 2022, 5.8: maps")
    chapter.say(
        "The thesis shows maps and gives no figures of them; its columns say in a word what its "
        "section 5.8 says. Here: nodes of the map in the end against where the robot truly was "
        "when it made them, after turning and shifting the map onto the truth, not stretching it."
    )
    chapter.say(
        "Its text names cells of 0.2 m and 12 degrees; here they are 0.4 m and 10 degrees, those "
        "of the reference run. Its program publishes how similar a match is as the angle between "
        "two views; here that angle is 0 for objects and templates, and measured by alignment."
    )
    for odometry, words in SETUPS.items():
        _tables(chapter, study, odometry, words)
    if "hospital" in study.made:
        chapter.say(
            "All wards of the made hospital have one plan, and its corridors are symmetric. What "
            "looks at clouds in the robot's frame, or at images, takes one ward for another there: "
            "it folds a map that closes every loop. Clouds in world coordinates carry the answer "
            "with them."
        )
    for note in study.notes():
        chapter.say(f"Missing: {note}.")
    for odometry in SETUPS:
        for world in study.words:
            chapter.picture(_figure(study, world, odometry, folder))
    return chapter


def _tables(chapter: Chapter, study: MapStudy, odometry: str, words: str) -> None:
    for preset, what in _MAPS.items():
        title = f"RMSE of the nodes in m, {words}; {what}"
        chapter.show(title, _errors(study, odometry, preset), "world")
    if odometry == "truth":
        chapter.say(
            "Perfect odometry has only the rounding errors of its summed steps: a map can hardly "
            "improve it, and wrong matches can fold it."
        )
    chapter.show(
        f"Arrivals at a known node while the robot was elsewhere, of all arrivals, {words}",
        _arrivals(study, odometry),
        "world",
    )
    chapter.show(
        f"Revisits that the map joins with the place seen before, in %, {words}",
        _shares(study, odometry),
        "world",
    )


def _errors(study: MapStudy, odometry: str, preset: str) -> Table:
    alone: Column[str] = Column(
        "odometry alone",
        "at the same moments as the nodes of the first map of the row",
        lambda world: _alone(study, world, odometry),
        "{:.2f}",
    )
    columns = [alone]
    for method in study.methods:
        used = "robust" if method == OURS else preset
        columns.append(_map_column(study, odometry, method, used, _rmse, "{:.2f}"))
        if odometry == "truth" and preset == "openratslam" and find_method(method).published:
            words = SAID[find_method(method).published or ""]
            columns.append(Column("thesis", "what section 5.8 says", words.get))
    return _table_of_worlds(study, columns)


def _table_of_worlds(study: MapStudy, columns: Sequence[Column[str]]) -> Table:
    return build_table(columns, list(study.words), list(study.words))


def _alone(study: MapStudy, world: str, odometry: str) -> float | None:
    reports = (m.report for m in study.maps if (m.world, m.odometry) == (world, odometry))
    errors = (r.nodes_by_odometry for r in reports if r is not None)
    return next((one.rmse_m for one in errors if one is not None), None)


def _rmse(report: MapReport) -> float | None:
    return None if report.nodes is None else report.nodes.rmse_m


def _map_column(
    study: MapStudy, odometry: str, method: str, preset: str, value: Value, show: str
) -> Column[str]:
    hint = f"{find_method(method).help}; preset {preset}"
    return Column(
        title_of(method),
        hint,
        lambda world: figure(study, world, odometry, method, preset, value),
        show,
    )


def figure(
    study: MapStudy, world: str, odometry: str, method: str, preset: str, value: Value
) -> float | None:
    """Return a figure of a map; None without a map or such a figure."""
    mapped = study.map(world, odometry, method, preset)
    report = None if mapped is None else mapped.report
    return None if report is None else value(report)


def _pairs(study: MapStudy) -> list[tuple[str, str]]:
    """Return methods and presets in the order of the columns."""
    return [
        (method, preset)
        for method in study.methods
        for preset in (("robust",) if method == OURS else tuple(_MAPS))
    ]


def _title_of_map(method: str, preset: str) -> str:
    own = "" if method == OURS or preset == "openratslam" else ", our map"
    return title_of(method) + own


def _arrivals(study: MapStudy, odometry: str) -> Table:
    def count(world: str, method: str, preset: str) -> str | None:
        mapped = study.map(world, odometry, method, preset)
        report = None if mapped is None else mapped.report
        if report is None or report.judged_loops is None:
            return None
        refused = f", {report.refused} refused" if preset == "robust" else ""
        return f"{report.false_loops} of {report.judged_loops}{refused}"

    columns: list[Column[str]] = [
        Column(
            _title_of_map(method, preset),
            f"preset {preset}",
            partial(count, method=method, preset=preset),
        )
        for method, preset in _pairs(study)
    ]
    return _table_of_worlds(study, columns)


def _shares(study: MapStudy, odometry: str) -> Table:
    def share(report: MapReport) -> float | None:
        found = report.linked_revisit_share
        return None if found is None else 100 * found

    columns = []
    for method, preset in _pairs(study):
        column = _map_column(study, odometry, method, preset, share, "{:.0f}")
        columns.append(replace(column, title=_title_of_map(method, preset)))
    return _table_of_worlds(study, columns)


def _figure(study: MapStudy, world: str, odometry: str, folder: Path) -> Picture | None:
    drawn = []
    for method in study.methods:
        preset = "robust" if method == OURS else "openratslam"
        one = study.map(world, odometry, method, preset)
        if one and one.run and one.report and len(one.run.nodes) > 1:
            drawn.append((one.run, one.report, title_of(method)))
    if not drawn:
        return None
    runs, reports, titles = zip(*drawn, strict=True)
    picture = map_figure(runs, reports, titles=titles)
    like = "Figure" if odometry == "truth" else "The like of figure"
    caption = (
        f"{like} {_FIGURES[world]}, {study.words[world]}; {SETUPS[odometry]}. Grey: the truth. "
        "Each map is turned and shifted onto it, not stretched; rings mark the ends of loops. Ours "
        "is made by our preset, the others by the original's."
    )
    name = f"maps_{world}_{'exact' if odometry == 'truth' else 'drift'}"
    return keep(folder, name, picture, caption)


def map_claims(study: MapStudy) -> list[Claim]:
    """Decide the conclusions of section 5.8, then our own."""

    def value(world: str, _: str, operand: Operand) -> float | None:
        if isinstance(operand, float):
            return operand
        odometry, *which = operand.split()
        if which == ["alone"]:
            return _alone(study, world, odometry)
        method, preset = which
        return figure(study, world, odometry, method, preset, _rmse)

    return decide("maps", list(study.words), value, {"": "{:.2f} m"})


_NAMES = ("world", "odometry", "method", "preset", "note")


def map_figures(study: MapStudy) -> dict[str, Any]:
    """Collect all results on maps."""
    return {
        "maps": [
            {
                **{name: getattr(mapped, name) for name in _NAMES},
                "report": mapped.report and mapped.report.metrics(),
                "config": dict(mapped.run.config) if mapped.run else {},
            }
            for mapped in study.maps
        ]
    }
