# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Reads synchronised, rectified KITTI raw drives (Geiger, Lenz, Stiller, Urtasun 2013).

True poses are those of the GPS/IMU records in ``oxts/``, made as the data's devkit makes them,
unless a pose file is given.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats, Matrix
from fusionslam.base.files import reading
from fusionslam.datasets.base import Dataset, FileDataset
from fusionslam.datasets.calibration import homogeneous, read_calibration, rectified_camera
from fusionslam.datasets.kitti_odometry import POSE_FRAME, ROBOT_FROM_VELODYNE, find_streams
from fusionslam.datasets.pose_files import match_poses, read_timestamps, stamps_of
from fusionslam.datasets.streams import (
    Request,
    Stream,
    choose,
    entries,
    find_existing,
    frame_numbers,
    itself,
    named_and_linked,
    one_of,
    scan,
    warn_uncalibrated,
)
from fusionslam.errors import DataError, naming
from fusionslam.geometry.rigid import check_mounting
from fusionslam.sensors.frame import Camera
from fusionslam.sensors.messages import Fix

IMU_FRAME = "GPS/IMU"
OXTS = Path("oxts", "data")
EARTH_RADIUS_M = 6378137.0
FIELDS = (
    *("lat", "lon", "alt", "roll", "pitch", "yaw", "vn", "ve", "vf", "vl", "vu"),
    *("ax", "ay", "az", "af", "al", "au", "wx", "wy", "wz", "wf", "wl", "wu"),
    *("pos_accuracy", "vel_accuracy", "navstat", "numsats", "posmode", "velmode", "orimode"),
)
"""Numbers of a record, as in oxts/dataformat.txt of the data: degrees, metres, radians first."""
_POSE = ("lat", "lon", "alt", "roll", "pitch", "yaw")
_LARGEST = {"lat": 90.0, "lon": 180.0}
STREAM_FOLDERS = ("velodyne_points", "image_00", "image_01", "image_02", "image_03")


def open_kitti_raw(path: Path, request: Request) -> Dataset:
    """Open a drive folder, or the requested drive in the folder of a date.

    Raises:
        DataError: no such drive; a file is missing, too short or malformed.
    """
    root = _drive(path, request.sequence)
    camera_numbers, streams = find_streams(root, "velodyne_points/data", "image_{:02d}/data")
    chosen = choose(streams, request, root)
    numbers, gaps = frame_numbers(chosen, request)
    # Those of the scans or, if they have none, of the first sensor that has some.
    folders = [stream.expected(int(numbers[0])).parent.parent for stream in chosen.values()]
    times = [folder / "timestamps.txt" for folder in folders]
    stamps, recorded = stamps_of(numbers, times, read_timestamps)
    rectified_from_points, cameras = _calibration(root, chosen, camera_numbers)
    # Records of drives that are not synchronised are of 100 Hz: their numbers are not frames'.
    is_synchronised = not root.name.endswith("_extract")
    records = scan(root / OXTS, (".txt",)) if is_synchronised else None
    mounting, velodyne_from_imu = _calibration_file(root, "calib_imu_to_velo.txt"), None
    if records is not None and mounting is not None:
        velodyne_from_imu = read_calibration(mounting).transform("R", "T")
        with naming(mounting):
            check_mounting("R T", velodyne_from_imu)
    if request.poses is not None:
        poses = match_poses(request.poses, numbers, stamps, recorded=recorded)
        truth = _Truth(poses, request.poses, POSE_FRAME, rectified_from_points)
    elif records is None:
        truth = _Truth(None, None, POSE_FRAME, rectified_from_points)
    else:
        truth = _truth(root, records, numbers, rectified_from_points, velodyne_from_imu)
    return KittiRaw(
        kind="kitti-raw",
        name=f"KITTI raw {root.name}",
        root=root,
        streams=chosen,
        numbers=numbers,
        stamps_ns=stamps,
        pose_frame=truth.pose_frame,
        body_is_camera=truth.pose_frame == POSE_FRAME,
        body_from_points=truth.body_from_points,
        poses=truth.poses,
        poses_file=truth.path,
        cameras=cameras,
        gaps=gaps,
        recorded=recorded,
        robot_from_points=ROBOT_FROM_VELODYNE,
        records={} if records is None else records.files,
        velodyne_from_imu=velodyne_from_imu,
    )


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class KittiRaw(FileDataset):
    """A drive whose GPS/IMU tells its positions.

    Attributes:
        records: files of the GPS/IMU by number.
        velodyne_from_imu: float64 (4, 4); None if unknown.
    """

    records: Mapping[int, Path]
    velodyne_from_imu: Matrix | None

    def fixes(self) -> Iterator[Fix]:
        """Positions of the GPS/IMU, twice as uncertain in height as it states for east and north.

        Raises:
            DataError: a record is cut or garbled; the message names the file and the field.
        """
        numbers = sorted(self.records)
        if not numbers:
            return
        times = [self.root / folder / "timestamps.txt" for folder in ("oxts", *STREAM_FOLDERS)]
        stamps_ns, _ = stamps_of(np.array(numbers), times, read_timestamps)
        for number, stamp_ns in zip(numbers, stamps_ns.tolist(), strict=True):
            *place, sd_m = _read_record(self.records[number], (*FIELDS[:3], "pos_accuracy"))
            covariance = np.diag([1.0, 1.0, 4.0]) * sd_m**2 if sd_m > 0 else None
            position = np.array(place)
            yield Fix(
                stamp_ns=stamp_ns, frame_id=IMU_FRAME, position=position, covariance=covariance
            )

    def robot_from_antenna(self) -> Matrix | None:
        """Of the IMU: positions are those of it."""
        if self.velodyne_from_imu is None:
            return None
        return ROBOT_FROM_VELODYNE @ self.velodyne_from_imu


