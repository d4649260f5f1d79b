# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The one way to open a command's DATA, as a value that is stored with results."""

import logging
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats
from fusionslam.config import merged
from fusionslam.datasets import Dataset, open_dataset
from fusionslam.datasets.base import CloudDataset, FileDataset, PosesOrigin
from fusionslam.datasets.streams import (
    absolute_path,
    check_scans,
    check_self_contained,
)
from fusionslam.errors import DataError
from fusionslam.fusion import SENSORS_OF, FusionConfig, frame_from_points
from fusionslam.geometry.trajectory import ground_poses
from fusionslam.sensors.frame import Cloud
from fusionslam.sensors.scan_motion import ScanMotion
from fusionslam.sensors.synchronizer import SyncConfig
from fusionslam.views.scene_set import SceneSet, is_scene_set

logger = logging.getLogger(__name__)


_LACKING = ("missing-sensor", "no-calibration", "no-transform", "no-odometry", "no-colors")
"""Codes of what all frames lack if the first one does."""


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
    deskew: bool = True
    simulated: str | None = None

    @classmethod
    def at(cls, path: str | os.PathLike[str], **how: Any) -> "Recording":
        """Return the recording at a path, which may be relative; the absolute path is stored."""
        for name in ("poses", "calibration"):
            if (file := how.get(name)) is not None:
                how[name] = _absolute(file)
        return cls(_absolute(path), **how)

    def open(self, source: str | None = None) -> Dataset:
        """Open the dataset with the sensors that a source needs; None for all that it has.

        Raises:
            DataError, ConfigError: as ``open_dataset``.
        """
        sensors = None if source is None else SENSORS_OF[source]
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
            deskew=self.deskew,
        )

    def sources(self) -> tuple[str, ...]:
        """Return the sources of clouds that the data allow, at least one.

        Raises:
            DataError: there is no source, or the data of some sensor are damaged. That is no
                reason to take another source, but the message names those that can be asked for.
        """
        try:
            everything = self.open()
        except DataError as error:
            others = " or ".join(f"--source {source}" for source in self._usable())
            if not others:
                raise
            message = f"{error}; {others} makes clouds without these data"
            raise type(error)(message, code=error.code, fields=error.fields) from error
        if everything.sensors == ("points",) or isinstance(everything, CloudDataset):
            return ("cloud",)
        # A calibration can be lacking in files; that of a bag can be named by option.
        is_complete = isinstance(everything, FileDataset) or has_colors(everything)
        if everything.has_points and not everything.cameras and is_complete:
            return ("cloud",)
        usable = self._usable()
        if not usable:
            raise DataError(
                f"{self.path}: clouds need scans and left images, or left and right images of the "
                "same frames",
                code="no-source",
            )
        return usable

    def _open_scenes(self, sensors: Sequence[str] | None) -> Dataset:
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

    def _usable(self) -> tuple[str, ...]:
        """Return the sources of clouds with a camera for which there are frames."""
        usable = []
        for source in ("lidar", "stereo"):
            with suppress(DataError):
                self.open(source)
                usable.append(source)
        return tuple(usable)


def has_colors(dataset: Dataset, source: str = "cloud") -> bool:
    """Whether clouds of a source have colours, by the first scan."""
    return source != "cloud" or dataset[0].colors is not None


