# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""DBSCAN in six dimensions, and the making of a view."""

from collections.abc import Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull
from sklearn.cluster import DBSCAN

from benchmarks.speed.cases import Agreement, Bound, Case, agree, times_faster
from benchmarks.speed.inputs import Bytes, Inputs, Points
from benchmarks.speed.settings import Settings
from benchmarks.speed.timing import timer
from fusionslam.views import Scene, build_scene, dbscan

SCIKIT_LEARN = "scikit-learn DBSCAN"
MIN_POINTS = 10  # as in the thesis, like the scale
COLOR_SCALE = 0.001
VIEW_EPS = 0.6


def view_cases(inputs: Inputs, settings: Settings) -> Iterator[Case]:
    """Clusters of clouds of several sizes, then whole views."""
    for size in settings.clusters:
        points, colors = inputs.sized(size)
        for eps in (0.2, 0.6):
            yield Case(
                f"DBSCAN with colours, eps {eps}, {size:,} points",
                SCIKIT_LEARN,
                timer(_ours, points, colors, eps),
                timer(_scikit_learn, points, colors, eps),
                partial(_same_labels, points, colors, eps),
                times_faster(5),
            )
    points, colors = _room()
    yield Case(
        f"view of {len(points):,} points: clusters, hulls, colours",
        f"{SCIKIT_LEARN}, SciPy ConvexHull, NumPy",
        timer(build_scene, points, colors, preset="author"),
        timer(_peer_view, points, colors),
        partial(_same_views, points, colors),
        Bound("median", "<=", 2),
    )


def _room() -> tuple[Points, Bytes]:
    """Nine boxes on a floor that is not there, points on and in them."""
    rng = np.random.default_rng(0)
    box = rng.integers(0, 9, 2000)
    sizes, shades = rng.uniform(0.3, 0.9, (9, 3)), rng.integers(30, 200, (9, 3))
    inside = rng.uniform(0, 1, (2000, 3)) * sizes[box]
    places = np.c_[2 * (box % 3), 2 * (box // 3), np.zeros(2000)]
    colors = shades[box] + rng.integers(-30, 30, (2000, 3))
    return (places + inside).astype(np.float32), colors.astype(np.uint8)


def _ours(points: Points, colors: Bytes, eps: float) -> NDArray[np.int32]:
    return dbscan(
        points, colors, eps=eps, min_points=MIN_POINTS, color_scale=COLOR_SCALE, inclusive=True
    )


def _scikit_learn(points: Points, colors: Bytes, eps: float) -> NDArray[np.int64]:
    features = np.c_[points.astype(float), COLOR_SCALE * colors.astype(float)]
    labels: NDArray[np.int64] = DBSCAN(eps=eps, min_samples=MIN_POINTS).fit_predict(features)
    return labels


def _same_labels(points: Points, colors: Bytes, eps: float) -> Agreement:
    other = _ours(points, colors, eps) != _scikit_learn(points, colors, eps)
    return agree("points with another label", float(other.sum()), 0)


def _peer_view(points: Points, colors: Bytes) -> NDArray[np.float64]:
    """Number of points, volume, area and colour of each cluster, float64 (K, 6)."""
    labels = _scikit_learn(points, colors, VIEW_EPS)
    rows = []
    for label in range(labels.max() + 1):
        chosen = labels == label
        hull = ConvexHull(points[chosen].astype(float))
        shade = np.median(colors[chosen], axis=0).astype(int)
        rows.append([np.count_nonzero(chosen), hull.volume, hull.area, *shade])
    return np.array(rows)


def _same_views(points: Points, colors: Bytes) -> Agreement:
    theirs = _peer_view(points, colors)
    theirs = theirs[np.argsort(-theirs[:, 0], kind="stable")]
    error = np.abs(_rows(build_scene(points, colors, preset="author")) / theirs - 1).max()
    return agree("relative difference of volumes, areas and colours", error, 1e-6)


def _rows(scene: Scene) -> NDArray[np.float64]:
    objects = scene.objects
    rows: NDArray[np.float64] = np.c_[
        objects["points"], objects["volume"], objects["area"], objects["color"]
    ]
    return rows