class _Truth(NamedTuple):
    """True poses, where they are from, and the body that they describe."""

    poses: Matrix | None
    path: Path | None
    pose_frame: str
    body_from_points: Matrix | None


def _truth(
    root: Path,
    records: Stream,
    numbers: NDArray[np.int64],
    rectified_from_points: Matrix | None,
    velodyne_from_imu: Matrix | None,
) -> _Truth:
    """Poses by the GPS/IMU: of camera 0 if the calibration places it.

    The world is then camera 0 at the drive's first record, as for KITTI odometry. Where the
    calibration is incomplete, the poses are the IMU's own.
    """
    imu_poses = _read_oxts(records, numbers)
    if velodyne_from_imu is None:
        return _Truth(imu_poses, root / OXTS, IMU_FRAME, None)
    if rectified_from_points is None:
        imu_from_velodyne = np.linalg.inv(velodyne_from_imu).astype(np.float64)
        return _Truth(imu_poses, root / OXTS, IMU_FRAME, imu_from_velodyne)
    camera_from_imu = rectified_from_points @ velodyne_from_imu
    poses = camera_from_imu @ imu_poses @ np.linalg.inv(camera_from_imu)
    return _Truth(poses, root / OXTS, POSE_FRAME, rectified_from_points)


def _calibration_file(root: Path, name: str) -> Path | None:
    """Find a file of the drive or of its date's folder, as in the published data."""
    return find_existing(root / name, *(one.parent / name for one in named_and_linked(root)))


def _drive(path: Path, name: str | None) -> Path:
    """Find the drive folder; a drive may be named by its number alone ("0001")."""
    if _is_drive(path):
        return itself(path, name)
    available = {folder.name: folder for folder in entries(path) if _is_drive(folder)}
    numbered = name.zfill(4) if name else name
    full = next((drive for drive in available if f"_drive_{numbered}_" in drive), name)
    return one_of(path, available, full)


def _is_drive(path: Path) -> bool:
    return any((path / folder).is_dir() for folder in STREAM_FOLDERS)


