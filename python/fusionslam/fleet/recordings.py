# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The recordings below a folder: where they are, and which robot drove where."""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from fusionslam.datasets import KINDS, Dataset
from fusionslam.errors import ConfigError, DataError
from fusionslam.fleet.places import ABOUT
from fusionslam.pipelines.recording import Recording

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

    def dump(self) -> dict[str, Any]:
        """Return everything as values for JSON."""
        return asdict(self)

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
    for path in _candidates(root, excluded, found.refused):
        for sequence in _sequences(path):
            session = _name(root, path, sequence)
            _add(found, session, Recording.at(path, sequence=sequence), labels)
    found.recordings.sort(key=lambda each: each.session)
    return found


def _add(found: Found, session: str, recording: Recording, labels: Labels) -> None:
    """Take in a recording, unless another one has its name."""
    others = [each for each in found.recordings if each.session == session]
    if others:
        message = (
            f"{recording.path} has the name of {others[0].recording.path}, {session!r}: it is left "
            "out; expected names of their own"
        )
        found.refused[recording.path] = DataError(message, code="same-name", fields=(session,))
        return
    found.recordings.append(FleetRecording(session, recording, **labels.of(session)))


def _candidates(
    folder: Path, excluded: Path | None, refused: dict[str, DataError]
) -> Iterator[Path]:
    """Yield the paths that are recordings, or look like them, and do not lie in one."""
    if excluded is not None and folder.resolve() == excluded.resolve():
        return
    if _recognised(folder):
        yield folder
        return
    try:
        inside = sorted(folder.iterdir())
    except OSError as error:
        message = f"{folder} cannot be read: {error.strerror}"
        refused[str(folder)] = DataError(message, code="unreadable", fields=(str(folder),))
        return
    for path in inside:
        if path.is_dir():
            yield from _candidates(path, excluded, refused)
        elif path.suffix in _SUFFIXES:
            yield path


def _recognised(path: Path) -> bool:
    with suppress(OSError):
        return any(kind.recognises(path) for kind in KINDS.values())
    return False


def _sequences(path: Path) -> Sequence[str | None]:
    """Return the names of the sequences that a folder holds; None alone for a single one."""
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
    """Return a name of a recording's content: its name, its files' sizes and times, its begin."""
    digest = hashlib.sha256(recording.session.encode())
    files = dataset.files()
    for path in files:
        with suppress(OSError):  # a missing file is reported when it is read
            status = path.stat()
            digest.update(f"{path.name} {status.st_size} {status.st_mtime_ns}\n".encode())
    with suppress(OSError, StopIteration), next(iter(files)).open("rb") as stream:
        digest.update(stream.read(_HEAD))
    digest.update(dataset.stamps_ns.tobytes())
    return digest.hexdigest()
