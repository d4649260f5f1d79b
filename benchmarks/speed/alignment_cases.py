# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A view found among stored ones by alignment."""

from collections.abc import Iterator

import numpy as np

from benchmarks.speed.cases import Agreement, Case, agree
from benchmarks.speed.inputs import Inputs
from benchmarks.speed.settings import Settings
from benchmarks.speed.timing import timer
from fusionslam.views import AlignmentConfig, AlignmentIndex, Scene, align_scenes, build_scene

PEER = "every stored view aligned"


def alignment_cases(inputs: Inputs, settings: Settings) -> Iterator[Case]:
    """Candidates by thumbnail, then alignment, against alignment with everything."""
    count = settings.scenes[0]
    stored, current = made_views(count), made_views(1, seed=1)[0]
    index, whole = AlignmentIndex(), AlignmentIndex(AlignmentConfig(candidates=count))
    for scene in stored:
        index.add(scene)
        whole.add(scene)

    def check() -> Agreement:
        found = index.query(current)
        apart = [
            abs(alignment.probability - align_scenes(current, stored[number]).probability)
            for number, alignment in found
        ]
        return agree("largest difference of a probability to one pair alone", max(apart), 0)

    what = f"1 view among {count:,} by alignment, {index.config.candidates} candidates"
    yield Case(what, PEER, timer(index.query, current), timer(whole.query, current), check)


def made_views(count: int, *, seed: int = 0) -> list[Scene]:
    """Views of 18 x 120 rays: a wall and six boxes before it."""
    random = np.random.default_rng(seed)
    elevation, azimuth = np.meshgrid(
        np.deg2rad(np.linspace(15, -15, 18)), np.linspace(-0.55, 0.55, 120), indexing="ij"
    )
    views = []
    for _ in range(count):
        range_m = random.uniform(3, 8) / np.cos(azimuth - random.uniform(-0.3, 0.3))
        colors = np.full((*range_m.shape, 3), random.integers(0, 256, 3), np.uint8)
        for _ in range(6):
            middle, width = random.uniform(-0.5, 0.5), random.uniform(0.05, 0.2)
            box = (np.abs(azimuth - middle) < width) & (elevation < random.uniform(-0.1, 0.25))
            range_m[box] = random.uniform(1, 3)
            colors[box] = random.integers(0, 256, 3)
        level = range_m * np.cos(elevation)
        points = np.stack(
            [level * np.cos(azimuth), level * np.sin(azimuth), range_m * np.sin(elevation) + 0.17],
            axis=-1,
        )
        views.append(build_scene(points.reshape(-1, 3).astype(np.float32), colors.reshape(-1, 3)))
    return views
