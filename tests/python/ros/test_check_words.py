# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What ``fusionslam ros check`` says of a robot's messages."""

import dataclasses
from collections.abc import Iterable, Iterator

import numpy as np
import pytest

from bags import (
    INFOS,
    SECOND,
    START,
    changed,
    drive,
    picture,
    static,
    stereo_drive,
    translation,
    without,
)
from bags import TOPICS as TOPICS_OF_PAIR
from fusionslam.errors import ConfigError
from fusionslam.sensors.messages import Event, FrameTransform, FrameTransforms
from robots import TOPICS, checked, faults, said

ELSEWHERE = {**TOPICS, "left": "/camera/rgb/image_raw", "camera_info": "/camera/rgb/camera_info"}


def late(events: Iterable[Event], topic: str, delay_s: float) -> Iterator[Event]:
    """The stamps of one topic, later than they were."""
    for event in events:
        if event.topic == topic:
            stamp_ns = event.message.stamp_ns + round(delay_s * SECOND)
            event = dataclasses.replace(
                event, message=dataclasses.replace(event.message, stamp_ns=stamp_ns)
            )
        yield event


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
    return sorted(events, key=lambda event: event.time_ns)


def test_a_robot_that_has_everything_is_told_so() -> None:
    check = checked(drive())
    assert check.works and not faults(check) and not check.remappings
    assert said(check, "scans") == "ok: /points of /driver"
    assert said(check, "scans rate") == "ok: 2.00 Hz"
    assert "41 points (x, y, z, intensity, ring), 0 % without return, 3.0 to 3.2 m" in said(
        check, "scans content"
    )
    assert said(check, "images content") == "ok: 64x48, Image, in 'camera'"
    assert "focal 60.0 60.0 px" in said(check, "CameraInfo content")
    assert said(check, "odometry content") == "ok: 'base' in 'odom'"
    assert said(check, "TF camera") == "ok: camera <- base <- velodyne"
    assert said(check, "TF robot") == "ok: base <- velodyne"
    assert said(check, "pairs").startswith("ok: 5 of 5 scans have an image within 0.1 s")
    # The camera looks 56 degrees wide: so many of the 41 points that 4 m ahead are 5 cm apart.
    assert said(check, "fusing").startswith("ok: possible: 41 points of the first scan")
    assert check.verdict.startswith(
        "This suffices for data_fusion, lv_builder, lv_matching, loop_closure and ratslam"
    )
    assert "lv_analyzer and lv_dataset_creator lack true poses" in check.verdict


def test_remappings_are_told_and_suffice() -> None:
    check = checked(drive(), asked=ELSEWHERE)
    assert not check.works and {*faults(check)} == {"images", "CameraInfo"}
    assert check.remappings == [
        "camera/rgb/image_raw:=/camera/image",
        "camera/rgb/camera_info:=/camera/camera_info",
    ]
    assert "/camera/rgb/image_raw is not published; give the nodes " in said(check, "images")
    assert said(check, "fusing").startswith("ok: possible")
    assert check.verdict.startswith("With these remappings, this suffices for data_fusion")
    assert check.launch == [
        "ratslam",
        "scan:=/points",
        "image:=/camera/image",
        "camera_info:=/camera/camera_info",
    ]


def test_a_topic_of_another_type_is_named_with_what_would_fit() -> None:
    check = checked(
        without(drive(), "/points"),
        asked={**TOPICS, "points": "/scan"},
        also={"/scan": "sensor_msgs/LaserScan", "/cloud": "sensor_msgs/PointCloud2"},
    )
    assert said(check, "scans") == (
        "fault: /scan is a sensor_msgs/LaserScan; give the nodes velodyne_points:=/cloud"
    )


def test_what_our_own_nodes_publish_is_no_sensor() -> None:
    check = checked(
        without(drive(), "/points"),
        also={"/rgb_cloud": "sensor_msgs/PointCloud2"},
        publishers={"/rgb_cloud": ["/robot/data_fusion"]},
    )
    assert "no other PointCloud2 would fit: start the scanner's driver" in said(check, "scans")
    assert said(check, "fusing") == "fault: not possible: no scans"


def test_two_publishers_of_a_topic_are_both_named() -> None:
    check = checked(drive(), publishers={"/points": ["/front", "/rear"]})
    assert said(check, "scans").startswith("note: /points has 2 publishers, /front, /rear: nodes")
    assert check.works


def test_a_silent_topic_says_whether_its_publisher_can_be_reached() -> None:
    events = without(drive(), "/points")
    cloud = {"/points": "sensor_msgs/PointCloud2"}
    assert "nothing arrived on /points in 5 s: is the sensor connected" in said(
        checked(events, also=cloud), "scans rate"
    )
    check = checked(events, also=cloud, unreachable={"/driver": "http://robot:4242"})
    assert (
        "/driver says that it is at http://robot:4242, where nothing answers: set ROS_IP"
        in said(check, "scans rate")
    )
    assert not check.works


