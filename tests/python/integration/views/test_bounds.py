# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What the default matcher has to reach on recordings: a warehouse, and a house not fitted to.

Collision scans in the robot's frame, without what is below 0.1 m; scans left empty are skipped; the
paper's rule.
"""

from pathlib import Path

import numpy as np
import pytest

from fusionslam.datasets.range_recording import RangeRecording, RecordingConfig
from fusionslam.pipelines.scenes import record_scenes
from fusionslam.pipelines.views import MatchRun, run_views
from fusionslam.views.matcher import ViewMatcher

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    "world", ["warehouse", pytest.param("small_house", marks=pytest.mark.nightly)]
)
def test_the_default_matcher_keeps_the_bounds(test_data: Path, world: str) -> None:
    path = test_data / "recordings" / f"{world}.npz"
    config = RecordingConfig(frame="robot")
    scenes = record_scenes(RangeRecording.open(path, "collision"), recording=config)
    run = run_views(scenes.without_empty(), ViewMatcher())
    report = run.with_truth("alignment").judge("paper")
    assert report.accuracy is not None and report.accuracy >= 0.95
    assert report.loop_recall is not None and report.loop_recall >= 0.88
    assert report.loop_precision is not None and report.loop_precision >= 0.97
    if report.mean_false_positive_distance is not None:
        assert report.mean_false_positive_distance <= 1.5
    # The baseline that gives every scan a new view, or the same, must not pass for it.
    assert 0.1 * report.n < report.views < 0.9 * report.n
    off_m, off_rad = errors_of_relative_poses(run)
    assert len(off_m) == run.stats.matched > 100
    assert np.median(off_m) < 0.05 and np.median(off_rad) < np.radians(1)


def errors_of_relative_poses(run: MatchRun) -> tuple[list[float], list[float]]:
    """Metres and radians between the true poses and those beside the stored views."""
    poses, off_m, off_rad = run.scenes.true_poses(), [], []
    for pose, match in zip(poses, run.matches, strict=True):
        if match.matched is None or match.relative_pose is None:
            continue
        x, y, yaw = poses[match.matched]
        dx, dy, turn = match.relative_pose
        c, s = np.cos(yaw), np.sin(yaw)
        off_m.append(np.hypot(x + c * dx - s * dy - pose[0], y + s * dx + c * dy - pose[1]))
        off_rad.append(abs(np.angle(np.exp(1j * (yaw + turn - pose[2])))))
    return off_m, off_rad
