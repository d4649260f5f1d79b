# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Drives: recordings with the robot's trajectory, the input of RatSLAM and method comparison."""

import os
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats, Image
from fusionslam.base.progress import Step, label_progress
from fusionslam.config import merged
from fusionslam.datasets.base import CloudDataset, FileDataset, PosesOrigin
from fusionslam.datasets.range_recording import (
    RangeRecording,
    RecordingConfig,
    is_recording,
    shapes_in,
)
from fusionslam.errors import DataError
from fusionslam.evaluation.views.published import world_of
from fusionslam.fusion import ROBOT_FUSION
from fusionslam.geometry.odometry_noise import DRIFT, OdometryConfig, add_odometry_errors
from fusionslam.geometry.se2 import places_of, transform_points
from fusionslam.geometry.trajectory import Trajectory, read_trajectory
from fusionslam.pipelines.recording import (
    ON_ROBOT,
    Recording,
    SceneRecording,
    settle_frame,
    warn_of_odometry,
)
from fusionslam.pipelines.scenes import record_scenes
from fusionslam.sensors.frame import Cloud
from fusionslam.sensors.image_series import ImageSeries
from fusionslam.views.scene_set import CloudArray, SceneSet

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset

Render = Callable[..., ImageSeries]
"""Renders a drive's images in a world: ``fusionslam.sim.rendered_images.rendered_images``."""
FrameName = Literal["robot", "odometry", "drift"]

FRAMES: dict[FrameName, str] = {
    "robot": "clouds in the robot's frame",
    "odometry": "clouds in the frame of odometry that never errs: what the thesis did",
    "drift": "clouds in the frame of odometry that drifts: 2 % of the way, 1 % of the turns",
}
"""The frames that clouds may be in, with a description of each."""


