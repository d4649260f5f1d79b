# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Findings of ``fusionslam ros check`` in a robot's messages."""

import dataclasses
from collections.abc import Iterable

import numpy as np
import pytest

from bags import (
    INFOS,
    SECOND,
    START,
    changed,
    copies,
    delayed,
    drive,
    picture,
    static,
    stereo_drive,
    translation,
    without,
)
from bags import TOPICS as TOPICS_OF_PAIR
from cli import fails
from fusionslam.errors import ConfigError
from fusionslam.ros.check.graph import ROS2
from fusionslam.sensors.messages import Event, FrameTransform, FrameTransforms, Imu
from robots import TOPICS, check_events, faults, finding, problems
from ros_master import needs_ros
from rows import rows

ELSEWHERE = {**TOPICS, "left": "/camera/rgb/image_raw", "camera_info": "/camera/rgb/camera_info"}
CLOUD = {"/points": "sensor_msgs/PointCloud2"}
GREY = picture().image[:, :, 0].copy()
ON_CLOUDS = ["data_fusion", "lv_builder", "lv_matching", "loop_closure"]


def moving(topic_events: Iterable[Event], delay_s: float) -> list[Event]:
    """The scanner on a mast that turns: its transform arrives late."""
    events = [e for e in topic_events if e.topic != "/tf_static"]
    fixed = FrameTransforms(
        transforms=(static("base", "camera", drive()[0].message.transforms[1].parent_from_child),)
    )
    events.insert(0, Event("/tf_static", START, fixed))
    for k in range(60):
        stamp_ns = START + k * SECOND // 25
        mast = FrameTransform(
            stamp_ns=stamp_ns,
            parent="base",
            child="velodyne",
            parent_from_child=translation(-0.1, 0, 0.3),
        )
        arrival_ns = stamp_ns + round(delay_s * SECOND)
        events.append(Event("/tf", arrival_ns, FrameTransforms(transforms=(mast,))))
    return events


def test_a_robot_that_has_everything_has_no_problem_but_the_missing_truth() -> None:
    check = check_events(drive())
    assert check.works and not check.again
    assert problems(check) == {"true poses": "not-published"}
    rows = dict(check.overview.rows)
    assert rows["extrinsics"] == "camera <- base <- velodyne, from TF"
    assert "2.00 Hz" in rows["topic /points"] and "10.00 Hz" in rows["topic /camera/image"]
    assert "60.0 60.0 px" in rows["camera left"]
    # The camera looks 56 degrees wide: so many of the 41 points that 4 m ahead are 5 cm apart.
    assert finding(check, "fusing").fine and "41 points" in finding(check, "fusing").detail
    assert check.nodes == [*ON_CLOUDS, "mapper", "ratslam"] and check.lacking == ["truth"]


def test_a_guessed_topic_gives_a_remapping_that_suffices() -> None:
    check = check_events(drive(), asked=ELSEWHERE)
    assert not check.works and faults(check) == {"images", "CameraInfo"}
    assert check.again == [
        "camera/rgb/image_raw:=/camera/image",
        "camera/rgb/camera_info:=/camera/camera_info",
    ]
    assert finding(check, "images").fields == (check.again[0],)
    assert finding(check, "fusing").fine and "data_fusion" in check.nodes
    assert check.launch[3:] == [
        "ratslam",
        "scan:=/points",
        "image:=/camera/image",
        "camera_info:=/camera/camera_info",
    ]


def test_a_topic_of_another_type_is_named_with_what_would_fit() -> None:
    check = check_events(
        without(drive(), "/points"),
        asked={**TOPICS, "points": "/scan"},
        also={"/scan": "sensor_msgs/LaserScan", "/cloud": "sensor_msgs/PointCloud2"},
    )
    scans = finding(check, "scans")
    assert (scans.code, scans.fields) == ("wrong-type", ("velodyne_points:=/cloud",))
    assert "sensor_msgs/LaserScan" in scans.detail


def test_what_our_own_nodes_publish_is_no_sensor() -> None:
    check = check_events(
        without(drive(), "/points"),
        also={"/rgb_cloud": "sensor_msgs/PointCloud2"},
        publishers={"/rgb_cloud": ["/robot/data_fusion"]},
    )
    assert (finding(check, "scans").code, finding(check, "scans").fields) == ("not-published", ())
    assert finding(check, "fusing").code == "no-frame"


