# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Real recordings of the test data as clouds, poses and odometry, each with its protocol."""

import itertools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.accuracy.euroc_loops import APART_S, NEAR_DEG, NEAR_M, Flight
from benchmarks.accuracy.place_maps import add_drift
from benchmarks.accuracy.room_maps import DRIFT
from benchmarks.accuracy.rooms import RoomDrive
from fusionslam import Cloud, FusionConfig, LoopDetector
from fusionslam.base.arrays import Floats, Integers
from fusionslam.datasets.calibration import homogeneous, read_calibration
from fusionslam.datasets.pose_files import read_poses_kitti
from fusionslam.loop_closure import LoopConfig
from fusionslam.loop_closure.local_maps import RecentFrames
from fusionslam.loop_closure.observation import Observation, level
from fusionslam.registration import RegistrationConfig
from fusionslam.registration.leveling import find_level
from fusionslam.sensors.frame import Frame

CLOUDS = FusionConfig(source="cloud")
DRIFT_SEED = 1
"""Of the noise on the path of recordings that come without odometry."""
_BODY_FROM_OPTICAL = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])
"""From x right, y down, z ahead to x ahead, y left, z up."""
_KITCHEN_HZ = 30.0
STEPS = {"kitti_bev_05": 4, "kitti_bev_06": 2}
"""Each fourth and each second frame is taken."""
_CUBE_M, _KITTI_HEIGHT_M = 0.4, 1.73
"""Edge of the cubes seen from above, and of the sensor above the road."""


@dataclass(frozen=True)
class Rule:
    """When a frame revisits a place: it is near the pose of one that is old enough.

    Attributes:
        metres, degrees: less far from that pose.
        seconds, frames: more than this before.
    """

    metres: float
    degrees: float = 181.0
    seconds: float = 0.0
    frames: int = 0


@dataclass(frozen=True, kw_only=True)
class Recording:
    """A real drive.

    Attributes:
        name: of the recording.
        clouds: N of them.
        stamps_ns: int64 (N,).
        poses: float64 (N, 4, 4), world_from_cloud, taken for the truth.
        recorded_odometry: float64 (N, 4, 4), odom_from_cloud; None if there is none.
        rule: when a frame revisits a place.
        descriptor: the default one for such clouds.
        registration: how clouds are registered.
        joined: keyframes of the local maps of peers. Sixty where these last less long than a
            revisit is old: others would share scans with their candidates.
    """

    name: str
    clouds: list[Cloud]
    stamps_ns: Integers
    poses: Floats
    recorded_odometry: Floats | None = None
    rule: Rule
    descriptor: str = "m2dp"
    registration: RegistrationConfig = field(default_factory=RegistrationConfig)
    joined: tuple[int, ...] = (10,)

    @cached_property
    def odometry(self) -> Floats:
        """Float64 (N, 4, 4), odom_from_cloud; where none was recorded, the poses with noise."""
        recorded = self.recorded_odometry
        return add_drift(self.poses, DRIFT_SEED) if recorded is None else recorded

    @cached_property
    def leveled(self) -> list[Cloud]:
        """The clouds, levelled as a detector levels them."""
        if self.registration.gravity != "auto":
            return self.clouds
        recent, leveled = RecentFrames(), []
        for cloud, odometry in zip(self.clouds, self.odometry, strict=True):
            found = find_level(cloud.points, odometry, up=recent.up)
            Observation({}, None, odometry=odometry, level=found).add_to(recent, 0)
            leveled.append(level(cloud, found))
        return leveled

    def tilted(self, degrees: float) -> "Recording":
        """The recording by a sensor that is pitched down, or up by negative degrees."""
        turn = np.eye(4)
        turn[:3, :3] = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
        rows = turn[:3, :3].astype(np.float32)
        return replace(
            self,
            clouds=[replace(cloud, points=cloud.points @ rows) for cloud in self.clouds],
            poses=self.poses @ turn,
            recorded_odometry=self.odometry @ turn,
        )

    def options(self) -> dict[str, Any]:
        """How loops are found, as of ``PlaceMap.open``; all else is the default."""
        return {
            "loops": LoopConfig(window=self.rule.frames, window_seconds=self.rule.seconds),
            "fusion": CLOUDS,
            "registration": self.registration,
        }

    def detector(self) -> LoopDetector:
        options = self.options()
        return LoopDetector(self.descriptor, config=options.pop("loops"), **options)

    def frames(self) -> Iterator[Frame]:
        """Make the frames of the recording, for maps."""
        for number, cloud in enumerate(self.clouds):
            yield Frame(
                number=number,
                stamp_ns=int(self.stamps_ns[number]),
                points=cloud.points,
                colors=cloud.colors,
                odometry=self.odometry[number],
            )


