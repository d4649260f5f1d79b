# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What is drawn and written of a map: grids, heights, one cloud, trajectories."""

import json
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image

from fusionslam import Cloud, ConfigError, DataError
from fusionslam.base.arrays import Matrix
from fusionslam.geometry.globe import MapOrigin, geographic
from fusionslam.loop_closure import local_maps
from fusionslam.loop_closure.local_maps import join_clouds
from fusionslam.mapping.geojson import write_geojson
from fusionslam.mapping.grids import (
    GridConfig,
    OccupancyGrid,
    PlacedCloud,
    draw_heights,
    draw_occupancy,
)
from rows import rows

CONFIG = GridConfig(resolution=0.1, max_range=8.0)


def room(width: float, depth: float) -> np.ndarray:
    """Walls of a room about the sensor, 1 m high, on a floor 0.5 m below it."""
    along = np.arange(-width / 2, width / 2, 0.05)
    across = np.arange(-depth / 2, depth / 2, 0.05)
    sides = [np.stack([along, np.full_like(along, s * depth / 2)], axis=1) for s in (-1, 1)]
    sides += [np.stack([np.full_like(across, s * width / 2), across], axis=1) for s in (-1, 1)]
    ground = np.concatenate(sides)
    walls = [np.insert(ground, 2, z, axis=1) for z in np.arange(-0.5, 0.5, 0.1)]
    return np.concatenate(walls).astype(np.float32)


def pose(x: float, y: float, yaw: float = 0.0) -> np.ndarray:
    matrix = np.eye(4)
    c, s = np.cos(yaw), np.sin(yaw)
    matrix[:2, :2] = [[c, -s], [s, c]]
    matrix[:2, 3] = x, y
    return matrix


