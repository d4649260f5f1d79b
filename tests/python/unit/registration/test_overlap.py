# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Points are counted by what another sensor saw where they are."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from fusionslam.base.arrays import Floats32, Points
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.registration import count_overlap, nearest_ranges
from rows import rows
from streets import at

NAMES = ["agreeing", "before", "open", "behind", "outside"]


def wall(x: float, *, hole: bool = False) -> Points:
    """Seen from the origin 45 degrees to both sides and 20 up and down; maybe with a hole ahead."""
    azimuths, elevations = np.radians(np.mgrid[-45:45.1:0.5, -20:20.1:0.5]).reshape(2, -1)
    points = x * np.stack(
        [np.ones(azimuths.size), np.tan(azimuths), np.tan(elevations) / np.cos(azimuths)], axis=1
    )
    ahead = np.maximum(np.abs(azimuths), np.abs(elevations)) < np.radians(6)
    kept: Points = points[~(ahead & hole)].astype(np.float32)
    return kept


SEEN = wall(10)
RANGES = nearest_ranges(SEEN)


def counts_of(
    *points: tuple[float, float, float], other: Points = SEEN, ranges: Floats32 = RANGES
) -> dict[str, int]:
    found = count_overlap(np.array(points, np.float32), other, ranges, np.eye(4))
    assert list(found) == NAMES
    assert sum(found.values()) == len(points)
    return {name: number for name, number in found.items() if number}


@rows(
    "point, name",
    [
        ((10.4, 0, 0), "agreeing"),
        ((9.6, 2, 1), "agreeing"),
        ((9.0, 0, 0), "before"),
        ((3, 1, 0), "before"),
        ((10.6, 0, 0), "behind"),
        ((13, 3, 1), "behind"),
        ((3, 5, 0), "outside"),  # too far to the left
        ((3, 0, 2), "outside"),  # too high
        ((-3, 0, 0), "outside"),
        ((40, 0, 0), "outside"),  # farther than anything that was seen
    ],
)
def test_a_point_is_judged_by_what_the_other_sensor_saw(point: Any, name: str) -> None:
    assert counts_of(point) == {name: 1}


def test_a_direction_from_which_nothing_came_back_is_open() -> None:
    holed = wall(10, hole=True)
    ranges = nearest_ranges(holed)
    assert counts_of((5, 0, 0), (12, 0, 0), other=holed, ranges=ranges) == {"open": 2}
    # At the edge of the hole the wall counts.
    assert counts_of((5, 0.5, 0), other=holed, ranges=ranges) == {"before": 1}


def test_the_view_is_limited_where_many_columns_in_a_row_are_empty() -> None:
    around = np.radians(np.arange(0, 360, 1.0))
    level = np.stack([np.cos(around), np.sin(around), np.zeros(360)], axis=1) * 10
    for gap, name in ((8, "open"), (30, "outside")):
        away = np.abs(np.arange(360) - 180) > gap / 2
        ring = np.concatenate([level[away], [[9, 0, 2], [9, 0, -2]]]).astype(np.float32)
        assert counts_of((-5, 0, 0), other=ring, ranges=nearest_ranges(ring)) == {name: 1}


def test_points_are_moved_into_the_frame_of_the_other_sensor() -> None:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("xyz", [5, -8, 130], degrees=True).as_matrix()
    pose[:3, 3] = 3, -4, 1
    back = np.linalg.inv(pose)
    points = (np.array([[9.0, 0, 0], [10, 1, 1], [13, 3, 1]]) @ back[:3, :3].T) + back[:3, 3]
    found = count_overlap(points.astype(np.float32), SEEN, RANGES, pose)
    assert [found[name] for name in NAMES] == [1, 1, 0, 1, 0]


def test_what_a_further_view_saw_to_be_free_counts() -> None:
    wall_behind = wall(10) * np.array([-1, 1, 1], np.float32)  # seen by turning around
    turned = np.diag([-1.0, -1.0, 1.0, 1.0])
    points = np.array([[-5, 0, 0], [5, 0, 0], [-12, 0, 0]], np.float32)
    alone = count_overlap(points, SEEN, RANGES, np.eye(4))
    assert alone["outside"] == 2 and alone["before"] == 1
    further = [(nearest_ranges(wall_behind @ turned[:3, :3].astype(np.float32).T), turned)]
    both = count_overlap(points, SEEN, RANGES, np.eye(4), further=further)
    assert both["before"] == 2 and both["outside"] + both["behind"] == 1
    assert sum(both.values()) == 3


