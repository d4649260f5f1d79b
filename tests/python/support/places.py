# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Made-up places that descriptors are tested on."""

import math

import numpy as np
from numpy.typing import NDArray

from fusionslam import Cloud


def make_place(seed: int) -> Cloud:
    """A rough floor, eight walls and five posts within 25 m of a scanner 1.8 m high, coloured."""
    rng = np.random.default_rng(seed)
    ground = rng.uniform(-18, 22, (6000, 2)) * [1, 0.7]
    parts = [np.column_stack([ground, -1.8 + 0.1 * np.sin(ground[:, 0])])]
    for _ in range(8):
        x, y, azimuth, length = (
            *rng.uniform(-18, 18, 2),
            rng.uniform(0, math.pi),
            rng.uniform(4, 14),
        )
        along, height = rng.uniform(0, length, 1500), rng.uniform(-1.8, rng.uniform(1, 6), 1500)
        parts.append(
            np.column_stack([x + along * math.cos(azimuth), y + along * math.sin(azimuth), height])
        )
    for _ in range(5):
        x, y, top = *rng.uniform(-15, 15, 2), rng.uniform(0, 5)
        around = rng.uniform(0, 2 * math.pi, 400)
        parts.append(
            np.column_stack(
                [x + 0.3 * np.cos(around), y + 0.3 * np.sin(around), rng.uniform(-1.8, top, 400)]
            )
        )
    points = np.concatenate(parts) + rng.normal(0, 0.01, (sum(map(len, parts)), 3))
    shades = np.concatenate([np.tile(rng.uniform(40, 220, 3), (len(part), 1)) for part in parts])
    noisy = np.clip(shades + rng.normal(0, 8, shades.shape), 0, 255)
    return Cloud(points.astype(np.float32), noisy.astype(np.uint8))


def turn(points: NDArray[np.floating], degrees: float) -> NDArray[np.float32]:
    """Turn points about z, to the left."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    turned: NDArray[np.float64] = points @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    return turned.astype(np.float32)
