# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A node without /odom tracks scans and IMU itself, uses and publishes that, and reports it."""

from pathlib import Path

import numpy as np
import pytest

from error_codes import has_code
from fusionslam import open_dataset
from fusionslam.datasets.bags import open_bag
from fusionslam.datasets.bags.messages import value_of
from fusionslam.errors import ConfigError
from fusionslam.mapping import PlaceMap
from fusionslam.odometry import LidarOdometryConfig
from fusionslam.pipelines.lidar_odometry import track_lidar
from fusionslam.ros.nodes import node_class
from fusionslam.sensors.messages import FrameTransforms, Imu, Odometry, Scan
from inertial_house import inertial_house
from ros_master import needs_ros
from ros_node import Desk

pytestmark = needs_ros
pytest.importorskip("rko_lio", reason="the library of odometry by LiDAR and IMU is an extra")
pytest.importorskip("gtsam", reason="the library of pose graphs is an extra")


def start(path: Path, odometry: str) -> Desk:
    return Desk(
        "mapper",
        map={"file": str(path), "session": "today"},
        fusion={"source": "cloud"},
        descriptor="m2dp",
        odometry=odometry,
    )


def drive(desk: Desk, bag_path: Path, scans: int, *, imu: bool = True) -> None:
    """What scanner, IMU and robot_state_publisher say until the last of some scans ends."""
    count = 0
    with open_bag(bag_path) as bag:
        for event in bag.events():
            message = event.message
            count += isinstance(message, Scan)
            if count > scans:
                break
            if isinstance(message, Scan):
                desk.give("velodyne_points", message)
            elif isinstance(message, Imu) and imu:
                desk.give("imu", message)
            elif isinstance(message, FrameTransforms):
                links = tuple(each for each in message.transforms if each.static)
                if links:
                    desk.give("/tf_static", FrameTransforms(transforms=links))


@pytest.mark.slow
def test_a_map_is_made_by_scans_and_imu(tmp_path: Path) -> None:
    house, path = inertial_house(), tmp_path / "site.fsmap"
    dataset = open_dataset(house, sensors=["points"])[:20]
    track = track_lidar(dataset, LidarOdometryConfig(imu="always"))
    desk = start(path, "inertial")
    assert "odom" not in desk.worker.inputs
    drive(desk, house, 20)
    desk.worker.idle()
    report = desk.node.report()
    assert "by scans and IMU (gravity 9." in str(report["odometry"])
    assert report["odometry tracked"] == report["frames"] == 20
    assert report["without odometry"] == 0
    assert report["motion stays"] == 1  # within the last, as nothing reaches its end
    assert desk.problems() == {}
    desk.node.close()
    moved = [value_of(each, "nav_msgs/Odometry", "odom") for each in desk.outlet.of("odom")]
    assert all(isinstance(each, Odometry) for each in moved)
    np.testing.assert_array_equal([each.stamp_ns for each in moved], track.stamps_ns)
    # A quaternion on the line.
    np.testing.assert_allclose([each.pose for each in moved], track.poses, atol=1e-12)
    links = [value_of(each, "tf2_msgs/TFMessage", "/tf") for each in desk.outlet.of("/tf")]
    (last,) = links[-1].transforms
    assert (last.parent, last.child) == ("odom", moved[-1].child_frame_id)
    np.testing.assert_allclose(last.parent_from_child, track.poses[-1], atol=1e-12)
    with PlaceMap.open(path, read_only=True) as site:
        numbers = site.frames("today")
        # Between poses the robot moves along arcs, whose ends are rounded.
        np.testing.assert_allclose(site.odometry("today"), track.poses[numbers], atol=1e-12)


def test_an_imu_that_is_silent_is_reported(tmp_path: Path) -> None:
    desk = start(tmp_path / "site.fsmap", "inertial")
    assert "imu" in [each.topic for each in desk.worker.silent]
    drive(desk, inertial_house(), 3, imu=False)
    desk.worker.idle()
    (problem,) = (each for each in desk.problems() if each.startswith("odom: "))
    assert "the IMU has said nothing yet" in problem and desk.problems()[problem] == 3
    report = desk.node.report()
    assert report["odometry scans left out"] == report["frames"] == 3
    assert report["odometry"] == "waiting for scans and IMU"
    desk.node.close()


def test_only_nodes_with_odometry_of_their_own_publish_it() -> None:
    for name, published in (("mapper", {"odom"}), ("data_fusion", {"odom", "/tf"})):
        kind = node_class(name)
        own = kind.defaults.model_copy(update={"odometry": "lidar"})
        assert kind.outputs_of(kind.defaults) == kind.outputs
        assert {*kind.outputs_of(own)} - {*kind.outputs} == published


def test_stereo_pairs_have_no_odometry_of_scans() -> None:
    with pytest.raises(ConfigError, check=has_code("no-scans", "~odometry")):
        Desk("data_fusion", fusion={"source": "stereo"}, odometry="inertial")


@pytest.mark.slow
def test_of_several_scanners_the_leading_one_tells_the_motion() -> None:
    pytest.importorskip("kiss_icp", reason="odometry by scans is an extra")
    pytest.importorskip("embreex", reason="the simulator is an extra")
    from fusionslam.sim.simulator import SimulationConfig, simulate
    from worlds import hall, two_scanners, winding

    events = [*simulate(hall(), two_scanners(), winding(), SimulationConfig(seed=2))]
    names = {"/front": "velodyne_points", "/rear": "rear_points", "/tf_static": "/tf_static"}
    poses, sizes = [], []
    for scanners in ([], ["rear"]):
        fusion = {"source": "cloud", "frame": "scan", "ground": "none"}
        desk = Desk("data_fusion", scanners=scanners, fusion=fusion, odometry="lidar")
        for event in events:
            if event.topic in names and (scanners or event.topic != "/rear"):
                desk.give(names[event.topic], event.message)
        desk.worker.idle()
        moved = [value_of(each, "nav_msgs/Odometry", "odom") for each in desk.outlet.of("odom")]
        poses.append([each.pose for each in moved if isinstance(each, Odometry)])
        sizes.append([each.width * each.height for each in desk.outlet.of("rgb_cloud")])
        desk.node.close()
    assert len(poses[0]) == len(sizes[0]) == len(sizes[1]) == 30
    np.testing.assert_array_equal(*poses)
    assert all(both > 1.5 * one for one, both in zip(*sizes, strict=True))
