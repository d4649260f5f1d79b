# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What is said of a map's quality is what its graph and its clouds hold."""

from pathlib import Path

import numpy as np
import pytest

from fusionslam.base.arrays import Floats
from fusionslam.errors import DataError
from fusionslam.geometry.se3 import exp
from fusionslam.mapping import Edge, MapConfig, PlaceMap, judge_map
from fusionslam.mapping.edge import deviations_of, measurement_errors
from fusionslam.mapping.gtsam_extra import Uncertainty
from fusionslam.mapping.map_content import MapContent
from fusionslam.mapping.quality import judge_graph
from fusionslam.mapping.surfaces import doubling
from laps import LAP, Drive, circle
from map_fixtures import FRAMES, build
from streets import OPTIONS, at, changed

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


def test_bounds_while_driving_are_those_of_a_chain_and_no_less_than_of_the_graph() -> None:
    drive, way = Drive(), circle(2 * LAP)
    for number in range(len(way)):
        is_loop = number >= LAP and number % 5 == 0
        drive.add(1, way, number, {number - LAP: way[number - LAP]} if is_loop else {})
        drive.content.bound(number)  # from now on it grows
        if number == LAP - 1:
            alone = judge_graph(drive.content, passes={}, **LIMITS).deviations
            bounds = [deviations_of(drive.content.bound(k).covariance) for k in range(LAP)]
            np.testing.assert_allclose(bounds[1:], alone[1:], rtol=2e-3)
    drive.content.solve()
    content = drive.content
    grown = np.array([deviations_of(content.bound(k).covariance) for k in range(2 * LAP)])
    anew = MapContent(content.sessions, content.keyframes, content.edges.values(), None)
    best = np.array([deviations_of(anew.bound(k).covariance) for k in range(2 * LAP)])
    least = judge_graph(content, passes={}, **LIMITS).deviations
    assert np.all(best[:, 0] <= grown[:, 0] + 1e-9) and np.all(least[1:] <= best[1:] * 1.001)
    assert best[LAP - 1, 0] < 0.5 * alone[-1, 0]  # the loop after it leads back to the start
    step = np.linalg.norm(way[1, :3, 3] - way[0, :3, 3]) * 1.01
    unconfirmed = [content.bound(k).unconfirmed_m / step for k in range(2 * LAP)]
    np.testing.assert_allclose(unconfirmed[:LAP], range(LAP), rtol=1e-6)
    np.testing.assert_allclose(unconfirmed[LAP:], [*range(5)] * (LAP // 5), rtol=1e-6, atol=1e-9)


def test_a_session_that_was_joined_late_has_bounds_from_its_first_keyframe() -> None:
    drive, way = Drive(), circle(2 * LAP)
    for number in range(LAP):
        drive.add(1, way, number, {})
    for number in range(LAP):
        match = {number: way[number]} if number in (20, 22, 24) else {}
        drive.add(2, way[LAP:], number, match)
        bound = drive.content.bound(LAP + number)
    content = drive.content
    assert content.list_sessions()[1].parts == (0,)
    ends = [deviations_of(content.bound(k).covariance)[0] for k in (LAP, LAP + 20, 2 * LAP - 1)]
    assert ends[0] > ends[1] > 0 and ends[2] > ends[1]
    step = np.linalg.norm(way[1, :3, 3] - way[0, :3, 3]) * 1.01
    assert bound.unconfirmed_m == pytest.approx(15 * step)


@pytest.mark.slow
def test_a_robot_that_has_odometry_alone_is_lost_until_a_loop_finds_it(tmp_path: Path) -> None:
    config = MapConfig(lost_after=20.0)
    steps = build(tmp_path / "site.fsmap", config=config)  # 48 m out, and back 1 m to the side
    out, back = steps[:9], steps[9:]
    # Odometry makes each step 2 % too long.
    assert [each.unconfirmed_m for each in out] == pytest.approx([6.12 * k for k in range(9)])
    assert [each.is_lost for each in out] == [6.12 * k > 20 for k in range(9)]
    assert np.all(np.diff([each.deviation_m for each in out]) > 0)
    assert np.all(np.diff([each.deviation_deg for each in out]) > 0)
    found = [each for each in back if any(edge.state == "believed" for edge in each.loops)]
    assert len(found) > 3 and not any(each.is_lost or each.unconfirmed_m for each in found)
    assert back[-1].deviation_m < 0.6 * out[-1].deviation_m  # it is near the start again
    with PlaceMap.open(tmp_path / "site.fsmap", "monday", **OPTIONS) as site:
        last, ahead = FRAMES[-1], at(0.5, 0, 0, 0)
        on = site.add(changed(last, index=99, odometry=last.odometry @ ahead))
        assert on.keyframe is None and on.covariance.shape == (6, 6)
        assert on.unconfirmed_m == pytest.approx(0.5)  # the loop of the last one is believed now
        before = deviations_of(site.content.bound(17).covariance)[0]
        assert before < on.deviation_m < before + 0.1


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
