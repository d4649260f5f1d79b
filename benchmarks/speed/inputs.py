# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What is measured on: KITTI and the c-M2DP author's cloud where they are, else the simulator."""

import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import fusionslam
from fusionslam.datasets import Dataset, open_dataset
from fusionslam.fusion import fuse
from fusionslam.sim import (
    CarConfig,
    DriveConfig,
    LidarConfig,
    SimConfig,
    StereoConfig,
    TownConfig,
    embedded_drive,
    record,
)

ROOT = Path(__file__).resolve().parents[2]
JITTER_M = 0.02

Points = NDArray[np.float32]
Bytes = NDArray[np.uint8]


@dataclass(frozen=True)
class Scene:
    """A scan, a colour image and how points project into it."""

    points: Points
    image: Bytes
    projection: NDArray[np.float64]
    source: str


@dataclass(frozen=True)
class StereoPair:
    """A rectified grey pair with its two projections."""

    left: Bytes
    right: Bytes
    projections: tuple[NDArray[np.float64], NDArray[np.float64]]
    source: str


@dataclass(frozen=True)
class Inputs:
    """Everything that is measured on.

    Attributes:
        cloud: coloured; clouds of all sizes are made of it.
        cloud_source: where it is from.
        scan: what is coloured.
        frame: what goes through the whole pipeline.
        pair: what stereo is matched on.
        sequence: what is described.
    """

    cloud: fusionslam.Cloud
    cloud_source: str
    scan: Scene
    frame: Scene
    pair: StereoPair
    sequence: Dataset

    def sized(self, size: int) -> tuple[Points, Bytes]:
        """A coloured cloud of exactly this size: a sample, or copies with some jitter added."""
        assert self.cloud.colors is not None
        return resized(self.cloud.points, self.cloud.colors, size)


def resized(points: Points, colors: Bytes, size: int) -> tuple[Points, Bytes]:
    """The same for any cloud; equal calls give equal clouds."""
    rng = np.random.default_rng(size)
    count = len(points)
    whole = np.tile(np.arange(count), size // count)
    kept = np.sort(rng.permutation(count)[: size % count])
    indices = np.concatenate([whole, kept])
    chosen = points[indices]
    jitter = rng.normal(scale=JITTER_M, size=chosen.shape).astype(np.float32)
    jitter[:count] = 0
    return np.ascontiguousarray(chosen + jitter), np.ascontiguousarray(colors[indices])


def random_descriptors(rows: int, width: int, seed: int = 0) -> Points:
    """Unit vectors without any structure that a search could use, float32 (rows, width)."""
    table = np.random.default_rng(seed).random((rows, width), dtype=np.float32)
    table /= np.linalg.norm(table, axis=1, keepdims=True)
    return table


def load(folder: Path, *, quick: bool, frames: int) -> Inputs:
    """Find or simulate everything.

    Args:
        folder: a simulated drive for a quick run is written here.
        quick: make a short drive instead of the embedded one.
        frames: of the sequence.
    """
    drive = _short_drive(folder) if quick else embedded_drive()
    sequence = _first_frames(open_dataset(drive), frames)
    data = test_data()
    made = _of_test_data(data, sequence) if data else _of_drive(sequence)
    return made


def test_data() -> Path | None:
    """The folder of recordings that are no part of the project; None where they are missing."""
    folder = Path(os.environ.get("FUSIONSLAM_TEST_DATA", ROOT.parent / "shared" / "data"))
    needed = ("reference/cm2dp/colored_cloud.npz", "kitti/raw_2011_09_26", "kitti/sequences/00")
    return folder if all((folder / name).exists() for name in needed) else None


def _of_test_data(data: Path, sequence: Dataset) -> Inputs:
    stored = np.load(data / "reference/cm2dp/colored_cloud.npz")
    raw = _scene(open_dataset(data / "kitti/raw_2011_09_26"), "KITTI raw 2011_09_26, frame 0")
    odometry = open_dataset(data / "kitti/sequences/00", gaps="skip")
    full = replace(
        raw,
        points=_points(odometry),
        source="KITTI 00, scan 000000, with the image and calibration of raw 2011_09_26, frame 0",
    )
    return Inputs(
        cloud=fusionslam.Cloud(stored["xyz"], stored["rgb"]),
        cloud_source="the coloured cloud of the c-M2DP author (25,415 points)",
        scan=full,
        frame=raw,
        pair=_pair(odometry, "KITTI 00, grey pair 000000"),
        sequence=sequence,
    )


def _of_drive(sequence: Dataset) -> Inputs:
    scene = _scene(sequence, "the simulated drive, frame 0")
    cloud = fuse(sequence[0])
    return Inputs(
        cloud=cloud,
        cloud_source=f"the first coloured scan of the simulated drive ({len(cloud):,} points)",
        scan=scene,
        frame=scene,
        pair=_pair(sequence, "the simulated drive, frame 0, in grey"),
        sequence=sequence,
    )


def _scene(dataset: Dataset, source: str) -> Scene:
    frame = dataset[0]
    projection = frame.cameras["left"].projection_from_points
    return Scene(
        _points(dataset),
        np.ascontiguousarray(frame.images["left"]),
        np.ascontiguousarray(projection),
        source,
    )


def _points(dataset: Dataset) -> Points:
    points = dataset[0].points
    assert points is not None
    return np.ascontiguousarray(points[fusionslam.drop_invalid(points)])


def _pair(dataset: Dataset, source: str) -> StereoPair:
    frame = dataset[0]
    left, right = (_grey(frame.images[name]) for name in ("left", "right"))
    cameras = frame.cameras
    return StereoPair(
        left, right, (cameras["left"].projection, cameras["right"].projection), source
    )


def _grey(image: Bytes) -> Bytes:
    if image.ndim == 2:
        return np.ascontiguousarray(image)
    return np.ascontiguousarray(np.rint(image @ np.array([0.299, 0.587, 0.114])).astype(np.uint8))


def _first_frames(dataset: Dataset, count: int) -> Dataset:
    return replace(
        dataset,
        numbers=dataset.numbers[:count],
        stamps_ns=dataset.stamps_ns[:count],
        poses=None if dataset.poses is None else dataset.poses[:count],
    )


def _short_drive(folder: Path) -> Path:
    """One street of a small town, a few frames with small images."""
    config = SimConfig(
        town=TownConfig(blocks=(1, 1)),
        drive=DriveConfig(laps=(((0, 0), (1, 0)),), spacing_m=10),
        car=CarConfig(
            lidar=LidarConfig(rings=32, azimuths=600),
            camera=StereoConfig(width=320, height=96, focal_px=180, centre_px=(159.5, 47.5)),
        ),
    )
    return record(config, folder / "drive", jobs=2)
