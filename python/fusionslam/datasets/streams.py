# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Groups files into frames: one stream of numbered files per sensor, and the gaps in them."""

import logging
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from fusionslam.errors import ConfigError, DataError
from fusionslam.sensors.synchronizer import SyncConfig

logger = logging.getLogger(__name__)

SENSORS = ("points", "left", "right")
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp")
# If the numbers of the first and the last file are further apart (28 hours at 10 Hz), the file
# names are not frame numbers.
MAX_SPAN = 1_000_000
PERIOD_NS = 100_000_000

Key = TypeVar("Key", int, str)


class MissingSensorError(DataError):
    """The recording has no data of a requested sensor."""

    code = "missing-sensor"


class GapsError(DataError):
    """Frames between the first and the last lack a file, and gaps are not to be skipped."""

    code = "gaps"


@dataclass(frozen=True)
class Stream:
    """One sensor's files by frame number.

    Attributes:
        files: the file of each frame that has one; never empty.
        stems: file name (without suffix) by frame number, if names are not frame numbers.
    """

    files: Mapping[int, Path]
    stems: Mapping[int, str] = field(default_factory=dict)

    def expected(self, number: int) -> Path:
        """Path of a frame's file, whether or not it exists."""
        sample = next(iter(self.files.values()))
        stem = re.sub(r"\d+$", lambda digits: f"{number:0{len(digits[0])}d}", sample.stem)
        return self.files.get(number) or sample.with_stem(self.stems.get(number, stem))


@dataclass(frozen=True)
class Request:
    """Arguments of ``open_dataset``, which describes them."""

    sequence: str | None = None
    sensors: Sequence[str] | None = None
    gaps: str = "error"
    poses: Path | None = None
    topics: Mapping[str, str] = field(default_factory=dict)
    stamps: str = "header"
    sync: SyncConfig = field(default_factory=SyncConfig)
    calibration: Path | None = None
    shapes: str | None = None
    deskew: bool = True


def check_self_contained(root: Path, what: str, options: Mapping[str, Any]) -> None:
    """Check that no reading options are given for a file that is self-contained.

    Args:
        root: the file.
        what: its kind in words.
        options: value of each option by name; empty values count as not given.

    Raises:
        ConfigError: an option was given.
    """
    for name, value in options.items():
        if value:
            raise ConfigError(f"{name}: {root} is {what}, which says all about itself")


def check_scans(root: Path, what: str, sensors: Sequence[str] | None) -> None:
    """Raise MissingSensorError if images are requested from a file that only has scans.

    Args:
        root: the file.
        what: its kind in words.
        sensors: those requested; None for any.
    """
    if missing := [name for name in sensors or () if name != "points"]:
        raise MissingSensorError(
            f"{root} is {what}: it has coloured clouds, but no {' and '.join(missing)} images",
            fields=missing,
        )


def scan(folder: Path, suffixes: Sequence[str]) -> Stream | None:
    """Find the files of a folder whose names are frame numbers; None if there are none.

    Args:
        folder: need not exist.
        suffixes: those accepted, in lower case, with the dot.

    Raises:
        DataError: two files have the same number.
    """
    paths = [path for path in files_in(folder, suffixes) if path.stem.isdecimal()]
    return Stream(unique(paths, lambda path: int(path.stem))) if paths else None


def files_in(folder: Path, suffixes: Sequence[str]) -> list[Path]:
    """List the files of a folder with one of these suffixes, by name, without hidden ones."""
    return sorted(
        path
        for path in entries(folder)
        if path.suffix.lower() in suffixes and not path.name.startswith(".")
    )


def unread_types(folder: Path, suffixes: Sequence[str]) -> str:
    """Say which types of files a folder without a file that is read holds; empty if none."""
    files = (path for path in entries(folder) if path.is_file() and path.name[0] != ".")
    types = sorted({path.suffix.lower() or "no type" for path in files})
    if not types:
        return ""
    expected = ", ".join(suffixes)
    return f"{folder} holds files of {', '.join(types)}, which are not read: expected {expected}"


def absolute_path(path: str | os.PathLike[str]) -> Path:
    """Make a path absolute, but keep links to folders: poses are found by the link's name.

    Links to files are resolved, and so is everything up to the last "..", as the system does.
    """
    full = Path(path).expanduser().absolute()
    if os.path.isfile(full):
        return full.resolve()
    parts = full.parts
    end = len(parts) - parts[::-1].index("..") if ".." in parts else 0
    return Path(*parts[:end]).resolve() / Path(*parts[end:]) if end else full


def named_and_linked(folder: Path) -> tuple[Path, ...]:
    """A folder as named and, if links lead to it, as stored: its files may lie beside either."""
    return tuple(dict.fromkeys((folder, folder.resolve())))


def find_existing(*paths: Path) -> Path | None:
    """Return the first of these paths that exists, links resolved; None if none does."""
    return next((path.resolve() for path in paths if path.exists()), None)


def entries(folder: Path) -> list[Path]:
    """List the contents of a folder by name; empty if it does not exist."""
    return sorted(folder.iterdir()) if folder.is_dir() else []


def unique(paths: Sequence[Path], key: Callable[[Path], Key], layout: str = "") -> dict[Key, Path]:
    """Map each path's key to the path.

    Args:
        paths, key: the files, and what tells the frame of each.
        layout: where files belong, for the message.

    Raises:
        DataError: two paths have the same key.
    """
    files: dict[Key, Path] = {}
    for path in paths:
        if (other := files.setdefault(key(path), path)) is not path:
            message = (
                f"{other} and {path} are both frame {key(path)}: expected one file of each number, "
                f"which are the digits at the end of the name{layout}"
            )
            raise DataError(message, code="two-files", fields=(str(other), str(path)))
    return files