def test_without_odometry_clouds_are_made_but_no_map() -> None:
    check = checked(without(drive(), "/odom"), parameters={"fusion": {"frame": "scan"}})
    assert check.works and said(check, "odometry").startswith("note: /odom is not published")
    assert "ratslam lacks odometry" in check.verdict and "ratslam" not in check.launch
    assert check.launch[0] == "two_stages"


def test_true_poses_are_found_and_make_judging_possible() -> None:
    truth = [
        Event("/truth", e.time_ns, dataclasses.replace(e.message, frame_id="world"))
        for e in drive()
        if e.topic == "/odom"
    ]
    check = checked([*drive(), *truth])
    assert said(check, "true poses content") == "ok: 'base' in 'world'"
    assert "lv_analyzer, lv_dataset_creator and ratslam" in check.verdict
    assert "truth:=/truth" in check.launch


def test_odometry_that_is_taken_for_the_truth_is_told() -> None:
    check = checked(changed(drive(), "/odom", frame_id="world"))
    assert "takes for true poses: _online/odometry_frame:=world" in said(check, "odometry content")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"camera_matrix": np.zeros((3, 3))}, "has a camera matrix K of zeros: calibrate"),
        ({"size": (32, 24)}, "is 64x48, its CameraInfo says 32x24"),
        (
            {"distortion": np.ones(5), "distortion_model": "double_sphere"},
            "double_sphere",
        ),
    ],
)
def test_a_calibration_that_cannot_be_used_is_a_fault(
    changes: dict[str, object], words: str
) -> None:
    check = checked(changed(drive(), "/camera/camera_info", **changes))
    assert words in said(check, "CameraInfo content")
    assert not check.works and said(check, "fusing").startswith("fault: not possible: ")
    assert (
        "lv_matching with _source:=visual_templates" in check.verdict
        and check.launch[0] == "visual"
    )


def test_stamps_of_zero_are_a_fault_unless_arrival_counts() -> None:
    events = list(changed(drive(delay_ns=0), "/points", stamp_ns=0))
    check = checked(events)
    assert "5 of 5 stamps are zero: the driver has to stamp" in said(check, "scans rate")
    assert not check.works
    arrived = checked(events, parameters={"node": {"stamps": "arrival"}})
    assert said(arrived, "scans rate") == "ok: 2.00 Hz"


def test_a_camera_whose_clock_is_off_is_found_out() -> None:
    check = checked(late(drive(), "/camera/image", 2.5))
    assert said(check, "pairs").startswith("fault: 0 of 5 scans have an image within 0.1 s")
    assert "set the clocks" in said(check, "pairs")
    assert "no image of some camera lies within max_difference" in said(check, "fusing")
    far = checked(late(drive(), "/camera/image", 3600))
    assert "stamps of /camera/image lie 3600 s after the time of this machine: set the clocks" in (
        said(far, "clock")
    )


def test_stamps_that_go_back_are_told() -> None:
    events = [e for e in drive() if e.topic != "/points"]
    scans = [e for e in drive() if e.topic == "/points"]
    scans[2], scans[3] = scans[3], scans[2]
    check = checked([*events, *scans])
    assert said(check, "scans rate").startswith("note: ") and "1 step back" in said(
        check, "scans rate"
    )


def test_a_bag_that_begins_anew_is_told() -> None:
    again = [dataclasses.replace(e, time_ns=e.time_ns + 3 * SECOND) for e in drive()]
    check = checked([*drive(), *again])
    assert "(1 step back)" in said(check, "images rate") and check.works
    assert "the nodes drop what waits" in said(check, "images rate")


def test_odometry_of_another_clock_than_the_scans_is_told() -> None:
    check = checked(late(drive(), "/odom", -4.0))
    assert said(check, "motion").startswith("note: odometry is stamped 4.0 s before the scans that")
    assert check.works and "motion" not in [each.what for each in checked(drive()).findings]


def test_a_camera_that_looks_elsewhere_is_told_with_the_usual_reason() -> None:
    own, turned = drive()[0].message.transforms, np.diag([-1.0, -1.0, 1.0, 1.0])
    behind = dataclasses.replace(own[1], parent_from_child=turned @ own[1].parent_from_child)
    check = checked(changed(drive(), "/tf_static", transforms=(own[0], behind)))
    assert "no point of the first scan falls into its image" in said(check, "fusing")
    assert "the optical one (z ahead, x right)?" in said(check, "fusing")
    assert not check.works


