# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""On a live ROS, mapper makes the map that ``fusionslam map build`` makes of the same bag."""

import json
import signal
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli import succeeds
from fusionslam.datasets import open_dataset
from fusionslam.mapping import PlaceMap
from ros_master import PlayedBag, RosWorld, needs_ros, wait_until

pytestmark = needs_ros
pytest.importorskip("small_gicp", reason="the libraries of registration are an extra")
pytest.importorskip("gtsam", reason="the library of pose graphs is an extra")

POINTS = ("--topic", "points=/velodyne_points")
FILE = "_map/file:=site.fsmap"
_CALL = """
import json, sys
from fusionslam.ros.environment import need_ros
need_ros()
import rospy
from fusionslam.ros.messages.types import service_class
name, kind = sys.argv[1:]
answer = rospy.ServiceProxy(name, service_class(kind))()
print(json.dumps({slot: str(getattr(answer, slot)) for slot in answer.__slots__}))
"""


def call(world: RosWorld, name: str, kind: str) -> dict[str, str]:
    """The response of a service."""
    process = world.run("call", [sys.executable, "-c", _CALL, name, kind])
    assert process.wait(timeout=300) == 0, world.log("call")
    found: dict[str, str] = json.loads(world.log("call").splitlines()[-1])
    return found


def start(world: RosWorld, bag: PlayedBag, *parameters: str) -> Any:
    return world.node("mapper", *bag.sensors, FILE, *parameters)


def assert_same_map(path: Path, other: Path) -> None:
    with PlaceMap.open(path, read_only=True) as found, PlaceMap.open(other, read_only=True) as site:
        assert found.check() == [] and found.sessions == site.sessions
        for session in (each.name for each in site.sessions):
            stamps, poses = found.trajectory(session)
            wanted_stamps, wanted = site.trajectory(session)
            assert stamps.tolist() == wanted_stamps.tolist()
            assert found.frames(session).tolist() == site.frames(session).tolist()
            np.testing.assert_allclose(poses, wanted, rtol=0, atol=1e-9)
        assert len(found.edges) == len(site.edges)
        for edge, same in zip(found.edges, site.edges, strict=True):
            assert (edge.kind, edge.a, edge.b, edge.state) == (
                same.kind,
                same.a,
                same.b,
                same.state,
            )
            np.testing.assert_allclose(edge.pose, same.pose, rtol=0, atol=1e-9)
            np.testing.assert_allclose(edge.covariance, same.covariance, rtol=1e-6, atol=1e-12)


def test_the_map_of_two_drives_is_that_of_the_command(
    played_bag: PlayedBag, tmp_path: Path
) -> None:
    other = tmp_path / "other.fsmap"
    for session in ("monday", "tuesday"):
        succeeds("map", "build", played_bag.path, "-o", other, "--session", session, *POINTS)
    with RosWorld(tmp_path) as world:
        listener = world.listen("/mapper/cloud", "/mapper/grid", "/mapper/path", "/odom")
        for session, rate in (("monday", "1"), ("tuesday", "5")):
            node = start(world, played_bag, f"_map/session:={session}")
            world.play(played_bag.path, "-r", rate)
            listener.settle()
            assert call(world, "/mapper/localize", "fusionslam_ros/Localize")["found"] == "True"
            assert world.end(node) == 0, world.log("mapper")
        assert "Traceback" not in world.log("mapper")
        found = listener.messages()
    assert_same_map(tmp_path / "site.fsmap", other)
    assert not (tmp_path / "site.fsmap-wal").exists()
    with PlaceMap.open(other, read_only=True) as site:
        assert any(each.kind == "merge" for each in site.edges)
        assert found["/mapper/grid"] and found["/mapper/cloud"]
        assert len(found["/mapper/path"][-1].poses) == len(site.keyframes("tuesday"))


def test_a_map_outlives_a_killed_node_and_goes_on(played_bag: PlayedBag, tmp_path: Path) -> None:
    with RosWorld(tmp_path) as world:
        listener = world.listen("/odom")
        node = start(world, played_bag, "_map/session:=monday")
        world.play(played_bag.path, "-r", "4", "-u", "10")
        listener.settle()
        world.end(node, signal.SIGKILL)
        with PlaceMap.open(tmp_path / "site.fsmap", read_only=True) as site:
            stamps, frames = site.trajectory("monday")[0], site.frames("monday")
        node = start(world, played_bag, "_map/session:=monday")
        world.play(played_bag.path, "-r", "4", "-s", "10")
        listener.settle()
        assert world.end(node) == 0
    with PlaceMap.open(tmp_path / "site.fsmap", read_only=True) as site:
        after, numbers = site.trajectory("monday")[0], site.frames("monday")
        assert site.check() == [] and site.sessions[0].parts == (0,)
    assert after[: len(stamps)].tolist() == stamps.tolist() and len(stamps) > 3
    assert len(after) > len(stamps) + 3 and np.all(np.diff(after) > 0)
    assert numbers[: len(frames)].tolist() == frames.tolist() and np.all(np.diff(numbers) > 0)


def test_a_robot_that_starts_elsewhere_is_found_on_the_map(
    played_bag: PlayedBag, tmp_path: Path
) -> None:
    path = tmp_path / "site.fsmap"
    succeeds("map", "build", played_bag.path, "-o", path, "--session", "monday", *POINTS)
    before = path.read_bytes()
    with RosWorld(tmp_path) as world:
        listener = world.listen("/mapper/pose", "/odom")
        node = start(world, played_bag, "_map/read_only:=true")
        world.play(played_bag.path, "-s", "8", "--clock")
        listener.settle()
        restarted = world.end(world.core) is not None and world.start_core()
        assert restarted
        wait_until(lambda: "registered again" in world.log("mapper"), "the node to register")
        answer = call(world, "/mapper/localize", "fusionslam_ros/Localize")
        assert (answer["found"], answer["code"]) == ("True", "")
        call(world, "/mapper/forget_motion", "std_srvs/Empty")
        assert world.end(node) == 0
        poses = listener.messages()["/mapper/pose"]
    assert path.read_bytes() == before and len(poses) > 3
    dataset = open_dataset(played_bag.path, topics={"points": "/velodyne_points"})
    truth = {frame.stamp_ns: frame.odometry for frame in dataset}
    first = np.linalg.inv(dataset[0].odometry)
    for each in poses:
        wanted = (first @ truth[each.header.stamp.to_nsec()])[:3, 3]
        place = each.pose.pose.position
        assert np.linalg.norm([place.x, place.y, place.z] - wanted) < 0.1
