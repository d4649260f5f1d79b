# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The first stage as the author's program does it, against what that program gave.

The figures are those of his program, run again on the same recordings: published parameters,
threshold 0.737, paper's rule; scans left empty are skipped.
"""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from fusionslam.datasets.range_recording import RangeRecording, RecordingConfig
from fusionslam.evaluation import ViewReport
from fusionslam.geometry.odometry_noise import OdometryConfig
from fusionslam.pipelines.scenes import record_scenes
from fusionslam.pipelines.views import run_views
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.recognisers import ViewMatcherConfig
from fusionslam.views.scene_set import SceneSet

pytestmark = pytest.mark.slow

DRIFT = OdometryConfig(scale=1.02, rotation_scale=1.01)
FRAMES = {
    "robot": RecordingConfig(frame="robot"),
    "odometry": RecordingConfig(frame="odometry"),
    "drift": RecordingConfig(frame="odometry", odometry=DRIFT),
}


@cache
def recording(path: Path) -> RangeRecording:
    return RangeRecording.open(path, "collision")


def scenes_of(test_data: Path, world: str, frame: str) -> SceneSet:
    path = test_data / "recordings" / f"{world}.npz"
    if not path.is_file():
        pytest.skip(f"no recording {path}")
    return record_scenes(recording(path), recording=FRAMES[frame])


def judged(scenes: SceneSet) -> ViewReport:
    matcher = ViewMatcher(ViewMatcherConfig(preset="author", threshold=0.737))
    return run_views(scenes.without_empty(), matcher).with_truth("objects author").judged("paper")


@pytest.mark.parametrize(
    ("world", "frame", "accuracy", "loop_recall"),
    [
        ("warehouse", "odometry", 85.8, 74),
        ("small_house", "odometry", 89.0, 84),
        ("warehouse", "robot", 75.8, 55),
        ("small_house", "robot", 76.6, 65),
        ("warehouse", "drift", 72.3, 3),
        ("small_house", "drift", 74.7, 14),
    ],
)
def test_the_authors_first_stage_scores_as_his_program_does(
    test_data: Path, world: str, frame: str, accuracy: float, loop_recall: float
) -> None:
    report = judged(scenes_of(test_data, world, frame))
    assert report.accuracy is not None and report.loop_recall is not None
    assert abs(100 * report.accuracy - accuracy) < 0.5
    assert abs(100 * report.loop_recall - loop_recall) < 1


def test_in_the_robots_frame_drift_makes_no_difference(test_data: Path) -> None:
    path = test_data / "recordings" / "warehouse.npz"
    robot = scenes_of(test_data, "warehouse", "robot").clouds
    config = RecordingConfig(frame="robot", odometry=DRIFT)
    drifted = record_scenes(recording(path), recording=config).clouds
    assert robot is not None and drifted is not None
    assert np.array_equal(robot.points, drifted.points)


def test_forty_three_scans_of_the_warehouse_hold_only_floor(test_data: Path) -> None:
    scenes = scenes_of(test_data, "warehouse", "robot")
    assert (len(scenes), int(scenes.empty.sum())) == (509, 43)
    assert len(scenes.without_empty()) == 466