def test_two_publishers_of_a_topic_are_both_named() -> None:
    check = check_events(drive(), publishers={"/points": ["/front", "/rear"]})
    assert finding(check, "scans").code == "many-publishers"
    assert finding(check, "scans").fields == ("/front", "/rear")
    assert check.works


def test_publishers_of_ros_2_that_do_not_resend_are_named() -> None:
    reliable = {"/points": False, "/camera/image": True, "/odom": False}
    check = check_events(drive(), advice=ROS2, reliable=reliable)
    assert check.works and not faults(check)
    assert problems(check) == {"true poses": "not-published", "scans QoS": "best-effort"}


def test_another_definition_of_a_type_is_a_fault_if_the_topic_is_needed() -> None:
    foreign = {"/points": ["/humble"], "/odom": ["/humble"]}
    check = check_events(drive(), advice=ROS2, foreign=foreign)
    assert faults(check) == {"scans type"}
    assert finding(check, "odometry type").fields == ("/humble",)


def test_advice_for_ros_2_is_in_its_own_words() -> None:
    check = check_events(without(drive(), "/tf_static"), advice=ROS2, asked=ELSEWHERE)
    details = " ".join(each.detail for each in check.findings)
    assert "--child-frame-id camera" in details and "-r camera/rgb/image_raw:=/camera" in details
    assert not any(word in details for word in ("rosrun", "rosparam", "rosbag", "_online"))
    assert check.launch[:3] == ["ros2", "launch", "fusionslam_ros2"]


def test_a_silent_topic_says_whether_its_publisher_can_be_reached() -> None:
    events = without(drive(), "/points")
    assert finding(check_events(events, also=CLOUD), "scans rate").code == "silent"
    check = check_events(events, also=CLOUD, unreachable={"/driver": "http://robot:4242"})
    rate = finding(check, "scans rate")
    assert (rate.code, rate.fields) == ("unreachable", ("/driver", "http://robot:4242"))
    assert not check.works


def test_without_odometry_clouds_are_made_but_no_map() -> None:
    check = check_events(without(drive(), "/odom"), parameters={"fusion": {"frame": "scan"}})
    assert check.works and problems(check)["odometry"] == "not-published"
    assert "odometry" not in faults(check)
    assert check.nodes == ON_CLOUDS and check.launch[3] == "two_stages"


def test_true_poses_are_found_and_make_judging_possible() -> None:
    truth = copies(changed(drive(), "/odom", frame_id="world"), "/odom", "/truth")
    check = check_events([*drive(), *truth])
    assert not problems(check) and not check.lacking
    assert check.nodes == [*ON_CLOUDS, "lv_analyzer", "lv_dataset_creator", "mapper", "ratslam"]
    assert "truth:=/truth" in check.launch


