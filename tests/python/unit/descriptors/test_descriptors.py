# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Descriptors by name, their normals and resolution, and whether they repeat."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import fusionslam
from clouds import Points, distance, load_made, street
from error_codes import has_code
from fusionslam.datasets import write_cloud
from fusionslam.views.scenes import SceneConfig, scene_of_cloud
from refusals import refuses


def test_the_resolution_is_the_mean_distance_to_the_nearest_neighbour() -> None:
    from scipy.spatial import KDTree

    points, _ = street(5, 1000)
    nearest = KDTree(points).query(points, k=2)[0][:, 1]
    assert fusionslam.cloud_resolution(points) == pytest.approx(nearest.mean(), rel=1e-5)


def test_normals_are_the_directions_of_least_spread_and_look_at_the_origin() -> None:
    from scipy.spatial import KDTree

    points, _ = street(6, 1000)
    tree, radius = KDTree(points), 2.0
    normals, curvatures, indices = fusionslam.estimate_normals(points, radius=radius)
    assert ((normals * points[indices]).sum(axis=1) <= 1e-3).all()
    assert np.linalg.norm(normals, axis=1) == pytest.approx(np.ones(len(normals)), abs=1e-5)
    compared = 0
    for normal, curvature, i in zip(normals, curvatures, indices, strict=True):
        near = points[tree.query_ball_point(points[i], radius)].astype(np.float64)
        spread, axes = np.linalg.eigh(np.cov(near.T, bias=True))
        if spread[1] - spread[0] < 0.02:
            continue  # no clear direction of least spread
        compared += 1
        assert abs(normal @ axes[:, 0]) == pytest.approx(1, abs=1e-3)
        assert curvature == pytest.approx(spread[0] / spread.sum(), abs=1e-3)
    assert compared > len(indices) // 2


def test_points_with_fewer_than_three_neighbours_have_no_normal() -> None:
    points, _ = street(7, 1000)
    far = np.array([[500, 0, 0], [501, 0, 0]], np.float32)
    _, _, indices = fusionslam.estimate_normals(np.concatenate([points, far]), radius=2.0)
    assert indices.max() < len(points)


CALLS: dict[str, Callable[..., NDArray[np.floating]]] = {
    "m2dp robust": lambda p, c, n: fusionslam.m2dp(p, threads=n),
    "m2dp paper": lambda p, c, n: fusionslam.m2dp(p, preset="paper", threads=n),
    "m2dp author": lambda p, c, n: fusionslam.m2dp(p, preset="author", threads=n),
    "m2dp upright": lambda p, c, n: fusionslam.m2dp(p, preset="upright", threads=n),
    "m2dp_signature": lambda p, c, n: fusionslam.m2dp_signature(p, threads=n),
    "cm2dp rgb": lambda p, c, n: fusionslam.cm2dp(p, c, threads=n),
    "cm2dp hsv": lambda p, c, n: fusionslam.cm2dp(p, c, color_space="hsv", threads=n),
    "cm2dp lab": lambda p, c, n: fusionslam.cm2dp(
        p, c, color_space="lab", preset="author", threads=n
    ),
    "cm2dp_signature": lambda p, c, n: fusionslam.cm2dp_signature(p, c, threads=n),
    "shot": lambda p, c, n: fusionslam.shot(p, threads=n),
    "cshot": lambda p, c, n: fusionslam.cshot(p, c, threads=n),
    "normals": lambda p, c, n: fusionslam.estimate_normals(p, radius=1.0, threads=n)[0],
}


@pytest.mark.parametrize("call", CALLS)
def test_two_runs_and_one_or_two_threads_give_the_same_bytes(call: str) -> None:
    points, colors = street(60)
    results = {CALLS[call](points, colors, threads).tobytes() for threads in (1, 1, 2, 2, 0)}
    assert len(results) == 1


@pytest.mark.parametrize(
    ("name", "length"),
    [
        ("m2dp", 192),
        ("cm2dp", 576),
        ("shot", 352),
        ("cshot", 1344),
        ("scan_context", 1200),
        ("cscan_context", 3600),
        ("bev_spectrum", 4320),
    ],
)
def test_describe_by_name_is_the_function_of_that_name(name: str, length: int) -> None:
    points, colors = street(61, 1000)
    arguments = (points, colors) if name.startswith("c") else (points,)
    given = fusionslam.describe(fusionslam.Cloud(points, colors), name)
    assert given.shape == (length,) and given.dtype == np.float32
    assert np.array_equal(given, getattr(fusionslam, name)(*arguments))


def test_describe_obeys_its_configuration() -> None:
    points, colors = street(62, 1000)
    config = fusionslam.DescriptorConfig(preset="author", color_space="lab", threads=2)
    given = fusionslam.describe(fusionslam.Cloud(points, colors), "cm2dp", config)
    expected = fusionslam.cm2dp(points, colors, preset="author", color_space="lab")
    assert np.array_equal(given, expected)


def test_describe_names_what_is_missing_or_unknown() -> None:
    points, _ = street(63, 200)
    with refuses("no-colors"):
        fusionslam.describe(fusionslam.Cloud(points), "cm2dp")
    with pytest.raises(fusionslam.ConfigError, match=r"m3dp.*m2dp, cm2dp, shot, cshot"):
        fusionslam.describe(fusionslam.Cloud(points), "m3dp")


def test_what_is_no_cloud_or_no_frame_is_refused_by_its_kind(tmp_path: Path) -> None:
    points, _ = street(63, 200)
    cloud, frame = fusionslam.Cloud(points), fusionslam.Frame(points=points)
    for given, kind in ((points, "ndarray"), (frame, "Frame")):
        for take in (
            lambda each: fusionslam.describe(each, "m2dp"),
            lambda each: scene_of_cloud(each, SceneConfig()),
            lambda each: write_cloud(tmp_path / "cloud.ply", each),
        ):
            with pytest.raises(fusionslam.ShapeError, check=has_code("no-cloud", kind)):
                take(given)
    with pytest.raises(fusionslam.ShapeError, check=has_code("no-frame", "Cloud")):
        fusionslam.fuse(cloud)


def test_two_visits_of_a_place_are_nearer_than_other_places() -> None:
    visits = ("house_016", "house_112")
    others = ("house_000", "house_006", "town_040", "town_150", "town_300")
    kinds: dict[str, Callable[[Points], NDArray[np.float32]]] = {
        "robust": fusionslam.m2dp,
        "author": lambda points: fusionslam.m2dp(points, preset="author"),
        "shot": fusionslam.shot,
    }
    for kind, compute in kinds.items():
        first, second = (compute(load_made(name)[0]) for name in visits)
        unrelated = [compute(load_made(name)[0]) for name in others]
        nearest = min(distance(visit, other) for visit in (first, second) for other in unrelated)
        assert 2 * distance(first, second) < nearest, kind
