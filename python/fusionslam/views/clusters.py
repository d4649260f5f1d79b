# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Assigns the points of a cloud to the objects of its scene; compares single objects."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusionslam.errors import DataError
from fusionslam.sensors.frame import Cloud
from fusionslam.views.scenes import (
    Scene,
    SceneConfig,
    SimilarityConfig,
    build_scene,
    dbscan,
    scene_similarity,
)


@dataclass(frozen=True, eq=False)
class ClusteredScan:
    """A scan, its scene, and the points of each object.

    Attributes:
        number: the scan's number in the data.
        points: float32 (N, 3), metres in the robot's frame, without ground.
        colors: uint8 (N, 3) RGB.
        scene: the scene built from the points.
        members: int64, the indices of each object's points.
    """

    number: int
    points: NDArray[np.float32]
    colors: NDArray[np.uint8]
    scene: Scene
    members: tuple[NDArray[np.int64], ...]

    @property
    def loose(self) -> NDArray[np.int64]:
        """Indices of the points that belong to no object."""
        free = np.ones(len(self.points), np.bool_)
        for indices in self.members:
            free[indices] = False
        return np.flatnonzero(free)


def cluster_scan(number: int, cloud: Cloud, config: SceneConfig) -> ClusteredScan:
    """The scene of a cloud, with the points of each object.

    Raises:
        DataError: NaN, or a cloud without colours.
    """
    if cloud.colors is None:
        raise DataError(f"scan {number} has no colours, which scenes need", code="no-colors")
    points, colors = cloud.points, cloud.colors
    scene = build_scene(points, colors, config=config)
    # The core drops points near the floor in the same way; 0 keeps all.
    high = np.abs(points[:, 2]) > config.floor if config.floor > 0 else slice(None)
    rows = np.arange(len(points))[high]
    labels = dbscan(
        points[rows],
        colors[rows],
        eps=config.eps,
        min_points=config.min_points,
        color_scale=config.color_scale,
        inclusive=config.inclusive,
    )
    groups = [rows[labels == label] for label in range(labels.max(initial=-1) + 1)]
    kept = [group for group in groups if len(group) >= config.min_size]
    # As in the scene: most points first, ties in the order of their clusters.
    members = tuple(sorted(kept, key=len, reverse=True))
    return ClusteredScan(number, points, colors, scene, members)


def object_similarities(
    current: Scene, stored: Scene, config: SimilarityConfig
) -> NDArray[np.float64]:
    """Similarity of each object of one scene to each of the other: float64 (n, m)."""
    singles = [[Scene(s.objects[i : i + 1]) for i in range(len(s))] for s in (current, stored)]
    rows = [[scene_similarity(a, b, config=config) for b in singles[1]] for a in singles[0]]
    return np.array(rows, np.float64).reshape(len(current), len(stored))
