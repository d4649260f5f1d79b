# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Write the coloured clouds of a whole recording as a bag: ROS 1, ROS 2 SQLite or MCAP."""

import logging
import os
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fusionslam.base.arrays import Matrix
from fusionslam.base.parallel import ordered_results
from fusionslam.base.progress import Progress, reported
from fusionslam.datasets.base import PosesOrigin
from fusionslam.errors import DataError
from fusionslam.fusion import FusionConfig, frame_from_points, fuse
from fusionslam.pipelines.export_folder import log_empty
from fusionslam.pipelines.frame_check import readable_frames
from fusionslam.pipelines.recording import Recording, name_frame, warn_of_mistakes
from fusionslam.pipelines.results import refuse_input
from fusionslam.sensors.frame import Frame
from fusionslam.sensors.messages import (
    Event,
    FrameTransform,
    FrameTransforms,
    Message,
    Odometry,
    Scan,
)

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset

logger = logging.getLogger(__name__)

BAG_SUFFIXES = (".bag", ".db3", ".mcap")
CLOUDS, ODOMETRY, TRUTH = "/rgb_cloud", "/odom", "/ground_truth"
WORLD, ODOM, ROBOT, SCAN = "world", "odom", "base_footprint", "lidar"
_FRAME_IDS = {"scan": SCAN, "camera": "camera", "robot": ROBOT, "odometry": ODOM}


def write_cloud_bag(
    recording: Recording,
    path: str | os.PathLike[str],
    config: FusionConfig,
    *,
    jobs: int = 1,
    bad_frames: str = "error",
    progress: Progress | None = None,
) -> int:
    """Write a bag of clouds on /rgb_cloud, with the known motion of the robot.

    /odom holds the odometry of the frames; /ground_truth their poses in the world, all of them,
    if they are known from more than odometry; /tf links world, odom, base_footprint, the scan's
    frame (lidar) and camera as far as known, /tf_static the links of lidar and camera that are
    the same in all frames. Stamps are those of the frames. Memory does not grow with the recording.

    Args:
        recording: the data.
        path: file ending in .bag or .mcap, or a folder ending in .db3.
        config: how frames become clouds.
        jobs: number of frames processed in parallel.
        bad_frames: "error" fails on a frame that cannot be read; "skip" leaves it out and logs it.
        progress: called with (frames done, total frames).

    Returns:
        The number of frames.

    Raises:
        DataError: a frame cannot be read or fused, or the bag cannot be written or is the
            recording itself; the part written so far is kept, see ``open_writer``.
    """
    from fusionslam.datasets.bags import open_writer

    target = Path(path).expanduser()
    _refuse_own_input(recording, target)
    dataset = readable_frames(recording.open(config.source), bad_frames, jobs=jobs)
    if target.exists():
        logger.warning("%s is there already and will be replaced", target)
    maker = _Maker(dataset, config, _find_fixed_frames(dataset))
    # Clouds wait for their turn in memory, so only as many as there are threads are made ahead.
    made = ordered_results(maker.events, range(len(dataset)), jobs, ahead=max(jobs, 1) + 1)
    empty = []
    with open_writer(target) as bag, made as frames:
        for row, events in enumerate(reported(frames, progress, len(dataset))):
            for event in events:
                bag.write(event)
                if isinstance(event.message, Scan) and not len(event.message.points):
                    empty.append(row)
    log_empty(dataset, empty)
    warn_of_mistakes(dataset, config.source)
    return len(dataset)


def _refuse_own_input(recording: Recording, target: Path) -> None:
    """Raise DataError if the bag, or the part kept after an error, would replace the input."""
    for path in (target, target.with_name(f"{target.stem}.partial{target.suffix}")):
        refuse_input(recording, path)
        # A ROS 2 bag is a folder; the input may be that folder or the file in it.
        source, there = Path(recording.path).resolve(), path.resolve()
        inside = there.exists() and source in there.parents and (source / "metadata.yaml").exists()
        if there in source.parents or inside:
            raise DataError(
                f"{target} is part of {source}, which is read: write to another place",
                code="output-is-input",
            )


