# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A robot that drives up and down a made street; its true poses are known."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from clouds import scan_blocks
from fusionslam import Cloud, FusionConfig, LoopConfig
from fusionslam.datasets import write_cloud
from fusionslam.datasets.pose_files import write_poses_tum
from fusionslam.sensors.frame import Frame

Floats = NDArray[np.float64]

OPTIONS: dict[str, Any] = {
    "descriptor": "m2dp",
    "fusion": FusionConfig(source="cloud"),
    "loops": LoopConfig(window=3),
}
"""Of a map of the street."""


def at(x: float, y: float, yaw_deg: float, z: float = 1.7) -> Floats:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("z", yaw_deg, degrees=True).as_matrix()
    pose[:3, 3] = x, y, z
    return pose


# Out, and back in the opposite direction, 1 m to the side.
WAY = [at(6 * step, 0, 0) for step in range(-4, 5)]
WAY += [at(6 * step, 1, 180) for step in range(4, -5, -1)]
# The next day: back first, on the other side.
RETURN = [at(6 * step + 2, -1, 180) for step in range(4, -5, -1)]


def drift(way: list[Floats], turn_deg: float = 1.0, scale: float = 1.02) -> list[Floats]:
    """Odometry that turns, and makes each step too long."""
    poses = [np.eye(4)]
    for before, after in pairwise(way):
        step = np.linalg.inv(before) @ after
        step[:3, 3] *= scale
        poses.append(poses[-1] @ step @ at(0, 0, turn_deg, 0))
    return poses


def frames(way: list[Floats], seed: int = 0, *, day: int = 0, place: int = 12) -> list[Frame]:
    """What the robot sees, with odometry that drifts; its scanner is the robot's frame."""
    return [
        Frame(
            index=k,
            stamp_ns=(86_400 * day + k) * 10**9,
            points=scan_blocks(pose, seed + k, place=place),
            odometry=odometry,
        )
        for k, (pose, odometry) in enumerate(zip(way, drift(way), strict=True))
    ]


def changed(frame: Frame, **values: Any) -> Frame:
    """What the robot sees with other values."""
    kept = {name: getattr(frame, name) for name in ("index", "stamp_ns", "points", "odometry")}
    return Frame(**kept | values)


def error(poses: Floats, truth: list[Floats]) -> float:
    """Root mean square of the distances of positions after the best rigid motion, metres."""
    a, b = np.asarray(poses)[:, :3, 3], np.asarray(truth)[:, :3, 3]
    turn, _ = Rotation.align_vectors(b - b.mean(axis=0), a - a.mean(axis=0))
    off = turn.apply(a - a.mean(axis=0)) - (b - b.mean(axis=0))
    return float(np.sqrt((off**2).sum(axis=1).mean()))


def assert_near(found: Floats | None, truth: Floats, metres: float, degrees: float) -> None:
    """A pose was found, and is so near to the true one."""
    assert found is not None
    off = np.linalg.inv(truth) @ found
    assert np.linalg.norm(off[:3, 3]) < metres
    assert np.degrees(Rotation.from_matrix(off[:3, :3]).magnitude()) < degrees


def write_street(folder: Path, way: list[Floats], seed: int = 0, *, place: int = 12) -> Path:
    """A plain folder of what the robot sees, with odometry.txt."""
    driven = frames(way, seed, place=place)
    for frame in driven:
        assert frame.points is not None
        write_cloud(folder / f"clouds/{frame.index:06d}.bin", Cloud(frame.points))
    stamps = np.array([frame.stamp_ns for frame in driven])
    (folder / "times.txt").write_text("".join(f"{stamp / 1e9:.1f}\n" for stamp in stamps))
    poses = np.array([frame.odometry for frame in driven])
    write_poses_tum(folder / "odometry.txt", stamps, poses)
    return folder
