# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Bad input to data_fusion: logged once, counted, and the node goes on."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from bags import OPTICAL, extrinsics, picture, static, translation
from bags import scan as good_scan
from fusionslam.ros.ros1.environment import has_ros
from fusionslam.ros.runtime.diagnostics import list_values
from fusionslam.sensors.frame_builder import BAD_CALIBRATION, NO_CAMERA_INFO, NO_TRANSFORM
from fusionslam.sensors.messages import FrameTransforms
from fusionslam.sensors.synchronizer import NO_IMAGE
from robots import IMAGES, INFOS, SCANS, Sent, drive_messages, only, replace_values, spoil, without
from ros_master import lacking
from ros_node import Desk, causes

if lacking:  # the cases themselves are made of messages
    pytest.skip(lacking, allow_module_level=True)

CLOUDS = "rgb_cloud"


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


def moving(child: str, stamp_ns: int, x: float = 1.0) -> FrameTransforms:
    link = replace(static("odom", child, translation(x)), stamp_ns=stamp_ns, static=False)
    return FrameTransforms(transforms=(link,))


def link(parent: str, child: str) -> FrameTransforms:
    return FrameTransforms(transforms=(static(parent, child, np.eye(4)),))


def with_first(messages: Sent, topic: str, value: Any) -> Sent:
    """After the first message, which links the sensors."""
    return [messages[0], (topic, value), *messages[1:]]


def every_other(messages: Sent, topic: str, **changes: Any) -> Sent:
    numbers = iter(range(len(messages)))
    return spoil(
        messages, topic, lambda value: replace(value, **changes) if next(numbers) % 2 else value
    )


@dataclass(frozen=True)
class Case:
    """Bad input.

    Attributes:
        messages: what arrives.
        cause: code of the problem, which is logged once.
        reports: the start of what /diagnostics counts it as.
        count: how often.
        clouds: number of clouds that are published all the same.
        remedy: what has to arrive besides good messages.
    """

    messages: Sent
    cause: str
    reports: str
    count: int
    clouds: int = 0
    remedy: Sent = field(default_factory=list)


DRIVE = drive_messages()
ALL, IMAGE_COUNT, ODOMETRY_COUNT = (len(only(DRIVE, name)) for name in (SCANS, IMAGES, "odom"))
NO_INFO, MISFIT = "points: no CameraInfo", "points: calibration does not fit"
NO_TF, NO_IMAGE_NEAR = "points: no transform", "points: no image near"
REFUSED_TF = "refused FrameTransforms"
SCANNER_ONLY = FrameTransforms(transforms=extrinsics().transforms[:1])
ON_MAST = FrameTransforms(transforms=(static("mast", "camera", OPTICAL),))
WITHOUT_TF = without(DRIVE, "/tf_static")
EMPTY = {"points": np.zeros((0, 3), np.float32), "fields": {}}
NAN_POINTS = {"points": np.full((41, 3), np.nan, np.float32)}


