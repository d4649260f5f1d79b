# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
import json
from pathlib import Path

import numpy as np
import pytest

from fusionslam.mapping.geojson import MapOrigin, geographic, write_geojson

pyproj = pytest.importorskip("pyproj")
KARLSRUHE = MapOrigin(latitude=49.0, longitude=8.4, altitude=110.0, heading=30.0)


@pytest.mark.parametrize(("x", "y", "azimuth"), [(100.0, 0.0, 60.0), (0.0, 100.0, -30.0)])
def test_positions_lie_where_geodesics_say(x: float, y: float, azimuth: float) -> None:
    longitude, latitude, altitude = geographic(np.array([[x, y, 0.0]]), KARLSRUHE)[0]
    found, _, metres = pyproj.Geod(ellps="WGS84").inv(8.4, 49.0, longitude, latitude)
    assert found == pytest.approx(azimuth, abs=1e-3)
    assert metres == pytest.approx(100, abs=0.01)  # at the ellipsoid, 110 m below
    assert altitude == pytest.approx(110, abs=0.01)


def test_a_trajectory_is_a_line_with_times(tmp_path: Path) -> None:
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, 0, 3] = 0.0, 1.0, 2.0
    stamps = np.array([0, 1_500_000_000, 2_000_000_000])
    write_geojson(tmp_path / "track.geojson", {"monday": (stamps, poses)}, KARLSRUHE)
    content = json.loads((tmp_path / "track.geojson").read_text())
    assert content["type"] == "FeatureCollection"
    (feature,) = content["features"]
    assert feature["geometry"]["type"] == "LineString"
    assert feature["geometry"]["coordinates"][0] == [8.4, 49.0, 110.0]
    assert feature["properties"]["session"] == "monday"
    assert feature["properties"]["coordTimes"][1] == "1970-01-01T00:00:01.500000+00:00"


def test_one_pose_is_no_line(tmp_path: Path) -> None:
    write_geojson(tmp_path / "a.geojson", {"a": (np.array([0]), np.eye(4)[None])}, KARLSRUHE)
    (feature,) = json.loads((tmp_path / "a.geojson").read_text())["features"]
    assert feature["geometry"]["type"] == "MultiPoint"
