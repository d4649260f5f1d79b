# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The node live_view: messages of the other nodes reach viewers of Foxglove."""

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from error_codes import has_code
from foxglove_client import Viewer, cloud_of
from fusionslam import ConfigError
from fusionslam.ros.nodes import node_class
from fusionslam.ros.runtime.config import from_parameters
from fusionslam.sensors.messages import FrameTransform, FrameTransforms, Picture, Scan
from ros_master import needs_ros
from ros_node import Desk, colored_cloud

pytest.importorskip("foxglove", reason="foxglove-sdk is not installed")

SECOND = 10**9
STAMP = SimpleNamespace(sec=12, nanosec=5)
HEADER = SimpleNamespace(stamp=STAMP, frame_id="map")


class Watched:
    """A node without ROS, whose inputs take messages of any class, and a viewer of all it shows."""

    def __init__(self, **parameters: Any) -> None:
        kind = node_class("live_view")
        parameters.setdefault("port", 0)
        self.node = kind(from_parameters(kind.defaults, parameters), None)
        self.takes = {each.topic: each.take for each in self.node.inputs}
        self.viewer = Viewer(self.node.url)
        self.viewer.follow(self.node._server, *self.viewer.channels)

    def give(self, topic: str, message: Any) -> dict[str, Any]:
        """By topic: what is shown of a message."""
        before = self.node.counts.total()
        self.takes[topic](message)
        shown = self.node.counts.total() - before
        return {
            topic: message for topic, _, message in (self.viewer.receive() for _ in range(shown))
        }


@pytest.fixture
def watched() -> Iterator[Watched]:
    found = Watched()
    yield found
    found.node.close()
    assert found.viewer.receive_rest() == {}


def pose(x: float, y: float) -> SimpleNamespace:
    return SimpleNamespace(
        position=SimpleNamespace(x=x, y=y, z=0.0),
        orientation=SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0),
    )


def test_coloured_clouds_and_images_are_shown_under_their_topics(watched: Watched) -> None:
    points, colors = colored_cloud()
    scan = Scan(stamp_ns=SECOND, frame_id="base_link", points=points, colors=colors)
    found = cloud_of(watched.give("rgb_cloud", scan)["rgb_cloud"])
    assert np.array_equal(found[0], points) and np.array_equal(found[1], colors)
    image = np.full((40, 60), 77, np.uint8)
    shown = watched.give("rgb_image", Picture(stamp_ns=SECOND, frame_id="cam", image=image))
    assert (shown["rgb_image"].frame_id, shown["rgb_image"].format) == ("cam", "jpeg")


def test_the_map_is_shown_with_the_loops_that_were_closed(watched: Watched) -> None:
    for source, target, kind in ((0, 1, 1), (2, 0, 2)):
        action = SimpleNamespace(action=kind, src_id=source, dest_id=target)
        assert watched.give("PoseCell/TopologicalAction", action) == {}
    nodes = [SimpleNamespace(pose=pose(k, 2 * k)) for k in range(3)]
    edges = [SimpleNamespace(source_id=a, destination_id=b) for a, b in ((0, 1), (1, 2), (2, 0))]
    shown = watched.give(
        "ExperienceMap/Map", SimpleNamespace(header=HEADER, node=nodes, edge=edges)
    )
    parts = {each.id: each for each in shown["ExperienceMap/Map"].entities}
    assert [(dot.pose.position.x, dot.pose.position.y) for dot in parts["nodes"].spheres] == [
        (k, 2 * k) for k in range(3)
    ]
    assert list(parts["links"].lines[0].indices) == [0, 1, 1, 2, 2, 0]
    assert list(parts["loops"].lines[0].indices) == [2, 0]
    assert shown["ExperienceMap/size"] == {"nodes": 3, "edges": 3, "loops": 1}


def test_paths_and_poses_are_shown(watched: Watched) -> None:
    poses = [SimpleNamespace(pose=pose(k, 0)) for k in range(4)]
    for topic in ("ExperienceMap/Path", "mapper/path"):
        (path,) = watched.give(topic, SimpleNamespace(header=HEADER, poses=poses)).values()
        assert [each.position.x for each in path.poses] == [0, 1, 2, 3]
    place = SimpleNamespace(header=HEADER, pose=pose(5, 6))
    (shown,) = watched.give("ExperienceMap/RobotPose", place).values()
    assert (shown.pose.position.y, shown.timestamp.ToNanoseconds()) == (6, 12 * SECOND + 5)
    located = SimpleNamespace(header=HEADER, pose=SimpleNamespace(pose=pose(7, 8)))
    (shown,) = watched.give("mapper/pose", located).values()
    assert shown.pose.position.x == 7


def test_objects_probabilities_and_shares_are_numbers(watched: Watched) -> None:
    described = SimpleNamespace(header=HEADER, objects=9)
    assert watched.give("current_scene_description", described) == {
        "current_scene_description": {"objects": 9}
    }
    template = SimpleNamespace(
        header=HEADER, current_id=3, is_new=True, relative_rad=0.5, reason="new view 3"
    )
    shown = watched.give("LocalView/Template", template)
    assert shown["LocalView/Template"] == {"current_id": 3, "is_new": 1, "relative_rad": 0.5}
    assert shown["log"].message == "new view 3"
    names = ("query", "match", "distance", "probability", "overlap", "rejected")
    values = dict(zip(names, (40, 3, 0.25, 0.98, 0.7, 2), strict=True))
    shown = watched.give("loop_closures", SimpleNamespace(header=HEADER, **values))
    assert shown["loop_closures"] == values and "40" in shown["log"].message


def test_static_transforms_are_shown_together(watched: Watched) -> None:
    def link(child: str, static: bool) -> FrameTransform:
        return FrameTransform(
            stamp_ns=SECOND,
            parent="base_link",
            child=child,
            parent_from_child=np.eye(4),
            static=static,
        )

    for child in ("velodyne", "camera"):
        found = FrameTransforms(transforms=(link(child, True),))
        shown = watched.give("/tf_static", found)["/tf_static"]
    assert [each.child_frame_id for each in shown.transforms] == ["velodyne", "camera"]
    moving = FrameTransforms(transforms=(link("wheel", False),))
    (wheel,) = watched.give("/tf", moving)["/tf"].transforms
    assert wheel.timestamp.ToNanoseconds() == SECOND


def test_a_second_view_on_the_port_cannot_start(watched: Watched) -> None:
    port = watched.node._server.port
    with pytest.raises(ConfigError, match=str(port), check=has_code("port-in-use")):
        Watched(port=port)


@needs_ros
def test_messages_of_ros_1_reach_a_viewer() -> None:
    desk = Desk("live_view", port=0)
    points, colors = colored_cloud()
    with Viewer(desk.node.url) as viewer:
        viewer.follow(desk.node._server, "rgb_cloud")
        desk.give(
            "rgb_cloud", Scan(stamp_ns=SECOND, frame_id="base_link", points=points, colors=colors)
        )
        found = cloud_of(viewer.receive()[2])
    desk.node.close()
    assert np.array_equal(found[0], points) and np.array_equal(found[1], colors)
    assert not desk.problems()
