# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What is said of a map's quality is what its graph and its clouds hold."""

from pathlib import Path

import numpy as np
import pytest

from fusionslam.base.arrays import Floats
from fusionslam.errors import DataError
from fusionslam.geometry.se3 import exp
from fusionslam.mapping import Edge, PlaceMap, judge_map
from fusionslam.mapping.edge import measurement_errors
from fusionslam.mapping.gtsam_extra import Uncertainty
from fusionslam.mapping.map_content import MapContent
from fusionslam.mapping.quality import judge_graph
from fusionslam.mapping.surfaces import doubling
from laps import LAP, Drive, circle
from streets import at

pytest.importorskip("gtsam", reason="the library of pose graphs is an extra")

LIMITS = {"unsure_m": 0.5, "apart_m": 0.05}


@pytest.fixture(scope="module")
def laps() -> MapContent:
    """Two laps, each fifth keyframe of the second one with a loop, solved."""
    drive, way = Drive(), circle(2 * LAP)
    for number in range(len(way)):
        is_loop = number >= LAP and number % 5 == 0
        drive.add(1, way, number, {number - LAP: way[number - LAP]} if is_loop else {})
    drive.content.solve()
    return drive.content


def whitened(edge: Edge, poses: Floats) -> Floats:
    """Residuals (m, 6) of an edge in its deviations, of m pairs of poses (m, 2, 4, 4)."""
    errors = measurement_errors(poses, [edge] * len(poses))
    return np.asarray(np.linalg.solve(np.linalg.cholesky(edge.covariance), errors.T).T)


def design_of(content: MapContent) -> Floats:
    """How residuals change with small motions of all keyframes but the first, numerically."""
    step, rows = 1e-6, []
    motions = np.concatenate([exp(sign * step * np.eye(6)) for sign in (1.0, -1.0)])
    for edge in content.edges.values():
        row = np.zeros((6, 6 * len(content)))
        for side, end in enumerate((edge.a, edge.b)):
            pairs = np.tile(content.poses[[edge.a, edge.b]], (12, 1, 1, 1))
            pairs[:, side] = pairs[:, side] @ motions
            forth, back = whitened(edge, pairs).reshape(2, 6, 6)
            row[:, 6 * end : 6 * end + 6] = (forth - back).T / (2 * step)
        rows.append(row[:, 6:])
    return np.concatenate(rows)


def test_deviations_and_redundancies_are_those_of_the_dense_inverse(laps: MapContent) -> None:
    design = design_of(laps)
    covariance = np.linalg.inv(design.T @ design)
    variances = np.diag(covariance).reshape(-1, 2, 3).sum(axis=2)
    quality = judge_graph(laps, passes={}, **LIMITS)
    deviations = np.sqrt(variances) * [1.0, np.degrees(1.0)]
    np.testing.assert_allclose(quality.deviations[1:], deviations, rtol=1e-3)
    assert np.all(quality.deviations[0] < 1e-3)
    left = np.eye(len(design)) - design @ covariance @ design.T
    redundancies = np.diag(left).reshape(-1, 6).sum(axis=1)
    for each in quality.influences:
        assert each.redundancy == pytest.approx(redundancies[each.edge.number], rel=1e-3)
    squares = {each.edge.number: each.chi_square for each in quality.influences}
    assert len(squares) == len(laps.loops) == quality.loops == 8
    own = sum(redundancies[number] for number in squares)
    assert quality.fit == pytest.approx(sum(squares.values()) / own, rel=1e-3)


def test_influences_are_shifts_of_maps_that_are_solved_without_the_loop(laps: MapContent) -> None:
    influences = judge_graph(laps, passes={}, **LIMITS).influences
    for each in influences:
        kept = [edge for edge in laps.edges.values() if edge.number != each.edge.number]
        without = MapContent(laps.sessions, laps.keyframes, kept, None)
        without.solve()
        shifts = np.linalg.norm((without.poses - laps.poses)[:, :3, 3], axis=1)
        assert each.shift_m == pytest.approx(shifts.max(), rel=0.02, abs=1e-4)
        assert each.keyframe is not None and shifts[each.keyframe] > 0.95 * shifts.max()
    assert [each.shift_m for each in influences] == sorted(each.shift_m for each in influences)[
        ::-1
    ]


