# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Does RatSLAM find a robot that was carried while it was off? A Markdown table.

python -m benchmarks.accuracy.carried_robots            # houses that nothing was fitted to
python -m benchmarks.accuracy.carried_robots house 7    # one world of these seeds
python -m benchmarks.accuracy.carried_robots --write    # and put the table into the docs

A made world is driven through on two days, on the second one from the middle of the same way on,
with other noise. Then odometry begins anew at its origin. Recording a world takes about four
minutes of processor time; recordings are kept in the cache.
"""

import argparse
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from textwrap import fill
from typing import NamedTuple

import numpy as np

from benchmarks.accuracy.data import ROOT
from benchmarks.accuracy.markdown import table, write_between
from benchmarks.accuracy.presets import mean_and_range
from fusionslam.base.cache import cache_folder
from fusionslam.config import merged
from fusionslam.evaluation import RatSlamRun, judge_map
from fusionslam.evaluation.maps.report import MapReport
from fusionslam.geometry.odometry_noise import DRIFT
from fusionslam.geometry.se3 import inverse
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.pipelines.drives import Drive, open_drive
from fusionslam.pipelines.map_events import RunEvents, events_of
from fusionslam.pipelines.maps import RunRecorder, run_events
from fusionslam.ratslam import ActionKind, RatSlam, ViewSource
from fusionslam.ratslam.view_sources import build_view_source
from fusionslam.sensors.messages import NANOSECONDS, Odometry
from fusionslam.sim.catalogue import MADE, drive_through
from fusionslam.sim.recordings import embedded_bag, embedded_config, write_recording

PAGE = ROOT / "docs" / "results" / "maps.md"
SEEDS = {"house": (7, 8, 9, 10, 11)}
"""Nothing was fitted to them."""
VIEWS = ("alignment",)
OTHER_DAY = 1000
"""Added to the seed, for the way and the noise of the second day."""
SECOND_DAY_M = 60.0
NIGHT_S = 8 * 3600
HEAD = ["world", "seed", "views", "carried, m", "loops refused before", "found after, s"]
HEAD += ["driven, m", "off by, m", "ATE of the first day, m", "of both, m", "false arrivals"]


class Found(NamedTuple):
    """How a robot was found on its map.

    Attributes:
        carried: metres between where it was switched off and where it was switched on.
        refused: loops that were refused before.
        seconds, metres: driven until it was found; None if it never was.
        error: metres between where it was found and its true place; None likewise.
        report: errors and arrivals of both days.
    """

    carried: float
    refused: int
    seconds: float | None
    metres: float | None
    error: float | None
    report: MapReport


def record_day(world: str, seed: int, *, second: bool) -> Drive:
    """A drive through the world of a seed, on the first or the second day."""
    config = merged(embedded_config(world), {"world": {"seed": seed}})
    config = merged(config, {"seed": seed, "plan": {"seed": seed}})
    jobs = os.cpu_count() or 1
    if not second:
        return open_drive(embedded_bag(world, config, jobs=jobs), jobs=jobs)
    path = cache_folder() / f"carried-{world}-{seed}.bag"
    if not path.exists():
        place, way = drive_through(MADE[world].make(config.world), config.robot, config.plan)
        again = merged(config, {"seed": seed + OTHER_DAY})
        write_recording(place, cut_way(way), again, path, jobs=jobs)
    return open_drive(path, jobs=jobs)


def cut_way(way: Trajectory) -> Trajectory:
    """``SECOND_DAY_M`` of a way, from its middle on."""
    metres = np.concatenate([[0], np.hypot(np.diff(way.x), np.diff(way.y)).cumsum()])
    first, last = np.searchsorted(metres, metres[-1] / 2 + np.array([0, SECOND_DAY_M])).tolist()
    parts = (values[first:last].copy() for values in (way.seconds, way.x, way.y, way.yaw))
    return Trajectory(*parts)


def begin_anew(events: RunEvents, after_ns: int) -> RunEvents:
    """The events of another day, with odometry that begins at its origin."""
    motions = [one for one in events.motions if isinstance(one, Odometry)]
    shift = after_ns + NIGHT_S * NANOSECONDS - motions[0].stamp_ns
    origin = inverse(motions[0].pose)
    truth = events.truth
    assert truth is not None
    return replace(
        events,
        motions=[
            replace(one, stamp_ns=one.stamp_ns + shift, pose=origin @ one.pose) for one in motions
        ],
        look_stamps_ns=events.look_stamps_ns + shift,
        truth=Trajectory(truth.seconds + shift / NANOSECONDS, truth.x, truth.y, truth.yaw),
    )


def map_days(world: str, seed: int, views: str) -> tuple[RatSlamRun, RatSlamRun]:
    """Map both days; return the run of the first one and of both."""
    source: ViewSource = build_view_source(views)
    slam = RatSlam(views=source)
    days = [
        events_of(
            record_day(world, seed, second=second),
            source,
            "truth+noise",
            merged(DRIFT, {"seed": seed + OTHER_DAY * second}),
            resumed=second,
        )
        for second in (False, True)
    ]
    first = RunRecorder(slam, days[0])
    run_events(first)
    mapped = first.record()
    second = RunRecorder(slam, begin_anew(days[1], int(mapped.stamps_ns[-1])), earlier=mapped)
    run_events(second)
    return mapped, second.record()


def judge_days(first: RatSlamRun, both: RatSlamRun) -> Found:
    """When the robot was found, and how well."""
    report = judge_map(both)
    assert both.truth is not None and report.nodes is not None
    start, truth, stamps = len(first), both.truth, both.stamps_ns
    kinds, targets = both.actions[start:, 0], both.actions[start:, 2]
    arrivals = np.flatnonzero((kinds == ActionKind.CREATE_EDGE) & (targets < len(first.nodes)))
    at = start + int(arrivals[0]) if arrivals.size else None
    refused = both.refused["stamp_ns"]
    until = stamps[-1] if at is None else stamps[at]
    carried = float(np.linalg.norm(truth[start, :2] - truth[start - 1, :2]))
    count = int(np.count_nonzero((refused >= stamps[start]) & (refused <= until)))
    if at is None:
        return Found(carried, count, None, None, None, report)
    place = report.nodes.motion.apply(both.poses[[at]])[0]
    driven = np.linalg.norm(np.diff(truth[start : at + 1, :2], axis=0), axis=1).sum()
    error = np.linalg.norm(place[:2] - truth[at, :2])
    seconds = (stamps[at] - stamps[start]) / NANOSECONDS
    return Found(carried, count, float(seconds), float(driven), float(error), report)


def row(world: str, seed: int, views: str, found: Found, first: MapReport) -> list[str]:
    def cell(value: float | None, digits: int) -> str:
        return "never" if value is None else f"{value:.{digits}f}"

    report = found.report
    assert report.trajectory is not None and first.trajectory is not None
    return [
        *(world, str(seed), views, f"{found.carried:.1f}", str(found.refused)),
        *(cell(found.seconds, 1), cell(found.metres, 1), cell(found.error, 2)),
        f"{first.trajectory.rmse_m:.3f}",
        f"{report.trajectory.rmse_m:.3f}",
        f"{report.false_loops} of {report.judged_loops}",
    ]


def carried_text() -> str:
    return fill(
        f"Simulated worlds, driven through on two days: the whole way, then {SECOND_DAY_M:g} m "
        "of the same way from its middle on, with other noise; a sector with colours sees other "
        f"things where the robot looks elsewhere. Odometry is {100 * (DRIFT.scale - 1):.0f} % "
        f"too long and turns {100 * (DRIFT.rotation_scale - 1):.0f} % too much, and begins anew at "
        "its origin on the second day. Found: the first arrival at a node of the first day. ATE: "
        "every step on the final map. Nothing was fitted to these seeds.",
        100,
    )


def carried_table(worlds: Mapping[str, Sequence[int]], views: Sequence[str]) -> str:
    rows = []
    for world, seeds in worlds.items():
        for name in views:
            errors = []
            for seed in seeds:
                first, both = map_days(world, seed, name)
                found = judge_days(first, both)
                rows.append(row(world, seed, name, found, judge_map(first)))
                print(rows[-1], flush=True)
                assert found.report.trajectory is not None
                errors.append(found.report.trajectory.rmse_m)
            mean = mean_and_range(np.array(errors))
            rows.append([world, "mean (range)", name, *[""] * 6, mean, ""])
    return table(HEAD, rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("world", nargs="?", choices=[*MADE])
    parser.add_argument("seeds", nargs="*", type=int)
    parser.add_argument("--views", default=",".join(VIEWS), help="recognisers, with commas between")
    parser.add_argument("--write", action="store_true", help="put the table into the docs")
    arguments = parser.parse_args()
    worlds: Mapping[str, Sequence[int]] = SEEDS
    if arguments.world:
        worlds = {arguments.world: arguments.seeds or SEEDS.get(arguments.world, (7,))}
    text = f"{carried_text()}\n\n{carried_table(worlds, arguments.views.split(','))}"
    print(text)
    if arguments.write:
        write_between(PAGE, "carried robots", text)


if __name__ == "__main__":
    main()
