# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Trajectories: read, written, interpolated, and checked against walls."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from error_codes import has_code
from fusionslam.errors import DataError, ShapeError
from fusionslam.geometry.trajectory import Trajectory, read_trajectory, write_trajectory
from fusionslam.sim.motion.clearance import check_trajectory
from fusionslam.sim.motion.map_files import read_map
from fusionslam.sim.motion.occupancy import OccupancyMap, largest_part
from rows import rows

NUMBERS = st.floats(-1e6, 1e6)


def trajectory(*rows: tuple[float, float, float, float]) -> Trajectory:
    return Trajectory(*np.array(rows, np.float64).T.copy())


def grid_with_wall(wall_column: int | None) -> OccupancyMap:
    """4 m x 4 m in cells of 0.1 m from (0, 0), with a wall one cell wide."""
    occupied = np.zeros((40, 40), bool)
    if wall_column is not None:
        occupied[:, wall_column] = True
        occupied[35:38, wall_column] = False
    return OccupancyMap(occupied, largest_part(~occupied), 0.1, (0.0, 0.0))


@given(st.lists(st.tuples(NUMBERS, NUMBERS, st.floats(-3, 3)), min_size=2, max_size=20))
@settings(max_examples=30, deadline=None)
def test_a_written_trajectory_is_read_back_exactly(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[float, float, float]]
) -> None:
    path = tmp_path_factory.mktemp("csv") / "t.csv"
    values = np.array(rows)
    seconds = 0.1 + np.arange(len(rows)) / 30
    written = Trajectory(seconds, values[:, 0], values[:, 1], np.unwrap(values[:, 2]))
    write_trajectory(path, written)
    back = read_trajectory(path)
    for name in ("seconds", "x", "y", "yaw"):
        assert np.array_equal(getattr(back, name), getattr(written, name))


def test_places_are_interpolated_and_speeds_are_those_along_the_heading() -> None:
    drive = trajectory((1, 0, 0, 3.0), (2, 2, 4, 3.0 + 0.4))
    poses = drive.at([1.0, 1.25, 2.0])
    assert poses.shape == (3, 4, 4)
    assert np.allclose(poses[1, :2, 3], [0.5, 1.0])
    expected = [[np.cos(3.1), -np.sin(3.1)], [np.sin(3.1), np.cos(3.1)]]
    assert np.allclose(poses[1, :2, :2], expected)
    assert np.array_equal(poses[:, 2:], np.tile(np.eye(4)[2:], (3, 1, 1)))
    assert (drive.duration_s, len(drive)) == (1.0, 2)
    assert drive.length_m == pytest.approx(np.sqrt(20))
    seconds = np.linspace(0, 5, 151)
    yaw = 0.4 * seconds
    circle = Trajectory(seconds, 1.5 * np.sin(yaw), 1.5 * (1 - np.cos(yaw)), yaw)
    forwards, turn = circle.speeds()
    assert np.allclose(forwards[1:-1], 0.6, rtol=1e-4)
    assert np.allclose(turn, 0.4)


