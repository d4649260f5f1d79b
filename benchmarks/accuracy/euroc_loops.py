# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Proves loops of a real stereo flight, EuRoC V1_01 (Burri et al., IJRR 2016), with Vicon truth.

    python -m benchmarks.accuracy.euroc_loops

A drone turns freely, so that no axis points up: poses are searched by features. A revisit is within
1 m and 45 degrees of a keyframe more than 30 s before it. No value was fitted to these data, but
the search without gravity was developed by looking at the revisits that it missed here.
"""

import argparse
from pathlib import Path

import numpy as np
import yaml
from PIL import Image
from scipy.spatial.transform import Rotation

from benchmarks.accuracy.data import data_folder
from fusionslam import (
    Cloud,
    Loop,
    LoopDetector,
    cloud_from_disparity,
    rectify_image,
    stereo_disparity,
)
from fusionslam.base.arrays import Floats
from fusionslam.registration import RegistrationConfig

FOCAL_PX, CENTRE_PX, SIZE = 435.0, (367.0, 252.0), (752, 480)
APART_S, NEAR_M, NEAR_DEG = 30.0, 1.0, 45.0
RIGHT_M, RIGHT_DEG = 0.5, 15.0


class Rig:
    """The stereo camera: rectified axes lie along the baseline and the mean line of sight."""

    def __init__(self, folder: Path) -> None:
        text = (folder / "kalibr_imucam_chain.yaml").read_text().replace("%YAML:1.0", "")
        self._cameras = [yaml.safe_load(text)[name] for name in ("cam0", "cam1")]
        mounted = [np.array(camera["T_imu_cam"]) for camera in self._cameras]
        baseline = mounted[1][:3, 3] - mounted[0][:3, 3]
        x = baseline / np.linalg.norm(baseline)
        z = mounted[0][:3, 2] + mounted[1][:3, 2]
        z -= x * (x @ z)
        z /= np.linalg.norm(z)
        self.imu_from_cloud = np.eye(4)
        self.imu_from_cloud[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
        self.imu_from_cloud[:3, 3] = mounted[0][:3, 3]
        self._turns = [self.imu_from_cloud[:3, :3].T @ each[:3, :3] for each in mounted]
        self._projections = [np.zeros((3, 4)), np.zeros((3, 4))]
        for projection in self._projections:
            projection[:, :3] = np.diag([FOCAL_PX, FOCAL_PX, 1.0])
            projection[:2, 2] = CENTRE_PX
        self._projections[1][0, 3] = -FOCAL_PX * np.linalg.norm(baseline)

    def cloud(self, left: Path, right: Path) -> Cloud:
        """Cloud of an image pair, in the rectified left camera's frame."""
        images = []
        for path, camera, turn, projection in zip(
            (left, right), self._cameras, self._turns, self._projections, strict=True
        ):
            fx, fy, cx, cy = camera["intrinsics"]
            images.append(
                rectify_image(
                    np.array(Image.open(path).convert("L")),
                    camera_matrix=np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]),
                    distortion=np.array([float(value) for value in camera["distortion_coeffs"]]),
                    model="plumb_bob",
                    rectification=turn,
                    projection=projection,
                    size=SIZE,
                )
            )
        points, colors, _ = cloud_from_disparity(
            stereo_disparity(*images), images[0], *self._projections
        )
        return Cloud(points, colors)


class Flight:
    """The keyframes of the flight.

    Attributes:
        stamps: int64 (N), nanoseconds.
        poses: float64 (N, 4, 4), world_from_cloud, by Vicon.
    """

    def __init__(self, folder: Path) -> None:
        self._images, self._rig = folder / "images", Rig(folder)
        lines = [row.split() for row in (folder / "poses.txt").read_text().splitlines()]
        rows = [row for row in lines if row and not row[0].startswith("#")]
        self.stamps = np.array([int(row[0]) for row in rows])
        places = np.array([[float(value) for value in row[1:]] for row in rows])
        poses = np.tile(np.eye(4), (len(rows), 1, 1))
        poses[:, :3, :3] = Rotation.from_quat(places[:, 3:]).as_matrix()
        poses[:, :3, 3] = places[:, :3]
        self.poses: Floats = poses @ self._rig.imu_from_cloud

    def cloud(self, number: int) -> Cloud:
        """Cloud of a keyframe."""
        stamp = self.stamps[number]
        left, right = (self._images / f"{stamp}_{camera}.jpg" for camera in (0, 1))
        return self._rig.cloud(left, right)


def differences(one: Floats, other: Floats) -> tuple[float, float]:
    """Metres and degrees between two poses."""
    off = np.linalg.inv(one) @ other
    turned = Rotation.from_matrix(off[:3, :3]).magnitude()
    return float(np.linalg.norm(off[:3, 3])), float(np.degrees(turned))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--candidates", type=int, default=10)
    candidates = parser.parse_args().candidates
    flight = Flight(data_folder() / "euroc_v101")
    stamps, poses = flight.stamps, flight.poses
    detector = LoopDetector(
        "cm2dp",
        window=0,
        window_seconds=APART_S,
        candidates=candidates,
        registration=RegistrationConfig(gravity=False),
    )
    revisits: dict[int, set[int]] = {}
    proposed: dict[int, set[int]] = {}
    loops: dict[int, Loop] = {}
    for number, stamp in enumerate(stamps.tolist()):
        found = detector.add(flight.cloud(number), stamp_ns=stamp)
        if found is not None:
            loops[number] = found
        best = detector.nearest
        proposed[number] = {each.match for each in (best, *detector.rejected) if each is not None}
        for earlier in np.flatnonzero(stamps < stamp - APART_S * 1e9).tolist():
            metres, degrees = differences(poses[earlier], poses[number])
            if metres <= NEAR_M and degrees <= NEAR_DEG:
                revisits.setdefault(number, set()).add(earlier)
    errors: dict[int, tuple[float, float]] = {}
    for number, loop in loops.items():
        assert loop.match_from_query is not None
        truth = np.linalg.inv(poses[loop.match]) @ poses[number]
        errors[number] = differences(truth, loop.match_from_query)
    right = {n for n, (m, deg) in errors.items() if m <= RIGHT_M and deg <= RIGHT_DEG}
    off = [errors[number][0] for number in right]
    print(f"{len(stamps)} keyframes, {len(revisits)} revisits; {detector!r}")
    print(f"{len(loops)} loops, {len(loops) - len(right)} wrong (> {RIGHT_M} m, {RIGHT_DEG} deg)")
    missed = revisits.keys() - right
    print(f"recall of the revisits {1 - len(missed) / len(revisits):.2f}")
    unseen = sum(revisits[number].isdisjoint(proposed[number]) for number in missed)
    print(f"missed: {unseen} without a candidate of the place, {len(missed) - unseen} not proven")
    if off:
        print(f"error: median {np.median(off):.3f} m, most {max(off):.3f} m")


if __name__ == "__main__":
    main()
