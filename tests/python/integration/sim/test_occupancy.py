# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of where there is room: made of scenes, grown by robots, read from files and written."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from PIL import Image

from benchmarks.accuracy.maps import off_borders, overlay
from error_codes import has_code
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.sim.mesh import Mesh, Paint, box, join_meshes, panels
from fusionslam.sim.motion.map_files import read_map, write_map
from fusionslam.sim.motion.occupancy import OccupancyMap, largest_part, occupancy_of
from fusionslam.sim.scene import Scene
from rows import rows

PAINT = Paint(0)
GRIDS = arrays(np.bool_, st.tuples(st.integers(1, 12), st.integers(1, 12)))


def scene(*meshes: Mesh) -> Scene:
    return Scene(join_meshes(meshes), [])


def wall(start: tuple[float, float], end: tuple[float, float], low: float, high: float) -> Mesh:
    """A wall without thickness."""
    return panels([[(*start, low), (*end, low), (*end, high), (*start, high)]], PAINT)


def room(width: float, depth: float) -> Mesh:
    """Four thin walls around (0, 0) .. (width, depth)."""
    corners = [(0.0, 0.0), (width, 0.0), (width, depth), (0.0, depth), (0.0, 0.0)]
    return join_meshes([wall(a, b, 0, 2) for a, b in pairwise(corners)])


def grid_of(occupied: NDArray[np.bool_], resolution: float = 0.1) -> OccupancyMap:
    return OccupancyMap(occupied, largest_part(~occupied), resolution, (-1.0, 2.0))


def world_scene(path: Path) -> Scene:
    import trimesh

    triangles = np.asarray(trimesh.load_scene(path).to_geometry().triangles, np.float32)
    count = len(triangles)
    uv, ones = np.zeros((count, 3, 2), np.float32), np.ones((count, 3), np.float32)
    return Scene(Mesh(triangles, uv, np.zeros(count, np.int32), ones, ones), [])


@given(GRIDS, st.floats(0.0, 0.6))
@settings(max_examples=60, deadline=None)
def test_an_inflated_map_holds_the_radius(occupied: NDArray[np.bool_], radius: float) -> None:
    found = grid_of(occupied).inflate(radius).occupied
    around = np.argwhere(np.pad(occupied, 1, constant_values=True)) - 1
    for row, column in np.ndindex(occupied.shape):
        apart = 0.1 * np.hypot(around[:, 0] - row, around[:, 1] - column).min()
        if abs(apart - radius) > 1e-6:
            assert found[row, column] == (apart < radius)


@given(GRIDS)
@settings(max_examples=40, deadline=None)
def test_the_reachable_part_is_what_flooding_finds(free: NDArray[np.bool_]) -> None:
    part = largest_part(free)
    best = 0
    for start in map(tuple, np.argwhere(free)):
        flooded = {start}
        edge = [start]
        while edge:
            row, column = edge.pop()
            for down, right in ((1, 0), (-1, 0), (0, 1), (0, -1)):
                near = (row + down, column + right)
                inside = 0 <= near[0] < free.shape[0] and 0 <= near[1] < free.shape[1]
                if inside and free[near] and near not in flooded:
                    flooded.add(near)
                    edge.append(near)
        best = max(best, len(flooded))
        if part[start]:
            assert flooded == set(map(tuple, np.argwhere(part)))
    assert part.sum() == best


@given(
    st.floats(-1, 1),
    st.floats(-1, 1),
    st.floats(0, np.pi),
    st.sampled_from([0.0, 1e-7, -1e-7, 3e-6, -3e-6, 0.013]),
    st.booleans(),
)
@settings(max_examples=60, deadline=None)
def test_a_thin_wall_has_no_gap_and_is_no_wider_than_its_cells(
    x: float, y: float, angle: float, shift: float, straight: bool
) -> None:
    if straight:  # along the border of two cells, or beside it by less than can be told
        angle, x, y = 0.0, round(x, 1), round(y, 1) + shift
    start, end = np.array([x, y]), np.array([x, y]) + 1.7 * np.array([np.cos(angle), np.sin(angle)])
    grid = occupancy_of(scene(wall(tuple(start), tuple(end), 0.1, 0.2)))
    along = start + np.linspace(0, 1, 2000)[:, None] * (end - start)
    row, column, _ = grid.cells(along[:, 0], along[:, 1])
    # Points within rounding of a border may belong to the cell on its other side.
    inner = [np.abs(v / 0.05 - np.round(v / 0.05)) > 1e-3 for v in along.T]
    sure = inner[0] & inner[1]
    assert grid.occupied[row[sure], column[sure]].all()
    apart = np.hypot(
        *(np.array(grid.centres(*np.nonzero(grid.occupied)))[:, :, None] - along.T[:, None])
    )
    assert apart.min(axis=1).max() <= 0.05 * np.sqrt(0.5) + 1e-3
    # Cells that touch by corners only would let somebody through between them.
    assert np.array_equal(largest_part(grid.occupied), grid.occupied)


