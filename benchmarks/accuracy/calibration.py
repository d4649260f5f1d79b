# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Are wrong turns and delays, put in on purpose, found? A Markdown table of recordings.

    python -m benchmarks.accuracy.calibration [--write]

Needs the test data, which FUSIONSLAM_TEST_DATA names, and the extras bags and sim: images are
stamped late in a copy of the bag, and the simulated town is made where the user's cache lacks it.
"""

import argparse
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import fusionslam
from benchmarks.accuracy.data import ROOT, data_folder
from benchmarks.accuracy.markdown import table, write_between
from fusionslam.calibration.check import CalibrationCheck, check_calibration
from fusionslam.calibration.search import DELAY, CalibrationCheckConfig, Recording, camera_turns
from fusionslam.datasets import open_bag, open_writer
from fusionslam.sensors.frame import Frame
from fusionslam.sensors.messages import CameraInfo, Picture
from fusionslam.sim import embedded_drive

PAGE = ROOT / "docs" / "guides" / "calibration.md"
HEADER = ("recording", "frames", "put in", "roll, pitch, yaw found", "delay found", "verdict")
BAG = Path("bags", "small_house_20s.bag")
WRONG_TURN = (0.0, 1.0, -1.5)
DELAY_S = 0.1
Degrees = tuple[float, float, float]


class Case(NamedTuple):
    """A recording, what was put in, and how many frames are looked at."""

    name: str
    recording: Recording
    put_in: str
    frames: int


@dataclass(frozen=True, eq=False)
class Turned:
    """A recording whose calibration is wrong by a turn: roll, pitch, yaw in degrees."""

    recording: Recording
    degrees: Degrees

    @property
    def name(self) -> str:
        return self.recording.name

    @property
    def numbers(self) -> NDArray[np.int64]:
        return self.recording.numbers

    @property
    def body_from_points(self) -> NDArray[np.float64] | None:
        return self.recording.body_from_points

    def __len__(self) -> int:
        return len(self.recording)

    def __getitem__(self, index: int) -> Frame:
        frame = self.recording[index]
        wrong = np.linalg.inv(camera_turns(np.array([self.degrees]))[0])
        left = frame.cameras["left"]
        moved = replace(left, rectified_from_points=wrong @ left.rectified_from_points)
        frame.cameras = {"left": moved}
        return frame


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="put it into the docs")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        text = table(HEADER, [judge_case(case) for case in cases(data_folder(), Path(scratch))])
    print(text)
    if arguments.write:
        write_between(PAGE, "calibration", text)


def cases(data: Path, scratch: Path) -> Iterator[Case]:
    """Real and simulated recordings, as they are and with what was put in."""
    drive = open_bag_dataset(data / "kitti" / "raw_2011_09_26")
    yield from turns("KITTI raw", drive, len(drive))
    yield from turns(BAG.name, open_bag_dataset(data / BAG), 20)
    for delay in (DELAY_S, -DELAY_S):
        late = restamp_bag(data / BAG, delay, scratch / f"{delay}.bag")
        yield Case(BAG.name, open_bag_dataset(late), f"images stamped {delay:+g} s", 40)
    yield Case("KITTI object", open_bag_dataset(data / "kitti" / "object"), "nothing", 1)
    yield Case("simulated town", open_bag_dataset(embedded_drive()), "nothing", 10)


def turns(name: str, recording: Recording, frames: int) -> Iterator[Case]:
    yield Case(name, recording, "nothing", frames)
    _, pitch, yaw = WRONG_TURN
    words = f"pitch {pitch:+g}, yaw {yaw:+g} deg"
    yield Case(name, Turned(recording, WRONG_TURN), words, frames)


def open_bag_dataset(path: Path) -> fusionslam.Dataset:
    return fusionslam.open_dataset(path, sensors=["points", "left"])


def restamp_bag(bag: Path, seconds: float, copy: Path) -> Path:
    """A copy of a bag whose images claim to be taken that much later than they were."""
    delay = round(seconds * 1e9)
    with open_bag(bag) as source, open_writer(copy, images="jpeg") as target:
        for event in source.events(list(source.topics)):
            message = event.message
            if isinstance(message, Picture | CameraInfo):
                message = replace(message, stamp_ns=message.stamp_ns + delay)
            target.write(replace(event, message=message))
    return copy


def judge_case(case: Case) -> list[object]:
    """A row of the table."""
    found = check_calibration(case.recording, CalibrationCheckConfig(frames=case.frames))
    angles = ", ".join(f"{angle:+.1f}" for angle in found.turn.degrees)
    return [case.name, len(found.frames), case.put_in, angles + " deg", late(found), found.verdict]


def late(found: CalibrationCheck) -> str:
    """By how much images are late as the check sees it; empty where nothing tells it."""
    return f"{found.curves[DELAY].best:+.2f} s" if DELAY in found.curves else ""


if __name__ == "__main__":
    main()
