# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""DBSCAN gives the labels of scikit-learn, of the definition and of the thesis's program."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from sklearn.cluster import DBSCAN

from fusionslam import ConfigError, DataError, ShapeError
from fusionslam.views import dbscan
from rows import rows

Points = NDArray[np.float32]
Bytes = NDArray[np.uint8]


def random_cloud(seed: int, size: int) -> tuple[Points, Bytes]:
    """Blobs of several densities, with some points twice."""
    rng = np.random.default_rng(seed)
    spread = rng.choice([0.1, 0.5, 2.0], size=(size, 1))
    centres = rng.uniform(-4, 4, (5, 3))[rng.integers(0, 5, size)]
    points = (centres + spread * rng.normal(size=(size, 3))).astype(np.float32)
    colors = rng.integers(0, 256, (size, 3), dtype=np.uint8)
    points[: size // 10], colors[: size // 10] = points[-1], colors[-1]
    return points, colors


def six_columns(points: Points, colors: Bytes, scale: float) -> NDArray[np.float64]:
    return np.c_[points.astype(float), scale * colors.astype(float)]


def check(cloud: tuple[Points, Bytes], scale: float, eps: float, min_points: int) -> None:
    """The labels are those of scikit-learn; a scale of 0 is as no colours."""
    points, colors = cloud
    ours = dbscan(points, colors, eps=eps, min_points=min_points, color_scale=scale, inclusive=True)
    theirs = DBSCAN(eps=eps, min_samples=min_points).fit_predict(six_columns(points, colors, scale))
    assert ours.dtype == np.int32
    np.testing.assert_array_equal(ours, theirs)
    if scale == 0:
        alone = dbscan(points, eps=eps, min_points=min_points, inclusive=True)
        np.testing.assert_array_equal(alone, theirs)


def by_definition(
    features: NDArray[np.float64], eps: float, min_points: int, *, inclusive: bool
) -> NDArray[np.int64]:
    """Every distance, then one cluster after the other from its first core point."""
    squares = ((features[:, None] - features[None]) ** 2).sum(axis=2)
    near = squares <= eps**2 if inclusive else squares < eps**2
    core = near.sum(axis=1) >= min_points
    labels = np.full(len(features), -1)
    for first in np.flatnonzero(core):
        if labels[first] >= 0:
            continue
        label, waiting = labels.max() + 1, [first]
        labels[first] = label
        while waiting:
            reached = np.flatnonzero(near[waiting.pop()] & (labels < 0))
            labels[reached] = label
            waiting.extend(reached[core[reached]])
    return labels


@rows("eps", [0.05, 0.2, 0.6, 3.0])
@rows("scale", [0.0, 0.001, 0.01])
@rows("min_points", [1, 4, 10])
def test_labels_are_those_of_scikit_learn(eps: float, scale: float, min_points: int) -> None:
    check(random_cloud(seed=min_points, size=500), scale, eps, min_points)


@rows("offset", [0, 40_000])
def test_large_coordinates_are_clustered_as_scikit_learn_does(offset: float) -> None:
    points, colors = random_cloud(seed=5, size=800)
    check((points + np.float32(offset), colors), 1e-3, 0.3, 5)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 10_000),
    size=st.integers(1, 90),
    eps=st.floats(0.05, 4),
    min_points=st.integers(1, 12),
    scale=st.sampled_from([0.0, 0.001, 0.02]),
    inclusive=st.booleans(),
)
def test_any_small_cloud_is_clustered_as_defined(
    seed: int, size: int, eps: float, min_points: int, scale: float, inclusive: bool
) -> None:
    points, colors = random_cloud(seed, size)
    labels = dbscan(
        points, colors, eps=eps, min_points=min_points, color_scale=scale, inclusive=inclusive
    )
    features = six_columns(points, colors, scale)
    expected = by_definition(features, eps, min_points, inclusive=inclusive)
    np.testing.assert_array_equal(labels, expected)


@rows("inclusive, clusters", [(True, 1), (False, 0)])
def test_a_lattice_of_spacing_eps_needs_eps_to_count(inclusive: bool, clusters: int) -> None:
    lattice = np.stack(np.meshgrid(*[np.arange(6)] * 3), axis=-1).reshape(-1, 3)
    labels = dbscan(lattice.astype(np.float32), eps=1, min_points=2, inclusive=inclusive)
    assert labels.max() + 1 == clusters
    assert (labels >= 0).all() == inclusive