def test_a_scan_without_a_single_return_is_a_fault() -> None:
    nothing = np.full((41, 3), np.nan, np.float32)
    check = checked(changed(drive(), "/points", points=nothing))
    assert said(check, "scans content").endswith("all its points are NaN")
    assert not check.works


def test_images_of_grey_are_told() -> None:
    grey = picture().image[:, :, 0].copy()
    check = checked(changed(drive(), "/camera/image", image=grey))
    assert "they are grey, so clouds are, too" in said(check, "images content")
    assert check.works


def test_missing_static_transforms_are_told_with_what_to_publish() -> None:
    check = checked(without(drive(), "/tf_static"))
    assert "no frame 'velodyne'; known: none" in said(check, "TF camera")
    assert "a bag sends /tf_static once" in said(check, "TF camera")
    assert "static_transform_publisher X Y Z YAW PITCH ROLL velodyne camera" in said(
        check, "TF camera"
    )
    assert not check.works and "no frame 'velodyne'" in said(check, "fusing")


def test_two_trees_are_to_be_linked_at_their_root() -> None:
    links = FrameTransforms(
        transforms=(
            static("base", "camera", translation(0.1)),
            static("mast", "velodyne", translation(0.1)),
        )
    )
    check = checked(changed(drive(), "/tf_static", transforms=links.transforms))
    assert "no transform links 'camera' and 'velodyne'" in said(check, "TF camera")
    assert said(check, "TF camera").endswith("ROLL camera mast")
    assert said(check, "TF robot").startswith("fault: ") and "start " not in said(check, "TF robot")


def test_loops_and_second_parents_are_told_and_do_not_stop_anything() -> None:
    own = drive()[0].message.transforms
    more = (static("velodyne", "base", np.eye(4)), static("mast", "camera", np.eye(4)))
    check = checked(changed(drive(), "/tf_static", transforms=(*own, *more)))
    assert "note: transforms form a loop: base -> velodyne -> base: 1 left out" in said(check, "TF")
    assert "frame 'camera' has two parents, 'base' and 'mast'" in said(check, "TF")
    assert check.works


def test_transforms_that_come_later_than_scans_wait_are_told() -> None:
    prompt = checked(moving(drive(), 0.02))
    assert said(prompt, "TF rate").startswith("ok: 'velodyne' 25.00 Hz") and prompt.works
    slow = checked(moving(drive(), 0.8), parameters={"online": {"wait": 0.5}})
    assert said(slow, "TF rate").startswith("note: ")
    assert "that is late; start data_fusion with _online/wait:=1.6" in said(slow, "TF rate")


def test_a_robot_without_a_name_is_to_be_named() -> None:
    check = checked(without(drive(), "/odom"))
    assert "name it with _online/robot_frame:=NAME" in said(check, "TF robot")
    assert not check.works
    named = checked(without(drive(), "/odom"), parameters={"online": {"robot_frame": "base"}})
    assert named.works


def test_sim_time_without_a_clock_is_a_fault() -> None:
    missing = checked(drive(), sim_time=True, clock=False)
    assert "use_sim_time is set, but /clock is missing" in said(missing, "clock")
    paused = checked(drive(), sim_time=True, clock=False, also={"/clock": "rosgraph_msgs/Clock"})
    assert "/clock stands at 0" in said(paused, "clock")


def test_a_stereo_pair_needs_no_scans() -> None:
    sides = {"left": "camera_info", "right": "right_camera_info"}
    asked = {**TOPICS, **TOPICS_OF_PAIR, **{sides[side]: name for side, name in INFOS.items()}}
    check = checked(
        without(stereo_drive(), "/points"), asked=asked, parameters={"fusion": {"source": "stereo"}}
    )
    assert said(check, "stereo") == "ok: the two cameras are calibrated as a pair"
    assert said(check, "pairs").startswith("ok: 11 of 11 left images have a right one within 0.01")
    assert said(check, "fusing").startswith("ok: possible: ")
    assert "points of the first stereo pair, " in said(check, "fusing")
    # The launch files make clouds of scans.
    assert check.works and not check.launch and "launch files" not in check.verdict


def test_nothing_at_all_is_told_thing_by_thing() -> None:
    check = checked([])
    assert {*faults(check)} == {"scans", "images", "CameraInfo", "fusing"}
    assert said(check, "fusing") == "fault: not possible: no scans and no images and no CameraInfo"
    assert check.verdict.startswith("This suffices for none of the nodes; ")
    assert not check.works and not check.launch


def test_what_is_no_remapping_is_refused_before_anything_is_asked() -> None:
    from fusionslam.ros.check.robot import check_robot

    with pytest.raises(ConfigError, match="'odom=/wheels' is no remapping, expected NAME:=TOPIC"):
        check_robot(["odom=/wheels"], 1.0, lambda what, done, total: None)
