# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The kinds of recordings: how each is recognised, and what opens it."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from fusionslam.datasets.bags.reader import bag_kind
from fusionslam.datasets.base import Dataset
from fusionslam.datasets.folder import is_folder, open_folder
from fusionslam.datasets.kitti_360 import is_kitti_360, open_kitti_360
from fusionslam.datasets.kitti_object import is_kitti_object, open_kitti_object
from fusionslam.datasets.kitti_odometry import is_kitti_odometry, open_kitti_odometry
from fusionslam.datasets.kitti_raw import is_kitti_raw, open_kitti_raw
from fusionslam.datasets.mulran import MULRAN
from fusionslam.datasets.nclt import NCLT
from fusionslam.datasets.range_recording import is_recording, open_recording
from fusionslam.datasets.streams import Request


class Kind(NamedTuple):
    """A kind of recording.

    Attributes:
        name: as in ``open_dataset(kind=...)``.
        layout: what it is recognised by, in a few words for messages.
        recognises: whether a path is of this kind.
        open: opens it.
        folder: whether it is always a folder, so that files need not be looked at.
        topics: whether it has topics to choose.
        calibration: whether another calibration can be used instead of its own.
    """

    name: str
    layout: str
    recognises: Callable[[Path], bool]
    open: Callable[[Path, Request], Dataset]
    folder: bool = True
    topics: bool = False
    calibration: bool = False


def _bag(name: str, suffix: str) -> Kind:
    def open_bag(path: Path, request: Request) -> Dataset:
        # Imported here, as it loads SciPy.
        from fusionslam.datasets.bags.dataset import open_bag_dataset

        return open_bag_dataset(path, request)

    return Kind(
        name,
        suffix,
        lambda path: bag_kind(path) == name,
        open_bag,
        folder=False,
        topics=True,
        calibration=True,
    )


# In the order in which they are tried: an object folder has a velodyne/ too, a drive of KITTI-360
# looks like one of KITTI raw, and any of them may contain a folder of images.
KINDS = {
    kind.name: kind
    for kind in (
        Kind(
            "kitti-object", "calib/ with velodyne/ or image_2/", is_kitti_object, open_kitti_object
        ),
        Kind(
            "kitti-odometry",
            "sequences/, velodyne/ or image_0/ ... image_3/",
            is_kitti_odometry,
            open_kitti_odometry,
        ),
        Kind("kitti-360", "data_3d_raw/ or data_2d_raw/", is_kitti_360, open_kitti_360),
        Kind(
            "kitti-raw",
            "velodyne_points/ or image_00/ ... image_03/",
            is_kitti_raw,
            open_kitti_raw,
        ),
        Kind(
            "mulran",
            "sensor_data/Ouster/, or Ouster/ and global_pose.csv",
            MULRAN.recognises,
            MULRAN.open,
        ),
        Kind("nclt", "velodyne_sync/", NCLT.recognises, NCLT.open),
        Kind(
            "folder",
            "files in clouds/, points/, images/ or left/",
            is_folder,
            open_folder,
            calibration=True,
        ),
        Kind(
            "ranges",
            "a .npz with stamps, rays and lidar_xyz",
            is_recording,
            open_recording,
            folder=False,
        ),
        _bag("rosbag1", ".bag"),
        _bag("rosbag2", ".db3"),
        _bag("mcap", ".mcap"),
    )
}