def at(grid: OccupancyGrid, x: float, y: float) -> int:
    column = int((x - grid.origin[0]) // grid.resolution)
    row = int((y - grid.origin[1]) // grid.resolution)
    return int(grid.cells[row, column])


def draw(*placed: PlacedCloud, config: GridConfig = CONFIG) -> OccupancyGrid:
    return draw_occupancy(placed, np.array([each.map_from_cloud[:2, 3] for each in placed]), config)


@rows("yaw", [0.0, np.pi / 2, np.pi])
def test_a_room_is_free_up_to_its_walls_and_unknown_behind_them(yaw: float) -> None:
    grid = draw(PlacedCloud(room(6.0, 4.0), pose(10.0, -20.0, yaw), -0.5))
    x, y = (2.4, 1.4) if np.sin(yaw) ** 2 < 0.5 else (1.4, 2.4)
    for dx in np.arange(-x, x, 0.1):
        for dy in np.arange(-y, y, 0.1):
            assert at(grid, 10 + dx, -20 + dy) == 0
    occupied = np.argwhere(grid.cells == 100) * grid.resolution
    size = np.ptp(occupied, axis=0)  # of the walls, y first
    expected = (4.0, 6.0) if np.sin(yaw) ** 2 < 0.5 else (6.0, 4.0)
    np.testing.assert_allclose(size, expected, atol=0.11)
    # Nothing is known outside: the walls are the border of the grid.
    assert grid.cells.shape == tuple(np.rint(size / 0.1).astype(int) + 1)


def test_an_obstacle_hides_what_is_behind_it() -> None:
    pillar = np.array([[1.0, y, 0.0] for y in np.arange(-0.2, 0.21, 0.05)], np.float32)
    grid = draw(PlacedCloud(np.concatenate([room(6.0, 4.0), pillar]), pose(0.05, 0.05), -0.5))
    assert at(grid, 0.55, 0.05) == 0
    assert at(grid, 1.05, 0.05) == 100
    assert at(grid, 2.05, 0.05) == -1
    assert at(grid, -2.05, 0.05) == 0


def test_rays_do_not_pass_between_the_points_of_a_wall() -> None:
    wall = np.array([[3.0, y, 0.0] for y in np.arange(-3, 3, 0.1)], np.float32)
    floor = np.array([[7.0, y, -0.5] for y in np.arange(-3, 3, 0.01)], np.float32)
    grid = draw(PlacedCloud(np.concatenate([wall, floor]), pose(0, 0), -0.5))
    behind = grid.cells[:, int((3.3 - grid.origin[0]) / 0.1) :]
    assert not (behind == 0).any()


def test_what_more_clouds_see_counts() -> None:
    empty = room(6.0, 4.0)
    someone = np.array([[1.0, 0.0, 0.0]], np.float32)
    passed = PlacedCloud(np.concatenate([empty, someone]), pose(0.05, 0.05), -0.5)
    later = [PlacedCloud(empty, pose(0.05, 0.05), -0.5)] * 3
    assert at(draw(passed), 1.05, 0.05) == 100
    assert at(draw(passed, *later), 1.05, 0.05) == 0


def test_ground_and_ceilings_are_no_obstacles() -> None:
    floor = np.array([[2.0, 0.0, -0.5]], np.float32)
    ceiling = np.array([[3.0, 0.0, 3.0]], np.float32)
    grid = draw(PlacedCloud(np.concatenate([floor, ceiling]), pose(0, 0), -0.5))
    assert not (grid.cells == 100).any()
    assert at(grid, 1.0, 0.02) == 0


def test_a_grid_is_written_for_map_server(tmp_path: Path) -> None:
    cells = np.array([[100, 0, -1], [0, 0, 100]], np.int8)
    image, about = OccupancyGrid(cells, 0.5, (-3.0, 2.0)).save(tmp_path / "site.pgm")
    assert image.read_bytes().startswith(b"P5")
    # The first row of the image is the one farthest along y.
    assert np.array(Image.open(image)).tolist() == [[254, 254, 0], [0, 254, 205]]
    content = yaml.safe_load(about.read_text())
    assert content["image"] == "site.pgm"
    assert content["origin"] == [-3.0, 2.0, 0.0]
    assert content["resolution"] == 0.5
    # As map_server reads it: 205 lies between both thresholds.
    unknown = (255 - 205) / 255
    assert content["free_thresh"] < unknown < content["occupied_thresh"]


def test_heights_are_those_of_the_highest_points(tmp_path: Path) -> None:
    points = np.array([[0.05, 0.05, 1.0], [0.05, 0.05, 2.0], [0.25, 0.05, -1.0]], np.float32)
    lifted = pose(5.0, 5.0)
    lifted[2, 3] = 100.0
    cloud = PlacedCloud(points, lifted, -2.0)
    grid = draw_heights([cloud], np.array([[5.0, 5.0]]), CONFIG)
    np.testing.assert_allclose(grid.heights, [[102.0, np.nan, 99.0]])
    np.testing.assert_allclose(grid.origin, (5.0, 5.0))
    grid.save(tmp_path / "heights.asc")
    lines = (tmp_path / "heights.asc").read_text().splitlines()
    names = ["ncols", "nrows", "xllcorner", "yllcorner", "cellsize", "NODATA_value"]
    assert [line.split()[0] for line in lines[:6]] == names
    assert [float(cell) for cell in lines[6].split()] == [102.0, -9999.0, 99.0]


def test_clouds_without_points_leave_everything_unknown() -> None:
    grid = draw(PlacedCloud(np.empty((0, 3), np.float32), pose(0, 0), 0.0))
    assert grid.cells.tolist() == [[-1]]


def test_maps_that_are_empty_or_too_wide_are_refused() -> None:
    with pytest.raises(DataError, match="without clouds"):
        draw_occupancy([], np.empty((0, 2)))
    with pytest.raises(ConfigError, match="resolution"):
        draw_occupancy([], np.array([[0.0, 0.0], [1e5, 1e5]]), CONFIG)
    with pytest.raises(ConfigError, match="highest"):
        draw(config=GridConfig(lowest=2.0, highest=1.0))


def placed(count: int, *, colored: bool = True) -> Iterator[tuple[Matrix, Cloud]]:
    """Clouds of one place of 10 m, taken from several poses."""
    rng = np.random.default_rng(1)
    for k in range(count):
        pose = np.eye(4)
        pose[0, 3] = k % 3
        points = rng.uniform(0, 10, (20_000, 3)).astype(np.float32) - pose[:3, 3]
        colors = np.full((20_000, 3), 10 * (k % 5), np.uint8) if colored else None
        yield pose, Cloud(points.astype(np.float32), colors)


def test_few_points_at_a_time_give_the_same_voxels(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = join_clouds(placed(10), 1.0)
    monkeypatch.setattr(local_maps, "MOST_POINTS", 50_000)
    joined = join_clouds(placed(10), 1.0)
    cells = [
        {tuple(cell) for cell in np.floor(cloud.points).astype(int).tolist()}
        for cloud in (whole, joined)
    ]
    assert cells[0] == cells[1] and len(joined) == len(cells[1]) == 1000
    assert joined.colors is not None and joined.colors.shape == (1000, 3)


def test_memory_does_not_grow_with_the_number_of_clouds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(local_maps, "MOST_POINTS", 50_000)
    peaks = []
    for count in (8, 32):
        tracemalloc.start()
        join_clouds(placed(count), 1.0)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0]


def test_clouds_without_colours_make_one_without() -> None:
    mixed = [*placed(2), *placed(1, colored=False)]
    assert join_clouds(mixed, 1.0).colors is None
    assert join_clouds(placed(2, colored=False), 1.0).colors is None
    empty = join_clouds([], 1.0)
    assert len(empty) == 0 and empty.colors is None


KARLSRUHE = MapOrigin(latitude=49.0, longitude=8.4, altitude=110.0, heading=30.0)


@rows("x, y, azimuth", [(100.0, 0.0, 60.0), (0.0, 100.0, -30.0)])
def test_positions_lie_where_geodesics_say(x: float, y: float, azimuth: float) -> None:
    pyproj = pytest.importorskip("pyproj")
    longitude, latitude, altitude = geographic(np.array([[x, y, 0.0]]), KARLSRUHE)[0]
    found, _, metres = pyproj.Geod(ellps="WGS84").inv(8.4, 49.0, longitude, latitude)
    assert found == pytest.approx(azimuth, abs=1e-3)
    assert metres == pytest.approx(100, abs=0.01)  # at the ellipsoid, 110 m below
    assert altitude == pytest.approx(110, abs=0.01)


def test_a_trajectory_is_a_line_with_times(tmp_path: Path) -> None:
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, 0, 3] = 0.0, 1.0, 2.0
    stamps = np.array([0, 1_500_000_000, 2_000_000_000])
    write_geojson(tmp_path / "track.geojson", [("monday", stamps, poses, KARLSRUHE)])
    content = json.loads((tmp_path / "track.geojson").read_text())
    assert content["type"] == "FeatureCollection"
    (feature,) = content["features"]
    assert feature["geometry"]["type"] == "LineString"
    assert feature["geometry"]["coordinates"][0] == [8.4, 49.0, 110.0]
    assert feature["properties"]["session"] == "monday"
    assert feature["properties"]["coordTimes"][1] == "1970-01-01T00:00:01.500000+00:00"


def test_one_pose_is_no_line(tmp_path: Path) -> None:
    write_geojson(tmp_path / "a.geojson", [("a", np.array([0]), np.eye(4)[None], KARLSRUHE)])
    (feature,) = json.loads((tmp_path / "a.geojson").read_text())["features"]
    assert feature["geometry"]["type"] == "MultiPoint"
