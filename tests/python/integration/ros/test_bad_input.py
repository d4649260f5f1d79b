# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Bad input to data_fusion: logged once, counted, and the node goes on."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bags import OPTICAL, extrinsics, picture, static, translation
from bags import scan as good_scan
from fusionslam.ros.runtime.diagnostics import list_values
from fusionslam.sensors.frame_builder import BAD_CALIBRATION, NO_CAMERA_INFO, NO_TRANSFORM
from fusionslam.sensors.messages import FrameTransforms
from fusionslam.sensors.synchronizer import NO_IMAGE
from robots import IMAGES, INFOS, SCANS, Sent, drive_messages, only, replace_values, spoil, without
from ros_master import lacking
from ros_node import Desk, causes
from rows import rows

if lacking:  # the cases themselves are made of messages
    pytest.skip(lacking, allow_module_level=True)

CLOUDS = "rgb_cloud"
DRIVE = drive_messages(1.0)
ALL, SEEN, MOVED = (len(only(DRIVE, name)) for name in (SCANS, IMAGES, "odom"))
WITHOUT_TF = without(DRIVE, "/tf_static")


def message_of(value: Any, stored: str = "raw") -> Any:
    from fusionslam.ros.messages.library import build

    return build(value, stored)


def shorten(value: Any, stored: str = "raw") -> Any:
    message = message_of(value, stored)
    message.data = message.data[:20]
    return message


def alter(value: Any, **changes: Any) -> Any:
    message = message_of(value)
    for name, change in changes.items():
        setattr(message, name, change)
    return message


def unknown_place(odometry: Any) -> Any:
    message = message_of(odometry)
    message.pose.pose.position.x = float("nan")
    return message


def link(parent: str, child: str, place: Any = np.eye(4)) -> FrameTransforms:  # noqa: B008
    return FrameTransforms(transforms=(static(parent, child, place),))


def unstamped(parent: str, child: str) -> FrameTransforms:
    moving = replace(static(parent, child, translation(1.0)), stamp_ns=0, static=False)
    return FrameTransforms(transforms=(moving,))


def changed(topic: str, **changes: Any) -> Sent:
    return replace_values(DRIVE, topic, **changes)


def spoiled(topic: str, how: Callable[[Any], Any]) -> Sent:
    return spoil(DRIVE, topic, how)


def every_other_info() -> Sent:
    numbers = iter(range(len(DRIVE)))
    return spoiled(INFOS, lambda k: replace(k, size=(640, 480)) if next(numbers) % 2 else k)


def with_second(value: Any, topic: str = "/tf_static") -> Sent:
    """After the first message, which links the sensors."""
    return [DRIVE[0], (topic, value), *DRIVE[1:]]