class Drive:
    """A robot's drive through a world: sensor data, odometry and ground truth.

    Args:
        dataset: scans, images, or both.
        name: for people; None for the dataset's.
        world: the thesis's world that was driven through; None for any other.
        ranges: how scans of a range recording become clouds.
        render: renders the images of a range recording in the world beside it; None for no images.
        jobs: number of frames processed in parallel.
        step: progress callback.
    """

    def __init__(
        self,
        dataset: "Dataset",
        *,
        name: str | None = None,
        world: str | None = None,
        ranges: RecordingConfig | None = None,
        render: Render | None = None,
        jobs: int = 1,
        step: Step | None = None,
    ) -> None:
        self.dataset = dataset
        self.name = name or dataset.short_name
        self.world = world
        self.stamps_ns: NDArray[np.int64] = np.asarray(dataset.stamps_ns, np.int64)
        self._ranges = ranges or RecordingConfig()
        self._render, self._jobs, self._step = render, jobs, step

    @property
    def shapes(self) -> str:
        """Shapes that the scanner saw, "collision" or "visual"; empty if unknown."""
        return self.dataset.shapes if isinstance(self.dataset, RangeRecording) else ""

    @property
    def slides(self) -> bool:
        """Whether the true poses may be of a sensor off the axle, which turns move sideways."""
        return isinstance(self.dataset, FileDataset)

    @cached_property
    def truth(self) -> Trajectory | None:
        """Ground-truth trajectory; None if unknown. Odometry does not count as ground truth."""
        dataset = self.dataset
        if isinstance(dataset, RangeRecording):
            if dataset.places is None:
                return None
            # The recorded trajectory, else straight lines between the poses of the scans.
            world = world_beside(dataset.root)
            beside = None if world is None else world.with_suffix(".trajectory.csv")
            if beside is not None and beside.is_file():
                return read_trajectory(beside)
            return _between(dataset.seconds, dataset.places)
        if dataset.truth_topic is not None and dataset.poses_origin is not PosesOrigin.FILE:
            messages = dataset.motion("truth")
            poses = np.stack([message.pose for message in messages]) @ dataset.body_from_robot
            seconds = np.array([message.stamp_ns for message in messages]) / 1e9
            return _between(seconds, places_of(poses))
        warn_of_odometry(dataset)
        if dataset.true_poses is None:
            return None
        return _between(
            self.stamps_ns / 1e9, places_of(dataset.true_poses @ dataset.body_from_robot)
        )

    def true_way(self) -> Trajectory:
        """Return the ground-truth trajectory. Raises DataError if it is unknown."""
        if self.truth is None:
            raise DataError(
                f"{self.name}: no true poses, in the data or beside them (gt)", code="no-poses"
            )
        return self.truth

    def scan(self, index: int, *, ground: bool) -> Any:
        """Return a cloud in the robot's frame, or a frame to be fused.

        Args:
            index: of the scan.
            ground: whether a cloud keeps its ground; has no effect on a frame, which the caller
                fuses.
        """
        if isinstance(self.dataset, RangeRecording):
            height = None if ground else self._ranges.ground_height
            config = self._ranges.model_copy(update={"ground_height": height})
            return self.dataset.cloud(index, config)
        if isinstance(self.dataset, CloudDataset):
            return self.dataset.whole_cloud(index)
        return self.dataset[index]

    def images(self, bottom: int | None = None) -> ImageSeries | None:
        """Return the camera images, or None if there are none.

        Args:
            bottom: index of the row after the last one needed.
        """
        dataset = self.dataset
        if not isinstance(dataset, RangeRecording):
            return dataset.camera_images()
        world = world_beside(dataset.root)
        if world is None or dataset.places is None or self._render is None:
            return None
        return self._render(world, dataset.seconds, dataset.places, bottom=bottom)

    def images_with_poses(self, bottom: int | None = None) -> ImageSeries | None:
        """Return ``images`` with ground-truth poses, interpolated between those of the scans."""
        images = self.images(bottom)
        if images is None or images.poses is not None:
            return images
        scans = self._all_scenes
        return replace(images, poses=places_at(images.seconds, scans.seconds, scans.poses))

    @cached_property
    def scenes(self) -> SceneSet:
        """Clouds without ground, and ground-truth poses, of all scans with points above the floor.

        Raises:
            DataError: there are no ground-truth poses, the scene set is not in the robot's frame,
                or no scan has points above the floor; or as ``record_scenes``.
        """
        whole = self._all_scenes
        whole.true_poses()
        if whole.frame not in ON_ROBOT:
            raise DataError(
                f"{whole.name}: scenes in the frame {whole.frame!r}, expected 'robot'",
                code="wrong-frame",
                fields=(whole.frame,),
            )
        scenes = whole.without_empty()
        if not len(scenes):
            raise DataError(
                f"{whole.name}: none of {len(whole)} scans holds anything above the floor",
                code="only-floor",
            )
        return scenes

    @property
    def dropped(self) -> int:
        """Number of scans left out because they have no points above the floor."""
        return len(self._all_scenes) - len(self.scenes)

    @cached_property
    def with_ground(self) -> SceneSet | None:
        """The same scans with the ground left in; None if the recording was stored without it."""
        if isinstance(self.dataset, SceneRecording):
            return None
        whole = self._record(ground=True)
        return whole.subset(np.flatnonzero(np.isin(whole.numbers, self.scenes.numbers)))

    @property
    def picture(self) -> Callable[[int], Image] | None:
        """Function from the number of a scan to its left image; None if there are no images."""
        dataset = self.dataset
        if "left" not in dataset.sensors:
            return None
        rows = {number: row for row, number in enumerate(dataset.numbers.tolist())}
        return lambda number: dataset[rows[number]].images["left"]

    def cloud(self, number: int) -> Cloud:
        """Return the cloud of a scan, by its number. Raises DataError if the set lacks it."""
        row = np.flatnonzero(self.scenes.numbers == number)
        if self.scenes.clouds is None or not row.size:
            raise DataError(f"{self.name}: no cloud of scan {number}")
        return self.scenes.clouds[int(row[0])]

    @cached_property
    def _all_scenes(self) -> SceneSet:
        return self._record(ground=False)

    def _record(self, *, ground: bool) -> SceneSet:
        """Record all scans as clouds, with or without the ground."""
        dataset, source = self.dataset, "cloud"
        if dataset.has_points and "left" in dataset.sensors:
            source = "lidar"
        elif dataset.has_stereo:
            source = "stereo"
        fusion = merged(ROBOT_FUSION, {"source": source})
        fusion = settle_frame(fusion, self.dataset)
        ranges = self._ranges
        if ground:
            fusion = merged(fusion, {"ground": "none"})
            ranges = ranges.model_copy(update={"ground_height": None})
        scenes = record_scenes(
            self.dataset,
            fusion=fusion,
            recording=ranges,
            jobs=self._jobs,
            progress=label_progress(self._step, f"fusing {self.name}"),
        )
        return replace(scenes, name=self.name)


