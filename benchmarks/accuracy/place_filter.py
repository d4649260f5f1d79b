# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Are look-alike places told apart by odometry? A Markdown table.

python -m benchmarks.accuracy.place_filter             # recordings, and made worlds
python -m benchmarks.accuracy.place_filter house 7 8   # one made world of these seeds
python -m benchmarks.accuracy.place_filter --write     # and put the table into the docs
python -m benchmarks.accuracy.place_filter --many      # milliseconds with a thousand stored views

The recordings need the test data, which FUSIONSLAM_TEST_DATA names. A made world takes two to ten
minutes to record; recordings are kept in the cache.
"""

import argparse
import os
import time
from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import NamedTuple

import numpy as np

from benchmarks.accuracy.data import ROOT, WORLDS, data_folder
from benchmarks.accuracy.markdown import table, write_between
from benchmarks.accuracy.presets import mean_and_range
from fusionslam.config import merged
from fusionslam.evaluation import ViewJudge
from fusionslam.evaluation.views.report import ViewReport
from fusionslam.geometry.odometry_noise import DRIFT, add_odometry_errors
from fusionslam.geometry.trajectory import ground_poses
from fusionslam.pipelines.drives import Drive, open_drive
from fusionslam.sim.recordings import embedded_bag, embedded_config
from fusionslam.views import ViewMatcher
from fusionslam.views.recognisers import ViewMatcherConfig

PAGE = ROOT / "docs" / "stages" / "views" / "place_filter.md"
SEEDS = {"house": (12, 13, 14, 15, 16), "warehouse": (3, 4, 5), "hospital": (3, 4, 5, 6, 7, 8)}
"""Developed on the recordings, houses 3 and 7 to 11, warehouse 3 and hospitals 3 to 5."""
HEAD = ["drive", "seed", "scans", "by", "accuracy, %", "loop recall, %", "loop precision, %"]
HEAD += ["false positives", "metres off", "ambiguous, %", "revised", "delay, s, 95 %"]
HEAD += ["ms a scan", "95 %"]


class Matched(NamedTuple):
    """Scans of a drive, matched in one way.

    Attributes:
        report: what is right.
        ambiguous: share of the scans.
        revised: answers that were revised.
        delays: float64 (n,), seconds until each scan had its last answer.
        seconds: float64 (n,), of processor time.
    """

    report: ViewReport
    ambiguous: float
    revised: int
    delays: np.ndarray
    seconds: np.ndarray


def open_made(world: str, seed: int) -> Drive:
    """The drive through a made world of a seed."""
    jobs = os.cpu_count() or 1
    config = embedded_config(world)
    if seed != config.world.model_dump()["seed"]:
        changes = {"seed": seed, "plan": {"seed": seed}, "world": {"seed": seed}}
        config = merged(config, changes)
    return open_drive(embedded_bag(world, config, jobs=jobs), jobs=jobs)


def match_both(drive: Drive) -> list[Matched]:
    """Match the scans of a drive alone, and with odometry that drifts."""
    scenes = drive.scenes
    poses = scenes.true_poses()
    odometry = ground_poses(*add_odometry_errors(poses, scenes.seconds, DRIFT).T)
    judge = ViewJudge(poses, scenes.seconds)
    found = []
    for with_odometry in (False, True):
        matcher, seconds, delays = ViewMatcher(), np.zeros(len(scenes)), np.zeros(len(scenes))
        assert scenes.clouds is not None
        views = [matcher.view(scenes.clouds[index]) for index in range(len(scenes))]
        ids = []
        for index, view in enumerate(views):
            started = time.process_time()
            match = matcher.process(view, odometry=odometry[index] if with_odometry else None)
            seconds[index] = time.process_time() - started
            ids.append(match.id)
            for scan, _ in match.revised:
                delays[scan] = scenes.seconds[index] - scenes.seconds[scan]
        stats = matcher.stats
        report = judge.judge(np.array(ids))
        share = stats.ambiguous / len(scenes)
        found.append(Matched(report, share, stats.revised, delays, seconds))
    return found


def shares_of(matched: Matched) -> list[float]:
    """Accuracy, loop recall and loop precision, in percent."""
    report = matched.report
    values = (report.accuracy, report.loop_recall, report.loop_precision)
    return [float("nan") if value is None else 100 * value for value in values]


def rows_of(name: str, seed: str, both: Sequence[Matched]) -> list[list[str]]:
    rows = []
    for by, matched in zip(("scans", "scans and odometry"), both, strict=True):
        report = matched.report
        off = report.distances[report.false_positive]
        rows.append(
            [
                *(name, seed, str(report.n), by),
                *(f"{value:.1f}" for value in shares_of(matched)),
                str(report.false_positives),
                f"{off.mean():.1f}" if off.size else "",
                f"{100 * matched.ambiguous:.1f}",
                str(matched.revised),
                f"{np.percentile(matched.delays, 95):.1f}",
                f"{1e3 * np.median(matched.seconds):.0f}",
                f"{1e3 * np.percentile(matched.seconds, 95):.0f}",
            ]
        )
    return rows


def filter_table(worlds: Mapping[str, Sequence[int]], recordings: Sequence[str]) -> str:
    rows = []
    for name in recordings:
        path = data_folder() / "recordings" / f"{name}.npz"
        rows += rows_of(f"recorded {name}", "", match_both(open_drive(path)))
    for world, seeds in worlds.items():
        drives = [match_both(open_made(world, seed)) for seed in seeds]
        for seed, both in zip(seeds, drives, strict=True):
            rows += rows_of(world, str(seed), both)
        for by, some in zip(
            ("scans", "scans and odometry"), zip(*drives, strict=True), strict=True
        ):
            if len(seeds) > 1:
                means = [mean_and_range(v) for v in np.array([shares_of(m) for m in some]).T]
                rows.append([world, "mean (range)", "", by, *means, *[""] * 7])
    return table(HEAD, rows)


def filter_text() -> str:
    return fill(
        "Alignment, a sector with colours; rule `paper`. Odometry is "
        f"{100 * (DRIFT.scale - 1):.0f} % too long and turns "
        f"{100 * (DRIFT.rotation_scale - 1):.0f} % too much. Accuracy, recall and precision are "
        "those of the first answers. The filter was developed on the recordings, houses 3 and 7 "
        "to 11, warehouse 3 and hospitals 3 to 5; the other worlds were not run before. Delay: "
        "until a scan has its last answer. Milliseconds are processor time of one thread, without "
        "building the view.",
        100,
    )


def time_many_views(drive: Drive, least: int = 1000) -> str:
    """Milliseconds of a scan while so many views are stored: several of each place."""
    scenes = drive.scenes
    assert scenes.clouds is not None
    odometry = add_odometry_errors(scenes.true_poses(), scenes.seconds, DRIFT)
    every = {"policy": "several", "store_below": 1.0, "per_place": len(scenes)}
    matcher, seconds = ViewMatcher(merged(ViewMatcherConfig(), every)), []
    for index, pose in enumerate(ground_poses(*odometry.T)):
        view, stored = matcher.view(scenes.clouds[index]), len(matcher)
        started = time.process_time()
        matcher.process(view, odometry=pose)
        if stored >= least:
            seconds.append(time.process_time() - started)
    median, most = 1e3 * np.percentile(seconds, [50, 95])
    return (
        f"With {least:,} stored views and more ({len(seconds)} scans of hospital 5): median "
        f"{median:.1f} ms a scan, 95 % {most:.1f} ms."
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("world", nargs="?", choices=SEEDS)
    parser.add_argument("seeds", nargs="*", type=int)
    parser.add_argument("--write", action="store_true", help="put the table into the docs")
    parser.add_argument("--many", action="store_true", help="only time a thousand stored views")
    arguments = parser.parse_args()
    if arguments.many:
        text = time_many_views(open_made("hospital", 5))
        print(text)
        if arguments.write:
            write_between(PAGE, "many views", text)
        return
    worlds: Mapping[str, Sequence[int]] = SEEDS
    if arguments.world:
        worlds = {arguments.world: arguments.seeds or SEEDS[arguments.world]}
    text = f"{filter_text()}\n\n{filter_table(worlds, () if arguments.world else WORLDS)}"
    print(text)
    if arguments.write:
        write_between(PAGE, "place filter", text)


if __name__ == "__main__":
    main()
