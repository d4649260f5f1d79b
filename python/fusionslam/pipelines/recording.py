# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Where data come from and where results lie, so that a later command can go on with them.

A folder of results has ``run.json``, which says what was worked on, how and by which command, and
the descriptor runs, in ``descriptors/`` or beside it.
"""

import logging
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fusionslam.errors import DataError
from fusionslam.sensors.synchronizer import SyncConfig

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset

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
