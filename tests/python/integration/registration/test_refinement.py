# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Refined poses beside those of small_gicp, which was written by others."""

from pathlib import Path

import numpy as np
import pytest

from clouds import scan_blocks
from fusionslam._core import SurfaceCloud, refine_pose
from fusionslam.sensors.frame import Cloud
from rows import rows
from streets import at

pytest.importorskip("small_gicp", reason="a peer of tests alone")

from benchmarks.speed.registration_cases import (
    Pair,
    align_by_peer,
    compare_poses,
    make_pairs,
    prepare_by_peer,
    recorded_pairs,
)


def check_pairs(pairs: list[Pair]) -> None:
    ours, theirs = [], []
    for source, target, start, distance in pairs:
        found = refine_pose(SurfaceCloud(source), SurfaceCloud(target), start, distance=distance)
        assert found.converged
        ours.append(found.target_from_source)
        theirs.append(
            align_by_peer(
                prepare_by_peer(source), prepare_by_peer(target), start, distance, step=1e-5
            )
        )
    compare_poses(ours, theirs)


def test_poses_in_a_made_town_are_those_of_small_gicp() -> None:
    way = np.array([at(3 * step, 0, 10 * step) for step in range(9)])
    check_pairs(make_pairs([Cloud(scan_blocks(each, 7)) for each in way], way, 8))


@pytest.mark.slow
@rows("recording", ["kitti00_keyframes", "euroc_v101"])
def test_poses_of_recorded_clouds_are_those_of_small_gicp(recording: str, test_data: Path) -> None:
    pairs = recorded_pairs(recording, 8)
    assert len(pairs) == 8
    check_pairs(pairs)
