# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Check whether frames of a recording, or a robot's first ones, can be read and fused."""

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from fusionslam.base.parallel import ordered_results
from fusionslam.base.progress import Progress, reported
from fusionslam.base.texts import counted
from fusionslam.datasets.base import CloudDataset
from fusionslam.errors import ConfigError, DataError, FusionSlamError, one_line
from fusionslam.fusion import DISTANT_M, FusionConfig, ScanCheck, Source, check_scan, fuse

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset
    from fusionslam.sensors.frame import Frame

logger = logging.getLogger(__name__)

BAD_FRAMES = ("error", "skip")
"""Ways to treat frames that cannot be read, fused or described."""
_NAMED = 20
"""Most frames that a row names."""
_SMALL = 0.25
"""Share of the median number of points below which a scan is small."""


@dataclass(frozen=True)
class FrameCheck:
    """What was found in a frame.

    Attributes:
        number: of the frame in the recording.
        errors: why a scan or image cannot be read, by sensor.
        points: number of points; None without a readable scan.
        invalid: number of points with NaN or infinity.
        at_scanner: number of points at the scanner itself.
        distant: number of points so far away that the unit may not be metres.
    """

    number: int
    errors: dict[str, FusionSlamError]
    points: int | None = None
    invalid: int = 0
    at_scanner: int = 0
    distant: int = 0


def check_frames(
    dataset: "Dataset", *, jobs: int = 1, progress: Progress | None = None
) -> list[FrameCheck]:
    """Read all scans and images.

    Args:
        dataset: the recording.
        jobs: number of frames read in parallel.
        progress: called with (frames done, total frames).
    """
    with ordered_results(lambda index: _check(dataset, index), range(len(dataset)), jobs) as found:
        return list(reported(found, progress, len(dataset)))


def _check(dataset: "Dataset", index: int) -> FrameCheck:
    number, errors = int(dataset.numbers[index]), {}
    points, invalid, found = None, 0, ScanCheck(0, 0)
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
                found = check_scan(frame.points)
        except FusionSlamError as error:
            errors[sensor] = error
    return FrameCheck(number, errors, points, invalid, *found)


def readable_frames(dataset: "Dataset", bad_frames: str = "error", *, jobs: int = 1) -> "Dataset":
    """Return the dataset; with "skip", without the frames that cannot be read, which are logged.

    Raises:
        DataError: no frame is left. ConfigError: an unknown value of ``bad_frames``.
    """
    check_bad_frames(bad_frames)
    if bad_frames == "error":
        return dataset
    checks = check_frames(dataset, jobs=jobs)
    good = [row for row, check in enumerate(checks) if not check.errors]
    if not good:
        reason = one_line(next(iter(checks[0].errors.values())))
        raise DataError(
            f"{dataset.name}: no frame can be read; frame {checks[0].number}: {reason}",
            code="no-frame",
        )
    for check in checks:
        for error in check.errors.values():
            logger.warning("%s, frame %d left out: %s", dataset.name, check.number, error)
    return dataset.only(good)


def warn_left_out(dataset: "Dataset", skipped: Mapping[int, str]) -> None:
    """Warn of frames that cannot be described: number -> reason.

    Raises:
        DataError: they are all frames (code "no-frame").
    """
    if len(skipped) == len(dataset):
        number, reason = next(iter(skipped.items()))
        raise DataError(
            f"{dataset.name}: no frame can be described; frame {number}: {reason}", code="no-frame"
        )
    for number, reason in skipped.items():
        logger.warning("%s, frame %d left out: %s", dataset.name, number, reason)


def check_bad_frames(value: str) -> None:
    """Raise ConfigError unless a value is one of ``BAD_FRAMES``."""
    if value not in BAD_FRAMES:
        raise ConfigError(
            f"bad_frames is {value!r}, expected one of {', '.join(BAD_FRAMES)}",
            code="choice",
            fields=("bad_frames", value),
        )


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
    yield from _small_scans(checks)
    yield from _shares(checks, "invalid points", "with NaN or infinity", lambda one: one.invalid)
    yield from _shares(
        checks, "no distance", "at the scanner (0, 0, 0)", lambda one: one.at_scanner
    )
    far = f"beyond {DISTANT_M:g} m (expected metres)"
    yield from _shares(checks, "distant points", far, lambda one: one.distant)


def _small_scans(checks: list[FrameCheck]) -> Iterator[tuple[str, str]]:
    """Yield a row about scans with far fewer points than others: a file may be cut short."""
    counts = [check.points for check in checks if check.points]
    usual = float(np.median(counts)) if counts else 0.0
    small = [one.number for one in checks if one.points and one.points < _SMALL * usual]
    if small:
        yield (
            "small scans",
            f"below {_SMALL:.0%} of the usual {usual:.0f} points, cut short? {_name(small)}",
        )


