# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What ``info`` says of recordings that lack something, and how much it says."""

import dataclasses
from pathlib import Path

from bags import SECOND, drive, write_bag
from cli import succeeds
from rows import rows

CAMERA = ("/camera/image", "/camera/camera_info")


def told(path: Path) -> str:
    """All that info says, in one line."""
    return " ".join(succeeds("info", path).stdout.split())


@rows(
    "lacking, words",
    [
        (
            ("/points",),
            "images in /camera/image, calibration in /camera/camera_info, "
            "no scans to place the camera against",
        ),
        (CAMERA[1:], "images in /camera/image, no calibration"),
        (CAMERA[:1], "no images, calibration in /camera/camera_info"),
        (CAMERA, "no images, no calibration"),
    ],
)
def test_info_tells_images_and_calibration_that_cannot_be_used(
    tmp_path: Path, lacking: tuple[str, ...], words: str
) -> None:
    events = [event for event in drive() if event.topic not in lacking]
    out = told(write_bag(tmp_path / "drive.bag", events))
    assert f"cameras {words} " in out
    assert "time offsets none: one sensor" in out


def test_info_keeps_silent_about_topics_as_they_should_be(tmp_path: Path) -> None:
    events = list(drive())
    out = told(write_bag(tmp_path / "drive.bag", events))
    assert "sensor_msgs/PointCloud2, 5 messages, 2.00 Hz topic" in out
    assert "path of 1.0 m" in out  # short ones to the decimetre
    assert "tf2_msgs/TFMessage, 1 message " in out and " 1 messages" not in out
    late = sorted(event.time_ns for event in events if event.topic == "/points")[2]
    moved = [
        dataclasses.replace(event, time_ns=event.time_ns + SECOND // 4)
        if event.topic == "/points" and event.time_ns == late
        else event
        for event in events
    ]
    assert "arrives +0.0 ms after its stamp (+0.0 to +250.0)" in told(
        write_bag(tmp_path / "late.bag", moved)
    )
    lacking = [e for e in events if e.topic != "/points" or e.time_ns != late]
    assert "2.00 Hz (longest step 1.000 s, 2.0 x the median; 1 gap)" in told(
        write_bag(tmp_path / "gap.bag", lacking)
    )


def test_info_says_of_folders_too_whether_they_can_be_fused(kitti: Path, recording: Path) -> None:
    assert "points of the first scan get a colour" in told(kitti)
    for path in recording.glob("image_*"):
        path.rename(path.with_name(f"not_{path.name}"))
    assert "fusion not possible: no images to colour the scans with" in told(recording)
