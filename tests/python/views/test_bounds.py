# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What the default matcher has to reach on recordings: a warehouse, and a house not fitted to.

Collision scans in the robot's frame, without what is below 0.1 m; scans left empty are skipped; the
paper's rule.
"""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from fusionslam.datasets.range_recording import RangeRecording, RecordingConfig
from fusionslam.geometry.odometry_noise import OdometryConfig
from fusionslam.pipelines.scenes import record_scenes
from fusionslam.pipelines.views import MatchRun, run_views
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.scene_set import SceneSet

pytestmark = pytest.mark.slow

WORLDS = ("warehouse", "small_house")
FIRST = 100
DRIFT = OdometryConfig(scale=1.02, rotation_scale=1.01)


def recording_of(test_data: Path, world: str) -> Path:
    path = test_data / "recordings" / f"{world}.npz"
    if not path.is_file():
        pytest.skip(f"no recording {path}")
    return path


def scenes_of(path: Path, odometry: OdometryConfig | None = None) -> SceneSet:
    config = RecordingConfig(frame="robot", odometry=odometry or OdometryConfig())
    return record_scenes(RangeRecording.open(path, "collision"), recording=config).without_empty()


@cache
def matched(path: Path) -> MatchRun:
    return run_views(scenes_of(path), ViewMatcher())


@pytest.mark.parametrize("world", WORLDS)
def test_the_default_matcher_keeps_the_bounds(test_data: Path, world: str) -> None:
    run = matched(recording_of(test_data, world))
    report = run.with_truth("alignment").judged("paper")
    assert report.accuracy is not None and report.accuracy >= 0.95
    assert report.loop_recall is not None and report.loop_recall >= 0.88
    assert report.loop_precision is not None and report.loop_precision >= 0.97
    if report.mean_false_positive_distance is not None:
        assert report.mean_false_positive_distance <= 1.5
    # The baseline that gives every scan a new view, or the same, must not pass for it.
    assert 0.1 * report.n < report.views < 0.9 * report.n


@pytest.mark.parametrize("world", WORLDS)
def test_the_pose_beside_the_stored_view_is_true(test_data: Path, world: str) -> None:
    run = matched(recording_of(test_data, world))
    poses, off_m, off_rad = run.scenes.true_poses(), [], []
    for pose, match in zip(poses, run.matches, strict=True):
        if match.matched is None or match.relative_pose is None:
            continue
        x, y, yaw = poses[match.matched]
        dx, dy, turn = match.relative_pose
        c, s = np.cos(yaw), np.sin(yaw)
        off_m.append(np.hypot(x + c * dx - s * dy - pose[0], y + s * dx + c * dy - pose[1]))
        off_rad.append(abs(np.angle(np.exp(1j * (yaw + turn - pose[2])))))
    assert len(off_m) == run.stats.matched > 100
    assert np.median(off_m) < 0.05 and np.median(off_rad) < np.radians(1)


@pytest.mark.parametrize("world", WORLDS)
def test_drifting_odometry_changes_no_id(test_data: Path, world: str) -> None:
    path = recording_of(test_data, world)
    straight, drifting = matched(path), scenes_of(path, DRIFT)
    assert straight.scenes.digest() == drifting.digest()
    # Ids depend on earlier scans only: the first ones are enough.
    found = run_views(drifting.subset(np.arange(FIRST)), ViewMatcher()).matches
    assert list(found) == list(straight.matches[:FIRST])
    assert sum(not match.is_new for match in found) > 20
