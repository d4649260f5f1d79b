# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The first stage as the author's program does it, against what that program gave.

The figures are those of his program, run again on the same recordings: published parameters,
threshold 0.737, paper's rule; scans left empty are skipped.
"""

from pathlib import Path

import pytest

from fusionslam.datasets.range_recording import RangeRecording, RecordingConfig
from fusionslam.geometry.odometry_noise import OdometryConfig
from fusionslam.pipelines.scenes import record_scenes
from fusionslam.pipelines.views import run_views
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.recognisers import ViewMatcherConfig
from recordings import write_drive
from rows import rows

pytestmark = pytest.mark.slow

DRIFT = OdometryConfig(scale=1.02, rotation_scale=1.01)
FRAMES = {
    "odometry": RecordingConfig(frame="odometry"),
    "robot": RecordingConfig(frame="robot"),
    "drift": RecordingConfig(frame="odometry", odometry=DRIFT),
}


@rows(
    "world, scans, empty, figures",
    [
        ("warehouse", 509, 43, {"odometry": (85.8, 74), "robot": (75.8, 55), "drift": (72.3, 3)}),
        ("small_house", 474, 0, {"odometry": (89.0, 84), "robot": (76.6, 65), "drift": (74.7, 14)}),
    ],
)
def test_the_authors_first_stage_scores_as_his_program_does(
    test_data: Path, world: str, scans: int, empty: int, figures: dict[str, tuple[float, float]]
) -> None:
    recording = RangeRecording.open(test_data / "recordings" / f"{world}.npz", "collision")
    for frame, (accuracy, loop_recall) in figures.items():
        scenes = record_scenes(recording, recording=FRAMES[frame])
        assert (len(scenes), int(scenes.empty.sum())) == (scans, empty)
        matcher = ViewMatcher(ViewMatcherConfig(preset="author", threshold=0.737))
        run = run_views(scenes.without_empty(), matcher).with_truth("objects author")
        report = run.judge("paper")
        assert report.accuracy is not None and report.loop_recall is not None
        assert abs(100 * report.accuracy - accuracy) < 0.5, frame
        assert abs(100 * report.loop_recall - loop_recall) < 1, frame


def test_in_the_robots_frame_drift_changes_no_cloud_and_in_odometrys_frame_all(
    tmp_path: Path,
) -> None:
    recording = RangeRecording.open(write_drive(tmp_path / "drive.npz"))
    for frame in ("robot", "odometry"):
        plain, drifting = (
            record_scenes(recording, recording=RecordingConfig(frame=frame, odometry=odometry))
            for odometry in (OdometryConfig(), DRIFT)
        )
        assert (plain.digest() == drifting.digest()) is (frame == "robot")
