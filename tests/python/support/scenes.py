# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes of random objects, recordings of places that hold them, and second stages."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.config import merged
from fusionslam.pipelines.views import run_views
from fusionslam.sensors.frame import Cloud
from fusionslam.views import Scene, build_scene
from fusionslam.views.match import ViewMatch
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.recognisers import ViewMatcherConfig
from fusionslam.views.scene_set import CloudArray, SceneSet
from fusionslam.views.two_stage_comparison import TwoStageComparison

EMPTY_SCENE = build_scene(np.empty((0, 3), np.float32), np.empty((0, 3), np.uint8))
Objects = NDArray[Any]


def random_scene(random: np.random.Generator | int, count: int) -> Scene:
    """Objects of any kind within 8 m in front of the robot, by a seed or a generator."""
    random = np.random.default_rng(random)
    objects = np.zeros(count, EMPTY_SCENE.objects.dtype)
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


NOTHING = Cloud(np.empty((0, 3), np.float32), np.empty((0, 3), np.uint8))
POINTS = 80


def place(number: int, visit: int = 0, objects: int = 3, shift: float = 0.01) -> Cloud:
    """Boxes that stand apart; each visit sees other points of them, a little moved."""
    world = np.random.default_rng([7, number])
    seen = np.random.default_rng([11, number, visit])
    points, colors = [], []
    for index in range(objects):
        center = np.array([2 + 2.5 * index, *world.uniform(-2, 2, 1), 0.8])
        half = world.uniform(0.1, 0.4, 3)
        moved = center + seen.normal(0, shift, 3)
        points.append(moved + half * seen.uniform(-1, 1, (POINTS, 3)))
        colors.append(np.tile(world.integers(0, 256, 3), (POINTS, 1)))
    if not points:
        return NOTHING
    return Cloud(np.concatenate(points).astype(np.float32), np.concatenate(colors).astype(np.uint8))


def drive(places: Sequence[int], gap_s: float = 5.0, poses: bool = True) -> SceneSet:
    """One scan a place, places 5 m apart on a line; a negative one is a scan without points."""
    clouds, visits = [], dict.fromkeys(places, 0)
    for number in places:
        clouds.append(NOTHING if number < 0 else place(number, visits[number]))
        visits[number] += 1
    count = len(places)
    where = np.array([[5.0 * number, 0, 0] for number in places])
    return SceneSet(
        name="boxes",
        stamps_ns=(np.arange(count) * gap_s * 1e9).astype(np.int64),
        numbers=np.arange(count),
        empty=np.array(places) < 0,
        poses=where if poses else None,
        clouds=CloudArray.of(clouds),
    )


def differing(one: SceneSet, other: SceneSet) -> list[str]:
    """Names of what differs between two sets."""
    arrays = ("stamps_ns", "numbers", "empty", "poses")
    names = [n for n in arrays if not np.array_equal(getattr(one, n), getattr(other, n))]
    values = ("name", "frame", "scenes", "scene_config", "source")
    names += [n for n in values if getattr(one, n) != getattr(other, n)]
    features = {*one.features, *other.features}
    names += [
        n
        for n in features
        if not np.array_equal(one.features[n], other.features[n], equal_nan=True)
    ]
    if one.clouds is None or other.clouds is None:
        return names + ["clouds"] * (one.clouds is not other.clouds)
    parts = ("points", "colors", "offsets")
    return names + [
        n for n in parts if not np.array_equal(getattr(one.clouds, n), getattr(other.clouds, n))
    ]


LAPS = (0, 1, 2, 3, 4, 5, 0, 1, 2, 3, 4, 5, 2, 0)


THERE_AND_BACK = (0, 1, 2, 3, 4, 5, 6, 5, 4, 3, 2, 1, 0)
LOOKS = (0, 1, 2, 3, 1, 2, 4)
"""What the places along a corridor look like: two of them twice."""
APART = 4.0
"""Metres between places."""


def write_recording(path: Path, places: Sequence[int], poses: bool = True) -> NDArray[np.float32]:
    """The clouds of places, with floor, in the layout of .npz recordings; returns all points."""
    seen = drive(places)
    assert seen.clouds is not None
    floor = np.array([[1.0, 0, 0.05], [1.5, 0.2, 0.09]], np.float32)
    clouds = [np.concatenate([seen.clouds[i].points, floor]) for i in range(len(seen))]
    origin = np.array([-0.064, 0, 0.17])
    ways = np.concatenate(clouds) - origin
    millimetres = np.round(np.linalg.norm(ways, axis=1) * 1000)
    rays = ways / np.linalg.norm(ways, axis=1)[:, None]
    colors = [
        np.concatenate([seen.clouds[i].colors, np.full((2, 3), 90, np.uint8)])
        for i in range(len(seen))
    ]
    arrays = {
        "stamps": seen.seconds,
        "rays": rays,
        "lidar_xyz": origin,
        "visual_range_mm": millimetres.astype(np.uint16),
        "visual_ray": np.arange(len(rays), dtype=np.uint16),
        "visual_rgb": np.concatenate(colors),
        "visual_offsets": np.cumsum([0, *map(len, clouds)]),
    }
    if poses:
        arrays["poses"] = seen.true_poses()
    np.savez(path, **arrays)
    return np.asarray(rays * millimetres[:, None] / 1000 + origin, np.float32)


Row = NDArray[np.float32]


class MeanColor:
    """Agrees where the mean colours are near; counts how often it is asked."""

    digest = "mean color"

    def __init__(self) -> None:
        self.asked = 0

    def features(self, cloud: Cloud) -> Row:
        assert cloud.colors is not None
        return np.asarray(cloud.colors.mean(axis=0), np.float32)

    def probability(self, current: Row, stored: Row) -> float:
        self.asked += 1
        return float(np.abs(current - stored).max() < 8)


def painted(number: int, visit: int, shade: int) -> Cloud:
    """A place whose objects look alike to the first stage but for their colour."""
    cloud = place(number, visit)
    return Cloud(cloud.points, np.full_like(cloud.points, shade, dtype=np.uint8))


def config_of(**values: Any) -> ViewMatcherConfig:
    return merged(ViewMatcherConfig(), values)


def matcher(**values: Any) -> ViewMatcher:
    return ViewMatcher(config_of(**values))


def two_stages(second: MeanColor, **more: Any) -> ViewMatcher:
    """A matcher that looks at shapes first, and then asks the second stage."""
    config = config_of(method="objects", similarity={"color_weight": 0.0}, threshold=0.75)
    first = ViewMatcher(config).comparison
    both = TwoStageComparison(first, second, **{"threshold": 0.5, "start": 0.75, **more})
    return ViewMatcher(config, comparison=both)


def check_going_on(scenes: SceneSet, path: Path, parts: int = 2, **values: Any) -> ViewMatcher:
    """A matcher that is stored after each part of a drive finds what one finds that is not."""
    whole, one = matcher(**values), matcher(**values)
    expected = run_views(scenes, whole).matches
    found: list[ViewMatch] = []
    for part in np.array_split(np.arange(len(scenes)), parts):
        found += run_views(scenes.subset(part), one).matches
        one.save(path)
        one = ViewMatcher.load(path)
    assert tuple(found) == tuple(expected) and one.stats == whole.stats
    return one
