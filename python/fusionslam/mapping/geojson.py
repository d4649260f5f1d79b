# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A trajectory on the globe, as a file that geographic programs read."""

import json
from datetime import UTC, datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats
from fusionslam.base.files import PathLike, write_file
from fusionslam.config import Section, merged, option
from fusionslam.errors import ConfigError, FusionSlamError


class MapOrigin(Section):
    """Where on the globe (WGS 84) the origin of a map is, and how the map is turned."""

    latitude: float = option(..., "north is positive", unit="deg", ge=-90, le=90)
    longitude: float = option(..., "east is positive", unit="deg", ge=-180, le=180)
    altitude: float = option(0.0, "above the ellipsoid", unit="m", ge=-12e3, le=1e5)
    heading: float = option(
        0.0, "direction of the map's x axis, from east towards north", unit="deg", ge=-360, le=360
    )


def parse_origin(text: str) -> MapOrigin:
    """Read LATITUDE,LONGITUDE[,ALTITUDE[,HEADING]].

    Raises:
        ConfigError: other than two to four numbers, or one out of range.
    """
    names = ("latitude", "longitude", "altitude", "heading")
    cells = text.split(",")
    try:
        values = dict(zip(names, map(float, cells), strict=False))
        if not 2 <= len(cells) <= 4:
            raise ValueError(text)
    except ValueError as error:
        raise ConfigError(
            f"origin {text!r}: expected LATITUDE,LONGITUDE[,ALTITUDE[,HEADING]]",
            code="choice",
            fields=("origin", text),
        ) from error
    return merged(MapOrigin(latitude=0, longitude=0), values, "origin.")


def geographic(positions: Floats, origin: MapOrigin) -> Floats:
    """Longitude and latitude, degrees, and altitude, metres, of positions in a map.

    Args:
        positions: float64 (n, 3), metres, z up at the origin.
        origin: of the map.

    Raises:
        FusionSlamError: the extra ``map`` is not installed.
    """
    try:
        from pyproj import Transformer
    except ImportError as error:
        raise FusionSlamError(
            'positions on the globe need pyproj: pip install "fusionslam[map]"'
        ) from error
    angle = np.radians(origin.heading)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    east, north = turn @ positions[:, :2].T
    transformer = Transformer.from_pipeline(
        "+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84 "
        f"+lat_0={origin.latitude!r} +lon_0={origin.longitude!r} +h_0={origin.altitude!r} "
        "+step +inv +proj=cart +ellps=WGS84 +step +proj=unitconvert +xy_in=rad +xy_out=deg"
    )
    return np.stack(transformer.transform(east, north, positions[:, 2]), axis=1)


def write_geojson(
    path: PathLike,
    tracks: "dict[str, tuple[NDArray[np.int64], Floats]]",
    origin: MapOrigin,
) -> None:
    """Write trajectories as GeoJSON (RFC 7946): a line each, with the times of its points.

    Args:
        path: of the file.
        tracks: stamps, int64 (n,), nanoseconds since 1970, and poses, float64 (n, 4, 4),
            map_from_robot, by name.
        origin: of the map.

    Raises:
        DataError: the file cannot be written.
        FusionSlamError: the extra ``map`` is not installed.
    """
    features = [
        _feature(name, stamps, geographic(poses[:, :3, 3], origin))
        for name, (stamps, poses) in tracks.items()
    ]
    content = {"type": "FeatureCollection", "features": features}
    write_file(path, json.dumps(content) + "\n")


def _feature(name: str, stamps: NDArray[np.int64], places: Floats) -> dict[str, Any]:
    # Degrees to 1 mm.
    points = [[round(x, 8), round(y, 8), round(z, 3)] for x, y, z in places.tolist()]
    geometry: dict[str, Any] = {"type": "LineString", "coordinates": points}
    if len(points) < 2:  # a line has two points or more
        geometry = {"type": "MultiPoint", "coordinates": points}
    times = [datetime.fromtimestamp(each / 1e9, UTC).isoformat() for each in stamps.tolist()]
    return {
        "type": "Feature",
        "geometry": geometry,
        "properties": {"session": name, "coordTimes": times},
    }
