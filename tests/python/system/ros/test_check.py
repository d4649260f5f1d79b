# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``fusionslam ros check`` on a live ROS: bags that are played, whole and lacking something."""

import signal
import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from bags import drive
from fusionslam.datasets.bags import messages as conversions
from fusionslam.datasets.bags import open_bag
from fusionslam.sensors.messages import Event
from robot_checks import REMAPPINGS, Result, check_live, new_bag
from ros_master import PlayedBag, RosWorld, needs_ros, wait_until

pytestmark = [needs_ros, pytest.mark.nightly]

COMMAND = (sys.executable, "-c", "from fusionslam.__main__ import main; main()", "ros", "check")


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RosWorld]:
    with RosWorld(tmp_path_factory.mktemp("ros")) as running:
        yield running


def check(world: RosWorld, *arguments: str, seconds: float = 1.5) -> Result:
    return check_live(world, sys.executable, "ros1", *arguments, seconds=seconds)


@contextmanager
def playing(world: RosWorld, events: Iterable[Event], images: str = "raw") -> Iterator[None]:
    """Play a bag of these events."""
    bag = new_bag(world, events, images)
    player = world.run("rosbag", ["rosbag", "play", "--quiet", str(bag)])
    try:
        yield
    finally:
        world.end(player)


def known_to_master(world: RosWorld) -> str:
    """All names of nodes and parameters that the master knows."""
    import rosgraph

    master = rosgraph.Master("/test", world.environment["ROS_MASTER_URI"])
    return f"{master.getSystemState()} {master.getParamNames()}"


def test_the_remappings_that_it_names_make_it_well_and_nothing_is_left_behind(
    world: RosWorld,
) -> None:
    with playing(world, drive(40)):
        found = check(world, "_node/queue:=50", "odom:=/wheels")
    assert not found.works and found.problems["scans"] == "not-published"
    assert {*found.again} == {*REMAPPINGS, "odom:=/odom", "_node/queue:=50"}
    assert found.launch[3:6] == ["ratslam", "scan:=/points", "image:=/camera/image"]
    with playing(world, drive(40)):
        # Long enough for rates, however late the first messages come.
        found = check(world, *found.again, seconds=4)
    assert found.works and found.problems == {"true poses": "not-published"} and not found.again
    assert "2.00 Hz" in found.rows["topic /points"]
    assert "10.00 Hz" in found.rows["topic /camera/image"]
    assert found.rows["extrinsics"] == "camera <- base <- velodyne, from TF"
    assert found.nodes[-1] == "ratslam"
    assert "fusionslam_check" not in known_to_master(world)


def test_the_command_prints_overview_findings_and_advice(world: RosWorld) -> None:
    with playing(world, drive(40)):
        done = subprocess.run(
            [*COMMAND, "--seconds", "1.5"],
            env=world.environment,
            cwd=world.folder,
            capture_output=True,
            text=True,
            timeout=600,
        )
    assert done.returncode == 1
    assert done.stderr.splitlines() == ["waiting: 0 of 2", "listening: 0 of 2"]
    lines = done.stdout.splitlines()
    assert any(line.startswith("topic /points") for line in lines)
    assert any(line.split()[:2] == ["fault", "scans"] for line in lines)
    again = next(line for line in lines if "fusionslam ros check " in line)
    assert again.split("fusionslam ros check ")[1].split() == [*REMAPPINGS]


def test_a_camera_whose_images_do_not_decode_is_a_fault(
    world: RosWorld, monkeypatch: pytest.MonkeyPatch
) -> None:
    cut = {"format": "jpeg", "data": np.frombuffer(b"\xff\xd8\xff", np.uint8)}
    monkeypatch.setattr(conversions, "compressed_parts", lambda image, stored: cut)
    with playing(world, drive(40), images="jpeg"):
        found = check(world, *REMAPPINGS)
    assert not found.works and found.problems["fusing"] == "no-frame"
    assert "lv_matching with _source:=visual_templates" not in found.nodes


def test_a_master_without_a_robot_and_sim_time_without_a_clock_are_named(world: RosWorld) -> None:
    import rosgraph

    master = rosgraph.Master("/test", world.environment["ROS_MASTER_URI"])
    master.setParam("/use_sim_time", True)
    try:
        found = check(world)
    finally:
        master.deleteParam("/use_sim_time")
    assert not found.works and not found.nodes
    assert found.problems["scans"] == "not-published" and found.problems["clock"] == "no-clock"


def test_ctrl_c_ends_it_at_once_and_cleanly(world: RosWorld) -> None:
    process = world.run("check", [*COMMAND, "--seconds", "60"])
    wait_until(lambda: "/tf_static" in known_to_master(world), "the check to listen")
    assert world.end(process, signal.SIGINT) == 130
    assert world.log("check").splitlines()[-1] == "interrupted: nothing was written"
    assert "fusionslam_check" not in known_to_master(world)


def test_a_drive_through_a_house_suffices(world: RosWorld, played_bag: PlayedBag) -> None:
    with open_bag(played_bag.path) as bag:
        transforms = [topic for topic in ("/tf", "/tf_static") if topic in bag.topics]
    topics = ["/velodyne_points", "/odom", played_bag.image, played_bag.camera_info, *transforms]
    # Static transforms come once, at the start: the check has to be there before.
    options = ["--quiet", "--wait-for-subscribers", "--topics", *topics]
    player = world.run("rosbag", ["rosbag", "play", *options, "--bags", str(played_bag.path)])
    try:
        found = check(world, *played_bag.sensors, seconds=4)
    finally:
        world.end(player)
    assert found.works and found.problems == {"true poses": "not-published"}
    assert "ratslam" in found.nodes
