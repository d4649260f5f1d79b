# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a pinhole camera sees of the painted wall of a round room, by its rays."""

import numpy as np

WIDTH, HEIGHT, VIEW = 320, 24, 1.0
RADIUS_M = 3.0


def room_image(x: float = 0.0, yaw: float = 0.0, view: float = VIEW, seed: int = 5) -> np.ndarray:
    """uint8 (24, 320), seen from (x, 0)."""
    focal = WIDTH / 2 / np.tan(view / 2)
    # The optical frame has x to the right: a column left of the centre looks counter-clockwise.
    ray = yaw - np.arctan((np.arange(WIDTH) - (WIDTH - 1) / 2) / focal)
    along = x * np.cos(ray)
    far = -along + np.sqrt(along**2 + RADIUS_M**2 - x**2)
    on_wall = np.arctan2(far * np.sin(ray), x + far * np.cos(ray))
    rng = np.random.default_rng(seed)
    waves, phases = np.arange(1, 90), rng.uniform(0, 2 * np.pi, 89)
    paint = (np.cos(np.outer(on_wall, waves) + phases) * rng.uniform(0.3, 1, 89)).sum(1)
    rows = rng.uniform(0.9, 1.1, (HEIGHT, 1))
    return np.asarray(((120 + 9 * paint) * rows).clip(0, 255).round(), np.uint8)