def _calibration(
    root: Path, streams: dict[str, Stream], numbers: dict[str, int]
) -> tuple[NDArray[np.float64] | None, dict[str, Camera]]:
    """Where the scanner is in camera 0, and the cameras; nothing if a file is missing, logged."""
    found = []
    for name in ("calib_cam_to_cam.txt", "calib_velo_to_cam.txt"):
        path = _calibration_file(root, name)
        if path is None:
            warn_uncalibrated(streams, f"{root / name} and no {root.parent / name}")
            return None, {}
        found.append(read_calibration(path))
    cam_to_cam, velo_to_cam = found
    rectified_from_camera = homogeneous(cam_to_cam.matrix("R_rect_00", 3, 3))
    rectified_from_points = rectified_from_camera @ velo_to_cam.transform("R", "T")
    return rectified_from_points, {
        name: rectified_camera(cam_to_cam, number, rectified_from_points)
        for name, number in numbers.items()
        if name in streams
    }


def is_kitti_raw(path: Path) -> bool:
    """Whether a folder has this layout."""
    return _is_drive(path) or any(_is_drive(folder) for folder in entries(path))


def _read_oxts(records: Stream, numbers: NDArray[np.int64]) -> Matrix:
    """Poses of the IMU at frames, float64 (N, 4, 4), NaN for those without a record.

    They are relative to the first record of the drive: its x axis ahead, y to the left, z up.

    Args:
        records: the files by frame number.
        numbers: int64 (N), of the frames.

    Raises:
        DataError: a record is cut or garbled; the message names the file and the field.
    """
    first = min(records.files)
    known = np.array([number in records.files for number in numbers.tolist()], dtype=bool)
    wanted = [first, *numbers[known].tolist()]
    poses = oxts_poses(np.array([_read_record(records.files[number], _POSE) for number in wanted]))
    found = np.full((len(numbers), 4, 4), np.nan)
    found[known] = poses[1:]
    return found


def oxts_poses(records: Floats) -> Matrix:
    """Poses relative to the first, first_from_imu, of latitude, longitude, altitude and angles.

    Positions are in Mercator's projection of a sphere, scaled by the cosine of the first latitude
    (devkit of Geiger, Lenz, Stiller, Urtasun 2013). The earth being flattened, distances at KITTI's
    latitude come out 0.2 % too short from west to east and 0.1 % too long from south to north.

    Args:
        records: float64 (N, 6), N > 0: degrees, degrees, metres, and roll, pitch, yaw in radians.

    Returns:
        float64 (N, 4, 4).
    """
    from scipy.spatial.transform import Rotation

    latitude, longitude = np.radians(records[:, :2]).T
    scale = EARTH_RADIUS_M * np.cos(latitude[0])
    east, north = scale * longitude, scale * np.log(np.tan(np.pi / 4 + latitude / 2))
    poses = np.tile(np.eye(4), (len(records), 1, 1))
    poses[:, :3, 3] = np.stack([east, north, records[:, 2]], axis=1)
    poses[:, :3, :3] = Rotation.from_euler("ZYX", records[:, 5:2:-1]).as_matrix()
    return np.asarray(np.linalg.inv(poses[0]) @ poses)


def _read_record(path: Path, names: Sequence[str]) -> Floats:
    """Read fields of a record, float64 (n,)."""
    with reading(path, f"{len(FIELDS)} numbers of a GPS/IMU record"):
        texts = path.read_text(encoding="ascii").split()
    if len(texts) != len(FIELDS):
        raise DataError(
            f"{path} has {len(texts)} numbers, expected {len(FIELDS)} of a GPS/IMU record",
            code="truncated",
            fields=(str(path), str(len(texts))),
        )
    values = np.full(len(names), np.nan)
    for row, name in enumerate(names):
        text = texts[FIELDS.index(name)]
        with suppress(ValueError):
            values[row] = float(text)
        largest, size = _LARGEST.get(name, np.inf), abs(values[row])
        # At a pole Mercator's projection is infinite.
        if not np.isfinite(size) or size > largest or (name == "lat" and size == largest):
            limit = "a number" if np.isinf(largest) else f"degrees from -{largest:g} to {largest:g}"
            raise DataError(
                f"{path}: {name} is {text!r}, expected {limit}",
                code="damaged-file",
                fields=(str(path), name),
            )
    return values
