# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``fusionslam ros2 check`` on a live ROS 2: bags that are played, whole and lacking something."""

import signal
import subprocess
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from bags import drive, without
from benchmarks.ros.ros2_world import JAZZY, Ros2World, fusionslam, lacking
from benchmarks.ros.world import wait_until
from fusionslam.sensors.messages import Event
from robot_checks import AS_LAUNCHED, REMAPPINGS, Result, check_live, new_bag
from rows import rows

pytestmark = [pytest.mark.nightly, pytest.mark.skipif(bool(lacking), reason=lacking)]

PYTHON = str(JAZZY / "bin" / "python")
PUBLISH = """
import sys, time
import rclpy
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Imu, PointCloud2
rclpy.init()
node = rclpy.create_node("driver")
kind = {"Imu": Imu, "PointCloud2": PointCloud2}[sys.argv[1]]
publisher = node.create_publisher(kind, "/points", qos_profile_sensor_data)
print("is ready", flush=True)
while True:
    publisher.publish(kind())
    time.sleep(0.1)
"""


@pytest.fixture
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ros2World]:
    with Ros2World(tmp_path_factory.mktemp("ros2")) as running:
        yield running


def check(world: Ros2World, *arguments: str, seconds: float = 6.0) -> Result:
    """Check for some time, as processes find each other within 3 s."""
    return check_live(world, PYTHON, "ros2", *arguments, seconds=seconds)


def command(world: Ros2World, *arguments: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        fusionslam("ros2", "check", "--seconds", "6", *arguments),
        env=world.environment,
        cwd=world.folder,
        capture_output=True,
        text=True,
        timeout=600,
    )


@contextmanager
def playing(world: Ros2World, events: Iterable[Event]) -> Iterator[None]:
    """Play a bag of these events once the check listens."""
    player = world.start_player(new_bag(world, events), "--wait", "0.5")
    try:
        yield
    finally:
        world.end(player)


def publish(world: Ros2World, name: str, kind: str) -> "subprocess.Popen[Any]":
    """A driver of scans that are best effort, as those of most drivers."""
    process = world.run(name, [PYTHON, "-c", PUBLISH, kind])
    wait_until(lambda: "is ready" in world.log(name), f"{name} to publish")
    return process


def test_the_remappings_that_it_names_make_it_well(world: Ros2World) -> None:
    with playing(world, drive(40)):
        found = check(world, "odom:=/wheels", "-p", "node.queue:=50")
    assert not found.works and found.problems["scans"] == "not-published"
    assert {*found.again} == {*REMAPPINGS, "odom:=/odom", "-p", "node.queue:=50"}
    with playing(world, drive(40)):
        found = check(world, *found.again)
    assert found.works and found.problems["true poses"] == "not-published" and not found.again
    assert "2.00 Hz" in found.rows["topic /points"]
    assert found.rows["extrinsics"] == "camera <- base <- velodyne, from TF"
    assert found.nodes[-1] == "ratslam" and found.launch[3:5] == [
        "ratslam.launch.py",
        "scan:=/points",
    ]


def test_the_command_prints_overview_findings_and_advice(world: Ros2World) -> None:
    with playing(world, without(without(drive(40), "/camera/camera_info"), "/tf_static")):
        done = command(world, "--ros-args", "-r", "camera/rgb/image_raw:=/camera/image")
    assert done.returncode == 1, done.stderr
    lines = done.stdout.splitlines()
    assert any(line.startswith("topic /points") for line in lines)
    faults = {line.split()[1] for line in lines if line.startswith("fault")}
    assert {"CameraInfo", "TF", "fusing", "scans"} <= faults
    again = next(line for line in lines if "fusionslam ros2 check " in line)
    assert {*again.split("fusionslam ros2 check ")[1].split()} == {*REMAPPINGS[:2]}


def test_best_effort_scans_of_several_drivers_are_reported(world: Ros2World) -> None:
    for name in ("front", "rear"):
        publish(world, name, "PointCloud2")
    found = check(world, *AS_LAUNCHED)
    assert found.problems["scans"] == "many-publishers"
    assert found.problems["scans QoS"] == "best-effort"
    assert "scans type" not in found.problems


def test_a_publisher_of_another_type_on_the_same_topic_is_a_fault(world: Ros2World) -> None:
    publish(world, "other", "Imu")
    assert check(world, *AS_LAUNCHED).problems["scans"] == "wrong-type"
    publish(world, "scanner", "PointCloud2")
    found = check(world, *AS_LAUNCHED)
    assert found.problems["scans type"] == "other-definition"
    assert "topic /points" in found.rows


def test_no_robot_and_sim_time_without_a_clock_are_named(world: Ros2World) -> None:
    found = check(world, "-p", "use_sim_time:=true", seconds=1)
    assert not found.works and not found.nodes
    assert found.problems["graph"] == "no-topics" and found.problems["clock"] == "no-clock"


@rows(
    "arguments, advice",
    [
        (("-p", "fusion.sorce:=stereo"), "did you mean 'source'"),
        (("-p", "online.wait:=soon"), "online.wait"),
        (("-p", "online.wait"), "online.wait"),
        (("_fusion/source:=stereo",), "-p NAME:=VALUE"),
        (("odom=/wheels",), "NAME:=TOPIC"),
        (("--frob",), "--frob"),
    ],
)
def test_wrong_arguments_are_refused(
    world: Ros2World, arguments: tuple[str, ...], advice: str
) -> None:
    done = command(world, *arguments)
    (line,) = done.stderr.splitlines()
    assert done.returncode == 2 and line.startswith("error: ") and advice in line


def test_ctrl_c_ends_it_at_once_and_cleanly(world: Ros2World) -> None:
    process = world.run("check", fusionslam("ros2", "check", "--seconds", "60"))
    wait_until(lambda: "waiting" in world.log("check"), "the check to listen")
    assert world.end(process, signal.SIGINT) == 130
    assert world.log("check").splitlines()[-1] == "interrupted: nothing was written"
