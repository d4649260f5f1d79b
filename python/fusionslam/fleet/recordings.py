# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The recordings below a folder: where they are, and which robot drove where."""

import hashlib
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import astuple, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fusionslam.base.archive import format_of
from fusionslam.datasets import KINDS, Dataset
from fusionslam.datasets.base import FileDataset
from fusionslam.errors import ConfigError, DataError
from fusionslam.fleet.config import FILE
from fusionslam.fleet.places import ABOUT
from fusionslam.pipelines.recording import Recording
from fusionslam.views.scene_set import is_scene_set

LEVELS = ("region", "site", "robot")
"""What the folders between the root and a recording can be names of."""
_HEAD = 1 << 20
_SUFFIXES = (".bag", ".db3", ".mcap", ".npz")
"""Of files that are recordings, or were meant to be."""


@dataclass(frozen=True)
class FleetRecording:
    """A recording of a robot of the fleet.

    Attributes:
        session: its name, its path below the root without a suffix.
        recording: how it is opened.
        robot, site, region: who drove, and where; "" where unknown.
    """

    session: str
    recording: Recording
    robot: str = ""
    site: str = ""
    region: str = ""

    @classmethod
    def load(cls, values: Mapping[str, Any]) -> "FleetRecording":
        """Return what ``dump`` was called on."""
        about = {name: str(values[name]) for name in ABOUT}
        return cls(recording=Recording(**values["recording"]), **about)


@dataclass(frozen=True)
class Labels:
    """How recordings get the names of robot, site and region.

    Attributes:
        folders: what folders below the root are names of, the outermost first: ``LEVELS``.
        robot, site, region: for recordings that no folder names one for.
    """

    folders: Sequence[str] = ()
    robot: str = ""
    site: str = ""
    region: str = ""

    def __post_init__(self) -> None:
        for name in self.folders:
            if name not in LEVELS or self.folders.count(name) > 1:
                raise ConfigError(
                    f"folders are {'/'.join(self.folders)}: expected some of {', '.join(LEVELS)}, "
                    "each once, with / between them",
                    code="choice",
                    fields=("--folders", "/".join(self.folders)),
                )

    def of(self, session: str) -> dict[str, str]:
        """Return robot, site and region of a recording."""
        named = dict(zip(self.folders, session.split("/"), strict=False))
        return {name: named.get(name) or getattr(self, name) for name in LEVELS}


@dataclass(frozen=True)
class Found:
    """Recordings below a root, and what looks like one and cannot be used.

    Attributes:
        recordings: in the order of their names.
        refused: why, by path.
    """

    recordings: list[FleetRecording] = field(default_factory=list)
    refused: dict[str, DataError] = field(default_factory=dict)


def find_recordings(root: Path, labels: Labels, *, excluded: Path | None = None) -> Found:
    """Find all recordings below a folder, or the one that it is.

    Args:
        root: of the recordings.
        labels: how they get names.
        excluded: a folder that is not looked into, as that of results.

    Raises:
        DataError: the root does not exist or cannot be read.
    """
    if not root.is_dir():
        raise DataError(
            f"{root} is no folder: expected one with recordings in it",
            code="missing-file",
            fields=(str(root),),
        )
    found = Found()
    named: dict[str, FleetRecording] = {}
    seen = set() if excluded is None else {excluded.resolve()}
    for path, kind in _candidates(root, seen, found.refused):
        for sequence in _sequences(path, kind):
            session = _name(root, path, sequence)
            recording = Recording.at(path, sequence=sequence)
            new = FleetRecording(session, recording, **labels.of(session))
            problem = _refuse_name(new, named.get(session))
            if problem is None:
                named[session] = new
            else:
                found.refused[str(path)] = problem
    found.recordings.extend(named[session] for session in sorted(named))
    return found


def _refuse_name(new: FleetRecording, other: FleetRecording | None) -> DataError | None:
    """Return why a recording cannot have its name, site, region or robot; None if it can."""
    path, session = new.recording.path, new.session
    for name in (getattr(new, each) for each in ABOUT):
        # No control character and no half of one, as of names that are no UTF-8.
        if not all(unicodedata.category(each) not in ("Cc", "Cs") for each in name):
            message = f"{path!r} has a name that is no text, {name!r}: expected one in Unicode"
            message += " without control characters"
            return DataError(message, code="bad-name", fields=(repr(path),))
    if other is None:
        return None
    message = (
        f"{path} has the name of {other.recording.path}, {session!r}: it is left out; "
        "expected names of their own"
    )
    return DataError(message, code="same-name", fields=(session,))