def _find_fixed_frames(dataset: "Dataset") -> frozenset[str]:
    """Return which of the scan's and the camera's frames are fixed throughout the recording.

    In a bag the camera moves relative to the scan if the two are taken at different times.
    """
    fixed = {SCAN: True, _FRAME_IDS["camera"]: True}
    first = dataset[0]
    for index in range(len(dataset)):
        frame = dataset[index]
        fixed[SCAN] &= _same(frame.robot_from_points, first.robot_from_points)
        fixed[_FRAME_IDS["camera"]] &= _same(_camera_place(frame), _camera_place(first))
        if not any(fixed.values()):
            break
    return frozenset(name for name, is_fixed in fixed.items() if is_fixed)


def _camera_place(frame: Frame) -> Matrix | None:
    return frame.cameras["left"].rectified_from_points if "left" in frame.cameras else None


def _same(one: Matrix | None, other: Matrix | None) -> bool:
    return one is not None and other is not None and np.allclose(one, other, rtol=0, atol=1e-9)


@dataclass(frozen=True)
class _Maker:
    """Builds the messages of single frames; shared by all threads."""

    dataset: "Dataset"
    config: FusionConfig
    fixed: frozenset[str] = frozenset()

    def events(self, index: int) -> list[Event]:
        frame, stamp_ns = self.dataset[index], int(self.dataset.stamps_ns[index])
        with name_frame(self.dataset, index, can_skip=True):
            cloud = fuse(frame, self.config)
        name = _FRAME_IDS[self.config.frame]
        scan = Scan(stamp_ns=stamp_ns, frame_id=name, points=cloud.points, colors=cloud.colors)
        messages: list[tuple[str, Message]] = []
        links = self._links(frame, stamp_ns)
        for topic, is_static in (("/tf_static", True), ("/tf", False)):
            chosen = tuple(link for link in links if link.static is is_static)
            # Static transforms are written once.
            if chosen and (index == 0 or not is_static):
                messages.append((topic, FrameTransforms(transforms=chosen)))
        messages += [(topic, odometry) for topic, odometry in self._motion(frame, stamp_ns)]
        messages.append((CLOUDS, scan))
        return [Event(topic, stamp_ns, message) for topic, message in messages]

    def _motion(self, frame: Frame, stamp_ns: int) -> list[tuple[str, Odometry]]:
        found = []
        if frame.odometry is not None:
            found.append((ODOMETRY, _odometry(stamp_ns, ODOM, ROBOT, frame.odometry)))
        world_from_scan = self._world_from_scan(frame)
        if world_from_scan is not None:
            on_robot = frame.robot_from_points is not None
            place = frame_from_points(frame, "robot" if on_robot else "scan")
            pose = world_from_scan @ np.linalg.inv(place)
            found.append((TRUTH, _odometry(stamp_ns, WORLD, ROBOT if on_robot else SCAN, pose)))
        return found

    def _links(self, frame: Frame, stamp_ns: int) -> tuple[FrameTransform, ...]:
        """Return the chain world, odom, base_footprint, lidar, camera, without unknown frames."""
        chain: list[tuple[str, Matrix]] = []  # name, name_from_scan; from the root down
        world_from_scan = self._world_from_scan(frame)
        if world_from_scan is not None:
            chain.append((WORLD, world_from_scan))
        if frame.robot_from_points is not None:
            if frame.odometry is not None:
                chain.append((ODOM, frame_from_points(frame, "odometry")))
            chain.append((ROBOT, frame_from_points(frame, "robot")))
        chain.append((SCAN, np.eye(4)))
        if "left" in frame.cameras:
            chain.append((_FRAME_IDS["camera"], frame_from_points(frame, "camera")))
        return tuple(
            FrameTransform(
                stamp_ns=stamp_ns,
                parent=parent,
                child=child,
                parent_from_child=parent_from_scan @ np.linalg.inv(child_from_scan),
                static=child in self.fixed,
            )
            for (parent, parent_from_scan), (child, child_from_scan) in pairwise(chain)
        )

    def _world_from_scan(self, frame: Frame) -> Matrix | None:
        if frame.pose is None:
            return None
        # Ask the recording whether it has only odometry: in a single frame the ground truth may
        # equal it.
        if frame.odometry is not None and self.dataset.poses_origin is PosesOrigin.ODOMETRY:
            return None
        body_from_points = self.dataset.body_from_points
        return frame.pose if body_from_points is None else frame.pose @ body_from_points


def _odometry(stamp_ns: int, frame_id: str, child: str, pose: Matrix) -> Odometry:
    return Odometry(stamp_ns=stamp_ns, frame_id=frame_id, child_frame_id=child, pose=pose)
