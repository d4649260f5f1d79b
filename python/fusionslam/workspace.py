# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Where data come from and where results lie, so that a later command can go on with them.

A folder of results has ``run.json``, which says what was worked on, how and by which command, and
the descriptor runs, in ``descriptors/`` or beside it.
"""

import json
import logging
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fusionslam._files import atomic_path
from fusionslam.errors import DataError
from fusionslam.synchronizer import SyncConfig

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset

FORMAT = "fusionslam.work.2"
FILE = "run.json"
SENSORS_OF = {"lidar": ("points", "left"), "stereo": ("left", "right"), "cloud": ("points",)}
"""What each source of clouds needs of a frame."""


@dataclass(frozen=True)
class Recording:
    """A recording and how it is opened; the arguments are those of ``open_dataset``.

    ``sync`` holds the values of ``SyncConfig`` that are not its defaults.
    """

    path: str
    kind: str | None = None
    sequence: str | None = None
    gaps: str = "error"
    poses: str | None = None
    topics: Mapping[str, str] = field(default_factory=dict)
    stamps: str = "header"
    sync: Mapping[str, Any] = field(default_factory=dict)
    calibration: str | None = None

    @classmethod
    def at(cls, path: str | os.PathLike[str], **how: Any) -> "Recording":
        """The recording at a path, which may be relative here and is not in what is stored."""
        for name in ("poses", "calibration"):
            if (file := how.get(name)) is not None:
                how[name] = _absolute(file)
        return cls(_absolute(path), **how)

    def open(self, source: str | None = None) -> "Dataset":
        """The dataset with the sensors that a source needs; None for all that it has.

        Raises:
            DataError, ConfigError: as ``open_dataset``.
        """
        return self._open(None if source is None else SENSORS_OF[source], self.gaps)

    def sources(self) -> tuple[str, ...]:
        """The sources of clouds that the data allow, at least one.

        Raises:
            DataError: there is none, or a file is missing in the middle of one.
        """
        everything, problem = self._everything()
        if everything is not None and everything.sensors == ("points",):
            return ("cloud",)
        usable = tuple(source for source in ("lidar", "stereo") if self._allows(source))
        if not usable:
            raise problem or DataError(
                f"{self.path}: clouds need scans and left images, or left and right images of the "
                "same frames"
            )
        return usable

    def _open(self, sensors: Sequence[str] | None, gaps: str) -> "Dataset":
        from fusionslam.datasets import open_dataset

        return open_dataset(
            self.path,
            kind=self.kind,
            sequence=self.sequence,
            sensors=sensors,
            gaps=gaps,
            poses=self.poses,
            topics=self.topics,
            stamps=self.stamps,
            sync=SyncConfig(**self.sync),
            calibration=self.calibration,
        )

    def _everything(self) -> "tuple[Dataset | None, DataError | None]":
        try:
            return self.open(), None
        except DataError as error:
            return None, error

    def _allows(self, source: str) -> bool:
        """Whether there are frames for a source; frames missing in between are an error."""
        try:
            self.open(source)
        except DataError:
            if self._has_gaps(source):
                raise
            return False
        return True

    def _has_gaps(self, source: str) -> bool:
        """Whether the data could be opened if frames were left out."""
        # The reader would say that frames are left out, which is not what happens next.
        reader = logging.getLogger("fusionslam.datasets.streams")
        reader.addFilter(_nothing)
        try:
            self._open(SENSORS_OF[source], "skip")
        except DataError:
            return False
        finally:
            reader.removeFilter(_nothing)
        return True


def _absolute(path: str | os.PathLike[str]) -> str:
    return str(Path(path).expanduser().resolve())


def _nothing(record: logging.LogRecord) -> bool:
    return False


@dataclass(frozen=True)
class Work:
    """What ``run.json`` says about the results in its folder.

    Attributes:
        recording: what was worked on.
        dataset: its name.
        command: what was typed.
        configs: the configuration in force, by source.
        about: whatever else belongs to these results; a change of it makes other results.
        demo: whether the demo made these, and may replace them.
    """

    recording: Recording
    dataset: str
    command: str = ""
    configs: dict[str, dict[str, Any]] = field(default_factory=dict)
    about: dict[str, Any] = field(default_factory=dict)
    demo: bool = False

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Write ``run.json``, whole or not at all. Raises DataError."""
        with atomic_path(Path(folder) / FILE) as temporary:
            content = {"format": FORMAT, **asdict(self)}
            temporary.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")

    @classmethod
    def load(cls, folder: str | os.PathLike[str]) -> "Work | None":
        """Read what ``save`` wrote; None where there is none. Raises DataError naming the file."""
        path = Path(folder) / FILE
        if not path.exists():
            return None
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            if content.pop("format", None) != FORMAT:
                raise DataError(f"{path}: expected format {FORMAT}")
            return cls(**content | {"recording": Recording(**content["recording"])})
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise DataError(f"{path}: not the description of stored work: {error}") from error


def claim(folder: str | os.PathLike[str], work: Work) -> Work:
    """Take a folder for this work, together with work on the same data that is there already.

    Returns:
        The work with the configurations of the earlier one that it does not replace.

    Raises:
        DataError: the folder holds work on other data, or cannot be written.
    """
    earlier = Work.load(folder)
    if earlier is not None:
        if (earlier.recording.path, earlier.dataset, earlier.about) != (
            work.recording.path,
            work.dataset,
            work.about,
        ):
            raise DataError(
                f"{folder} holds results of {earlier.dataset} ({earlier.recording.path})"
                f"{_shown(earlier.about)}: choose another folder or delete this one"
            )
        work = replace(
            work,
            configs=earlier.configs | work.configs,
        )
    work.save(folder)
    return work


def _shown(about: Mapping[str, Any]) -> str:
    return " made with other settings or of other frames" if about else ""


def forget_demo(folder: str | os.PathLike[str], recording: Recording) -> None:
    """Take what an earlier demo made of another drive out of the way, and nothing else.

    Raises:
        DataError: the folder holds other work, which is kept; or a file cannot be deleted.
    """
    earlier = Work.load(folder)
    if earlier is None or earlier.recording.path == recording.path:
        return
    if not earlier.demo:
        raise DataError(
            f"{folder} holds results of {earlier.dataset} ({earlier.recording.path}), which the "
            "demo does not replace: choose another folder"
        )
    try:
        for path in [*_runs_of(earlier, folder), Path(folder) / FILE]:
            path.unlink()
    except OSError as error:
        raise DataError(f"cannot delete {error.filename}: {error.strerror}") from error


def _runs_of(work: Work, folder: str | os.PathLike[str]) -> Iterator[Path]:
    """The runs in a folder that belong to this work; others may lie beside them."""
    from fusionslam.evaluation import DescriptorRun

    for source in work.configs:
        for path in sorted(runs_folder(folder).glob(f"{source}-*.npz")):
            with suppress(DataError):
                if DescriptorRun.load(path).dataset == work.dataset:
                    yield path


def runs_folder(folder: str | os.PathLike[str]) -> Path:
    """Where the descriptor runs of a folder of results lie."""
    inner = Path(folder) / "descriptors"
    return inner if inner.is_dir() else Path(folder)