SCANNER = ("/tf_static", FrameTransforms(transforms=extrinsics().transforms[:1]))
MAST = ("/tf_static", link("mast", "camera", OPTICAL))
NO_POINTS = {"points": np.zeros((0, 3), np.float32), "fields": {}}
NAN_POINTS = {"points": np.full((41, 3), np.nan, np.float32)}
NO_INFO, MISFIT = "points: no CameraInfo", "points: calibration does not fit"
NO_TF, NO_LINK = "points: no transform", "refused FrameTransforms"
BAD_SCAN, BAD_IMAGE, BAD_INFO = (f"refused {topic}" for topic in (SCANS, IMAGES, INFOS))
Case = tuple[Sent, str, str, int, int]
"""What arrives, the code of the problem, which is logged once, as what and how often /diagnostics
counts it, and how many clouds are published all the same."""
OF_CALIBRATION: dict[str, Case] = {
    "none": (without(DRIVE, INFOS), NO_CAMERA_INFO, NO_INFO, ALL, 0),
    "zeros": (changed(INFOS, camera_matrix=np.zeros((3, 3))), BAD_CALIBRATION, MISFIT, ALL, 0),
    "NaN": (spoiled(INFOS, lambda k: alter(k, K=[np.nan] * 9)), "DataError", BAD_INFO, SEEN, 0),
    "another size": (changed(INFOS, size=(640, 480)), BAD_CALIBRATION, MISFIT, ALL, 0),
    "two sizes": (every_other_info(), BAD_CALIBRATION, MISFIT, ALL // 2, ALL - ALL // 2),
    "no TF": (WITHOUT_TF, NO_TRANSFORM, NO_TF, ALL, 0),
    "no camera in TF": ([SCANNER, *WITHOUT_TF], NO_TRANSFORM, NO_TF, ALL, 0),
    "a mast in the air": ([SCANNER, MAST, *WITHOUT_TF], NO_TRANSFORM, NO_TF, ALL, 0),
    "a loop in TF": (with_second(link("camera", "base")), "FrameTransforms", NO_LINK, 1, ALL),
    "two parents": (with_second(link("mast", "camera")), "FrameTransforms", NO_LINK, 1, ALL),
    "TF unstamped": (
        with_second(unstamped("odom", "wheel"), "/tf"),
        "no-stamp",
        "refused /tf",
        1,
        ALL,
    ),
    "no name": (without(DRIVE, "odom"), "no-transform", f"{BAD_SCAN}: cannot be fused", ALL, 0),
}
OF_SENSORS: dict[str, Case] = {
    "scan unstamped": (changed(SCANS, stamp_ns=0), "no-stamp", BAD_SCAN, ALL, 0),
    "image unstamped": (changed(IMAGES, stamp_ns=0), "no-stamp", BAD_IMAGE, SEEN, 0),
    "odom unstamped": (changed("odom", stamp_ns=0), "no-stamp", "refused odom", MOVED, ALL),
    "odom of NaN": (spoiled("odom", unknown_place), "DataError", "refused odom", MOVED, ALL),
    "no points": (changed(SCANS, **NO_POINTS), "empty-scan", "empty clouds", ALL, ALL),
    "NaN alone": (changed(SCANS, **NAN_POINTS), "empty-scan", "empty clouds", ALL, ALL),
    "behind": (
        spoiled(SCANS, lambda s: replace(s, points=-s.points)),
        "nothing-seen",
        "empty clouds",
        ALL,
        ALL,
    ),
    "scan cut short": (spoiled(SCANS, shorten), "DataError", BAD_SCAN, ALL, 0),
    "no fields": (spoiled(SCANS, lambda s: alter(s, fields=[])), "DataError", BAD_SCAN, ALL, 0),
    "image cut short": (
        spoiled(IMAGES, lambda i: shorten(i, "jpeg")),
        "UnidentifiedImageError",
        BAD_IMAGE,
        SEEN,
        0,
    ),
    "depth": (
        spoiled(IMAGES, lambda i: alter(i, encoding="32FC1")),
        "DataError",
        BAD_IMAGE,
        SEEN,
        0,
    ),
    "image for scan": (
        spoiled(SCANS, lambda s: picture(s.stamp_ns)),
        "wrong-type",
        BAD_SCAN,
        ALL,
        0,
    ),
    "scan for image": (
        spoiled(IMAGES, lambda i: good_scan(i.stamp_ns)),
        "wrong-type",
        BAD_IMAGE,
        SEEN,
        0,
    ),
    "another clock": (changed(IMAGES, stamp_ns=5), NO_IMAGE, "points: no image near", ALL, 0),
}


def play(desk: Desk, messages: Sent) -> int:
    """Number of clouds that come of messages."""
    before = len(desk.outlet.of(CLOUDS))
    for topic, value in messages:
        desk.give(topic, value)
    desk.worker.idle()
    return len(desk.outlet.of(CLOUDS)) - before


def count_reported(desk: Desk, start: str) -> int:
    return sum(int(count) for what, count in list_values(desk.worker) if what.startswith(start))


def check_case(case: Case, remedy: Sent, caplog: pytest.LogCaptureFixture, robot: str) -> None:
    messages, cause, reports, count, clouds = case
    desk = Desk("data_fusion", online={"robot_frame": robot})
    assert play(desk, messages) == clouds
    assert count_reported(desk, reports) == count
    assert play(desk, remedy + drive_messages(1.0, later=20)) == ALL
    assert all(len(cloud.data) for cloud in desk.outlet.of(CLOUDS)[-ALL:])
    assert causes(caplog).count(cause) == 1, caplog.text


@rows("name", OF_CALIBRATION)
def test_bad_calibration_and_transforms_are_logged_once_and_the_node_goes_on(
    name: str, caplog: pytest.LogCaptureFixture
) -> None:
    remedy: Sent = [("/tf_static", link("base", "mast"))] if name == "a mast in the air" else []
    robot = "" if name == "no name" else "base"
    check_case(OF_CALIBRATION[name], remedy, caplog, robot)


@rows("name", OF_SENSORS)
def test_bad_messages_of_sensors_are_logged_once_and_the_node_goes_on(
    name: str, caplog: pytest.LogCaptureFixture
) -> None:
    check_case(OF_SENSORS[name], [], caplog, "base")


@rows(
    "header, cause",
    [
        ({"lost": 3}, "cut-short"),
        ({"md5sum": "1" * 32}, "other-definition"),
        ({"type": "strange/Type"}, "wrong-type"),
    ],
)
def test_bytes_that_are_no_message_of_the_topic(
    header: dict[str, Any], cause: str, caplog: pytest.LogCaptureFixture
) -> None:
    desk = Desk("data_fusion")
    for scan in only(DRIVE, SCANS):
        desk.put(SCANS, message_of(scan), **header)
    desk.work()
    assert count_reported(desk, f"refused {SCANS}") == ALL
    assert causes(caplog) == [cause]
    assert play(desk, DRIVE) == ALL
