# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Descriptors by name, their normals and resolution, and whether they repeat."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import fusionslam
from clouds import Points, distance, load_made, street
from error_codes import has_code
from fusionslam.datasets import write_cloud
from fusionslam.views.scenes import SceneConfig, scene_of_cloud
from refusals import refuses
from rows import rows


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


CALLS: list[Callable[..., Any]] = [
    *[partial(fusionslam.m2dp, preset=name) for name in ("robust", "paper", "author", "upright")],
    fusionslam.m2dp_signature,
    fusionslam.shot,
    lambda points, threads: fusionslam.estimate_normals(points, radius=1.0, threads=threads)[0],
]
COLOR_CALLS: list[Callable[..., Any]] = [
    *[partial(fusionslam.cm2dp, color_space=name) for name in ("rgb", "hsv")],
    partial(fusionslam.cm2dp, color_space="lab", preset="author"),
    fusionslam.cm2dp_signature,
    fusionslam.cshot,
]


def test_two_runs_and_one_or_two_threads_give_the_same_bytes() -> None:
    points, colors = street(60)
    calls = [*CALLS, *(partial(call, colors=colors) for call in COLOR_CALLS)]
    for call in calls:
        assert len({call(points, threads=threads).tobytes() for threads in (1, 1, 2, 2, 0)}) == 1


@rows(
    "name",
    ["m2dp", "cm2dp", "shot", "cshot", "scan_context", "cscan_context", "bev_spectrum"],
)
def test_describe_by_name_is_the_function_of_that_name(name: str) -> None:
    points, colors = street(61, 1000)
    arguments = (points, colors) if name.startswith("c") else (points,)
    given = fusionslam.describe(fusionslam.Cloud(points, colors), name)
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
    with pytest.raises(TypeError, match=r"frame is of type Cloud, expected Frame"):
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


@rows("preset", ["paper", "robust"])
def test_denormal_coordinates_have_the_descriptor_of_the_same_cloud_in_metres(preset: str) -> None:
    random = np.random.default_rng(5)
    points = random.integers(-1000, 1000, (500, 3)).astype(np.float32) * np.float32([4, 2, 1])
    tiny = points * np.float32(2.0**-149)  # each a whole multiple of the smallest float
    assert 0 < np.abs(tiny).max() < np.finfo(np.float32).tiny
    expected = fusionslam.m2dp_signature(points, preset=preset)
    assert np.array_equal(fusionslam.m2dp_signature(tiny, preset=preset), expected)


@pytest.mark.nightly
def test_ten_million_points_are_counted_one_by_one() -> None:
    random = np.random.default_rng(6)
    points = random.random((10_000_000, 3), dtype=np.float32) * np.float32([9, 4, 1])
    colors = np.zeros(points.shape, np.uint8)
    colors[:, 0] = 200
    one = fusionslam.cm2dp_signature(points, colors, preset="paper")
    assert np.array_equal(np.rint(one[:, :128] * len(points)).sum(axis=1), np.full(64, len(points)))
    for channel in range(3):
        rows = one[:, 128 + 128 * channel : 256 + 128 * channel]
        assert np.array_equal(np.rint(rows * len(points)).sum(axis=1), np.full(64, len(points)))
    two = fusionslam.cm2dp_signature(points, colors, preset="paper", threads=2)
    assert np.array_equal(one, two)
