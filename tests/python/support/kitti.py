# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Data sets in the layouts of KITTI and plain folders."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from fusionslam.datasets import write_cloud
from fusionslam.sensors.frame import Cloud

CALIB = (
    "P0: 30 0 32 0 0 30 24 0 0 0 1 0\nP1: 30 0 32 -15 0 30 24 0 0 0 1 0\n"
    "P2: 30 0 32 0 0 30 24 0 0 0 1 0\nP3: 30 0 32 -15 0 30 24 0 0 0 1 0\n"
    "Tr: 0 -1 0 0 0 0 -1 0 1 0 0 0\n"
)


def write_sequence(
    base: Path, places: Sequence[int], counts: Sequence[int], *, metres: float, width: int
) -> Path:
    """Sequence 03 below a folder: coloured stereo pairs and scans, equal at equal places.

    Args:
        places: of each frame; place n lies n * metres along z.
        counts: points of each scan.
        width: of the images in pixels; the height is 48.
    """
    root = base / "sequences" / "03"
    for folder in ("velodyne", "image_2", "image_3"):
        (root / folder).mkdir(parents=True)
    for number, (place, count) in enumerate(zip(places, counts, strict=True)):
        rng = np.random.default_rng(place)
        points = rng.uniform([2, -9, -1.7], [30, 6, 4], (count, 3)) * [1, 1 + place / 9, 1]
        scan = np.c_[points, rng.uniform(size=count)].astype(np.float32)
        scan.tofile(root / f"velodyne/{number:06d}.bin")
        wide = rng.integers(0, 256, (48, width + 16, 3), dtype=np.uint8)
        Image.fromarray(wide[:, :width]).save(root / f"image_2/{number:06d}.png")
        Image.fromarray(wide[:, 6 : width + 6]).save(root / f"image_3/{number:06d}.png")
    (root / "calib.txt").write_text(CALIB)
    (root / "times.txt").write_text("".join(f"{0.1 * n:e}\n" for n in range(len(places))))
    (base / "poses").mkdir()
    lines = [f"1 0 0 0 0 1 0 0 0 0 1 {metres * place}\n" for place in places]
    (base / "poses" / "03.txt").write_text("".join(lines))
    return root


P2 = "700 0 2 45 0 700 1.5 0.1 0 0 1 0.003"
P3 = "700 0 2 -330 0 700 1.5 0.1 0 0 1 0.003"
TR = "0 -1 0 0.1 0 0 -1 0.2 1 0 0 0.3"
ODOMETRY_CALIB = f"P0: {P2}\nP1: {P3}\nP2: {P2}\nP3: {P3}\nTr: {TR}\n"
POSE_LINE = "1 0 0 {} 0 1 0 0 0 0 1 0\n"
_RNG = np.random.default_rng(7)
POINTS = _RNG.normal(size=(20, 3)).astype(np.float32)
COLORS = _RNG.integers(0, 256, (20, 3), dtype=np.uint8)


def put_scan(path: Path) -> None:
    write_cloud(path, Cloud(POINTS))


def put_image(
    path: Path, size: tuple[int, int] = (4, 3), color: tuple[int, int, int] = (10, 20, 30)
) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", size, color).save(path)


def put_text(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def pose_lines(count: int, step: int = 1) -> str:
    """KITTI's poses, that many metres along x from each to the next."""
    return "".join(POSE_LINE.format(step * number) for number in range(count))


def odometry(root: Path, numbers: Iterable[int] = range(6)) -> Path:
    """A small sequence 03 of colour stereo pairs and scans."""
    sequence = root / "sequences" / "03"
    for number in numbers:
        put_scan(sequence / f"velodyne/{number:06d}.bin")
        put_image(sequence / f"image_2/{number:06d}.png")
        put_image(sequence / f"image_3/{number:06d}.png")
    put_text(sequence / "calib.txt", ODOMETRY_CALIB)
    put_text(sequence / "times.txt", "".join(f"{0.1 * n:e}\n" for n in range(6)))
    put_text(root / "poses" / "03.txt", pose_lines(6))
    return sequence


def folder(root: Path, stems: Iterable[str] = ("000", "001", "002"), suffix: str = ".ply") -> Path:
    for stem in stems:
        write_cloud(root / f"clouds/{stem}{suffix}", Cloud(POINTS, COLORS))
        put_image(root / f"images/{stem}.png")
    return root


def raw_drive(root: Path, name: str = "2011_09_26_drive_0001_sync") -> Path:
    size = "4.0 3.0"
    eye, zero = "1 0 0 0 1 0 0 0 1", "0 0 0"
    put_text(
        root / "calib_cam_to_cam.txt",
        f"calib_time: 09-Jan-2012 13:57:47\nR_rect_00: {eye}\nP_rect_02: {P2}\nS_rect_02: {size}\n",
    )
    put_text(root / "calib_velo_to_cam.txt", f"R: {eye}\nT: {zero}\n")
    for number in range(3):
        put_scan(root / name / f"velodyne_points/data/{number:010d}.bin")
        put_image(root / name / f"image_02/data/{number:010d}.png")
    stamps = (f"2011-09-26 13:02:25.96438944{n}\n" for n in range(3))
    put_text(root / name / "velodyne_points/timestamps.txt", "".join(stamps))
    return root / name
