# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Sets of labelled point clouds of objects."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Mask
from fusionslam.config import Section, option
from fusionslam.errors import DataError
from fusionslam.learning.procedural_shapes import SHAPES, sample_points


@dataclass(frozen=True, eq=False)
class ShapeSet:
    """Objects as points.

    Attributes:
        points: float32 (n, P, 3), z up.
        labels: int64 (n,), indices into ``names``.
        names: names of the classes.
    """

    points: NDArray[np.float32]
    labels: NDArray[np.int64]
    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.labels)

    def subset(self, rows: Mask) -> "ShapeSet":
        """Select objects by a mask, bool (n,)."""
        return ShapeSet(self.points[rows], self.labels[rows], self.names)


class ProceduralConfig(Section):
    """Procedural shapes, which need no download."""

    seed: int = option(0, "seed of proportions and points", ge=0)
    train: int = option(60, "training shapes per class", ge=1)
    test: int = option(15, "test shapes per class", ge=1)
    points: int = option(1024, "points per shape", ge=1)


def generate_shapes(config: ProceduralConfig) -> tuple[ShapeSet, ShapeSet]:
    """Generate a training and a test set: different shapes of the same classes."""
    rng = np.random.default_rng([config.seed, 0x5E])
    return _sample_classes(config.train, config.points, rng), _sample_classes(
        config.test, config.points, rng
    )


def _sample_classes(each: int, count: int, rng: np.random.Generator) -> ShapeSet:
    points = [
        sample_points(maker(rng), count, rng) for maker in SHAPES.values() for _ in range(each)
    ]
    return ShapeSet(np.stack(points), np.repeat(np.arange(len(SHAPES)), each), tuple(SHAPES))


def join_sets(sets: Sequence[ShapeSet]) -> ShapeSet:
    """Join the objects of several sets; classes of the same name are merged.

    Raises:
        DataError: no sets, or sets with different numbers of points.
    """
    counts = sorted({shapes.points.shape[1] for shapes in sets})
    if len(counts) != 1:
        raise DataError(f"sets of shapes have {counts} points each, expected the same number")
    names = tuple(sorted({name for shapes in sets for name in shapes.names}))
    labels = [
        np.array([names.index(name) for name in shapes.names], np.int64)[shapes.labels]
        for shapes in sets
    ]
    return ShapeSet(
        np.concatenate([shapes.points for shapes in sets]), np.concatenate(labels), names
    )