def open_drive(
    source: Recording | str | os.PathLike[str],
    *,
    ranges: RecordingConfig | None = None,
    render: Render | None = None,
    jobs: int = 1,
    step: Step | None = None,
) -> Drive:
    """Open a recording as a drive.

    Args:
        source: the recording, or its path.
        ranges: how scans of a range recording become clouds; None for the collision shapes. Where
            the recording lacks the shapes asked for, the others are used.
        render: renders the images of a range recording in the world beside it; None for no images.
        jobs: number of frames processed in parallel.
        step: progress callback.

    Raises:
        DataError, ConfigError: as ``Recording.open``.
    """
    recording = source if isinstance(source, Recording) else Recording.at(source)
    ranges = ranges or RecordingConfig(shapes="collision")
    if recording.shapes is None and is_recording(recording.path):
        shapes = ranges.shapes if ranges.shapes in shapes_in(recording.path) else None
        recording = replace(recording, shapes=shapes)
    dataset, simulated = recording.open(), recording.simulated
    place = dataset.name if isinstance(dataset, SceneRecording) else dataset.root.stem
    return Drive(
        dataset,
        name=f"simulated {simulated}" if simulated else None,
        # A simulated world differs from the thesis's world of the same name.
        world=None if simulated else world_of(place),
        ranges=ranges,
        render=render,
        jobs=jobs,
        step=step,
    )


def world_beside(recording: Path) -> Path | None:
    """Return the world named like a recording, in ``worlds`` beside its folder, or None."""
    found = recording.resolve().parent.parent / "worlds" / f"{recording.stem}.glb"
    return found if found.is_file() else None


def _between(seconds: Floats, places: Floats) -> Trajectory | None:
    """Join places (n, 3) by straight lines; None for fewer than two places or distinct times."""
    rising = np.concatenate([[True], np.diff(seconds) > 0])
    if np.count_nonzero(rising) < 2:
        return None
    x, y, yaw = places[rising].T
    return Trajectory(seconds[rising], x, y, np.unwrap(yaw))


def places_at(times: Floats, seconds: Floats, poses: Floats | None) -> Floats | None:
    """float64 (k, 3): places at ``times``, interpolated linearly between poses (n, 3).

    ``seconds`` (n) are the increasing times of the poses.
    """
    if poses is None:
        return None
    columns = (poses[:, 0], poses[:, 1], np.unwrap(poses[:, 2]))
    return np.stack([np.interp(times, seconds, values) for values in columns], axis=1)


def move_clouds(scenes: SceneSet, frame: FrameName) -> SceneSet:
    """Return the set with its clouds in one of ``FRAMES``, without scenes and descriptors.

    Raises:
        DataError: the set has no ground-truth poses, or no clouds.
    """
    if frame == "robot":
        return scenes
    if scenes.clouds is None:
        raise DataError(
            f"{scenes.name} holds no clouds: its frame cannot be changed", code="no-clouds"
        )
    errors = DRIFT if frame == "drift" else OdometryConfig()
    places = add_odometry_errors(scenes.true_poses(), scenes.seconds, errors)
    clouds = []
    for index, place in enumerate(places.tolist()):
        cloud = scenes.clouds[index]
        points = transform_points(cloud.points, *place).astype(np.float32)
        clouds.append(replace(cloud, points=points))
    return replace(
        scenes,
        frame="odometry",
        clouds=CloudArray.of(clouds),
        scenes=None,
        scene_config=None,
        features={},
    )
