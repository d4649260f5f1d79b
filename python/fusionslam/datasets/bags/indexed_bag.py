# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``IndexedBag``: an open bag, its topics by role, and its index."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from fusionslam.datasets.bags.index import BagIndex, Series
from fusionslam.datasets.bags.reader import Bag
from fusionslam.datasets.bags.topics import info_role
from fusionslam.errors import DataError
from fusionslam.sensors.messages import CameraInfo
from fusionslam.sensors.transforms import TransformError
from fusionslam.storage.arrays import Matrix


@dataclass(frozen=True, eq=False)
class IndexedBag:
    """An open bag with its topics by role and its index.

    Attributes:
        bag: open for reading.
        roles: topics in use by role ("points", "left", "camera_info", ...).
        index: of these topics, or of all.
        stamps: "header" or "bag".
    """

    bag: Bag
    roles: Mapping[str, str]
    index: BagIndex
    stamps: str

    def series(self, sensor: str) -> Series:
        """Messages of a sensor, which the bag must have."""
        return self.index.series[self.roles[sensor]]

    def info_at(self, stamp_ns: int, camera: str = "left") -> CameraInfo | None:
        """Calibration that is valid for an image's stamp; None if the bag has none."""
        infos = self.index.infos.get(self.roles.get(info_role(camera), ""), [])
        before = [info for info in infos if info.stamp_ns <= stamp_ns]
        return before[-1] if before else next(iter(infos), None)

    def optical_frame(self, camera: str = "left") -> str:
        """Optical frame of a camera; that of the left one also serves the right one."""
        info = self.info_at(0, camera)
        return (info.frame_id if info else "") or self.series(camera).frame_id

    def points_frame(self, sensors: Sequence[str]) -> str:
        """Frame of the points when frames have these sensors.

        The scans' frame, also for stereo pairs alone if TF links it to the camera; else the left
        camera's frame.
        """
        if "points" in sensors:
            return self.series("points").frame_id
        if "points" in self.roles:
            scanner = self.series("points").frame_id
            with suppress(DataError):
                self.index.frames.tree.chain(self.optical_frame(), scanner)
                return scanner
        return self.optical_frame()

    def camera_from_points(
        self, image_ns: int, points_frame: str, scan_ns: int, name: str = "left"
    ) -> Matrix:
        """float64 (4, 4), for a scan and an image with these stamps.

        Without odometry the robot is assumed to stand still between the two.

        Raises:
            TransformError: TF does not link the two frames.
        """
        frames, camera = self.index.frames, self.optical_frame(name)
        if points_frame == camera and image_ns == scan_ns:
            return np.eye(4)
        try:
            return frames.camera_from_points(camera, image_ns, points_frame, scan_ns)
        except TransformError:
            return frames.camera_from_points(camera, image_ns, points_frame, scan_ns, still=True)

    def odometry_at(self, stamp_ns: int) -> Matrix | None:
        """float64 (4, 4), odom_from_robot, or None if it is not known."""
        return lookup_or_none(lambda: self.index.frames.odometry_from_robot(stamp_ns))

    def find_transform(self, body: str, frame: str, stamp_ns: int) -> Matrix | None:
        """float64 (4, 4), body_from_frame, or None if it is not known."""
        return lookup_or_none(lambda: self.index.frames.tree.lookup(body, frame, stamp_ns))


def lookup_or_none(lookup: Callable[[], Matrix | None]) -> Matrix | None:
    try:
        return lookup()
    except TransformError:
        return None
