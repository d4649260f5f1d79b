# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings as RatSLAM takes them: what a robot saw, how it moved, and where it truly was."""

import os
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.datasets.range_recording import RangeRecording, RecordingConfig, is_recording
from fusionslam.errors import DataError
from fusionslam.geometry.se2 import places_of
from fusionslam.geometry.trajectory import Trajectory, read_trajectory
from fusionslam.pipelines.drive_images import (
    Images,
    recorded_images,
    rendered_images,
    world_beside,
)
from fusionslam.sensors.messages import Odometry

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset
    from fusionslam.datasets.bags.dataset import BagDataset

Progress = Callable[[str, int, int], None]
"""Called with what is being done, how much of it is done, and how much there is."""


class Tour(ABC):
    """A robot's way through a world.

    Attributes:
        name: for people.
        stamps_ns: int64 (n), increasing, of the scans.
        truth: where the robot truly was; None where nobody knows.
    """

    name: str
    stamps_ns: NDArray[np.int64]
    truth: Trajectory | None

    @abstractmethod
    def scan(self, index: int, *, ground: bool) -> Any:
        """A cloud in the robot's frame, or a frame to be fused.

        Args:
            index: of the scan.
            ground: whether a cloud keeps its ground.
        """

    @abstractmethod
    def images(self, bottom: int | None = None) -> Images | None:
        """What the camera saw, given the row after the last that is needed; None for none."""

    @property
    def topic(self) -> str | None:
        """What odometry was published on; None where there is none."""
        return None

    def odometry(self) -> list[Odometry]:
        """What was published there, in the order of stamps. Raises DataError where nothing was."""
        raise DataError(f"{self.name} has no odometry messages")

    def true_way(self) -> Trajectory:
        """The truth. Raises DataError where nobody knows it."""
        if self.truth is None:
            raise DataError(f"{self.name}: no true poses, in the data or beside them (gt)")
        return self.truth


class RecordedTour(Tour):
    """A ``.npz`` recording; the true way and the world's images come from what lies beside it.

    Args:
        path: of the recording.
        config: what the scanner met.
    """

    def __init__(self, path: Path, config: RecordingConfig) -> None:
        self._path, self._config = path, config
        self._data = RangeRecording.open(path, config.shapes)
        self.name = self._data.name
        self.stamps_ns = _nanoseconds(self._data.seconds)
        self.truth = self._way()

    def scan(self, index: int, *, ground: bool) -> Any:
        """As ``Tour``."""
        height = None if ground else self._config.ground_height
        return self._data.cloud(index, self._config.model_copy(update={"ground_height": height}))

    def images(self, bottom: int | None = None) -> Images | None:
        """As ``Tour``."""
        world = world_beside(self._path)
        if world is None or self._data.places is None:
            return None
        return rendered_images(world, self._data.seconds, self._data.places, bottom=bottom)

    def _way(self) -> Trajectory | None:
        """The drive that was recorded, else straight lines between the poses of the scans."""
        world, poses = world_beside(self._path), self._data.places
        beside = None if world is None else world.with_suffix(".trajectory.csv")
        if poses is None:
            return None
        if beside is not None and beside.is_file():
            return read_trajectory(beside)
        return _between(self._data.seconds, poses)


class DatasetTour(Tour):
    """A dataset whose frames are fused when they are looked at.

    Args:
        dataset: with scans or images.
        name: instead of the dataset's own.
    """

    def __init__(self, dataset: "Dataset", name: str | None = None) -> None:
        self.dataset = dataset
        self.name = name or dataset.name.partition(" (")[0]
        self.stamps_ns = np.asarray(dataset.stamps_ns, np.int64)
        self.truth = self._way()

    def scan(self, index: int, *, ground: bool) -> Any:
        """As ``Tour``; whoever fuses the frame decides about its ground."""
        return self.dataset[index]

    def images(self, bottom: int | None = None) -> Images | None:
        """As ``Tour``."""
        return recorded_images(self.dataset, self.stamps_ns / 1e9, None)

    @property
    def topic(self) -> str | None:
        """As ``Tour``."""
        bag = _bag(self.dataset)
        return None if bag is None else bag.source.roles.get("odometry")

    def odometry(self) -> list[Odometry]:
        """As ``Tour``."""
        return super().odometry() if self.topic is None else self._messages("odometry")

    def _messages(self, role: str) -> list[Odometry]:
        bag = _bag(self.dataset)
        assert bag is not None
        found, by_arrival = [], bag.source.stamps == "bag"
        for event in bag.source.bag.events([bag.source.roles[role]]):
            assert isinstance(event.message, Odometry)
            stamp_ns = event.time_ns if by_arrival else event.message.stamp_ns
            found.append(replace(event.message, stamp_ns=stamp_ns))
        # Arrival may be out of order; what is measured is not.
        return sorted(found, key=lambda message: message.stamp_ns)

    def _way(self) -> Trajectory | None:
        """The truth of a bag, or the poses of the frames; odometry is no truth."""
        bag = _bag(self.dataset)
        if bag is not None and "truth" in bag.source.roles:
            messages = self._messages("truth")
            poses = np.stack([message.pose for message in messages])
            seconds = np.array([message.stamp_ns for message in messages]) / 1e9
            return _between(seconds, places_of(poses))
        by_file = self.dataset.pose_frame.endswith("by a file")
        if self.dataset.poses is None or (bag is not None and not by_file):
            return None
        return _between(self.stamps_ns / 1e9, places_of(self.dataset.poses))


def open_tour(
    source: str | os.PathLike[str],
    *,
    recording: RecordingConfig | None = None,
    jobs: int = 1,
    progress: Progress | None = None,
) -> Tour:
    """A recording, a bag or another dataset, or the embedded drive of a world, by its name.

    Args:
        source: path, or name: "warehouse", "house", "hospital".
        recording: how scans of a ``.npz`` become clouds.
        jobs: frames that a world is recorded at a time, if it has yet to be.
        progress: told about that.

    Raises:
        DataError: nothing there, or nothing recognised.
    """
    from fusionslam.datasets import open_dataset
    from fusionslam.pipelines.drives import embedded

    path, name = Path(source).expanduser(), None
    if not path.exists():
        path, name = embedded(str(source), jobs, progress), f"simulated {source}"
    if is_recording(path):
        return RecordedTour(path, recording or RecordingConfig(shapes="collision"))
    return DatasetTour(open_dataset(path), name)


def _bag(dataset: "Dataset") -> "BagDataset | None":
    from fusionslam.datasets.bags.dataset import BagDataset

    return dataset if isinstance(dataset, BagDataset) else None


def _nanoseconds(seconds: NDArray[np.float64]) -> NDArray[np.int64]:
    return np.round(seconds * 1e9).astype(np.int64)


def _between(seconds: NDArray[np.float64], places: NDArray[np.float64]) -> Trajectory | None:
    """Straight lines between places (n, 3); none between fewer than two, or the same times."""
    rising = np.concatenate([[True], np.diff(seconds) > 0])
    if np.count_nonzero(rising) < 2:
        return None
    x, y, yaw = places[rising].T
    return Trajectory(seconds[rising], x, y, np.unwrap(yaw))
