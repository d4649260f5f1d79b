# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A bag, its topics by role, and where everything in it lies."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from fusionslam.datasets.bags.index import BagIndex, Series
from fusionslam.datasets.bags.reader import Bag
from fusionslam.datasets.bags.topics import INFO_ROLES
from fusionslam.errors import DataError
from fusionslam.sensors.messages import CameraInfo
from fusionslam.sensors.transforms import TransformError
from fusionslam.storage.arrays import Matrix


@dataclass(frozen=True, eq=False)
class IndexedBag:
    """An open bag, which topic of it is what, and what a pass through it found out.

    Attributes:
        bag: open for reading.
        roles: topics in use, by what they are ("points", "left", "camera_info", ...).
        index: of these topics, or of all.
        stamps: "header" or "bag".
    """

    bag: Bag
    roles: Mapping[str, str]
    index: BagIndex
    stamps: str

    def series(self, sensor: str) -> Series:
        """The messages of a sensor that the bag has."""
        return self.index.series[self.roles[sensor]]

    def info_at(self, stamp_ns: int, camera: str = "left") -> CameraInfo | None:
        """The calibration in force when an image was taken; None if the bag has none."""
        infos = self.index.infos.get(self.roles.get(INFO_ROLES[camera], ""), [])
        before = [info for info in infos if info.stamp_ns <= stamp_ns]
        return before[-1] if before else next(iter(infos), None)

    def optical_frame(self) -> str:
        """The frame of the camera, of a pair of the left one."""
        info = self.info_at(0)
        return (info.frame_id if info else "") or self.series("left").frame_id

    def points_frame(self, sensors: Sequence[str]) -> str:
        """The frame of the points of frames with these sensors.

        That of the scans, also for stereo pairs without scans if TF links the two; else that of
        the left camera.
        """
        if "points" in sensors:
            return self.series("points").frame_id
        if "points" in self.roles:
            scanner = self.series("points").frame_id
            with suppress(DataError):
                self.index.frames.tree.chain(self.optical_frame(), scanner)
                return scanner
        return self.optical_frame()

    def camera_from_points(self, image_ns: int, points_frame: str, scan_ns: int) -> Matrix:
        """float64 (4, 4), for a scan and an image of these times.

        The robot is taken to stand in between where odometry does not say how it moved.

        Raises:
            TransformError: nothing links the two.
        """
        frames, camera = self.index.frames, self.optical_frame()
        if points_frame == camera and image_ns == scan_ns:
            return np.eye(4)
        try:
            return frames.camera_from_points(camera, image_ns, points_frame, scan_ns)
        except TransformError:
            return frames.camera_from_points(camera, image_ns, points_frame, scan_ns, still=True)

    def odometry_at(self, stamp_ns: int) -> Matrix | None:
        """float64 (4, 4), odom_from_robot, or None where it is not known."""
        return _known(lambda: self.index.frames.odometry_from_robot(stamp_ns))

    def placed_in(self, body: str, frame: str, stamp_ns: int) -> Matrix | None:
        """float64 (4, 4), body_from_frame, or None where it is not known."""
        return _known(lambda: self.index.frames.tree.lookup(body, frame, stamp_ns))


def _known(lookup: Callable[[], Matrix | None]) -> Matrix | None:
    try:
        return lookup()
    except TransformError:
        return None
