# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How right are RatSLAM's maps? All worlds, sources of views and presets; odometry that drifts
(2 % scale, 1 % rotation) and odometry without errors.

python -m benchmarks.accuracy.ratslam_maps                        # the tables
python -m benchmarks.accuracy.ratslam_maps --write                # into the docs, with pictures
python -m benchmarks.accuracy.ratslam_maps --world small_house --views alignment,visual

Recordings are those below FUSIONSLAM_TEST_DATA; the procedural worlds, "simulated warehouse" and so
on, need no data.
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

from benchmarks.accuracy.data import ROOT
from benchmarks.accuracy.markdown import table, write_between
from benchmarks.accuracy.ratslam_courses import Course, courses
from fusionslam.evaluation import MapReport, RatSlamRun, judge_map
from fusionslam.evaluation.maps.report import PoseErrors
from fusionslam.geometry.odometry_noise import DRIFT, OdometryConfig
from fusionslam.ratslam import RatSlamConfig
from fusionslam.report.maps.map_figures import map_figure

PAGE = ROOT / "docs" / "results" / "maps.md"
PICTURES = ROOT / "docs" / "images"
ODOMETRY: Mapping[str, OdometryConfig] = {
    "odometry that drifts: 2 % too far, turns 1 % too wide": DRIFT,
    "odometry without errors": OdometryConfig(),
}
PRESETS: Mapping[str, RatSlamConfig] = {
    "robust": RatSlamConfig(preset="robust"),
    "openratslam": RatSlamConfig(preset="openratslam"),
}

HEADER = ["world", "views", "dead reckoning", "robust: RMSE", "ATE", "false arrivals", "refused"]
HEADER += ["revisits linked", "openratslam: RMSE", "ATE", "false arrivals", "revisits linked"]


@dataclass(frozen=True)
class Row:
    """A course, by preset what was done there and how it was judged."""

    course: Course
    odometry: str
    runs: Mapping[str, RatSlamRun]
    reports: Mapping[str, MapReport]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--world", help="names of worlds, with commas between them")
    parser.add_argument("--views", help="names of sources of views, with commas between them")
    parser.add_argument("--write", action="store_true", help="put tables and pictures into docs/")
    arguments = parser.parse_args()
    chosen = [said.split(",") if said else () for said in (arguments.world, arguments.views)]
    rows = [row for course in courses(*chosen) for row in driven(course)]
    text = tables(rows)
    print(text)
    if arguments.write:
        draw(rows)
        write_between(PAGE, "ratslam-maps", text)


def driven(course: Course) -> list[Row]:
    """A course with both kinds of odometry and both presets."""
    rows = []
    for title, errors in ODOMETRY.items():
        runs = {preset: course.run(config, errors) for preset, config in PRESETS.items()}
        reports = {preset: judge_map(run) for preset, run in runs.items()}
        rows.append(Row(course, title, runs, reports))
        shown = ", ".join(f"{preset} {_m(report.nodes)}" for preset, report in reports.items())
        print(f"{course.drive.name}, {course.views}, {title}: {shown}", flush=True)
    return rows


def tables(rows: Sequence[Row]) -> str:
    """One table for each kind of odometry."""
    parts = []
    for title in ODOMETRY:
        cells = [cells_of(row) for row in rows if row.odometry == title]
        parts.append(f"With {title}:\n\n{table(HEADER, cells)}")
    return "\n\n".join(parts)


def cells_of(row: Row) -> list[str]:
    """Metres unless they say otherwise."""
    robust, original = (row.reports[preset] for preset in PRESETS)
    return [
        row.course.drive.name,
        row.course.views,
        _m(robust.dead_reckoning),
        _m(robust.nodes),
        _m(robust.trajectory),
        f"{robust.false_loops} of {robust.judged_loops}",
        f"{robust.refused}, {robust.refused_true} true",
        _percent(robust.linked_revisit_share),
        _m(original.nodes),
        _m(original.trajectory),
        f"{original.false_loops} of {original.judged_loops}",
        _percent(original.linked_revisit_share),
    ]


def draw(rows: Sequence[Row]) -> None:
    """A picture for each world: the maps of drifting odometry, the original's last."""
    drifting = [row for row in rows if row.odometry == next(iter(ODOMETRY))]
    for name, found in groupby(drifting, lambda row: row.course.drive.name):
        of_world = list(found)
        panels = [(row, "robust", row.course.views) for row in of_world]
        panels += [(of_world[-1], "openratslam", f"{of_world[-1].course.views}, openratslam")]
        figure = map_figure(
            [row.runs[preset] for row, preset, _ in panels],
            [row.reports[preset] for row, preset, _ in panels],
            titles=[title for *_, title in panels],
        )
        file = PICTURES / f"ratslam_maps_{name.replace(' ', '_')}.png"
        figure.savefig(file, format="png", dpi=80)


def _m(errors: PoseErrors | None) -> str:
    return "" if errors is None else f"{errors.rmse_m:.3f}"


def _percent(share: float | None) -> str:
    return "" if share is None else f"{100 * share:.0f} %"


if __name__ == "__main__":
    main()