def _shares(
    checks: list[FrameCheck], label: str, what: str, number: Callable[[FrameCheck], int]
) -> Iterator[tuple[str, str]]:
    """Yield a row about the share of some points, if a frame has such points."""
    found = [check for check in checks if number(check)]
    if found:
        shares = [number(check) / (check.points or 1) for check in found]
        worst = found[int(np.argmax(shares))].number
        said = f"{shares[0]:.1%} {what}"
        if len(found) > 1:
            said = f"{min(shares):.1%} to {max(shares):.1%} {what} (most in frame {worst})"
        yield label, f"{said} in {_name([check.number for check in found])}"


def _name(numbers: list[int]) -> str:
    some = ", ".join(map(str, numbers[:_NAMED]))
    more = ", ..." if len(numbers) > _NAMED else ""
    return f"{counted(len(numbers), 'frame')}: {some}{more}"


@dataclass(frozen=True)
class FirstCloud:
    """The outcome of fusing a first frame.

    Attributes:
        status: "possible"; "doubtful" where the cloud has no points; "not possible"; or "not
            needed" where the recording holds coloured clouds.
        points: number of points of the cloud, with those of the ground.
        above: number of points that are left without the ground.
        problem: what is wrong; empty if fusing is possible or not needed.
        detail: description of the data, for people, if nothing is wrong.
    """

    status: Literal["possible", "doubtful", "not possible", "not needed"]
    points: int = 0
    above: int = 0
    problem: str = ""
    detail: str = ""

    def __str__(self) -> str:
        return f"{self.status}: {self.problem or self.detail}"


def first_cloud(dataset: "Dataset") -> FirstCloud:
    """Fuse the first frame and return the outcome, or why it cannot be fused."""
    if isinstance(dataset, CloudDataset):
        return FirstCloud("not needed", detail="the clouds have their colours")
    source = source_of(dataset)
    if source == "cloud":
        return _only_scans(dataset)
    if source is None:
        return FirstCloud("not possible", problem="no scans and no pairs of images")
    try:
        return try_frame(dataset[0], FusionConfig(source=source))
    except FusionSlamError as error:
        return FirstCloud("not possible", problem=one_line(error))


def source_of(dataset: "Dataset") -> Source | None:
    """Return the source of clouds that shows most of what a dataset has; None if there is none."""
    if isinstance(dataset, CloudDataset) or dataset.sensors == ("points",):
        return "cloud"
    if dataset.has_points:
        return "lidar" if dataset.cameras else "cloud"
    return "stereo" if dataset.has_stereo else None


def _only_scans(dataset: "Dataset") -> FirstCloud:
    """Tell whether scans without calibrated images have colours of their own."""
    try:
        colors = dataset[0].colors
    except FusionSlamError as error:
        return FirstCloud("not possible", problem=one_line(error))
    if colors is not None:
        return FirstCloud("not needed", detail="the scans have their colours (source cloud)")
    lacking = "images" if dataset.sensors == ("points",) else "calibration"
    return FirstCloud(
        "not possible",
        problem=f"no {lacking} to colour the scans with: commands take them without colours "
        "(source cloud)",
    )


def try_frames(frames: "Iterable[Frame]", config: FusionConfig) -> FirstCloud | None:
    """Fuse frames until one has points; return the last outcome, or None without frames."""
    outcome = None
    for frame in frames:
        try:
            outcome = try_frame(frame, config)
        except FusionSlamError as error:
            outcome = FirstCloud("not possible", problem=one_line(error))
        if outcome.points:
            break
    return outcome


def try_frame(frame: "Frame", config: FusionConfig) -> FirstCloud:
    """Fuse a frame and return the outcome. Raises as ``fuse``."""
    count = len(fuse(frame, config.model_copy(update={"ground": "none"})))
    above = len(fuse(frame, config)) if count and config.ground != "none" else count
    first = "first stereo pair" if config.source == "stereo" else "first scan"
    if count:
        colored = " get a colour (calib-check says if it is theirs)"
        colored = colored if config.source == "lidar" else ""
        return FirstCloud(
            "possible", count, above, detail=f"{count} points of the {first}{colored}"
        )
    problem = {
        "lidar": f"no point of the {first} falls into its image",
        "stereo": f"the images of the {first} have nothing in common",
        "cloud": f"the {first} has no points",
    }
    return FirstCloud("doubtful", problem=problem[config.source])