def _candidates(
    root: Path, seen: set[Path], refused: dict[str, DataError]
) -> Iterator[tuple[Path, str]]:
    """Yield the paths that are recordings, or look like them, and their kinds or "".

    Not looked into are folders of results, hidden ones, and what links lead to again: links come
    last, so that what they lead to has its own name.
    """
    waiting = [root]
    for path in waiting:
        yield from _candidates_at(path, seen, refused, waiting)


def _candidates_at(
    folder: Path, seen: set[Path], refused: dict[str, DataError], links: list[Path]
) -> Iterator[tuple[Path, str]]:
    """Yield what is in a folder, or is a file; links in it are added to those to be followed."""
    real = folder.resolve()
    try:
        if real in seen or (folder / FILE).exists():
            return
        seen.add(real)
        if folder.is_file():
            yield folder, ""
            return
        if kind := _kind(folder):
            yield folder, kind
            return
        inside = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
    except OSError as error:
        message = f"{folder} cannot be read: {error.strerror}"
        refused[str(folder)] = DataError(message, code="unreadable", fields=(str(folder),))
        return
    for path in inside:
        is_file = not path.is_dir()
        if is_file and (
            path.suffix not in _SUFFIXES
            or (
                # made of recordings, as descriptors
                path.suffix == ".npz" and not is_scene_set(path) and format_of(path) is not None
            )
        ):
            continue
        if path.is_symlink():
            links.append(path)
        else:
            yield from _candidates_at(path, seen, refused, links)


def _kind(folder: Path) -> str:
    """Return the name of the kind of recording that a folder is; "" if it is none."""
    for kind in KINDS.values():
        with suppress(PermissionError):  # of a folder inside, which is looked into by itself
            if kind.recognises(folder):
                return kind.name
    return ""


def _sequences(path: Path, kind: str) -> Sequence[str | None]:
    """Return the names of the sequences that a folder holds; None alone for a single one."""
    if not kind or kind == "folder" or KINDS[kind].topics:  # opening a bag takes long
        return [None]
    try:
        Recording.at(path).open()
    except DataError as error:
        if error.code == "no-sequence" and error.fields:
            return list(error.fields)
    return [None]


def _name(root: Path, path: Path, sequence: str | None) -> str:
    below = path.relative_to(root)
    name = (below.with_suffix("") if path.is_file() else below).as_posix()
    name = root.name if name == "." else name
    return name if sequence is None else f"{name}/{sequence}"


def digest_input(recording: FleetRecording, dataset: Dataset) -> str:
    """Return a name of a recording's content.

    It is made of the name, of the sizes and times of its files, of the begin of the first, and of
    what was read when it was opened: stamps, poses and calibration.
    """
    digest = hashlib.sha256(recording.session.encode())
    files = dataset.files()
    if isinstance(dataset, FileDataset) and dataset.odometry is not None:
        files = [*files, dataset.odometry]
    for path in files:
        with suppress(OSError):  # a missing file is reported when it is read
            status = path.stat()
            line = f"{path.name} {status.st_size} {status.st_mtime_ns}\n"
            digest.update(line.encode(errors="surrogateescape"))
    with suppress(OSError, StopIteration), next(iter(files)).open("rb") as stream:
        digest.update(stream.read(_HEAD))
    for part in _opened_parts(dataset):
        digest.update(repr(part).encode() if not isinstance(part, np.ndarray) else part.tobytes())
    return digest.hexdigest()


def _opened_parts(dataset: Dataset) -> Iterator[object]:
    """Yield the values that descriptions depend on and that opening a recording reads."""
    yield dataset.numbers
    yield dataset.stamps_ns
    yield dataset.poses
    yield dataset.body_from_points
    if isinstance(dataset, FileDataset):
        yield dataset.robot_from_points
    for name, camera in sorted(dataset.cameras.items()):
        yield name
        yield from astuple(camera)
