# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes made of numbers, without a cloud."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.views import Scene, build_scene

NOTHING = build_scene(np.empty((0, 3), np.float32), np.empty((0, 3), np.uint8))
Objects = NDArray[Any]


def random_scene(random: np.random.Generator, count: int) -> Scene:
    """Objects of any kind within 8 m in front of the robot."""
    objects = np.zeros(count, NOTHING.objects.dtype)
    objects["center"] = random.uniform([0, -3, 0], [8, 3, 2], (count, 3))
    objects["volume"] = random.uniform(0, 1, count) ** 3
    objects["area"] = random.uniform(0.1, 3, count)
    objects["color"] = random.uniform(0, 255, (count, 3))
    objects["extents"] = np.sort(random.uniform(0, 2, (count, 3)))[:, ::-1]
    objects["points"] = random.integers(10, 500, count)
    return Scene(objects)


def seen_again(scene: Scene, random: np.random.Generator) -> Scene:
    """The scene, a little different."""
    objects = scene.objects.copy()
    objects["center"] += random.normal(0, 0.2, objects["center"].shape)
    objects["color"] = np.clip(objects["color"] + random.normal(0, 3, (len(objects), 3)), 0, 255)
    objects["volume"] += random.uniform(0, 0.03, len(objects))
    return Scene(objects)


def many_scenes(count: int, most: int, *, seed: int = 0) -> list[Scene]:
    """Scenes of up to so many objects, every other one the one before seen again."""
    random = np.random.default_rng(seed)
    scenes: list[Scene] = []
    while len(scenes) < count:
        scenes.append(random_scene(random, int(random.integers(most + 1))))
        scenes.append(seen_again(scenes[-1], random))
    return scenes[:count]