def test_a_border_point_belongs_to_the_first_cluster_that_reaches_it() -> None:
    left, right = ([[side, 0, 0]] + [[1.8 * side, 0, 0]] * 5 for side in (-1, 1))
    border = [[0, 0, 0]]
    for cloud in (left + border + right, right + border + left, border + left + right):
        labels = dbscan(np.array(cloud, np.float32), eps=1, min_points=6, inclusive=True)
        assert sorted(set(labels.tolist())) == [0, 1]
        assert labels[cloud.index([0, 0, 0])] == 0


def test_colors_alone_split_a_cluster_when_the_scale_allows() -> None:
    points = np.random.default_rng(0).uniform(0, 0.3, (400, 3)).astype(np.float32)
    colors = np.repeat(np.array([[250, 0, 0], [0, 250, 0]], np.uint8), 200, axis=0)
    assert dbscan(points, colors, eps=0.6, min_points=10).max() == 0
    labels = dbscan(points, colors, eps=0.6, min_points=10, color_scale=0.002)
    np.testing.assert_array_equal(labels, np.repeat([0, 1], 200))


@rows("offset", [0, 1e5, -3e7, 1e30])
def test_equal_points_far_away_are_one_cluster(offset: float) -> None:
    points = np.full((50, 3), offset, np.float32)
    points[25:] += np.float32(max(abs(offset), 1))
    labels = dbscan(points, eps=1e-6, min_points=5)
    np.testing.assert_array_equal(labels, np.repeat([0, 1], 25))


def test_a_tiny_radius_over_a_wide_cloud_needs_memory_for_the_points_only() -> None:
    points = np.random.default_rng(0).uniform(-1e6, 1e6, (50_000, 3)).astype(np.float32)
    assert (dbscan(points, eps=1e-6, min_points=2) == -1).all()


@pytest.mark.nightly
def test_a_million_points_in_one_cluster_are_no_special_case() -> None:
    rng = np.random.default_rng(0)
    points = rng.normal(size=(1_000_000, 3)).astype(np.float32)
    colors = rng.integers(0, 256, points.shape, dtype=np.uint8)
    labels = dbscan(points, colors, eps=0.6, min_points=10)
    core = np.linalg.norm(points, axis=1) < 3
    assert (labels[core] == 0).all()
    assert (dbscan(np.zeros_like(points), eps=0.6, min_points=10) == 0).all()


def test_two_dense_sheets_just_too_far_apart_stay_two_clusters() -> None:
    points = np.random.default_rng(0).uniform(0, 1, (200_000, 3)).astype(np.float32)
    points[:, 2] = 0
    points[100_000:, 2] = 0.2001
    labels = dbscan(points, eps=0.2, min_points=10)
    np.testing.assert_array_equal(labels, np.repeat([0, 1], 100_000))


@rows("size", [0, 1])
def test_clouds_of_no_and_one_point_have_no_clusters(size: int) -> None:
    points, colors = np.zeros((size, 3), np.float32), np.zeros((size, 3), np.uint8)
    for least, label in ((2, -1), (1, 0)):
        assert dbscan(points, colors, eps=1, min_points=least).tolist() == [label] * size


@rows(
    "name, values, words",
    [
        ("eps", (0, -1, np.nan, np.inf), r"eps .*1e-06.*1e\+06"),
        ("min_points", (0,), "min_points"),
        ("color_scale", (-1, np.nan), "color_scale"),
    ],
)
def test_values_out_of_range_are_refused(name: str, values: tuple[float], words: str) -> None:
    for value in values:
        with pytest.raises(ConfigError, match=rf"dbscan\.{words}"):
            dbscan(np.zeros((3, 3), np.float32), **{"eps": 1, "min_points": 3, name: value})


def test_bad_clouds_are_refused() -> None:
    for bad in (np.nan, np.inf):
        points = np.zeros((5, 3), np.float32)
        points[3, 1] = bad
        with pytest.raises(DataError, match=r"\b3\b"):
            dbscan(points, eps=1, min_points=1)
    for count in (0, 4, 6):
        colors = np.zeros((count, 3), np.uint8)
        with pytest.raises(ShapeError, match=f"colors .*{count}.*points .*5"):
            dbscan(np.zeros((5, 3), np.float32), colors, eps=1, min_points=1)
