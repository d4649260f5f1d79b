# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Does a map know how good it is? A Markdown table.

    python -m benchmarks.accuracy.map_quality [--write]

Needs the test data, which FUSIONSLAM_TEST_DATA names: the true path of KITTI's sequence 00, to
which noise is added. Three minutes of processor time.
"""

import argparse
import time
from textwrap import fill

import numpy as np

from benchmarks.accuracy.data import ROOT, data_folder
from benchmarks.accuracy.markdown import table, write_between
from benchmarks.accuracy.pose_graphs import LOOP_SD, LOOPS, ODOMETRY, make_drive
from fusionslam.base.arrays import Floats
from fusionslam.datasets.pose_files import read_poses_kitti
from fusionslam.geometry.se3 import inverse
from fusionslam.mapping.edge import Edge, deviations_of
from fusionslam.mapping.map_content import MapContent
from fusionslam.mapping.map_file import StoredKeyframe
from fusionslam.mapping.quality import MapQuality, judge_graph

PAGE = ROOT / "docs" / "stages" / "mapping.md"
SEEDS = range(5)
LEFT_OUT = 2
"""Of the loops that change most, those without which a map is really solved."""
WANTED = (LOOPS, 60)
FALSE = 0.5
"""False loops, of as many as there are right ones."""
HEAD = ["odometry", "loops", "false ones", "believed", "deviation, m: median", "most"]
HEAD += ["true error, of the deviation: mean", "of single drives"]
HEAD += ["bound while driving, of the deviation", "shifts: off by, at most", "s"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="put the table into the docs")
    arguments = parser.parse_args()
    path = read_poses_kitti(data_folder() / "kitti" / "poses" / "00.txt")
    path = inverse(path[:1]) @ path
    about = (
        f"The true path of KITTI 00, with noise as [below](#measured), {len(SEEDS)} drives a row. "
        "Stated deviations are those of the noise. True error: root mean square over all "
        "keyframes, against the first one, divided by that of the deviations; all errors of one "
        "drive are alike, so that it is to be 1 in the mean over drives alone. Bound while "
        "driving: that of a step, divided by the deviation that the whole graph leaves, in the "
        f"median. Shifts: of the {LEFT_OUT} loops that change most, beside maps that are really "
        f"solved without each, in {LEFT_OUT} drives. Seconds of processor time of `judge_graph`, "
        "in the median."
    )
    rows = [row(path, odometry, loops) for odometry in ODOMETRY for loops in WANTED]
    text = f"{fill(about, 100)}\n\n{table(HEAD, rows)}"
    print(text)
    if arguments.write:
        write_between(PAGE, "map quality", text)


def row(path: Floats, odometry: str, loops: int) -> list[str]:
    medians, most, errors, bounds, off, believed, seconds = [], [], [], [], [], [], []
    for seed in SEEDS:
        content = make_map(path, odometry, loops, seed)
        started = time.process_time()
        quality = judge_graph(content, {}, unsure_m=1.0, apart_m=0.05)
        seconds.append(time.process_time() - started)
        deviations = quality.deviations[:, 0]
        medians.append(np.median(deviations))
        most.append(deviations.max())
        error = np.linalg.norm((content.poses - path)[:, :3, 3], axis=1)
        errors.append(np.sqrt((error**2).mean() / (deviations**2).mean()))
        covariances = np.array([content.bound(k).covariance for k in range(len(path))])
        bounds.append(np.median(deviations_of(covariances)[1:, 0] / deviations[1:]))
        believed.append(quality.loops)
        if seed < LEFT_OUT:
            off.append(shifts_off(content, quality))
    return [
        *(odometry, str(loops), str(round(FALSE * loops)), f"{np.mean(believed):.0f}"),
        *(f"{np.mean(medians):.2f}", f"{np.mean(most):.2f}"),
        f"{np.sqrt(np.mean(np.square(errors))):.2f}",
        f"{min(errors):.2f} to {max(errors):.2f}",
        *(f"{np.mean(bounds):.2f}", f"{100 * max(off):.1f} %", f"{np.median(seconds):.1f}"),
    ]


def make_map(path: Floats, odometry: str, loops: int, seed: int) -> MapContent:
    """A solved map of a drive with noise."""
    drive = make_drive(path, odometry, FALSE, loops, seed)
    edges = [
        Edge(k, "odometry", k, k + 1, step, np.diag(sd**2), "believed")
        for k, (step, sd) in enumerate(zip(drive.steps, drive.sds, strict=True))
    ]
    for a, b, pose in drive.loops + drive.false:
        edges.append(Edge(len(edges), "loop", a, b, pose, np.diag(LOOP_SD**2), "pending"))
    keyframes = [StoredKeyframe(k, 1, k, 0, pose, np.eye(4)) for k, pose in enumerate(path)]
    return MapContent({"drive": 1}, keyframes, edges, None)


def shifts_off(content: MapContent, quality: MapQuality) -> float:
    """Largest error of the stated shifts, of those of maps that are solved without the loop."""
    errors = []
    for each in quality.influences[:LEFT_OUT]:
        kept = [edge for edge in content.edges.values() if edge.number != each.edge.number]
        without = MapContent(content.sessions, content.keyframes, kept, None)
        shift = np.linalg.norm((without.poses - content.poses)[:, :3, 3], axis=1).max()
        errors.append(abs(each.shift_m - shift) / shift)
    return float(max(errors))


if __name__ == "__main__":
    main()
