# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Bags that do not say where their camera is, and a calib.yaml that does."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from rows import rows

pytest.importorskip("rosbags", reason="bags are an extra")

from bags import START, drive, static, without, write_bag
from cli import fails, succeeds
from error_codes import has_code
from fusionslam.datasets import open_dataset
from fusionslam.errors import ConfigError, DataError
from fusionslam.pipelines.overview import look_at
from fusionslam.pipelines.recording import Recording
from fusionslam.sensors.frame import Camera
from fusionslam.sensors.messages import Event, FrameTransforms


def calib_yaml(path: Path, camera: Camera, **changes: object) -> Path:
    entry = {
        "projection": camera.projection.tolist(),
        "rectified_from_points": camera.rectified_from_points.tolist(),
        "size": list(camera.size or ()),
    }
    content = {key: value for key, value in (entry | changes).items() if value is not None}
    path.write_text(yaml.safe_dump({"left": content}))
    return path


@pytest.fixture
def camera(tmp_path: Path) -> Camera:
    """That of the whole bag."""
    return open_dataset(write_bag(tmp_path / "whole.bag", drive()))[0].cameras["left"]


@rows("missing", ["/tf_static", "/camera/camera_info"])
def test_a_calibration_stands_for_what_a_bag_lacks(
    tmp_path: Path, camera: Camera, missing: str
) -> None:
    bag = write_bag(tmp_path / "poor.bag", without(drive(), missing))
    file = calib_yaml(tmp_path / "calib.yaml", camera)
    with pytest.raises(DataError):
        open_dataset(bag, sensors=("points", "left"))
    dataset = open_dataset(bag, sensors=("points", "left"), calibration=file)
    whole = open_dataset(tmp_path / "whole.bag")
    assert len(dataset) == len(whole)
    for frame, expected in zip(dataset, whole, strict=True):
        found = frame.cameras["left"]
        assert np.allclose(found.projection_from_points, camera.projection_from_points)
        assert np.array_equal(frame.images["left"], expected.images["left"])


def test_a_calibration_wins_over_that_of_the_bag(tmp_path: Path, camera: Camera) -> None:
    moved = camera.rectified_from_points.copy()
    moved[0, 3] += 0.5
    file = calib_yaml(tmp_path / "other.yaml", camera, rectified_from_points=moved.tolist())
    frame = open_dataset(tmp_path / "whole.bag", calibration=file)[0]
    assert np.allclose(frame.cameras["left"].rectified_from_points, moved)
    assert not np.allclose(
        open_dataset(tmp_path / "whole.bag")[0].cameras["left"].rectified_from_points, moved
    )


def test_info_says_that_the_place_of_the_camera_is_from_the_calibration(
    tmp_path: Path, camera: Camera
) -> None:
    bag = write_bag(tmp_path / "poor.bag", without(drive(), "/tf_static"))
    file = calib_yaml(tmp_path / "calib.yaml", camera)
    seen = dict(look_at(Recording.at(bag, calibration=file)).rows)
    assert "from the calibration" in seen["extrinsics"]
    assert seen["fusion"].startswith("possible")


@rows(
    "changes, message",
    [
        ({"size": None}, "left .*size"),
        ({"size": [640, 480]}, "640x480"),
        ({"projection": [0.0] * 12}, "projection"),
    ],
)
def test_a_calibration_that_does_not_fit_is_named(
    tmp_path: Path, camera: Camera, changes: dict[str, object], message: str
) -> None:
    file = calib_yaml(tmp_path / "calib.yaml", camera, **changes)
    with pytest.raises(DataError, match=message):
        _ = open_dataset(tmp_path / "whole.bag", calibration=file)[0].images["left"]


def test_a_calibration_that_is_not_there_is_named(tmp_path: Path, camera: Camera) -> None:
    with pytest.raises(DataError, check=has_code("missing-file", tmp_path / "gone.yaml")):
        open_dataset(tmp_path / "whole.bag", calibration=tmp_path / "gone.yaml")


def test_kitti_has_its_own_calibration(kitti: Path, tmp_path: Path, camera: Camera) -> None:
    file = calib_yaml(tmp_path / "calib.yaml", camera)
    with pytest.raises(ConfigError, match="kitti-odometry"):
        open_dataset(kitti, calibration=file)


def test_commands_take_a_calibration(tmp_path: Path, camera: Camera) -> None:
    bag = write_bag(tmp_path / "poor.bag", without(drive(), "/tf_static"))
    file = calib_yaml(tmp_path / "calib.yaml", camera)
    words = ("fuse", bag, "--source", "lidar", "-o")
    line = fails(1, *words, tmp_path / "without")
    assert "velodyne" in line and "--calib" in line and "--source cloud" in line
    succeeds(*words, tmp_path / "with", "--calib", file)
    assert open_dataset(tmp_path / "with")[0].colors is not None


def test_the_file_places_a_scanner_that_tf_does_not_link_to_the_robot(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "poor.bag", without(drive(), "/tf_static"))
    file = tmp_path / "robot.yaml"
    file.write_text("robot_from_points: [1,0,0,0.2, 0,1,0,0, 0,0,1,0.5, 0,0,0,1]\n")
    placed = open_dataset(bag, sensors=("points",), calibration=file)[0]
    assert placed.robot_from_points[:3, 3].tolist() == [0.2, 0, 0.5]
    assert open_dataset(bag, sensors=("points",))[0].robot_from_points is None


def test_a_scanner_that_tf_links_to_something_else_is_named(tmp_path: Path) -> None:
    mast = FrameTransforms(transforms=(static("mast", "velodyne", np.eye(4)),))
    events = [Event("/tf_static", START, mast), *without(drive(), "/tf_static")]
    file = tmp_path / "robot.yaml"
    file.write_text("robot_from_points: [1,0,0,0.2, 0,1,0,0, 0,0,1,0.5, 0,0,0,1]\n")
    with pytest.raises(DataError, check=has_code("two-parents", "velodyne", "mast", "base")):
        bag = write_bag(tmp_path / "mast.bag", events)
        open_dataset(bag, sensors=("points",), calibration=file)


@rows("missing", ["/tf_static", "/camera/camera_info"])
def test_scans_serve_where_the_camera_is_not_calibrated_and_the_cure_is_named(
    tmp_path: Path, missing: str, caplog: pytest.LogCaptureFixture
) -> None:
    bag = write_bag(tmp_path / "poor.bag", without(drive(), missing))
    assert open_dataset(bag).sensors == ("points",)
    (record,) = caplog.records
    assert "--calib" in record.getMessage()
    assert ("--topic camera_info=" in record.getMessage()) == (missing != "/tf_static")
    line = fails(1, "calib-check", bag, "-o", tmp_path / "out")
    assert "--calib" in line and "--source" not in line
    succeeds("ratslam", bag, "-o", tmp_path / "map", "--source", "cloud", "--no-report")