def choose(streams: Mapping[str, Stream | None], request: Request, root: Path) -> dict[str, Stream]:
    """Choose the streams that every frame needs: those requested, else all that the folder has.

    Raises:
        DataError: a requested sensor has no file, or there is no file at all.
    """
    found = {sensor: stream for sensor, stream in streams.items() if stream is not None}
    wanted = found if request.sensors is None else request.sensors
    if not wanted:
        raise DataError(f"{root} has no frames: expected scans or images in it", code="no-frames")
    for sensor in wanted:
        if sensor not in found:
            others = f", only of {', '.join(found)}" if found else ""
            message = f"{root} has no files of sensor '{sensor}'{others}"
            raise MissingSensorError(message, fields=(sensor,))
    return {sensor: found[sensor] for sensor in SENSORS if sensor in wanted}


def frame_numbers(
    streams: Mapping[str, Stream], request: Request, *, consecutive: bool = True
) -> tuple[NDArray[np.int64], list[int]]:
    """Find the frames with a file from every stream, and the numbers of the incomplete ones.

    Args:
        streams: those that every frame needs.
        request: its ``gaps`` decides whether incomplete frames are an error or left out.
        consecutive: whether every number from the first to the last is expected to be a frame;
            else only those with a file from at least one stream.

    Raises:
        DataError: a file is missing and gaps are an error; or no frame is complete.
    """
    stream_numbers = [set(stream.files) for stream in streams.values()]
    seen, complete = set.union(*stream_numbers), set.intersection(*stream_numbers)
    if consecutive:
        first, last = min(seen), max(seen)
        if last - first > MAX_SPAN:
            folder = next(iter(streams.values())).expected(first).parent
            message = f"{folder}: file names {first} to {last} do not count frames"
            raise DataError(message, code="no-frame-numbers", fields=(str(folder),))
        seen = set(range(first, last + 1))
    gaps = sorted(seen - complete)
    if gaps:
        _report(streams, gaps, len(complete), request.gaps)
    if not complete:
        message = f"no frame has a file from each of {', '.join(streams)}{_rule(streams)}"
        raise DataError(message, code="no-frames", fields=tuple(streams))
    return np.array(sorted(complete), dtype=np.int64), gaps


def _report(streams: Mapping[str, Stream], gaps: list[int], complete: int, policy: str) -> None:
    first = gaps[0]
    path = next(s.expected(first) for s in streams.values() if first not in s.files)
    message = f"{path} is missing; {len(gaps)} of {len(gaps) + complete} frames lack a file"
    if policy == "error":
        kind = GapsError if complete else DataError
        advice = ': gaps="skip" (command line: --skip-gaps) leaves them out'
        if not complete:
            advice = _rule(streams)
        raise kind(f"{message}{advice}", fields=(str(path), str(len(gaps))))
    logger.warning("%s and are left out", message)


def _rule(streams: Mapping[str, Stream]) -> str:
    """State how the files of one frame are told, with the first file of each sensor."""
    firsts = [stream.files[min(stream.files)] for stream in streams.values()]
    names = " and ".join(f"{path.parent.name}/{path.name}" for path in firsts)
    return (
        ": files of one frame end in the same number, or have the same name if some end in none, "
        f"but the first ones are {names}"
    )


def regular_stamps(numbers: NDArray[np.int64], missing: str) -> NDArray[np.int64]:
    """int64 (N) nanoseconds at 10 Hz, for data without times; logs a warning."""
    logger.warning("no %s: frames are taken to be 0.1 s apart (10 Hz)", missing)
    return numbers * PERIOD_NS


def warn_uncalibrated(streams: Mapping[str, Stream], missing: str) -> None:
    """Log what a missing calibration costs: nothing for scans alone or images of one camera."""
    if len(streams) > 1:
        logger.warning(
            "no %s: images neither colour scans (source lidar) nor give clouds (source stereo)",
            missing,
        )


def one_of(root: Path, available: Mapping[str, Path], name: str | None) -> Path:
    """Find the sequence of that name; without a name, the only one.

    Raises:
        DataError: there is no such sequence, or there are several and none was named.
    """
    if name is None and len(available) == 1:
        return next(iter(available.values()))
    if name is not None:
        for known in [name, *(other for other in available if same_number(name, other))]:
            if known in available:
                return available[known]
    wish = f"{len(available)} sequences" if name is None else f"no sequence {name}"
    raise DataError(
        f"{root} has {wish}: choose with sequence= (command line: --sequence) "
        f"one of {', '.join(available) or 'none'}",
        code="no-sequence",
        fields=tuple(available),
    )


def same_number(a: str, b: str) -> bool:
    """Whether two names are equal, or are the same number but for leading zeros."""
    return a == b or (a.isdecimal() and b.isdecimal() and int(a) == int(b))


def itself(root: Path, name: str | None) -> Path:
    """Return the folder of a single sequence if no other one was requested.

    Raises:
        DataError: another sequence was requested.
    """
    if name is not None and not same_number(name, root.name):
        message = f"{root} is a single sequence: there is no sequence {name} in it"
        raise DataError(message, code="no-sequence", fields=(root.name,))
    return root
