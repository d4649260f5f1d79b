# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Sections 5.4 to 5.7 of Stastny 2022 as tables and pictures, beside the published figures."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from benchmarks.theses.config import WITHOUT_SENSOR
from benchmarks.theses.document import Chapter
from benchmarks.theses.view_study import DriveFacts, ViewStudy
from fusionslam.evaluation import VIEW_CITATION, published_views
from fusionslam.pipelines.drives import FrameName
from fusionslam.pipelines.methods import find_method
from fusionslam.report.page.images import Picture, keep
from fusionslam.report.page.tables import Column, Table, build_table
from fusionslam.report.views.plots import Judged, draw_errors, draw_times, draw_view_curves

TITLES = {
    "objects:author": "1st stage",
    "two_stages:author": "both stages",
    "visual_templates": "original RatSLAM",
    "alignment": "ours",
    WITHOUT_SENSOR: "no sensor",
}
"""Column headings of methods; other methods use their title."""
SETUPS: dict[FrameName, str] = {
    "odometry": "the thesis's set-up: clouds in world coordinates, perfect odometry, "
    "angles as its program compares them (72 and 7.2 degrees)",
    "robot": "strictly: clouds in the robot's frame, which do not depend on odometry, and the "
    "limits of the text (22.9 and 12 degrees)",
    "drift": "not tried in the thesis: clouds in the frame of odometry that is off by 2 % of the "
    "distance and 1 % of the turns, limits of the text",
}
"""Descriptions of the set-ups, by frame; the templates and our method use no odometry."""
_FIGURES = {"warehouse": ("5.7", "5.10"), "house": ("5.8", "5.11"), "hospital": ("5.9", "5.12")}


def title_of(method: str) -> str:
    """Return the heading of a method's column."""
    return TITLES.get(method, find_method(method).title)


def find_published(world: str, method: str, name: str) -> float | None:
    """Return a figure of tables 5.2 to 5.5; None if the thesis has none."""
    rows = (f for f in published_views(world) if f.method == find_method(method).published)
    found = next(rows, None)
    return None if found is None else float(getattr(found, name))


def drives_chapter(study: ViewStudy) -> Chapter:
    """Build section 5.1: the drives."""
    chapter = Chapter("Stastny 2022, 5.1: worlds")
    columns: list[Column[DriveFacts]] = [
        Column("drive", "what was driven", "words"),
        Column("scans", "with something above the floor", "scans"),
        Column("empty", "scans with nothing above the floor, left out", "dropped"),
        Column("revisits", "scans that come back after more than 20 s", "revisits"),
        Column("seconds", "how long", "seconds", "{:.0f}"),
        Column("metres", "how far", "metres", "{:.0f}"),
    ]
    worlds = [drive.world for drive in study.drives]
    chapter.show("What was driven", build_table(columns, study.drives, worlds), "world")
    chapter.say(_other_worlds(study.drives))
    for note in study.notes():
        chapter.say(f"Missing: {note}.")
    return chapter


def _other_worlds(drives: Sequence[DriveFacts]) -> str:
    if any(drive.made for drive in drives):
        return (
            "Worlds that are made are of the thesis's kind, but other worlds than its own: its "
            "figures stand beside ours to show the order of things, not to be met digit by digit."
        )
    return "The worlds are the thesis's own; the drives through them are not."


def accuracy_chapter(study: ViewStudy, methods: Sequence[str], folder: Path) -> Chapter:
    """Build section 5.4: figure 5.5, table 5.2, and the limits of accuracy as a measure."""
    chapter = Chapter("Stastny 2022, 5.4: accuracy")
    chapter.say(f"Published: {VIEW_CITATION}.")
    shown_with = [*methods, WITHOUT_SENSOR]
    for frame, words in SETUPS.items():
        table = _beside(study, frame, shown_with, "accuracy", "accuracy", "{:.1f}", 100)
        chapter.show(f"Table 5.2, accuracy in %, {words}", table, "world")
    chapter.say(
        "Accuracy hardly sees loops: the column without a sensor starts a new view with every "
        "third scan and looks at nothing. What a robot needs is in the next tables: of the scans "
        "that come back after more than 20 s the share that was recognised (R), and of the "
        "matches with old views the share that is right (P)."
    )
    for frame, words in SETUPS.items():
        table = _loops(study, frame, shown_with)
        chapter.show(f"Loop recall and loop precision in %, {words}", table, "world")
    for drive in study.drives:
        for frame in ("odometry", "robot"):
            chapter.picture(_curves(study, drive.world, frame, methods, folder))
    chapter.say("Ours has no curve here, as that takes long; fusionslam views curve makes one.")
    best = _best_thresholds(study, methods)
    if best.rows:
        chapter.show("Figure 5.5 in figures: the most accurate threshold", best, "world and way")
    return chapter


def errors_chapter(study: ViewStudy, methods: Sequence[str], folder: Path) -> Chapter:
    """Build section 5.5: table 5.3 and figures 5.7 to 5.9."""
    chapter = Chapter("Stastny 2022, 5.5: how far false positives are off")
    for frame, words in SETUPS.items():
        for name, title in (("mean_error", "average"), ("max_error", "largest")):
            table = _beside(study, frame, methods, name, name, "{:.2f}")
            chapter.show(f"Table 5.3, {title} distance in m, {words}", table, "world")
    for drive in study.drives:
        for frame in ("odometry", "robot"):
            figure = draw_errors(_select_runs(study, drive.world, frame, methods))
            caption = (
                f"Figure {_FIGURES[drive.world][0]}, {drive.words}; {SETUPS[frame]}: every false "
                "positive, when it happened and how far it is from the first scene of its view. "
                "Dashed: from here on the distance alone makes it false; below, it is the angle."
            )
            chapter.picture(keep(folder, f"errors_{drive.world}_{frame}", figure, caption))
    return chapter