def test_only_what_is_within_the_band_is_an_obstacle() -> None:
    low_step = box((1, 1, 0), (1.4, 1.4, 0.02), PAINT)
    table = box((2, 1, 0.7), (2.4, 1.4, 0.75), PAINT)
    crate = box((3, 1, 0), (3.4, 1.4, 0.5), PAINT)
    grid = occupancy_of(scene(room(5, 3), low_step, table, crate))
    x = np.array([1.2, 2.2, 3.02])
    assert list(grid.is_free(x, np.full(3, 1.2))) == [True, True, False]
    ramp = panels([[(1, 1, 0), (3, 1, 1), (3, 2, 1), (1, 2, 0)]], PAINT)
    grid = occupancy_of(scene(room(5, 3), ramp), low_m=0.25, high_m=0.5)
    x = np.array([1.2, 1.44, 1.55, 1.95, 2.06, 2.5])
    assert list(grid.is_free(x, np.full(6, 1.5))) == [True, True, False, False, True, True]


def test_the_inside_of_a_box_and_the_outside_of_a_house_are_not_reachable() -> None:
    grid = occupancy_of(scene(room(6, 4), box((1, 1, 0), (2, 2, 1), PAINT)))
    places = np.array([(3, 3), (1.5, 1.5), (-0.5, 2), (100, 2), (np.nan, 1)])
    assert list(grid.is_free(*places.T)) == [True, False, False, False, False]
    assert not grid.occupied[grid.cells(1.5, 1.5)[:2]]
    crates = [box((x, y, 0), (x + 0.5, y + 0.5, 1), PAINT) for x in (0, 4) for y in (0, 4)]
    grid = occupancy_of(scene(*crates))
    assert list(grid.is_free([2.0, -0.5, 0.25], [2.0, 2.0, 0.25])) == [True, True, False]


def test_a_start_chooses_the_room_and_several_scenes_make_one_map() -> None:
    two = scene(room(8, 4), wall((5, 0), (5, 4), 0, 2))
    assert list(occupancy_of(two).is_free([2, 7], [2, 2])) == [True, False]
    assert list(occupancy_of(two, start=(7.0, 2.0)).is_free([2, 7], [2, 2])) == [False, True]
    with pytest.raises(DataError, check=has_code("not-free", "5.0", "2.0")):
        occupancy_of(two, start=(5.0, 2.0))
    walls, crate = scene(room(4, 4)), scene(box((1, 1, 0), (2, 2, 1), PAINT))
    both = scene(room(4, 4), box((1, 1, 0), (2, 2, 1), PAINT))
    assert np.array_equal(occupancy_of(walls, crate).occupied, occupancy_of(both).occupied)


def test_scenes_and_settings_without_sense_are_refused() -> None:
    shapes = ((3, 3), (3, 2), (), (3,), (3,))
    nothing = Mesh(*(np.zeros((0, *shape), np.float32) for shape in shapes))
    with pytest.raises(DataError, check=has_code("empty-world")):
        occupancy_of(Scene(nothing, []))
    with pytest.raises(DataError, check=has_code("not-finite", 0)):
        occupancy_of(Scene(replace(room(4, 4), triangles=np.full((8, 3, 3), np.inf)), []))
    with pytest.raises(ConfigError, match="low_m"):
        occupancy_of(scene(room(4, 4)), low_m=1.0, high_m=0.5)
    with pytest.raises(ConfigError, check=has_code("out-of-range", "resolution_m", "0.0")):
        occupancy_of(scene(room(4, 4)), resolution_m=0.0)
    with pytest.raises(ConfigError, match="resolution_m"):
        occupancy_of(scene(room(4, 4)), resolution_m=1e-5)


@rows("radius", [-0.1, float("nan"), float("inf")])
def test_a_radius_that_is_no_length_is_refused(radius: float) -> None:
    with pytest.raises(ConfigError, check=has_code("out-of-range", "radius_m", str(radius))):
        grid_of(np.zeros((3, 3), bool)).inflate(radius)


def test_grids_that_do_not_belong_together_are_refused() -> None:
    free = np.zeros((3, 4), bool)
    with pytest.raises(ShapeError, match=r"\(3, 4\).*reachable.*\(4, 3\)"):
        OccupancyMap(free, free.T, 0.1, (0.0, 0.0))
    with pytest.raises(DataError, match="occupied"):
        OccupancyMap(~free, ~free, 0.1, (0.0, 0.0))
    with pytest.raises(DataError, match="nan"):
        OccupancyMap(free, free, float("nan"), (0.0, 0.0))