def test_what_one_edge_alone_holds_is_not_checked_by_anything(laps: MapContent) -> None:
    chain = [edge for edge in laps.edges.values() if edge.kind == "odometry"]
    errors = Uncertainty(laps.poses, chain, np.zeros(1, np.int64))
    redundancy, apart = errors.leverage(3)
    assert redundancy < 1e-6 and np.all(np.isinf(apart))


def test_loops_along_the_way_are_counted_by_hand() -> None:
    # 240 m straight on, and 120 m of the way back, a keyframe each 4 m. Two loops join both.
    drive = Drive()
    way = np.array(
        [at(4.0 * k, 0, 0) for k in range(61)] + [at(240.0 - 4 * k, 1, 180) for k in range(31)]
    )
    for number in range(len(way)):
        match = {64: 57, 66: 55}.get(number)
        drive.add(1, way, number, {} if match is None else {match: way[match]})
    drive.content.solve()
    quality = judge_graph(
        drive.content, passes={20: (0.02, 0.01), 40: (0.09, 0.07)}, unsure_m=1e9, apart_m=0.05
    )
    places = np.concatenate(
        [[0.0], np.cumsum(np.linalg.norm(np.diff(way[:, :3, 3], axis=0), axis=1))]
    )
    ends = places[[55, 57, 64, 66]]
    # Away from the borders, as the solved way is a little longer.
    near = [np.sum(np.abs(ends - place) <= 50) for place in places]
    sure = [np.all(np.abs(np.abs(ends - place) - 50) > 1.9) for place in places]
    np.testing.assert_array_equal(quality.near_loops[sure], np.array(near)[sure])
    assert np.sum(sure) > 80
    assert sum(each.metres for each in quality.segments) == pytest.approx(361, rel=0.02)
    assert {each.loops for each in quality.segments if each.first <= 64 <= each.last} == {2}
    assert quality.loops == 2 and 1000 * quality.loops / quality.metres == pytest.approx(
        5.5, rel=0.02
    )
    # The first loop ends 220 m from the start, the last one 261 m: 170 and 311 m are 50 m away.
    weak = [(each.first, each.weak) for each in quality.weak_places]
    assert weak[:2] == [(0, ("no-loops",)), (37, ("no-loops", "thick-walls"))] and len(weak) == 3
    assert quality.weak_places[1].last in range(42, 45) and weak[2] == (79, ("no-loops",))
    assert quality.weak_places[1].apart_m == 0.07


@pytest.mark.parametrize("apart", [0.0, 0.06, 0.12])
def test_surfaces_of_two_passes_are_as_thick_as_they_lie_apart(apart: float) -> None:
    rng, noise = np.random.default_rng(5), 0.01
    one, other = (
        np.column_stack(
            [
                rng.uniform(0, 8, 20_000),
                rng.normal(0.2 + x, noise, 20_000),
                rng.uniform(0, 3, 20_000),
            ]
        )
        for x in (0.0, apart)
    )
    thickness, half = doubling(one.astype(np.float32), other.astype(np.float32)) or (None, None)
    assert thickness == pytest.approx(np.hypot(noise, apart / 2), rel=0.05)
    assert half == pytest.approx(apart / 2, abs=0.003)
    assert doubling(one[:5].astype(np.float32), other.astype(np.float32)) is None


def test_a_map_is_judged_as_it_is_read(path: Path, tmp_path: Path) -> None:
    before = path.read_bytes()
    with PlaceMap.open(path, read_only=True) as site:
        quality = judge_map(site)
        assert quality.numbers.tolist() == site.keyframes("monday").tolist()
        assert quality.loops == sum(edge.state == "believed" for edge in site.loops) > 0
        assert 0.01 < np.median(quality.deviations[1:, 0]) < 1
    assert path.read_bytes() == before
    with PlaceMap.open(tmp_path / "new.fsmap", "a") as site, pytest.raises(DataError) as caught:
        judge_map(site)
    assert caught.value.code == "empty"
