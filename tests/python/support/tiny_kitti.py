# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A tiny recording in KITTI odometry's layout, for tests that need a dataset and no real one."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

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
