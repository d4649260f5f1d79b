# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``fusionslam ros check`` on a live ROS: bags that are played, whole and lacking something."""

import re
import signal
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pytest

from bags import changed, drive, without, write_bag
from cli import fails
from fusionslam.datasets.bags import messages as conversions
from fusionslam.sensors.messages import Event
from ros_master import RosWorld, needs_ros, wait_until

pytestmark = needs_ros

REMAPPINGS = (
    "velodyne_points:=/points",
    "camera/rgb/image_raw:=/camera/image",
    "camera/rgb/camera_info:=/camera/camera_info",
)
AS_LAUNCHED = ("scan:=/points", "image:=/camera/image", "camera_info:=/camera/camera_info")
COMMAND = (sys.executable, "-c", "from fusionslam.__main__ import main; main()", "ros", "check")


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RosWorld]:
    with RosWorld(tmp_path_factory.mktemp("ros")) as running:
        yield running


def check(world: RosWorld, *arguments: str) -> tuple[int, str]:
    """Exit code of the command, and all that it says, in one line without spaces doubled."""
    done = subprocess.run(
        [*COMMAND, "--seconds", "1.5", *arguments],
        env=world.environment,
        cwd=world.folder,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert not done.stderr, done.stderr
    return done.returncode, " ".join(done.stdout.split())


def check_while_playing(
    world: RosWorld, events: Iterable[Event], *arguments: str, images: str = "raw"
) -> tuple[int, str]:
    """The same while a bag of these events is played."""
    bag = world.folder / "drive.bag"
    bag.unlink(missing_ok=True)
    write_bag(bag, events, images=images)
    player = world.run("rosbag", ["rosbag", "play", "--quiet", str(bag)])
    try:
        return check(world, *arguments)
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
    code, words = check_while_playing(world, drive(40), "_node/queue:=50", "odom:=/wheels")
    assert code == 1 and "fault scans /velodyne_points is not published" in words
    assert "With these remappings, this suffices for data_fusion" in words
    assert "to start: fusionslam ros launch ratslam scan:=/points image:=/camera/image" in words
    named = words.partition("to check again: fusionslam ros check ")[2].split()
    assert {*named} == {*REMAPPINGS, "odom:=/odom", "_node/queue:=50"}
    # Long enough for rates, however late the first messages come.
    code, words = check_while_playing(world, drive(40), *named, "--seconds", "4")
    assert code == 0 and "fault" not in words and "to check again" not in words, words
    assert "ok scans rate 2.00 Hz" in words and "ok images rate 10.00 Hz" in words
    assert "ok TF camera camera <- base <- velodyne" in words
    assert re.search(r"ok fusing possible: \d+ points of the first scan get a colour", words)
    assert "This suffices for data_fusion, lv_builder, lv_matching, loop_closure and" in words
    assert "fusionslam_check" not in known_to_master(world)


def test_what_a_robot_lacks_is_named(world: RosWorld) -> None:
    code, words = check_while_playing(world, without(drive(40), "/odom"), *REMAPPINGS)
    assert code == 1 and "note odometry /odom is not published" in words
    assert "fault TF robot the robot's frame is not known" in words
    lacking = without(without(drive(40), "/camera/camera_info"), "/tf_static")
    code, words = check_while_playing(world, lacking, *AS_LAUNCHED)
    assert code == 1
    assert "fault CameraInfo /camera/camera_info is not published, and no other" in words
    assert "fault TF camera no frame 'velodyne'" in words
    assert "fault fusing not possible: no CameraInfo" in words


def test_a_camera_without_calibration_whose_images_do_not_decode_is_named(
    world: RosWorld, monkeypatch: pytest.MonkeyPatch
) -> None:
    cut = {"format": "jpeg", "data": np.frombuffer(b"\xff\xd8\xff", np.uint8)}
    monkeypatch.setattr(conversions, "compressed_parts", lambda image, stored: cut)
    zeros = changed(drive(40), "/camera/camera_info", camera_matrix=np.zeros((3, 3)))
    code, words = check_while_playing(world, zeros, *REMAPPINGS, images="jpeg")
    assert code == 1
    assert re.search(
        r"fault images content \d+ cannot be read, the last one: /camera/image at", words
    )
    assert "is no JPEG or PNG picture" in words and "fusing not possible: no images" in words
    assert "/camera/camera_info has a camera matrix K of zeros: calibrate the camera" in words


def test_a_master_without_a_robot_and_sim_time_without_a_clock_are_named(world: RosWorld) -> None:
    import rosgraph

    master = rosgraph.Master("/test", world.environment["ROS_MASTER_URI"])
    master.setParam("/use_sim_time", True)
    try:
        code, words = check(world)
    finally:
        master.deleteParam("/use_sim_time")
    assert code == 1 and "This suffices for none of the nodes" in words
    assert "fault scans /velodyne_points is not published, and no other PointCloud2" in words
    assert "fault clock use_sim_time is set, but /clock is missing" in words


def test_ctrl_c_ends_it_at_once_and_cleanly(world: RosWorld) -> None:
    process = world.run("check", [*COMMAND, "--seconds", "60"])
    wait_until(lambda: "/tf_static" in known_to_master(world), "the check to listen")
    assert world.end(process, signal.SIGINT) == 130
    assert world.log("check") == "interrupted: nothing was written\n"
    assert "fusionslam_check" not in known_to_master(world)


def test_no_master_is_an_error_that_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    for address in ("http://127.0.0.1:9", "here", "http://127.0.0.1:a"):
        monkeypatch.setenv("ROS_MASTER_URI", address)
        line = fails(1, "ros", "check")
        assert f"no ROS master at {address} (" in line and "start roscore or the robot" in line


def test_the_small_house_suffices(world: RosWorld, test_data: Path) -> None:
    bag = str(test_data / "bags" / "small_house_20s.bag")
    # Its static transforms are not latched: the check has to be there before they come.
    topics = (
        *("/velodyne_points", "/camera/image/compressed", "/camera/camera_info", "/odom"),
        *("/tf", "/tf_static"),
    )
    options = ("--quiet", "--wait-for-subscribers", "--topics", *topics, "--bags", bag)
    player = world.run("rosbag", ["rosbag", "play", *options])
    try:
        code, words = check(world, "--seconds", "4")
    finally:
        world.end(player)
    assert code == 1 and "possible: 1554 points of the first scan get a colour" in words
    assert words.endswith(
        "camera/rgb/image_raw:=/camera/image/compressed camera/rgb/camera_info:=/camera/camera_info"
    )