@given(GRIDS)
@settings(max_examples=20, deadline=None)
def test_a_written_map_is_read_back_the_same(
    tmp_path_factory: pytest.TempPathFactory, occupied: NDArray[np.bool_]
) -> None:
    path = tmp_path_factory.mktemp("map") / "some.map.yaml"
    grid = OccupancyMap(occupied, largest_part(~occupied), 0.1 / 3, (-1 / 3, 1e-7))
    write_map(path, grid)
    back = read_map(path)
    assert np.array_equal(back.occupied, grid.occupied)
    assert np.array_equal(back.reachable, grid.reachable)
    assert (back.resolution_m, back.origin) == (grid.resolution_m, grid.origin)


def write_files(folder: Path, grey: list[list[int]], **values: object) -> Path:
    Image.fromarray(np.array(grey, np.uint8)).save(folder / "m.pgm")
    lines = {"image": "m.pgm", "resolution": 0.5, "origin": [1.0, 2.0, 0.0], **values}
    text = "".join(f"{key}: {value}\n" for key, value in lines.items() if value is not None)
    (folder / "m.yaml").write_text(text)
    return folder / "m.yaml"


def test_grey_values_mean_what_map_server_says(tmp_path: Path) -> None:
    grey = [[254, 205, 0], [255, 250, 88], [254, 206, 90]]
    grid = read_map(write_files(tmp_path, grey))
    assert grid.occupied.tolist() == [[0, 0, 0], [0, 0, 1], [0, 0, 1]]
    assert grid.reachable.tolist() == [[1, 1, 0], [1, 1, 0], [1, 0, 0]]
    assert grid.is_free(1.2, 2.2)
    assert not grid.is_free(1.7, 3.2)
    turned = read_map(write_files(tmp_path, grey, negate=1))
    assert turned.occupied.tolist() == [[1, 1, 0], [1, 1, 0], [1, 1, 0]]
    strict = read_map(write_files(tmp_path, grey, occupied_thresh=0.99, free_thresh=0.01))
    assert strict.occupied.sum() == 1
    assert strict.reachable.tolist() == [[1, 0, 0]] * 3


@rows(
    "values",
    [
        {"image": None},
        {"resolution": None},
        {"resolution": 0},
        {"resolution": "fine"},
        {"resolution": ".nan"},
        {"origin": [0.0, 0.0]},
        {"origin": [0.0, 0.0, 0.5]},
        {"negate": 2},
        {"free_thresh": 0.9},
        {"free_thresh": -0.1},
        {"occupied_thresh": 1.1},
        {"occupied_thresh": "true"},
        {"mode": "scale"},
    ],
)
def test_descriptions_without_sense_are_refused(tmp_path: Path, values: dict[str, object]) -> None:
    path = write_files(tmp_path, [[254, 0]], **values)
    with pytest.raises(DataError, match=r"m\.yaml") as error:
        read_map(path)
    assert (error.value.code, error.value.fields) == ("map-file", tuple(values))


@rows(
    "file, content",
    [
        ("m.pgm", None),
        ("m.pgm", b"P5\n4 x\n"),
        ("m.pgm", lambda whole: whole[:-5]),
        ("m.yaml", None),
        ("m.yaml", b"- a\n- list\n"),
        ("m.yaml", b"image: ["),
    ],
)
def test_broken_map_files_are_named(tmp_path: Path, file: str, content: Any) -> None:
    path = write_files(tmp_path, [[254, 0]] * 20)
    if content is None:
        (tmp_path / file).unlink()
    else:
        whole = (tmp_path / file).read_bytes()
        (tmp_path / file).write_bytes(content(whole) if callable(content) else content)
    with pytest.raises(DataError, match=file.replace(".", r"\.")):
        read_map(path)


def test_coloured_maps_and_other_names_are_refused(tmp_path: Path) -> None:
    path = write_files(tmp_path, [[254, 0]] * 20)
    Image.fromarray(np.zeros((2, 2, 3), np.uint8)).save(tmp_path / "m.pgm", format="PPM")
    with pytest.raises(DataError, match=r"m\.pgm"):
        read_map(path)
    with pytest.raises(DataError, match=r"m\.yaml"):
        write_map(tmp_path / "m.pgm", grid_of(np.zeros((2, 2), bool)))


@pytest.mark.parametrize(
    "name", ["warehouse", pytest.param("small_house", marks=pytest.mark.nightly)]
)
def test_maps_are_those_of_another_program_but_for_borders(test_data: Path, name: str) -> None:
    path = test_data / "worlds" / name
    given = read_map(path.with_suffix(".map.yaml"))
    made = occupancy_of(
        *(world_scene(path.with_suffix(kind)) for kind in (".collision.glb", ".glb"))
    )
    over = overlay(made, given)
    assert over.agree[over.inside].mean() > 0.98
    # What differs lies beside an obstacle of the other map: on a cell's border, or rounded.
    for one, other in ((over.occupied, given.occupied), (given.occupied, over.occupied)):
        assert not (off_borders(one, other) & over.inside).any()