def test_a_file_with_wrapped_angles_gives_continuous_ones(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("t,x,y,yaw\n0,0,0,3.1\n\n1,0,0,-3.1\n2,0,0,-2.9\n")
    assert np.allclose(read_trajectory(path).yaw, [3.1, 2 * np.pi - 3.1, 2 * np.pi - 2.9])


@rows("time", [0.5, 2.5, float("nan")])
def test_no_place_is_made_up_beyond_the_ends(time: float) -> None:
    with pytest.raises(DataError, check=has_code("no-pose", str(time))):
        trajectory((1, 0, 0, 0), (2, 2, 4, 0)).at([1.5, time])


@rows(
    "content, code, fields",
    [
        (None, "missing-file", []),
        (bytes(range(256)), "damaged-file", []),
        (b"", "bad-header", ["nothing"]),
        (b"t,x,y\n0,0,0\n1,0,0\n", "bad-header", ["'t,x,y'"]),
        (b"0,0,0,0\n1,0,0,0\n", "bad-header", ["'0,0,0,0'"]),
        (b"t,x,y,yaw\n", "too-short", [0]),
        (b"t,x,y,yaw\n0,0,0,0\n", "too-short", [1]),
        (b"t,x,y,yaw\n0,0,0,0\n1,0,0\n", "wrong-columns", [3, 3]),
        (b"t,x,y,yaw\n0,0,0,0\n\n1,0,east,0\n", "not-a-number", [4]),
        (b"t,x,y,yaw\n0,\0,0,0\n1,0,0,0\n", "not-a-number", [2]),
        (b"t,x,y,yaw\n0,0,0,0\n1,0,nan,0\n", "not-finite", [3]),
        (b"t,x,y,yaw\n0,0,0,0\n1,0,0,0\n1,0,0,0\n", "not-later", [4]),
        (b"t,x,y,yaw\n5,0,0,0\n1,0,0,0\n", "not-later", [3]),
    ],
)
def test_files_that_are_no_trajectory_are_refused_with_the_line(
    tmp_path: Path, content: bytes | None, code: str, fields: list[str | int]
) -> None:
    path = tmp_path / "bad.csv"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(DataError, check=has_code(code, path, *fields)):
        read_trajectory(path)


def test_arrays_that_are_no_trajectory_are_refused() -> None:
    two = np.arange(2.0)
    with pytest.raises(ShapeError, match=r"\(3,\)"):
        Trajectory(two, two, two, np.arange(3.0))
    with pytest.raises(ShapeError, match=r"\(1,\)"):
        Trajectory(two[:1], two[:1], two[:1], two[:1])
    with pytest.raises(DataError, check=has_code("not-finite", 1)):
        Trajectory(two, two, np.array([0, np.inf]), two)
    with pytest.raises(DataError, check=has_code("not-later", 1, "0.0")):
        Trajectory(two * 0, two, two, two)


def test_a_way_through_a_wall_is_reported_with_time_and_place() -> None:
    # From x = 0.5 to 3.5 m at 1 m/s; the wall covers x = 2.0 .. 2.1, its middle 2.05.
    drive = trajectory((10, 0.5, 1.05, 0), (13, 3.5, 1.05, 0))
    check_trajectory(drive, grid_with_wall(None), 0.2)
    with pytest.raises(DataError) as caught:
        check_trajectory(drive, grid_with_wall(20), 0.2)
    # Cells whose middle is within 0.2 m of 2.05: from 1.85 to 2.25, that is x = 1.8 .. 2.3.
    assert caught.value.code == "blocked"
    *at, blocked = map(float, caught.value.fields)
    assert at in ([11.3, 1.8, 1.05], [11.35, 1.85, 1.05])
    assert blocked == pytest.approx(0.5, abs=0.06)


def test_a_wall_between_two_places_is_not_jumped() -> None:
    drive = trajectory((0, 0.55, 1.05, 0), (0.01, 3.55, 1.05, 0), (0.02, 3.55, 1.1, 0))
    with pytest.raises(DataError, check=has_code("blocked")):
        check_trajectory(drive, grid_with_wall(20), 0.0)
    through_the_door = trajectory((0, 0.55, 3.65, 0), (3, 3.05, 3.65, 0))
    check_trajectory(through_the_door, grid_with_wall(20), 0.0)
    with pytest.raises(DataError, check=has_code("blocked")):
        check_trajectory(through_the_door, grid_with_wall(20), 0.3)


def test_leaving_the_map_is_told_as_such_and_short_times_keep_their_digits() -> None:
    with pytest.raises(DataError) as error:
        check_trajectory(trajectory((0, 3, 1, 0), (5, 5, 1, 0)), grid_with_wall(None), 0.0)
    assert error.value.code == "off-map"
    seconds, x, y, _ = map(float, error.value.fields)
    assert 2 <= seconds < 3 and 4 <= x < 5 and y == 1
    with pytest.raises(DataError) as error:
        check_trajectory(trajectory((0, 0.55, 1, 0), (0.009, 3.55, 1, 0)), grid_with_wall(20), 0.0)
    assert 0.004 <= float(error.value.fields[0]) < 0.005


def test_the_drives_of_shared_worlds_are_read_and_find_room(test_data: Path) -> None:
    for name in ("small_house", "warehouse"):
        drive = read_trajectory(test_data / "worlds" / f"{name}.trajectory.csv")
        check_trajectory(drive, read_map(test_data / "worlds" / f"{name}.map.yaml"), 0.2)
        forwards, turn = drive.speeds()
        assert 0.68 < forwards.max() < 0.7
        assert np.abs(turn).max() < 1.25
        assert np.abs(np.diff(drive.yaw)).max() < 0.1
