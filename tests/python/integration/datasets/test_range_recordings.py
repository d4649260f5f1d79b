# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of ranges as one .npz: clouds, frames, drift, and files that are wrong."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from error_codes import has_code
from fusionslam.datasets.range_recording import RangeRecording, RecordingConfig, is_recording
from fusionslam.errors import DataError
from fusionslam.geometry.odometry_noise import (
    OdometryConfig,
    add_odometry_errors,
    simulate_odometry,
)
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.pipelines.scenes import record_scenes
from rows import rows
from scenes import LAPS, write_recording

DRIFT = OdometryConfig(scale=1.02, rotation_scale=1.01)


def test_points_are_where_the_rays_end_and_what_is_low_is_ground(tmp_path: Path) -> None:
    points = write_recording(tmp_path / "r.npz", LAPS)
    recording = RangeRecording.open(tmp_path / "r.npz")
    assert len(recording) == len(LAPS) and recording.name == "r"
    assert np.array_equal(recording.points, points)
    everything = recording.cloud(1, RecordingConfig(ground_height=None))
    above = recording.cloud(1, RecordingConfig())
    assert len(everything) == len(above) + 2
    assert np.array_equal(above.points, everything.points[everything.points[:, 2] > 0.1])
    assert above.colors is not None and len(above.colors) == len(above)


def test_in_odometrys_frame_points_move_with_the_robot(tmp_path: Path) -> None:
    write_recording(tmp_path / "r.npz", LAPS)
    data = RangeRecording.open(tmp_path / "r.npz")
    robot = record_scenes(data)
    true = record_scenes(data, recording=RecordingConfig(frame="odometry"))
    drifted = record_scenes(data, recording=RecordingConfig(frame="odometry", odometry=DRIFT))
    assert robot.clouds is not None and true.clouds is not None and drifted.clouds is not None
    for index in (0, 3, 9):
        points, x = robot.clouds[index].points, np.array([5.0 * LAPS[index], 0, 0])
        assert true.clouds[index].points == pytest.approx(points + x, abs=1e-5)
        assert drifted.clouds[index].points == pytest.approx(points + 1.02 * x, abs=1e-4)
    assert np.array_equal(drifted.true_poses(), robot.true_poses())


def test_a_slice_has_the_clouds_of_its_scans(tmp_path: Path) -> None:
    write_recording(tmp_path / "r.npz", LAPS)
    data = RangeRecording.open(tmp_path / "r.npz")
    some, config = data[2:7:2], RecordingConfig(frame="odometry")
    assert some.numbers.tolist() == [2, 4, 6] and some.places is not None
    for row in range(3):
        assert np.array_equal(some[row].points, data[2 + 2 * row].points)
        assert np.array_equal(some[row].colors, data[2 + 2 * row].colors)
    found = record_scenes(some, recording=config)
    assert found.numbers.tolist() == [2, 4, 6] and found.stamps_ns[1] == data.stamps_ns[4]


def test_odometry_at_places_is_that_of_the_simulator() -> None:
    seconds = np.arange(0, 20, 0.5)
    places = np.column_stack([np.cos(seconds), np.sin(seconds), seconds + np.pi / 2])
    config = OdometryConfig(
        scale=1.02, rotation_scale=1.01, speed_noise=0.02, turn_noise=0.01, seed=3
    )
    track = simulate_odometry(Trajectory(seconds, *places.T), config, 2.0)
    wrapped = np.column_stack([places[:, :2], np.angle(np.exp(1j * places[:, 2]))])
    found = add_odometry_errors(wrapped, seconds, config)
    assert found[:, :2] == pytest.approx(track.poses[:, :2, 3])
    assert np.array_equal(add_odometry_errors(places, seconds, OdometryConfig()), places)


def test_a_recording_without_poses_has_scenes_but_no_odometry(tmp_path: Path) -> None:
    write_recording(tmp_path / "r.npz", LAPS, poses=False)
    data = RangeRecording.open(tmp_path / "r.npz")
    assert record_scenes(data).poses is None
    with pytest.raises(DataError, check=has_code("no-poses")):
        record_scenes(data, recording=RecordingConfig(frame="odometry"))
    np.savez(tmp_path / "other.npz", stamps=np.arange(3))
    (tmp_path / "text.npz").write_text("no archive")
    found = [is_recording(tmp_path / name) for name in ("r.npz", "other.npz", "text.npz")]
    assert found == [True, False, False]


@rows(
    "change, words",
    [
        ({"rays": None}, "rays"),
        ({"visual_offsets": None}, "visual_offsets or collision_offsets"),
        ({"stamps": np.zeros(len(LAPS))}, "stamps"),
        ({"stamps": np.full(len(LAPS), np.nan)}, "stamps"),
        ({"poses": np.zeros((2, 3))}, r"poses .*\(2, 3\)"),
        ({"poses": np.full((len(LAPS), 3), np.inf)}, "poses"),
        ({"visual_offsets": np.arange(len(LAPS) + 1)[::-1]}, "visual_offsets"),
        ({"visual_offsets": np.r_[0, 9, 2 : len(LAPS) + 1]}, "visual_offsets"),
        ({"visual_offsets": np.arange(3)}, "visual_offsets"),
        ({"visual_ray": np.zeros(4, np.uint16)}, "visual_ray"),
        ({"rays": np.zeros((2, 3))}, "visual_ray"),
        ({"visual_rgb": "float"}, "visual_rgb.*float64"),
    ],
)
def test_wrong_arrays_are_named(change: dict[str, Any], words: str, tmp_path: Path) -> None:
    path = tmp_path / "r.npz"
    write_recording(path, LAPS)
    with np.load(path) as stored:
        arrays = {name: stored[name] for name in stored.files}
    ((name, value),) = change.items()
    arrays[name] = arrays[name].astype(value) if isinstance(value, str) else value
    np.savez(path, **{key: array for key, array in arrays.items() if array is not None})
    with pytest.raises(DataError, match=rf"r\.npz.*{words}"):
        RangeRecording.open(path)


def test_files_that_are_cut_or_missing_and_shapes_that_it_lacks_are_named(tmp_path: Path) -> None:
    path = tmp_path / "r.npz"
    write_recording(path, LAPS)
    with pytest.raises(DataError, match=r"r\.npz .*collision.* visual"):
        RangeRecording.open(path, "collision")
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(DataError, check=has_code("damaged-file", path)):
        RangeRecording.open(path)
    with pytest.raises(DataError, check=has_code("missing-file", tmp_path / "none.npz")):
        RangeRecording.open(tmp_path / "none.npz")
