# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The one way to open a command's DATA, as a value that is stored with results."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fusionslam.datasets.base import CloudDataset
from fusionslam.datasets.streams import GapsError, check_scans, check_self_contained
from fusionslam.errors import DataError
from fusionslam.fusion import SENSORS_OF
from fusionslam.sensors.synchronizer import SyncConfig

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset


@dataclass(frozen=True)
class Recording:
    """A recording and how to open it: anything that ``open_dataset`` reads, or a scene set.

    The other arguments are those of ``open_dataset``; ``sync`` holds the values of ``SyncConfig``
    that differ from its defaults.

    Attributes:
        simulated: name of the simulated world that the recording was made in; None for any other.
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
    shapes: str | None = None
    simulated: str | None = None

    @classmethod
    def at(cls, path: str | os.PathLike[str], **how: Any) -> "Recording":
        """Return the recording at a path, which may be relative; the absolute path is stored."""
        for name in ("poses", "calibration"):
            if (file := how.get(name)) is not None:
                how[name] = _absolute(file)
        return cls(_absolute(path), **how)

    def open(self, source: str | None = None) -> "Dataset":
        """Open the dataset with the sensors that a source needs; None for all that it has.

        Raises:
            DataError, ConfigError: as ``open_dataset``.
        """
        return self._open(None if source is None else SENSORS_OF[source])

    def sources(self) -> tuple[str, ...]:
        """Return the sources of clouds that the data allow, at least one.

        Raises:
            DataError: there is no source, or a source lacks a file in between.
        """
        everything, problem = self._everything()
        if everything is not None and (
            everything.sensors == ("points",) or isinstance(everything, CloudDataset)
        ):
            return ("cloud",)
        usable = tuple(source for source in ("lidar", "stereo") if self._allows(source))
        if not usable:
            raise problem or DataError(
                f"{self.path}: clouds need scans and left images, or left and right images of the "
                "same frames"
            )
        return usable

    def _open(self, sensors: Sequence[str] | None) -> "Dataset":
        from fusionslam.datasets import open_dataset
        from fusionslam.views.scene_set import is_scene_set

        if Path(self.path).is_file() and is_scene_set(self.path):
            return self._open_scenes(sensors)
        return open_dataset(
            self.path,
            kind=self.kind,
            sequence=self.sequence,
            sensors=sensors,
            gaps=self.gaps,
            poses=self.poses,
            topics=self.topics,
            stamps=self.stamps,
            sync=SyncConfig(**self.sync),
            calibration=self.calibration,
            shapes=self.shapes,
        )

    def _open_scenes(self, sensors: Sequence[str] | None) -> "Dataset":
        from fusionslam.pipelines.scene_recording import SceneRecording

        path, what = Path(self.path), "a scene set"
        given = {
            "--kind": self.kind not in (None, "scenes"),
            "--sequence": self.sequence,
            "--gt": self.poses,
            "--topic": self.topics,
            "--stamps": self.stamps != "header",
            "--sync": self.sync,
            "--calib": self.calibration,
        }
        check_self_contained(path, what, given)
        check_scans(path, what, sensors)
        return SceneRecording.open(path)

    def _everything(self) -> "tuple[Dataset | None, DataError | None]":
        try:
            return self.open(), None
        except DataError as error:
            return None, error

    def _allows(self, source: str) -> bool:
        """Tell whether there are frames for a source; frames missing in between are an error."""
        try:
            self.open(source)
        except GapsError:
            raise
        except DataError:
            return False
        return True


def _absolute(path: str | os.PathLike[str]) -> str:
    return str(Path(path).expanduser().resolve())
