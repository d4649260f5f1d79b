# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The path of KITTI 00 with drift: as many false loops as true ones, in runs that agree."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.accuracy.pose_graphs import add_loop, ate, believed, build, make_drive
from fusionslam.datasets.pose_files import read_poses_kitti

pytest.importorskip("gtsam", exc_type=ImportError)


@pytest.mark.slow
@pytest.mark.parametrize("odometry", [pytest.param("good", marks=pytest.mark.nightly), "rough"])
def test_true_loops_are_kept_and_false_ones_are_not(test_data: Path, odometry: str) -> None:
    path = read_poses_kitti(test_data / "kitti/poses/00.txt")
    drive = make_drive(path, odometry, 1.0)
    graph = build(drive)
    alone = graph.solve()
    for loop in drive.loops + drive.false:
        add_loop(graph, *loop)
    solution = graph.solve()
    true, false = believed(drive, solution)
    assert (len(drive.loops), len(drive.false)) == (790, 790)
    assert true >= 0.99 * 790 and false == 0
    assert ate(solution.poses, path) < 0.25 * ate(alone.poses, path)
    assert solution.reason is None
    assert np.array_equal(graph.solve().poses, solution.poses)
