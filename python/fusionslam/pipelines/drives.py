# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Drives on which ways to recognise views are compared: scans, true poses and images of each."""

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from fusionslam.config import merged
from fusionslam.datasets.range_recording import (
    SHAPES,
    RangeRecording,
    RecordingConfig,
    is_recording,
)
from fusionslam.errors import DataError
from fusionslam.evaluation.views.published import world_of
from fusionslam.fusion import ROBOT_FUSION
from fusionslam.geometry.odometry_noise import OdometryConfig, measured_places
from fusionslam.pipelines.drive_images import Images, recorded_images, rendered_images, world_beside
from fusionslam.pipelines.scenes import record_scenes
from fusionslam.sensors.frame import Cloud
from fusionslam.storage.arrays import Image
from fusionslam.views.scene_set import CloudArray, SceneSet, is_scene_set

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset
from fusionslam.geometry.odometry_noise import DRIFT

Step = Callable[[str, int, int], None]
"""Called with what is being done, how much of it is done, and how much there is."""
FrameName = Literal["robot", "odometry", "drift"]

FRAMES: dict[FrameName, str] = {
    "robot": "clouds in the robot's frame",
    "odometry": "clouds in the frame of odometry that never errs: what the thesis did",
    "drift": "clouds in the frame of odometry that drifts: 2 % of the way, 1 % of the turns",
}
"""The frames that clouds may be in, and what they are."""


@dataclass(frozen=True, eq=False)
class Drive:
    """Scans with something above the floor, in the robot's frame, and what else is known.

    Attributes:
        name: for people.
        scenes: clouds without ground, true poses; no scan is empty.
        dropped: scans that were left out because nothing stands above the floor there.
        world: the thesis's world that it is a drive through; None for any other.
        shapes: what the scanner met, "collision" or "visual"; empty where nobody knows.
        record: makes the same set with the ground left in, all scans; None where it is gone.
        find_images: the images, given the row after the last that is needed; None for none.
        picture: the image of a scan, by its number, where it was recorded.
    """

    name: str
    scenes: SceneSet
    dropped: int
    world: str | None = None
    shapes: str = ""
    record: Callable[[], SceneSet] | None = None
    find_images: Callable[[int | None], Images | None] = lambda bottom: None
    picture: Callable[[int], Image] | None = None

    def cloud(self, number: int) -> Cloud:
        """The cloud of a scan, by its number. Raises DataError where the set holds none."""
        row = np.flatnonzero(self.scenes.numbers == number)
        if self.scenes.clouds is None or not row.size:
            raise DataError(f"{self.name}: no cloud of scan {number}")
        return self.scenes.clouds[int(row[0])]

    @cached_property
    def with_ground(self) -> SceneSet | None:
        """The same scans with the ground left in; None where it is gone."""
        if self.record is None:
            return None
        whole = self.record()
        return whole.subset(np.flatnonzero(np.isin(whole.numbers, self.scenes.numbers)))


def open_drive(
    source: str | os.PathLike[str],
    *,
    shapes: str = "collision",
    jobs: int = 1,
    step: Step | None = None,
) -> Drive:
    """A recording, a bag, a scene set, or the embedded drive of a world that is made, by its name.

    Args:
        source: path, or name: "warehouse", "house", "hospital".
        shapes: what the scanner met, where a recording has both.
        jobs: frames worked on at a time.
        step: told about progress.

    Raises:
        DataError: nothing there, nothing recognised, no true poses, nothing above the floor, or
            a scene set in another frame than the robot's.
        FusionSlamError: an extra that is needed is not installed.
    """
    path, made = Path(source).expanduser(), None
    if not path.exists():
        path, made = embedded(str(source), jobs, step), str(source)
    if is_scene_set(path):
        scenes = SceneSet.load(path)
        return _drive(scenes, world=world_of(scenes.name))
    if is_recording(path):
        return _of_recording(path, shapes)
    return _of_dataset(path, jobs, step, made)


