# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""One scene against many stored ones."""

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from benchmarks.speed.cases import Agreement, Bound, Case, agree
from benchmarks.speed.inputs import Inputs
from benchmarks.speed.settings import Settings
from benchmarks.speed.timing import timer
from fusionslam.views import Scene, SceneIndex, SimilarityConfig, build_scene, scene_similarity

OBJECTS = 10
PEER = "the thesis's formula in NumPy, all scenes at once"

Numbers = NDArray[np.float64]


def similarity_cases(inputs: Inputs, settings: Settings) -> Iterator[Case]:
    """The index against the formula as it stands, for the published and for our parameters."""
    for count, limit_ms in zip(settings.scenes, (1, 100), strict=True):
        stored = random_scenes(count)
        current = random_scenes(1, seed=1)[0]
        for preset in ("author", "robust"):
            yield _case(current, stored, preset, limit_ms)


def _case(current: Scene, stored: list[Scene], preset: str, limit_ms: float) -> Case:
    index = SceneIndex(preset=preset)
    for scene in stored:
        index.add(scene)
    what = f"1 scene against {len(stored):,}, {OBJECTS} objects each, {preset}"
    bound = Bound("median", "<=", limit_ms)
    ours = timer(index.similarities, current)
    if preset != "author":  # nobody else has these terms
        return Case(what, "", ours, None, lambda: _like_pairs(index, current, stored), bound)
    peer = numpy_formula(stored)

    def check() -> Agreement:
        error = np.abs(index.similarities(current) - peer(current)).max()
        return agree("largest difference of a similarity", float(error), 1e-6)

    return Case(what, PEER, ours, timer(peer, current), check, bound)


def _like_pairs(index: SceneIndex, current: Scene, stored: list[Scene]) -> Agreement:
    some = slice(None, None, max(1, len(stored) // 200))
    pairs = [scene_similarity(current, scene, config=index.config) for scene in stored[some]]
    error = np.abs(index.similarities(current)[some] - pairs).max()
    return agree("largest difference to our own, scene by scene in double", float(error), 1e-6)


def random_scenes(count: int, *, seed: int = 0) -> list[Scene]:
    """Scenes of ten objects with random places, sizes and colours."""
    random = np.random.default_rng(seed)
    nothing = build_scene(np.empty((0, 3), np.float32), np.empty((0, 3), np.uint8))
    objects = np.zeros((count, OBJECTS), nothing.objects.dtype)
    objects["center"] = random.uniform([0, -4, 0], [8, 4, 2], (*objects.shape, 3))
    objects["volume"] = random.uniform(0, 1, objects.shape)
    objects["area"] = random.uniform(1, 3, objects.shape)
    objects["color"] = random.integers(0, 256, (*objects.shape, 3))
    objects["extents"] = random.uniform(0, 2, (*objects.shape, 3))
    objects["points"] = random.integers(10, 500, objects.shape)
    return [Scene(row) for row in objects]


def numpy_formula(stored: list[Scene]) -> Callable[[Scene], Numbers]:
    """The similarity with the published parameters, written with NumPy's broadcasting."""
    config = SimilarityConfig(preset="author")
    rows = np.stack([scene.objects for scene in stored])
    centers, volumes = rows["center"].copy(), rows["volume"].copy()
    ratios, reds = volumes / rows["area"], rows["color"][..., 0].copy()
    total = sum(getattr(config, f"{t}_weight") for t in ("color", "distance", "volume", "ratio"))

    def term(difference: Numbers, name: str) -> Numbers:
        x0, a = getattr(config, f"{name}_x0"), getattr(config, f"{name}_a")
        value = 1 - 1 / (1 + np.exp(np.minimum(-a * (difference - x0), 700)))
        return np.asarray(getattr(config, f"{name}_weight") * value)

    def similarities(current: Scene) -> Numbers:
        result = np.zeros(len(stored))
        for one in current.objects:
            similarity = (
                term(np.sqrt(3) * np.abs(reds - one["color"][0]), "color")
                + term(np.linalg.norm(centers - one["center"], axis=2), "distance")
                + term(np.abs(volumes - one["volume"]), "volume")
                + term(np.abs(ratios - one["volume"] / one["area"]), "ratio")
            )
            result += one["points"] * similarity.max(axis=1) / total
        return np.asarray(result / current.objects["points"].sum())

    return similarities
