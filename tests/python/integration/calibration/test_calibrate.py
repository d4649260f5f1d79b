# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command calibrate finds the IMU of a LiDAR that is waved in a house."""

import json
from pathlib import Path

import pytest

from artefacts import artefact
from cli import refusal, succeeds
from fusionslam import open_dataset
from fusionslam.config import merged
from fusionslam.pipelines.sensor_calibration import FORMAT
from fusionslam.sim.catalogue import MADE, drive_through
from fusionslam.sim.recordings import recording_config, write_recording
from fusionslam.sim.robot import ImuMount

pytest.importorskip("kiss_icp", reason="odometry by LiDAR is an extra")


@pytest.fixture(scope="module")
def waved() -> Path:
    """A LiDAR with 180 columns is waved for 12 s; its IMU is turned by 90 degrees."""
    pytest.importorskip("embreex")

    def make(folder: Path) -> None:
        entry = MADE["house"]
        sway = {"roll_deg": 5.0, "pitch_deg": 5.0, "yaw_deg": 5.0, "rate_hz": 0.5, "heave_m": 0.03}
        lidar = {"position_m": [0.0, 0.0, 1.0], "azimuths": 180}
        changes = {"robot": {"sway": sway, "lidars": {"velodyne": lidar}}, "seconds": 12.0}
        config = merged(recording_config(entry, "turtlebot3_vlp16"), changes)
        imu = ImuMount(position_m=(0.1, -0.05, 0.9), tilt_deg=(0, 0, 90), frame_id="imu_link")
        robot = config.robot.model_copy(update={"cameras": {}, "imus": {"imu": imu}})
        config = config.model_copy(update={"robot": robot})
        place, drive = drive_through(entry.make(entry.settings), robot, config.plan)
        write_recording(place, drive, config, folder / "waved.bag")

    return artefact("waved-lidar", make) / "waved.bag"


@pytest.mark.slow
def test_the_imu_of_a_waved_lidar_is_found(waved: Path, tmp_path: Path) -> None:
    output = tmp_path / "calibration.json"
    said = succeeds("calibrate", waved, "-o", output).output
    found = json.loads(output.read_text())
    assert found["format"] == FORMAT and found["frames"] == ["velodyne", "imu_link"]
    assert "--frame-id velodyne --child-frame-id imu_link" in said
    truth = open_dataset(waved).points_from_imu()
    assert truth is not None
    estimates = {each["name"]: each for each in found["estimates"]}
    true = {f"IMU turned about {axis}": 0.0 for axis in "xyz"} | {"IMU late by": 0.0}
    true |= {f"IMU at {axis}": truth[row, 3] for row, axis in enumerate("xyz")}
    for name, value in true.items():
        if estimates[name]["value"] is None:
            assert "needed" in estimates[name]["missing"]
        else:
            # Of seven intervals that hold in 95 %, one would often fail.
            assert abs(estimates[name]["value"] - value) < 2 * estimates[name]["half_width"]
    for name in ("IMU turned about x", "IMU turned about y", "IMU late by"):
        assert estimates[name]["value"] == pytest.approx(0, abs=0.5 if "turned" in name else 5)


def test_a_recording_without_imu_is_refused(kitti: Path, tmp_path: Path) -> None:
    code, *_ = refusal(1, "calibrate", kitti, "-o", tmp_path / "calibration.json")
    assert code == "no-imu"