def moved(scenes: SceneSet, frame: FrameName) -> SceneSet:
    """The set with its clouds in one of ``FRAMES``; scenes and descriptors are left behind.

    Raises:
        DataError: no true poses, or no clouds.
    """
    if frame == "robot":
        return scenes
    if scenes.clouds is None:
        raise DataError(f"{scenes.name} holds no clouds: its frame is {scenes.frame} for good")
    errors = DRIFT if frame == "drift" else OdometryConfig()
    places = measured_places(scenes.true_poses(), scenes.seconds, errors)
    clouds = [_placed(scenes.clouds[i], *places[i].tolist()) for i in range(len(scenes))]
    return replace(
        scenes,
        frame="odometry",
        clouds=CloudArray.of(clouds),
        scenes=None,
        scene_config=None,
        features={},
    )


def _placed(cloud: Cloud, x: float, y: float, yaw: float) -> Cloud:
    """A cloud of the robot's frame in the frame in which the robot is at x, y, yaw."""
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    points = np.einsum("ij,kj->ik", cloud.points.astype(np.float64), turn) + np.array([x, y, 0])
    return replace(cloud, points=points.astype(np.float32))


def embedded(name: str, jobs: int, step: Step | None) -> Path:
    """The bag of a world that is made, recorded if it has yet to be."""
    from fusionslam.sim.catalogue import check_world
    from fusionslam.sim.recordings import EMBEDDED, embedded_bag

    check_world(name)
    if name not in EMBEDDED:
        raise DataError(f"{name}: expected a recording, or one of {', '.join(EMBEDDED)}")
    label = f"driving: {name}"
    progress = (lambda done, total: step(label, done, total)) if step else None
    return embedded_bag(name, jobs=jobs, progress=progress)


def _of_recording(path: Path, shapes: str) -> Drive:
    with np.load(path) as held:
        known = [name for name in SHAPES if f"{name}_offsets" in held.files]
    met = shapes if shapes in known else None
    data = RangeRecording.open(path, met)
    bare = RecordingConfig(ground_height=None)

    def images(bottom: int | None) -> Images | None:
        world = world_beside(path)
        if world is None or data.places is None:
            return None
        return rendered_images(world, data.seconds, data.places, bottom=bottom)

    return _drive(
        record_scenes(data),
        world=world_of(path.stem),
        shapes=met or known[0],
        record=lambda: record_scenes(data, recording=bare),
        find_images=images,
    )


def _of_dataset(path: Path, jobs: int, step: Step | None, made: str | None) -> Drive:
    from fusionslam.datasets import open_dataset

    dataset = open_dataset(path)
    label = f"fusing {made or dataset.name}"
    progress = (lambda done, total: step(label, done, total)) if step else None
    whole = record_scenes(dataset, jobs=jobs, progress=progress)
    bare = merged(ROBOT_FUSION, {"ground": "none"})
    return _drive(
        # A made world is another one than the thesis's of the same name.
        replace(whole, name=f"simulated {made}" if made else whole.name.partition(" (")[0]),
        world=None if made else world_of(path.stem),
        record=lambda: record_scenes(dataset, fusion=bare, jobs=jobs, progress=progress),
        find_images=lambda bottom: recorded_images(dataset, whole.seconds, whole.poses),
        picture=_pictures(dataset),
    )


def _pictures(dataset: "Dataset") -> Callable[[int], Image] | None:
    """The left image of a scan, by its number."""
    if "left" not in dataset.sensors:
        return None
    rows = {number: row for row, number in enumerate(dataset.numbers.tolist())}
    return lambda number: dataset[rows[number]].images["left"]


def _drive(whole: SceneSet, **known: Any) -> Drive:
    whole.true_poses()
    if whole.frame != "robot":
        raise DataError(f"{whole.name}: scenes in the frame {whole.frame!r}, expected 'robot'")
    scenes = whole.without_empty()
    if not len(scenes):
        raise DataError(f"{whole.name}: none of {len(whole)} scans holds anything above the floor")
    return Drive(whole.name, scenes, dropped=len(whole) - len(scenes), **known)