def read_hku(data: Path, name: str) -> Recording:
    """A Livox Avia carried by hand; its optimised path is no outside truth."""
    stored = _read(data / "real" / f"{name}.npz")
    return Recording(
        name=name,
        clouds=_split(stored),
        stamps_ns=_nanoseconds(stored["stamps"]),
        poses=whole_poses(stored["optimised"]),
        recorded_odometry=whole_poses(stored["odometry"]),
        rule=Rule(3.0, seconds=30.0),
        joined=(10, 60),
    )


def read_balm(data: Path, name: str) -> Recording:
    """A LiDAR that sees all round, 74 m through a yard."""
    stored = _read(data / "real" / f"{name}.npz")
    poses = whole_poses(stored["poses"])
    return Recording(
        name=name,
        clouds=_split(stored),
        stamps_ns=_nanoseconds(stored["stamps"]),
        poses=poses,
        rule=Rule(5.0, seconds=20.0),
    )


def read_kitti(data: Path, name: str) -> Recording:
    """Keyframes of KITTI 00 before its first revisit: each loop is false."""
    stored = _read(data / "real" / f"{name}.npz")
    kitti, rows = data / "kitti", stored["kitti00_frame"]
    mounted = homogeneous(read_calibration(kitti / "calib" / "calib_00-02.txt").matrix("Tr", 3, 4))
    return Recording(
        name=name,
        clouds=_split(stored),
        stamps_ns=_nanoseconds(np.loadtxt(kitti / "times" / "times_00.txt")[rows]),
        poses=read_poses_kitti(kitti / "poses" / "00.txt")[rows] @ mounted,
        recorded_odometry=whole_poses(stored["laser_odometry"]),
        rule=Rule(10.0, seconds=30.0),
    )


def read_kitchen(data: Path, name: str) -> Recording:
    """A Kinect in a kitchen, turned from its optical frame to x ahead, z up."""
    stored = _read(data / "real" / f"{name}.npz")
    turn = _BODY_FROM_OPTICAL[:3, :3].astype(np.float32).T
    ends, rgb = stored["offsets"], stored["rgb"]
    points = (stored["xyz_mm"] * np.float32(0.001)) @ turn
    poses = _BODY_FROM_OPTICAL @ whole_poses(stored["poses"]) @ _BODY_FROM_OPTICAL.T
    return Recording(
        name=name,
        clouds=[Cloud(points[a:b], rgb[a:b]) for a, b in itertools.pairwise(ends)],
        stamps_ns=_nanoseconds(stored["frames"] / _KITCHEN_HZ),
        poses=poses,
        rule=Rule(0.5, 45.0, frames=30),
        descriptor="cm2dp",
    )


def read_flight(data: Path, name: str) -> Recording:
    """Stereo keyframes of a drone (EuRoC V1_01) that turns freely and seldom sees the ground."""
    flight = Flight(data / name)
    return Recording(
        name=name,
        clouds=[flight.cloud(number) for number in range(len(flight.stamps))],
        stamps_ns=flight.stamps,
        poses=flight.poses,
        rule=Rule(NEAR_M, NEAR_DEG, seconds=APART_S),
        descriptor="cm2dp",
        registration=RegistrationConfig(gravity=False),
    )