@rows("distance", [0.05, 0.3, 2.0])
def test_agreement_is_that_of_an_exhaustive_search(distance: float) -> None:
    rng = np.random.default_rng(8)
    points, other = rng.normal(0, 6, (2, 3000, 3)).astype(np.float32)
    found = count_overlap(points, other, nearest_ranges(other), np.eye(4), distance=distance)
    nearest, _ = cKDTree(other).query(points)
    assert np.abs(nearest - distance).min() > 1e-6  # nothing hangs on rounding
    assert found["agreeing"] == (nearest <= distance).sum()
    assert sum(found.values()) == 3000


@rows("step", [1.0, 2.0, 7.0])
def test_ranges_are_the_least_of_each_direction(step: float) -> None:
    rng = np.random.default_rng(9)
    points = rng.normal(0, 6, (5000, 3)).astype(np.float32)
    rows = round(180 / step)
    x, y, z = points.T.astype(np.float64)
    level = np.hypot(x, y)
    places = [
        (np.arctan2(z, level) + np.pi / 2) / np.pi * rows,
        (np.arctan2(y, x) + np.pi) / (2 * np.pi) * 2 * rows,
    ]
    # The core's angles are right to 1e-4 rad: points that near to an edge are left out.
    inner = np.all([np.abs(each - np.round(each)) > 0.01 * 2 / step for each in places], axis=0)
    expected = np.full((rows, 2 * rows), np.inf)
    row, column = (each[inner].astype(int) for each in places)
    np.minimum.at(expected, (row, column), np.linalg.norm(points[inner], axis=1))
    found = nearest_ranges(points[inner], step=step)
    assert found.shape == expected.shape
    np.testing.assert_allclose(found, np.where(np.isinf(expected), 0, expected), rtol=1e-5)


@rows("size", [1e6, 1e18, 3e38])
def test_points_far_beyond_any_sensor_are_outside(size: float) -> None:
    far = size * np.array([[1, 0, 0], [-1, 1, 0.3], [1, 1, 1]], np.float32)
    assert count_overlap(far, SEEN, RANGES, at(0, 0, 40, 0))["outside"] == 3
    assert nearest_ranges(far[:1]).max() >= 0.9 * size


def test_no_points_are_no_overlap() -> None:
    nothing = np.empty((0, 3), np.float32)
    assert not nearest_ranges(nothing).any()
    assert not any(count_overlap(nothing, SEEN, RANGES, np.eye(4)).values())
    lonely = count_overlap(SEEN, nothing, nearest_ranges(nothing), np.eye(4))
    assert lonely["outside"] == len(SEEN)


@rows(
    "name, value, error",
    [
        ("points", np.full((1, 3), np.nan, np.float32), DataError),
        ("other", np.full((1, 3), np.inf, np.float32), DataError),
        ("points", np.zeros((2, 2), np.float32), ShapeError),
        ("other_from_points", np.eye(3), ShapeError),
        ("other_from_points", np.full((4, 4), np.nan), DataError),
        *[
            ("other_from_points", np.diag(row), DataError)
            for row in ([2.0, 2, 2, 1], [1.0, 1, -1, 1])
        ],
        *[("other_ranges", np.zeros(n, np.float32), ShapeError) for n in (5, (0, 4))],
        ("other_ranges", np.zeros((4, 4), np.int32), ShapeError),
        *[
            ("other_ranges", np.full((4, 8), value, np.float32), DataError)
            for value in (np.inf, np.nan, -1)
        ],
        *[("distance", value, ConfigError) for value in (0.0, 101.0, np.nan)],
    ],
)
def test_bad_input_is_refused(name: str, value: Any, error: type[Exception]) -> None:
    whole: dict[str, Any] = {"points": SEEN, "other": SEEN, "other_ranges": RANGES}
    with pytest.raises(error):
        count_overlap(**whole | {"other_from_points": np.eye(4), name: value})


@rows("step", [0.0, 0.05, 31.0, float("nan")])
def test_a_step_out_of_range_is_refused(step: float) -> None:
    with pytest.raises(ConfigError, match=r"expected 0\.1 to 30"):
        nearest_ranges(SEEN, step=step)
