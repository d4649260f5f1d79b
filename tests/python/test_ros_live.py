# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The nodes on a live ROS give what the offline commands give on the same bag."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from command_line import succeeds
from fusionslam.datasets.bags import open_bag
from fusionslam.datasets.bags.conversions import stamp_of, value_of
from fusionslam.messages import Scan
from fusionslam.ratslam.run_record import RatSlamRun
from ros_world import RosWorld, needs_ros

pytestmark = needs_ros

POINTS = ("--topic", "points=/velodyne_points")
CLOUD = ("--set", "fusion.frame=robot", "--set", "fusion.ground=height")
SENSORS = (
    "camera/rgb/image_raw:=/camera/image/compressed",
    "camera/rgb/camera_info:=/camera/camera_info",
)
OUTPUTS = (
    "/rgb_cloud",
    "/LocalView/Template",
    "/PoseCell/TopologicalAction",
    "/ExperienceMap/RobotPose",
    "/ExperienceMap/Map",
)


@dataclass(frozen=True)
class Offline:
    """What the commands make of the bag."""

    bag: Path
    clouds: list[Scan]
    run: RatSlamRun


@pytest.fixture(scope="module")
def offline(test_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Offline:
    bag, folder = test_data / "bags" / "small_house_20s.bag", tmp_path_factory.mktemp("offline")
    succeeds("fuse", bag, "-o", folder / "fused.bag", *POINTS, *CLOUD)
    succeeds("ratslam", bag, "-o", folder / "map", *POINTS, "--no-report")
    with open_bag(folder / "fused.bag") as fused:
        clouds = [event.message for event in fused.events(["/rgb_cloud"])]
    return Offline(bag, clouds, RatSlamRun.load(folder / "map" / "run.npz"))


def stamps(messages: list[Any]) -> list[int]:
    return [stamp_of(message.header.stamp) for message in messages]


@pytest.mark.parametrize("rate", [1, 5])
def test_clouds_ids_and_map_are_those_of_the_commands(
    rate: int, offline: Offline, tmp_path: Path
) -> None:
    with RosWorld(tmp_path) as world:
        listener = world.listen(*OUTPUTS)
        for name in ("ratslam", "lv_matching", "lv_builder"):
            world.node(name)
        world.node("data_fusion", *SENSORS)
        world.play(offline.bag, "-r", str(rate))
        listener.settle()
        found = listener.messages()
    assert_same_clouds(found["/rgb_cloud"], offline.clouds)
    assert_same_views(found["/LocalView/Template"], offline.run)
    assert_same_map(found, offline.run)


def assert_same_clouds(messages: list[Any], clouds: list[Scan]) -> None:
    assert stamps(messages) == [cloud.stamp_ns for cloud in clouds]
    for message, cloud in zip(messages, clouds, strict=True):
        scan = value_of(message, "sensor_msgs/PointCloud2", "/rgb_cloud")
        assert isinstance(scan, Scan) and scan.frame_id == "base_footprint"
        np.testing.assert_array_equal(scan.points, cloud.points)
        np.testing.assert_array_equal(scan.colors, cloud.colors)


def assert_same_views(messages: list[Any], run: RatSlamRun) -> None:
    assert stamps(messages) == run.stamps_ns[run.is_view].tolist()
    assert [message.current_id for message in messages] == run.view_ids[run.is_view].tolist()


def assert_same_map(found: dict[str, list[Any]], run: RatSlamRun) -> None:
    """Step by step, up to where a recording ends: the first odometry after the last view."""
    steps = len(run)
    poses = found["/ExperienceMap/RobotPose"]
    assert stamps(poses)[:steps] == run.stamps_ns.tolist()
    np.testing.assert_array_equal([place(each.pose) for each in poses[:steps]], run.poses[:, :2])
    np.testing.assert_allclose(
        [heading(each.pose.orientation) for each in poses[:steps]],
        np.angle(np.exp(1j * run.poses[:, 2])),
        atol=1e-9,
    )
    done = run.actions[:, 0] > 0
    actions = [
        each
        for each in found["/PoseCell/TopologicalAction"]
        if stamp_of(each.header.stamp) <= run.stamps_ns[-1]
    ]
    assert stamps(actions) == run.stamps_ns[done].tolist()
    told = [(each.action, each.src_id, each.dest_id) for each in actions]
    assert told == [tuple(row) for row in run.actions[done].tolist()]
    last = found["/ExperienceMap/Map"][-1]
    assert len(last.node) == last.node_count == len(run.nodes)
    np.testing.assert_array_equal([place(node.pose) for node in last.node], run.nodes[:, :2])
    assert [stamp_of(node.stamp) for node in last.node] == run.node_stamps_ns.tolist()
    links = [(edge.source_id, edge.destination_id) for edge in last.edge]
    assert links == [(link["source"], link["target"]) for link in run.links]


def place(pose: Any) -> tuple[float, float]:
    return pose.position.x, pose.position.y


def heading(rotation: Any) -> float:
    return 2 * float(np.arctan2(rotation.z, rotation.w))
