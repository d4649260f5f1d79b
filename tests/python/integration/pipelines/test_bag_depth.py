# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Another simulator's recording, fused by its own transforms, fits our picture of its world."""

from pathlib import Path

import pytest

from benchmarks.accuracy.bag_depth import FULL_CIRCLE, SECTOR, depth_agreement

pytestmark = pytest.mark.nightly  # tests of the simulator and of fuse hold most of it


def test_points_of_the_full_circle_lie_where_the_renderer_sees_a_surface(test_data: Path) -> None:
    agreement = depth_agreement(test_data, FULL_CIRCLE)
    assert agreement.frames == 40
    assert agreement.points > 60_000
    assert agreement.share >= 0.9


def test_the_sector_hits_collision_shapes_that_no_camera_sees(test_data: Path) -> None:
    agreement = depth_agreement(test_data, SECTOR)
    print(f"{agreement.share:.1%} of the sector's points lie at the rendered depth")
    assert agreement.frames == 40
    assert 0.5 < agreement.share < 0.9
