# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A bag as a ``Dataset``: its scans, each with the image that belongs to it."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.datasets.bags.pairing import IndexedBag, Matched, match, motion, open_indexed
from fusionslam.datasets.base import Dataset
from fusionslam.datasets.streams import Request, itself
from fusionslam.datasets.trajectories import match_poses
from fusionslam.errors import DataError
from fusionslam.messages import Picture, Scan
from fusionslam.online import camera_from, rectified
from fusionslam.sensors import Camera, Frame

SENSORS = ("points", "left")


@dataclass(frozen=True, eq=False, kw_only=True)
class BagDataset(Dataset):
    """Frames of a bag; scans and images are read from it one at a time, by any thread.

    Attributes:
        source: the open bag and what is known of it.
        matched: which messages make which frame.
    """

    source: IndexedBag
    matched: Matched

    @property
    def counts(self) -> dict[str, int]:
        """Number of messages by sensor, including those that are in no frame."""
        return {sensor: len(self.source.series(sensor).stamps) for sensor in self.matched.rows}

    def files(self) -> list[Path]:
        """The files of the bag."""
        return sorted(self.root.iterdir()) if self.root.is_dir() else [self.root]

    def content(self, sensor: str) -> str:
        """Number and topic of the messages."""
        return f"{self.counts[sensor]} messages of {self.source.roles[sensor]}"

    def sensor_stamps(self, sensor: str) -> NDArray[np.int64]:
        """When the sensor measured each frame, int64 (N)."""
        return _stamps(self.source, self.matched, sensor)

    def _frame(self, index: int) -> Frame:
        scan = functools.cache(functools.partial(self._scan, index))
        stamp_ns, robot = int(self.stamps_ns[index]), self.source.index.frames.robot
        has_points, has_image = self.has_points, "left" in self.sensors
        return Frame(
            index=index,
            stamp_ns=stamp_ns,
            points=(lambda: scan().points) if has_points else None,
            colors=(lambda: scan().colors) if has_points else None,
            images={"left": functools.partial(self._image, index)} if has_image else {},
            cameras=_cameras(self.source, self.matched, index),
            pose=None if self.poses is None else self.poses[index],
            odometry=self.source.odometry_at(stamp_ns),
            robot_from_points=self.source.points_in(robot, stamp_ns)
            if has_points and robot
            else None,
        )

    def _scan(self, index: int) -> Scan:
        scan = self._message("points", index)
        assert isinstance(scan, Scan)
        return scan

    def _image(self, index: int) -> NDArray[np.uint8]:
        picture = self._message("left", index)
        assert isinstance(picture, Picture)
        info = self.source.info_at(int(self.sensor_stamps("left")[index]))
        if info is None:
            return picture.image
        try:
            return rectified(picture, info, self.source.roles["left"])
        except DataError as error:
            raise DataError(f"{self.root}: {error}") from error

    def _message(self, sensor: str, index: int) -> Any:
        row = int(self.matched.rows[sensor][index])
        place = self.source.series(sensor).place(row)
        return self.source.bag.message(self.source.roles[sensor], *place)


def open_bag_dataset(path: Path, request: Request) -> BagDataset:
    """The frames of a bag: its scans that an image and the place of the camera are known for.

    Raises:
        DataError: no scans or images; no CameraInfo or a useless one; nothing links camera and
            scanner; a clock that jumps back.
        ConfigError: an unknown role or kind of stamps.
    """
    itself(path, request.sequence)
    return dataset_of(open_indexed(path, request.topics, request.stamps), request)


def dataset_of(source: IndexedBag, request: Request) -> BagDataset:
    """The frames of a bag that is open. Raises as ``open_bag_dataset``."""
    path, sensors = source.bag.path, _sensors(source, request.sensors)
    matched = match(source, sensors, request.sync)
    stamps_ns = _stamps(source, matched, sensors[0])
    moved = motion(source, stamps_ns)
    poses, origin = moved.poses, moved.origin
    if request.poses is not None:
        poses, origin = match_poses(request.poses, matched.numbers, stamps_ns), "by a file"
    has_points = "points" in sensors and moved.body
    return BagDataset(
        kind=source.bag.kind,
        name=_name(source),
        root=path,
        numbers=matched.numbers,
        stamps_ns=stamps_ns,
        pose_frame=f"{moved.body or 'the robot'} {origin}".strip(),
        body_from_points=source.points_in(moved.body, int(stamps_ns[0])) if has_points else None,
        poses=poses,
        cameras=_cameras(source, matched, 0),
        gaps=matched.gaps,
        source=source,
        matched=matched,
    )


def _sensors(source: IndexedBag, wanted: Sequence[str] | None) -> tuple[str, ...]:
    """The sensors of the frames: those asked for, else those that the bag has.

    An image without a scan needs no calibration, but one with a scan does.
    """
    roles, path = source.roles, source.bag.path
    found = tuple(sensor for sensor in SENSORS if sensor in roles)
    if not found:
        raise DataError(f"{path} has neither PointCloud2 nor Image messages: {_topics(source)}")
    if wanted is None:
        return found if can_fuse(source) else found[:1]
    for sensor in wanted:
        if sensor not in SENSORS:
            raise DataError(f"{path}: bags are read with one camera, '{sensor}' is not among them")
        if sensor not in roles:
            raise DataError(
                f"{path} has no messages for '{sensor}' with which to make frames: "
                f"{_topics(source)}"
            )
    sensors = tuple(sensor for sensor in SENSORS if sensor in wanted)
    if sensors == SENSORS and source.info_at(0) is None:
        raise DataError(f"{path} has no CameraInfo of {roles['left']}: {_topics(source)}")
    return sensors


def can_fuse(source: IndexedBag) -> bool:
    """Whether there are scans, images and a calibration."""
    return {*SENSORS} <= source.roles.keys() and source.info_at(0) is not None


def _topics(source: IndexedBag) -> str:
    topics = [f"{topic.name} ({topic.type})" for topic in source.bag.topics.values()]
    return f"its topics are {', '.join(topics)}" if topics else "it has no topics"


def _stamps(source: IndexedBag, matched: Matched, sensor: str) -> NDArray[np.int64]:
    return source.series(sensor).stamps_ns[matched.rows[sensor]]


def _cameras(source: IndexedBag, matched: Matched, index: int) -> dict[str, Camera]:
    if matched.cameras_from_points is None:
        return {}
    stamp_ns = int(_stamps(source, matched, "left")[index])
    info = source.info_at(stamp_ns)
    assert info is not None  # _sensors has seen to it
    place = matched.cameras_from_points[index]
    try:
        return {"left": camera_from(info, place, source.roles["camera_info"])}
    except DataError as error:
        raise DataError(f"{source.bag.path}: {error}") from error


def _name(source: IndexedBag) -> str:
    """The bag and what of it is used, so that results of other topics have another name."""
    used = [source.roles[role] for role in (*SENSORS, "odometry", "truth") if role in source.roles]
    clock = ", times of arrival" if source.stamps == "bag" else ""
    return f"{source.bag.path.name} ({', '.join(used)}{clock})"