def cases() -> dict[str, Case]:
    return {
        "no CameraInfo": Case(without(DRIVE, INFOS), NO_CAMERA_INFO, NO_INFO, ALL),
        "K of zeros": Case(
            replace_values(DRIVE, INFOS, camera_matrix=np.zeros((3, 3))),
            BAD_CALIBRATION,
            MISFIT,
            ALL,
        ),
        "K of NaN": Case(
            spoil(DRIVE, INFOS, lambda info: alter(info, K=[float("nan")] * 9)),
            "DataError",
            f"refused {INFOS}",
            IMAGE_COUNT,
        ),
        "CameraInfo of another size": Case(
            replace_values(DRIVE, INFOS, size=(640, 480)),
            BAD_CALIBRATION,
            MISFIT,
            ALL,
        ),
        "CameraInfo of two sizes in turn": Case(
            every_other(DRIVE, INFOS, size=(640, 480)),
            BAD_CALIBRATION,
            MISFIT,
            ALL // 2,
            ALL - ALL // 2,
        ),
        "no TF": Case(WITHOUT_TF, NO_TRANSFORM, NO_TF, ALL),
        "a camera that TF lacks": Case(
            [("/tf_static", SCANNER_ONLY), *WITHOUT_TF],
            NO_TRANSFORM,
            NO_TF,
            ALL,
        ),
        "a camera that TF does not link": Case(
            [("/tf_static", SCANNER_ONLY), ("/tf_static", ON_MAST), *WITHOUT_TF],
            NO_TRANSFORM,
            NO_TF,
            ALL,
            remedy=[("/tf_static", link("base", "mast"))],
        ),
        "TF in a loop": Case(
            with_first(DRIVE, "/tf_static", link("camera", "base")),
            "FrameTransforms",
            REFUSED_TF,
            1,
            ALL,
        ),
        "a frame of two parents": Case(
            with_first(DRIVE, "/tf_static", link("mast", "camera")),
            "FrameTransforms",
            REFUSED_TF,
            1,
            ALL,
        ),
        "TF without stamps": Case(
            with_first(DRIVE, "/tf", moving("wheel", 0)),
            "no-stamp",
            "refused /tf",
            1,
            ALL,
        ),
        "scans without stamps": Case(
            replace_values(DRIVE, SCANS, stamp_ns=0), "no-stamp", f"refused {SCANS}", ALL
        ),
        "images without stamps": Case(
            replace_values(DRIVE, IMAGES, stamp_ns=0), "no-stamp", f"refused {IMAGES}", IMAGE_COUNT
        ),
        "odometry without stamps": Case(
            replace_values(DRIVE, "odom", stamp_ns=0),
            "no-stamp",
            "refused odom",
            ODOMETRY_COUNT,
            ALL,
        ),
        "empty scans": Case(
            replace_values(DRIVE, SCANS, **EMPTY), "empty-scan", "empty clouds", ALL, ALL
        ),
        "scans of NaN alone": Case(
            replace_values(DRIVE, SCANS, **NAN_POINTS),
            "empty-scan",
            "empty clouds",
            ALL,
            ALL,
        ),
        "scans that the camera does not see": Case(
            spoil(DRIVE, SCANS, lambda scan: replace(scan, points=-scan.points)),
            "nothing-seen",
            "empty clouds",
            ALL,
            ALL,
        ),
        "scans cut short": Case(
            spoil(DRIVE, SCANS, shorten),
            "DataError",
            f"refused {SCANS}",
            ALL,
        ),
        "scans of integers": Case(
            spoil(DRIVE, SCANS, lambda scan: alter(scan, fields=[])),
            "DataError",
            f"refused {SCANS}",
            ALL,
        ),
        "images cut short": Case(
            spoil(DRIVE, IMAGES, lambda image: shorten(image, "jpeg")),
            "UnidentifiedImageError",
            f"refused {IMAGES}",
            IMAGE_COUNT,
        ),
        "images of depth": Case(
            spoil(DRIVE, IMAGES, lambda image: alter(image, encoding="32FC1")),
            "DataError",
            f"refused {IMAGES}",
            IMAGE_COUNT,
        ),
        "images for scans": Case(
            spoil(DRIVE, SCANS, lambda scan: picture(scan.stamp_ns)),
            "wrong-type",
            f"refused {SCANS}",
            ALL,
        ),
        "scans for images": Case(
            spoil(DRIVE, IMAGES, lambda image: good_scan(image.stamp_ns)),
            "wrong-type",
            f"refused {IMAGES}",
            IMAGE_COUNT,
        ),
        "a camera with another clock": Case(
            replace_values(DRIVE, IMAGES, stamp_ns=5), NO_IMAGE, NO_IMAGE_NEAR, ALL
        ),
        "a robot of unknown name": Case(
            without(DRIVE, "odom"),
            "no-transform",
            f"refused {SCANS}: cannot be fused",
            ALL,
        ),
        "odometry of NaN": Case(
            spoil(DRIVE, "odom", unknown_place),
            "DataError",
            "refused odom",
            ODOMETRY_COUNT,
            ALL,
        ),
    }


def unknown_place(odometry: Any) -> Any:
    message = message_of(odometry)
    message.pose.pose.position.x = float("nan")
    return message


def play(desk: Desk, messages: Sent) -> int:
    """Number of clouds that come of messages."""
    before = len(desk.outlet.of(CLOUDS))
    for topic, value in messages:
        desk.give(topic, value)
    desk.worker.idle()
    return len(desk.outlet.of(CLOUDS)) - before


def count_reported(desk: Desk, start: str) -> int:
    return sum(int(count) for what, count in list_values(desk.worker) if what.startswith(start))


# Some are messages of ROS already.
@pytest.mark.parametrize("name", cases() if has_ros() else [])
def test_bad_input_is_logged_once_and_counted_and_the_node_goes_on(
    name: str, caplog: pytest.LogCaptureFixture
) -> None:
    known = {} if name == "a robot of unknown name" else {"online": {"robot_frame": "base"}}
    case, desk = cases()[name], Desk("data_fusion", **known)
    assert play(desk, case.messages) == case.clouds
    assert count_reported(desk, case.reports) == case.count
    assert causes(caplog).count(case.cause) == 1, caplog.text
    for seconds in (20, 40):
        assert play(desk, case.remedy + drive_messages(later=seconds)) == ALL
    assert all(len(cloud.data) for cloud in desk.outlet.of(CLOUDS)[-ALL:])
    assert causes(caplog).count(case.cause) == 1


@pytest.mark.parametrize(
    ("header", "cause"),
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
