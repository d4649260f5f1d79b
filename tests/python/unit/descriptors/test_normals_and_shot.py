# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Hard inputs for normals, resolution, SHOT and CSHOT, and their promises of sameness."""

import numpy as np
import pytest
from numpy.typing import NDArray

import fusionslam
from clouds import load_made
from rows import rows

Points = NDArray[np.float32]


def cloud(count: int, seed: int = 1) -> Points:
    rng = np.random.default_rng(seed)
    return (rng.normal(size=(count, 3)) * [6, 3, 0.5]).astype(np.float32)


@rows("count", [2, 3, 4, 5, 15, 16, 17, 33, 700])
def test_a_few_points_have_the_resolution_of_all_their_distances(count: int) -> None:
    points = cloud(count, seed=count)
    squared = ((points[:, None] - points[None]) ** 2).sum(axis=2)
    np.fill_diagonal(squared, np.inf)
    expected = np.sqrt(squared.min(axis=1).astype(np.float64)).mean()
    assert fusionslam.cloud_resolution(points) == pytest.approx(expected, rel=1e-6)


@rows("radius", [1e3, 1e10, 1e30, float("inf")])
def test_any_radius_beyond_the_cloud_gives_all_points_the_same_plane(radius: float) -> None:
    points = cloud(700) + np.float32(50)
    normals, curvatures, indices = fusionslam.estimate_normals(points, radius=radius)
    assert np.array_equal(indices, np.arange(700))
    spread, axes = np.linalg.eigh(np.cov(points.astype(np.float64).T, bias=True))
    assert np.abs(normals @ axes[:, 0]) == pytest.approx(np.ones(700), abs=1e-5)
    assert curvatures == pytest.approx(np.full(700, spread[0] / spread.sum()), abs=1e-4)


@rows("radius", [1e-3, 1e-20, 1e-30, 5e-324])
def test_a_radius_below_all_distances_leaves_no_normals(radius: float) -> None:
    normals, curvatures, indices = fusionslam.estimate_normals(cloud(700), radius=radius)
    assert normals.shape == (0, 3) and len(curvatures) == len(indices) == 0
    with pytest.raises(fusionslam.DataError, match="5 points"):
        fusionslam.shot(cloud(700), normal_radius=radius)


def test_duplicates_of_all_points_have_no_resolution_and_the_normals_of_one_copy() -> None:
    points = cloud(400)
    twice = np.concatenate([points, points])
    assert fusionslam.cloud_resolution(twice) == 0
    with pytest.raises(fusionslam.DataError):
        fusionslam.shot(twice)
    normals, _, indices = fusionslam.estimate_normals(twice, radius=1.5)
    single, _, single_indices = fusionslam.estimate_normals(points, radius=1.5)
    at = {int(i): normal for i, normal in zip(indices, normals, strict=True)}
    agreeing = [abs(at[int(i)] @ n) for i, n in zip(single_indices, single, strict=True)]
    assert np.median(agreeing) == pytest.approx(1, abs=1e-5)


def test_points_at_one_place_are_refused_or_have_no_normals() -> None:
    points = np.full((1500, 3), 7.25, np.float32)
    assert fusionslam.cloud_resolution(points) == 0
    assert len(fusionslam.estimate_normals(points, radius=1.0)[2]) == 0
    with pytest.raises(fusionslam.DataError):
        fusionslam.shot(points)


@rows(
    "outliers",
    [*([[far, -far, far]] for far in (1e3, 1e9, 1e15)), [[500, 0, 0], [500.5, 0, 0]]],
)
def test_outliers_have_no_normals_and_leave_those_of_the_others_as_they_are(
    outliers: list[list[float]],
) -> None:
    points = cloud(2000)
    for given, expected in zip(
        fusionslam.estimate_normals(np.r_[points, np.float32(outliers)], radius=0.7),
        fusionslam.estimate_normals(points, radius=0.7),
        strict=True,
    ):
        assert np.array_equal(given, expected)


def test_the_number_of_threads_changes_nothing_in_a_scan() -> None:
    points, colors = load_made("town_150")
    results = {
        (
            fusionslam.cshot(points, colors, threads=threads).tobytes(),
            *map(bytes, fusionslam.estimate_normals(points, radius=0.5, threads=threads)),
        )
        for threads in (1, 2, 3)
    }
    assert len(results) == 1


def test_shot_with_given_normals_is_that_of_the_whole_call() -> None:
    points = cloud(800)
    colors = np.random.default_rng(2).integers(0, 256, points.shape).astype(np.uint8)
    normals, _, kept = fusionslam.estimate_normals(points, radius=1.0)
    shot = fusionslam.shot_at_centroid(points[kept], normals)
    cshot = fusionslam.shot_at_centroid(points[kept], normals, colors[kept], threads=2)
    assert np.array_equal(shot, fusionslam.shot(points, normal_radius=1.0))
    assert np.array_equal(cshot, fusionslam.cshot(points, colors, normal_radius=1.0))


def test_memory_that_is_not_aligned_gives_the_same() -> None:
    points = cloud(1000)
    shifted = np.frombuffer(b"x" + points.tobytes(), np.uint8)[1:].view(np.float32).reshape(-1, 3)
    assert not shifted.flags.aligned
    for call in (fusionslam.m2dp, fusionslam.shot):
        assert np.array_equal(call(shifted), call(points))
