# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Descriptors of simulated clouds, against what the authors' own programs gave for them.

The clouds and the outputs are in ``tests/data/made``; its README says how they came to be.
"""

from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import fusionslam
from clouds import MADE, distance, load_made
from rows import rows

TOWN = ("town_040", "town_150", "town_300")


@cache
def load(name: str) -> dict[str, NDArray[Any]]:
    with np.load(MADE / f"{name}.npz") as file:
        return dict(file)


def author(name: str, value: str) -> NDArray[Any]:
    return load("cm2dp_author")[f"{name}_{value}"]


@rows("name", [*TOWN, "circle_100"])
def test_paper_m2dp_is_that_of_the_matlab_program(name: str) -> None:
    points, stored = load_made(name)[0], load("m2dp_matlab")
    votes = fusionslam.m2dp_signature(points, preset="paper") * len(points)
    assert np.array_equal(np.rint(votes), np.rint(stored[f"{name}_signature"] * len(points)))
    given, expected = fusionslam.m2dp(points, preset="paper"), stored[f"{name}_descriptor"]
    assert min(distance(given, expected), distance(given, -expected)) < 1e-6


@rows("name", TOWN)
def test_author_m2dp_is_that_of_the_authors_program(name: str) -> None:
    given = fusionslam.m2dp(load_made(name)[0], preset="author")
    assert distance(given, author(name, "m2dp_192")) < 1e-4


@rows("color_space, name", product(["rgb", "hsv", "lab"], TOWN))
def test_author_cm2dp_is_that_of_the_authors_program(name: str, color_space: str) -> None:
    given = fusionslam.cm2dp(*load_made(name), color_space=color_space, preset="author")
    assert distance(given, author(name, f"cm2dp_{color_space}_576")) < 1e-4


@rows("name", TOWN)
def test_shot_and_cshot_are_those_of_pcl(name: str) -> None:
    """In town_040 the farthest point has a vote, because its distance rounds up to the radius."""
    points, colors = load_made(name)
    assert distance(fusionslam.shot(points), author(name, "shot_352")) < 1e-5
    assert distance(fusionslam.cshot(points, colors), author(name, "cshot_1344")) < 1e-5


@rows("name", TOWN)
def test_resolution_and_normals_are_those_of_pcl(name: str) -> None:
    points = load_made(name)[0]
    resolution = fusionslam.cloud_resolution(points)
    assert resolution == pytest.approx(float(author(name, "resolution")), abs=1e-9)
    radius = float(author(name, "normal_radius"))
    normals, curvatures, indices = fusionslam.estimate_normals(points, radius=radius)
    assert len(indices) == author(name, "points_with_normal")
    each_20th = np.c_[points[indices], normals, curvatures][::20]
    np.testing.assert_allclose(each_20th, author(name, "normals_each_20th"), rtol=0, atol=1e-6)