def read_from_above(data: Path, name: str) -> Recording:
    """KITTI 05 or 06 as seen from above: columns of cubes, filled from the ground upwards."""
    stored = _read(data / "real" / f"{name}.npz")
    sequence, step = name[-2:], STEPS[name]
    times = np.loadtxt(data / "kitti" / "times" / f"times_{sequence}.txt")
    poses = whole_poses(stored["poses"])[::step]
    return Recording(
        name=name,
        clouds=[fill_columns(counts) for counts in stored["counts"][::step]],
        stamps_ns=_nanoseconds(times[::step]),
        poses=poses,
        rule=Rule(5.0, seconds=30.0),
        joined=(10, 60),
    )


def make_house(seed: int) -> Recording:
    """A made house, which nothing was fitted to, through which a small robot carries a VLP-16."""
    drive = RoomDrive("house", seed)
    frames = list(drive.frames())
    mount = frames[0].robot_from_points
    assert mount is not None
    return Recording(
        name=f"made house {seed}",
        clouds=[Cloud(frame.points) for frame in frames if frame.points is not None],
        stamps_ns=np.array([frame.stamp_ns for frame in frames]),
        poses=drive.true @ mount,
        recorded_odometry=drive.odometry(DRIFT) @ mount,
        rule=Rule(2.0, seconds=30.0),
    )


def fill_columns(counts: NDArray[np.uint8]) -> Cloud:
    """One point in the middle of each cube that is taken for occupied."""
    layer, row, column = np.nonzero(np.arange(counts.max())[:, None, None] < counts)
    ahead, left = ((75 - (cell + 10) + 0.5) * _CUBE_M for cell in (row, column))
    up = (layer + 0.5) * _CUBE_M - _KITTI_HEIGHT_M
    return Cloud(np.column_stack([ahead, left, up]).astype(np.float32))


READERS: Mapping[str, tuple[str, Callable[[Path, str], Recording]]] = {
    "hku_1": ("real/hku_1.npz", read_hku),
    "hku_2": ("real/hku_2.npz", read_hku),
    "balm_realworld": ("real/balm_realworld.npz", read_balm),
    "redkitchen": ("real/redkitchen.npz", read_kitchen),
    "euroc_v101": ("euroc_v101/poses.txt", read_flight),
    "kitti00_keyframes": ("real/kitti00_keyframes.npz", read_kitti),
    "kitti_bev_05": ("real/kitti_bev_05.npz", read_from_above),
    "kitti_bev_06": ("real/kitti_bev_06.npz", read_from_above),
}
"""A file that must be there, and what reads the recording, by name."""


MAPPED = ("hku_1", "balm_realworld", "redkitchen", "euroc_v101", "kitti00_keyframes")
"""Recordings that maps are made of."""
SECOND: Mapping[str, tuple[str, str]] = {"hku_2": ("hku_1", "real/T_HKU1_from_HKU2.txt")}
"""By a second session's name: that of the first, and the file of first_from_second."""


def read_recording(data: Path, name: str) -> Recording | None:
    """Read a recording; None if it is not there."""
    file, read = READERS[name]
    return read(data, name) if (data / file).exists() else None


def whole_poses(poses: Floats) -> Floats:
    """Float64 (N, 4, 4) of (N, 3, 4)."""
    whole = np.tile(np.eye(4), (len(poses), 1, 1))
    whole[:, :3] = poses
    # Numbers of six digits are no rotation to twelve.
    left, _, right = np.linalg.svd(whole[:, :3, :3])
    whole[:, :3, :3] = left @ right
    return whole


def _read(path: Path) -> dict[str, NDArray[Any]]:
    with np.load(path) as stored:
        return dict(stored)


def _split(stored: Mapping[str, NDArray[Any]]) -> list[Cloud]:
    points = stored["xyz_5mm"] * np.float32(0.005)
    return [Cloud(part) for part in np.split(points, stored["offsets"][1:-1])]


def _nanoseconds(seconds: Floats) -> Integers:
    return np.rint(seconds * 1e9).astype(np.int64)
