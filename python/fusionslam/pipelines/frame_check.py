# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Read every frame of a recording and report what cannot be read or used."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fusionslam.errors import FusionSlamError, one_line
from fusionslam.help_texts import counted
from fusionslam.storage.parallel import ordered_results
from fusionslam.storage.progress import Progress

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset

_NAMED = 20
"""Most frames that a row names."""


@dataclass(frozen=True)
class FrameCheck:
    """What was found in a frame.

    Attributes:
        number: of the frame in the recording.
        errors: why a scan or image cannot be read, by sensor.
        points: number of points; None without a readable scan.
        invalid: number of points with NaN or infinity.
    """

    number: int
    errors: dict[str, FusionSlamError]
    points: int | None = None
    invalid: int = 0


def check_frames(
    dataset: "Dataset", *, jobs: int = 1, progress: Progress | None = None
) -> list[FrameCheck]:
    """Read all scans and images.

    Args:
        dataset: the recording.
        jobs: number of frames read in parallel.
        progress: called with (frames done, total frames).
    """
    checks: list[FrameCheck] = []
    with ordered_results(lambda index: _check(dataset, index), range(len(dataset)), jobs) as found:
        for check in found:
            checks.append(check)
            if progress is not None:
                progress(len(checks), len(dataset))
    return checks


def _check(dataset: "Dataset", index: int) -> FrameCheck:
    number, errors = int(dataset.numbers[index]), {}
    points, invalid = None, 0
    try:
        frame = dataset[index]
    except FusionSlamError as error:  # the calibration of the frame
        return FrameCheck(number, {"calibration": error})
    for sensor in dataset.sensors:
        try:
            if sensor != "points":
                _ = frame.images[sensor]
            elif frame.points is not None:
                points = len(frame.points)
                invalid = int((~np.isfinite(frame.points)).any(axis=1).sum())
        except FusionSlamError as error:
            errors[sensor] = error
    return FrameCheck(number, errors, points, invalid)


def check_rows(checks: list[FrameCheck]) -> Iterator[tuple[str, str]]:
    """Yield (label, value) pairs about all frames, and about each that cannot be read."""
    bad = [check for check in checks if check.errors]
    yield "checked", f"all of {counted(len(checks), 'frame')}, {len(bad)} cannot be read"
    for check in bad[:_NAMED]:
        for sensor, error in check.errors.items():
            yield f"frame {check.number}", f"{sensor}: {one_line(error)}"
    if len(bad) > _NAMED:
        yield "more", f"{counted(len(bad) - _NAMED, 'frame')} that cannot be read"
    empty = [check.number for check in checks if check.points == 0]
    if empty:
        yield "empty scans", _name(empty)
    holed = [check for check in checks if check.invalid]
    if holed:
        shares = [check.invalid / (check.points or 1) for check in holed]
        worst = holed[int(np.argmax(shares))].number
        yield (
            "invalid points",
            f"{min(shares):.1%} to {max(shares):.1%} with NaN or infinity (most in frame {worst}) "
            f"in {_name([check.number for check in holed])}",
        )


def _name(numbers: list[int]) -> str:
    some = ", ".join(map(str, numbers[:_NAMED]))
    more = ", ..." if len(numbers) > _NAMED else ""
    return f"{counted(len(numbers), 'frame')}: {some}{more}"