def times_chapter(study: ViewStudy, methods: Sequence[str], folder: Path) -> Chapter:
    """Build section 5.6: table 5.4 and figures 5.10 to 5.12."""
    chapter = Chapter("Stastny 2022, 5.6: times")
    for name, known, title in (
        ("build_ms", "build_ms", "building a view"),
        ("pair_ms", "match_ms", "comparing two views"),
    ):
        table = _beside(study, "robot", methods, name, known, "{:.3f}")
        chapter.show(f"Table 5.4, {title}, mean in ms", table, "world")
    chapter.say(
        "The thesis's times are from another machine (see above). Comparing two views: time to "
        "compare a scan with all that is stored, divided by how many are."
    )
    for drive in study.drives:
        figure = draw_times(_select_runs(study, drive.world, "robot", methods))
        caption = (
            f"Figure {_FIGURES[drive.world][1]}, {drive.words}: wall time of every scan, to make "
            "its view and to compare it with all stored ones."
        )
        chapter.picture(keep(folder, f"times_{drive.world}", figure, caption))
    return chapter


def memory_chapter(study: ViewStudy, methods: Sequence[str]) -> Chapter:
    """Build section 5.7: table 5.5."""
    chapter = Chapter("Stastny 2022, 5.7: memory")
    for name, known, title in (
        ("view_bytes", "view_bytes", "bytes of a view"),
        ("views", "views", "views stored"),
    ):
        table = _beside(study, "robot", methods, name, known, "{:.0f}")
        chapter.show(f"Table 5.5, {title}, clouds in the robot's frame", table, "world")
    table = _beside(study, "odometry", methods, "views", "views", "{:.0f}")
    chapter.show(f"Table 5.5, views stored, {SETUPS['odometry']}", table, "world")
    return chapter


def _beside(
    study: ViewStudy,
    frame: FrameName,
    methods: Sequence[str],
    name: str,
    known: str,
    show: str,
    scale: float = 1.0,
) -> Table:
    """Build a table with one column per method, and the published figure beside each."""
    columns = []
    for method in methods:
        columns.append(_measured_column(study, frame, method, name, show, scale))
        if title := find_method(method).published:
            figure = partial(find_published, method=method, name=known)
            columns.append(Column("thesis", f"as published for {title}", figure, show, scale=scale))
    return _table_of_worlds(study, columns)


def _table_of_worlds(study: ViewStudy, columns: Sequence[Column[str]]) -> Table:
    worlds = [drive.world for drive in study.drives]
    return build_table(columns, worlds, worlds)


def _measured_column(
    study: ViewStudy, frame: FrameName, method: str, name: str, show: str, scale: float = 1
) -> Column[str]:
    figure = partial(study.figure, frame=frame, method=method, name=name)
    return Column(title_of(method), find_method(method).help, figure, show, scale=scale)


def _loops(study: ViewStudy, frame: FrameName, methods: Sequence[str]) -> Table:
    columns = []
    for method in methods:
        for name, letter in (("loop_recall", "R"), ("loop_precision", "P")):
            column = _measured_column(study, frame, method, name, "{:.1f}", 100)
            columns.append(replace(column, title=f"{column.title} {letter}"))
    return _table_of_worlds(study, columns)


def _select_runs(study: ViewStudy, world: str, frame: FrameName, methods: Sequence[str]) -> Judged:
    found = (study.outcome(world, frame, method) for method in methods)
    return [(o.run, o.report) for o in found if o and o.run is not None and o.report is not None]


def _curves(
    study: ViewStudy, world: str, frame: FrameName, methods: Sequence[str], folder: Path
) -> Picture | None:
    figure = draw_view_curves(_select_runs(study, world, frame, methods))
    caption = (
        f"Figure 5.5, {world}; {SETUPS[frame]}: precision over recall as the threshold of the "
        "first stage changes; dots are the thresholds in use, grey is without a sensor. Which "
        "scenes are stored depends on the threshold, so curves may turn back."
    )
    return keep(folder, f"curves_{world}_{frame}", figure, caption)


def _best_thresholds(study: ViewStudy, methods: Sequence[str]) -> Table:
    """Build a table of the most accurate thresholds, chosen as in the thesis."""
    rows: dict[str, dict[str, float | None]] = {}
    for frame in ("odometry", "robot"):
        for drive in study.drives:
            for run, _ in _select_runs(study, drive.world, frame, methods):
                if run.curve is None:
                    continue
                best = run.curve.most_accurate_threshold()
                if best is not None:
                    name = f"{drive.world}, {frame}: {run.method}"
                    rows[name] = {"threshold": best, **run.curve.at(best)}
    columns: list[Column[dict[str, float | None]]] = [
        Column("threshold", "where accuracy is largest", "threshold", "{:.2f}"),
        Column("accuracy %", "there", "accuracy", "{:.1f}", scale=100),
        Column("loop recall %", "there", "loop_recall", "{:.1f}", scale=100),
        Column("loop precision %", "there", "loop_precision", "{:.1f}", scale=100),
    ]
    return build_table(columns, list(rows.values()), list(rows))