def felt(topic: str = "/imu", frame: str = "velodyne", weight: float = 9.81) -> list[Event]:
    """The drive with an IMU."""
    events = drive()
    last = events[-1].time_ns
    for stamp_ns in range(START, last, SECOND // 100):
        imu = Imu(
            stamp_ns=stamp_ns,
            frame_id=frame,
            angular=np.zeros(3),
            linear=np.array([0.0, 0.0, weight]),
        )
        events.append(Event(topic, stamp_ns, imu))
    return events


def test_an_imu_is_looked_at_where_there_is_one() -> None:
    assert "IMU" not in {each.what for each in check_events(drive()).findings}
    check = check_events(felt())
    assert finding(check, "IMU").fine and check.works
    assert set(problems(check)) == {"true poses"}
    guessed = check_events(felt("/imu/data"))
    assert problems(guessed)["IMU"] == "not-published" and guessed.works
    assert finding(guessed, "IMU").fields == ("imu:=/imu/data",) and not faults(guessed)
    assert "imu:=/imu/data" in guessed.again
    unlinked = check_events(felt(frame="somewhere"))
    assert problems(unlinked)["TF IMU"] == "no-frame" and not faults(unlinked)
    in_g = check_events(felt(weight=1.0))
    assert problems(in_g)["IMU content"] == "imu-unit" and not faults(in_g)
    nameless = check_events(felt(frame=""))
    assert problems(nameless)["IMU content"] == "no-frame-name" and not faults(nameless)


def test_odometry_that_data_fusion_takes_for_the_truth_is_reported() -> None:
    check = check_events(changed(drive(), "/odom", frame_id="world"))
    content = finding(check, "odometry content")
    assert content.code == "taken-for-truth"
    assert content.fields == ("_online/odometry_frame:=world",)


@rows(
    "changes",
    [
        {"camera_matrix": np.zeros((3, 3)), "projection": np.zeros((3, 4))},
        {"size": (32, 24)},
        {"distortion": np.ones(5), "distortion_model": "double_sphere"},
    ],
)
def test_a_calibration_that_cannot_be_used_is_a_fault(changes: dict[str, object]) -> None:
    check = check_events(changed(drive(), "/camera/camera_info", **changes))
    assert not check.works and faults(check) == {"fusing"}
    assert "CameraInfo" in finding(check, "fusing").detail
    assert check.nodes == ["ratslam", "lv_matching with _source:=visual_templates"]
    assert check.launch[3] == "visual"


def test_stamps_of_zero_are_a_fault_unless_arrival_counts() -> None:
    events = list(changed(drive(delay_ns=0), "/points", stamp_ns=0))
    check = check_events(events)
    rate = finding(check, "scans rate")
    assert (rate.code, rate.fields) == ("zero-stamps", ("5",)) and not check.works
    arrived = check_events(events, parameters={"node": {"stamps": "arrival"}})
    assert arrived.works and "scans rate" not in problems(arrived)


@rows("delay_s", [2.5, 3600])
def test_a_camera_whose_clock_is_off_is_found(delay_s: float) -> None:
    check = check_events(delayed(drive(), "/camera/image", round(delay_s * SECOND)))
    clock, fusing = finding(check, "clock"), finding(check, "fusing")
    assert (clock.code, clock.fields) == ("other-clock", ("/camera/image",))
    assert (fusing.code, fusing.fields[0]) == ("no-frame", "no-pairs")


def test_odometry_of_another_clock_than_the_scans_is_reported() -> None:
    check = check_events(delayed(drive(), "/odom", -4 * SECOND))
    assert finding(check, "clock").fields == ("/odom",) and check.works


def test_stamps_of_a_bag_are_as_good_as_those_of_now() -> None:
    check = check_events(dataclasses.replace(e, time_ns=e.time_ns + 900 * SECOND) for e in drive())
    assert finding(check, "clock").fine and "900 s" in finding(check, "clock").detail
    assert check.works


def test_stamps_that_go_back_are_in_the_overview() -> None:
    events = [e for e in drive() if e.topic != "/points"]
    scans = [e for e in drive() if e.topic == "/points"]
    scans[2], scans[3] = (
        dataclasses.replace(scans[2], message=scans[3].message),
        dataclasses.replace(scans[3], message=scans[2].message),
    )
    check = check_events([*events, *scans])
    assert "1 step back" in dict(check.overview.rows)["topic /points"] and check.works


def test_a_bag_that_begins_anew_does_not_stop_anything() -> None:
    again = [dataclasses.replace(e, time_ns=e.time_ns + 3 * SECOND) for e in drive()]
    check = check_events([*drive(), *again])
    assert "1 step back" in dict(check.overview.rows)["topic /camera/image"] and check.works


def test_a_camera_that_looks_elsewhere_is_a_fault() -> None:
    own, turned = drive()[0].message.transforms, np.diag([-1.0, -1.0, 1.0, 1.0])
    behind = dataclasses.replace(own[1], parent_from_child=turned @ own[1].parent_from_child)
    check = check_events(changed(drive(), "/tf_static", transforms=(own[0], behind)))
    assert faults(check) == {"fusing"} and finding(check, "fusing").code == "no-cloud"
    assert not check.works


@rows(
    "topic, changes, what, code, works",
    [
        ("/points", {"stamp_ns": START}, "scans rate", "constant-stamps", True),
        ("/points", {"points": np.full((41, 3), np.nan, "f4")}, "fusing", "no-cloud", False),
        ("/points", {"frame_id": ""}, "scans content", "no-frame-name", False),
        ("/camera/image", {"image": GREY}, "images content", "grey-images", True),
    ],
)
def test_messages_that_make_no_sense_or_are_grey_are_reported(
    topic: str, changes: dict[str, object], what: str, code: str, works: bool
) -> None:
    check = check_events(changed(drive(), topic, **changes))
    assert finding(check, what).code == code and check.works == works


def test_missing_static_transforms_are_reported_with_what_to_publish() -> None:
    check = check_events(without(drive(), "/tf_static"))
    camera = finding(check, "TF camera")
    assert (camera.code, camera.fields) == ("no-frame", ("velodyne", "camera"))
    assert "static_transform_publisher" in camera.detail and "rosbag play" in camera.detail
    assert not check.works and finding(check, "fusing").fields == ("no-camera-pose", "velodyne")


def test_two_trees_are_to_be_linked_at_their_root() -> None:
    pairs = (("base", "camera"), ("mast", "velodyne"))
    links = tuple(static(parent, child, translation(0.1)) for parent, child in pairs)
    check = check_events(changed(drive(), "/tf_static", transforms=links))
    assert finding(check, "TF camera").code == "frames-not-linked"
    assert finding(check, "TF camera").fields == ("camera", "mast")
    assert finding(check, "TF robot").fields == ("base", "mast")


def test_loops_and_second_parents_are_in_the_overview_and_do_not_stop_anything() -> None:
    own = drive()[0].message.transforms
    for parent, child, word in (("velodyne", "base", "loop"), ("mast", "camera", "'mast'")):
        wrong = static(parent, child, np.eye(4))
        check = check_events(changed(drive(), "/tf_static", transforms=(*own, wrong)))
        assert word in dict(check.overview.rows)["refused"] and check.works, word


def test_transforms_that_come_later_than_scans_wait_are_reported() -> None:
    prompt = check_events(moving(drive(), 0.02))
    assert prompt.works and "25.00 Hz" in dict(prompt.overview.rows)["topic /tf"]
    slow = check_events(moving(drive(), 0.8), parameters={"online": {"wait": 0.5}})
    delay = finding(slow, "TF delay")
    assert (delay.code, delay.fields) == ("late-transforms", ("_online/wait:=1.6",))


def test_a_robot_without_a_name_is_to_be_named() -> None:
    check = check_events(without(drive(), "/odom"))
    assert finding(check, "TF robot").code == "no-robot-frame"
    assert not check.works
    named = check_events(without(drive(), "/odom"), parameters={"online": {"robot_frame": "base"}})
    assert named.works


def test_sim_time_without_a_clock_is_a_fault() -> None:
    missing = finding(check_events(drive(), sim_time=True, clock=False), "clock")
    assert (missing.code, missing.fields) == ("no-clock", [])
    also = {"/clock": "rosgraph_msgs/Clock"}
    paused = finding(check_events(drive(), sim_time=True, clock=False, also=also), "clock")
    assert (paused.code, paused.fields) == ("no-clock", ["/clock"])


def test_a_stereo_pair_needs_no_scans() -> None:
    sides = {"left": "camera_info", "right": "right_camera_info"}
    asked = {**TOPICS, **TOPICS_OF_PAIR, **{sides[side]: name for side, name in INFOS.items()}}
    check = check_events(
        without(stereo_drive(), "/points"), asked=asked, parameters={"fusion": {"source": "stereo"}}
    )
    assert dict(check.overview.rows)["stereo"] == "baseline 0.400 m"
    assert finding(check, "fusing").fine and "stereo pair" in finding(check, "fusing").detail
    # The launch files make clouds of scans.
    assert check.works and not check.launch and not check.files


def test_every_missing_sensor_is_a_fault() -> None:
    check = check_events([])
    assert faults(check) == {"scans", "images", "CameraInfo", "fusing"}
    assert not check.nodes and not check.works and not check.launch


def test_an_argument_that_is_no_remapping_is_refused_before_anything_is_asked() -> None:
    from fusionslam.ros.ros1.robot import connect

    with pytest.raises(ConfigError, match="odom=/wheels") as refused:
        connect(["odom=/wheels"]).__enter__()
    assert refused.value.code == "no-remapping"


@needs_ros
def test_no_master_is_an_error_that_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    for address in ("http://127.0.0.1:9", "here", "http://127.0.0.1:a"):
        monkeypatch.setenv("ROS_MASTER_URI", address)
        line = fails(1, "ros", "check")
        assert f" {address} (" in line and "roscore" in line