def settle_frame(config: FusionConfig, dataset: Dataset) -> FusionConfig:
    """Return a configuration whose clouds are in the scan's frame if the robot's is not known.

    The log says so: the scan's frame serves as the robot's if it has x ahead and z up.
    """
    if config.frame != "robot" or isinstance(dataset, CloudDataset):
        return config
    rows = {0, len(dataset) // 2, len(dataset) - 1}
    if any(dataset[row].robot_from_points is not None for row in rows):
        return config
    logger.warning(
        "%s does not say where its scans are on the robot: clouds are in the scan's frame "
        "(fusion.frame=scan), taken to have x ahead and z up; robot_from_points in a calib.yaml "
        "(--calib, or in a plain folder) says where they are",
        dataset.name,
    )
    return merged(config, {"frame": "scan"})


def warn_of_odometry(dataset: Dataset) -> None:
    """Say of a recording whose only poses are odometry that nothing is judged by them."""
    if dataset.poses_origin is PosesOrigin.ODOMETRY:
        logger.warning(
            "%s: its only poses are odometry, which drifts: nothing is judged by them, only by a "
            "file of true poses (--gt)",
            dataset.name,
        )


def warn_of_mistakes(dataset: Dataset, source: str) -> None:
    """Say what makes clouds of a recording wrong: turns within scans, or its calibration.

    Scans are taken as of one moment. How far the robot turned within them is told by the odometry
    of all frames and the times of points of three scans. Nothing is said where either is unknown,
    or a scan cannot be read, of which whoever uses it says more.

    Args:
        dataset: the recording.
        source: of its clouds.
    """
    # Imported here, as it loads SciPy.
    from fusionslam.calibration.mistakes import warn_of_wrong_calibration

    motion = ScanMotion()
    with suppress(DataError):
        # The motion of the last scan alone stays where odometry ends before its last point.
        rows = {0, len(dataset) // 2, max(len(dataset) - 2, 0)} if len(dataset) else ()
        spans = [span for row in rows if (span := dataset[row].span) is not None]
        if len(spans) > len(rows) / 2:
            typical = sorted(spans, key=lambda span: span[1] - span[0])[len(spans) // 2]
            for frame in dataset:
                motion.follow(frame.stamp_ns, frame.odometry)
                motion.within(typical)
    motion.warn(dataset.name)
    warn_of_wrong_calibration(dataset, source)


def body_from_clouds(dataset: Dataset, config: FusionConfig) -> Floats | None:
    """Return the transforms from the frame of each cloud to the body of the poses.

    The body is fixed to the robot; a scanner that turns on it moves in the body.

    Returns:
        float64 (N, 4, 4), one of each frame; None if ``dataset.body_from_points`` is not known.

    Raises:
        DataError: a frame does not know the pose of its cloud's frame.
    """
    if dataset.body_from_points is None:
        return None
    body_from_robot = dataset.body_from_robot if len(dataset) else np.eye(4)
    moved = []
    for frame in dataset:
        place = frame.robot_from_points
        scan = dataset.body_from_points if place is None else body_from_robot @ place
        moved.append(scan @ np.linalg.inv(frame_from_points(frame, config.frame)))
    return np.array(moved, np.float64).reshape(-1, 4, 4)


class FrameError(DataError):
    """A frame cannot be used; with bad_frames="skip" the others still can."""

    code = "frame"


@contextmanager
def name_frame(dataset: Dataset, index: int, *, can_skip: bool = False) -> Iterator[None]:
    """Add the names of recording, frame and file to a DataError of the block.

    Args:
        dataset, index: of the frame.
        can_skip: whether the caller can leave out such frames: the error is a ``FrameError``,
            unless all frames lack what the first one does.
    """
    try:
        yield
    except DataError as error:
        in_all = index == 0 and error.code in _LACKING
        kind = FrameError if can_skip and not in_all else DataError
        path = dataset.file_of(index)
        file = "" if path is None or str(path) in error.fields else f" ({path})"
        raise kind(
            f"{dataset.name}, frame {dataset.numbers[index]}{file}: {error}",
            code=error.code,
            fields=error.fields,
        ) from error


def _absolute(path: str | os.PathLike[str]) -> str:
    return str(absolute_path(path))


ON_ROBOT = ("robot", "scan")
"""Frames of clouds that move with the robot; a scene set is in the scan's if only that is known."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class SceneRecording(CloudDataset):
    """A scene set as a recording of clouds; it has none if the set holds only scenes."""

    scenes: SceneSet

    @classmethod
    def open(cls, path: Path) -> "SceneRecording":
        """Read a scene set. Raises DataError as ``SceneSet.load``, or if it has no scans."""
        scenes = SceneSet.load(path)
        if not len(scenes):
            raise DataError(f"{path} is a scene set without scans")
        return cls(
            kind="scenes",
            name=scenes.name,
            root=path,
            numbers=scenes.numbers,
            stamps_ns=scenes.stamps_ns,
            pose_frame="the robot",
            body_from_points=np.eye(4) if scenes.frame in ON_ROBOT else None,
            poses=None if scenes.poses is None else ground_poses(*scenes.poses.T),
            scenes=scenes,
        )

    @property
    def counts(self) -> dict[str, int]:
        """The number of clouds; empty if the set has none."""
        return {} if self.scenes.clouds is None else {"points": len(self)}

    def content(self, sensor: str) -> str:
        """Describe the number of clouds and their frame."""
        empty = int(self.scenes.empty.sum())
        return f"{len(self)} coloured clouds in the {self.scenes.frame} frame, {empty} empty"

    def whole_cloud(self, index: int) -> Cloud:
        """Return a stored cloud. Raises DataError if the set holds only scenes."""
        if self.scenes.clouds is None:
            raise DataError(
                f"{self.name} holds no clouds: record it without --only-scenes", code="no-clouds"
            )
        return self.scenes.clouds[index]

    def _only(self, rows: NDArray[np.int64]) -> dict[str, Any]:
        return {"scenes": self.scenes.subset(rows)}

    def rows(self) -> list[tuple[str, str]]:
        """Return (label, value) pairs about the content of the set other than clouds."""
        built = "built when needed" if self.scenes.scenes is None else f"{len(self)} stored"
        return [("scenes", built), ("features", ", ".join(self.scenes.features) or "none")]
