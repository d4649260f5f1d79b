# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Where on the globe (WGS 84) a map or a simulated world is."""

from typing import Any

import numpy as np

from fusionslam.base.arrays import Floats
from fusionslam.config import Section, merged, option
from fusionslam.errors import ConfigError, DataError, needing
from fusionslam.geometry.rigid import rotation


class MapOrigin(Section):
    """Where on the globe (WGS 84) the origin of a map is, and how the map is turned."""

    latitude: float = option(..., "north is positive", unit="deg", ge=-90, le=90)
    longitude: float = option(..., "east is positive", unit="deg", ge=-180, le=180)
    altitude: float = option(0.0, "above the ellipsoid", unit="m", ge=-12e3, le=1e5)
    heading: float = option(
        0.0, "direction of the map's x axis, from east towards north", unit="deg", ge=-360, le=360
    )

    def __str__(self) -> str:
        """As ``parse_origin`` reads it, to a centimetre."""
        place = f"{self.latitude:.7f},{self.longitude:.7f},{self.altitude:.2f}"
        return f"{place},{self.heading:.3f}"


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
        FusionSlamError: the extra ``map`` is not installed (code "missing-extra").
    """
    east, north = _turn(origin) @ positions[:, :2].T
    places = _enu_from_geographic(origin).transform(
        east, north, positions[:, 2], direction="INVERSE"
    )
    return np.stack(places, axis=1)


def from_geographic(places: Floats, origin: MapOrigin) -> Floats:
    """Positions in a map, as ``geographic`` takes them, of what it returns.

    Raises:
        FusionSlamError: the extra ``map`` is not installed (code "missing-extra").
    """
    east, north, up = _enu_from_geographic(origin).transform(*places.T)
    x, y = _turn(origin).T @ np.stack([east, north])
    return np.stack([x, y, up], axis=1)


def utm_code(origin: MapOrigin) -> int:
    """EPSG code of the zone of UTM (WGS 84) that an origin is in, of six degrees everywhere.

    Raises:
        DataError: it is south of 80 degrees or north of 84 (code "out-of-range").
    """
    if not -80 <= origin.latitude <= 84:
        raise DataError(
            f"the origin's latitude is {origin.latitude:g}: UTM reaches from -80 to 84 degrees",
            code="out-of-range",
            fields=("latitude", f"{origin.latitude:g}"),
        )
    zone = min(int((origin.longitude + 180) // 6), 59) + 1
    return (32600 if origin.latitude >= 0 else 32700) + zone


def utm_poses(poses: Floats, origin: MapOrigin, code: int) -> Floats:
    """Poses in a zone of UTM: east and north, metres, and above the ellipsoid of WGS 84.

    The map's axes are turned as at its origin, where they are level; a kilometre away, the horizon
    is tilted against it by 0.009 degrees.

    Args:
        poses: float64 (n, 4, 4), map_from_robot.
        origin: of the map.
        code: as of ``utm_code``.

    Raises:
        FusionSlamError: the extra ``map`` is not installed (code "missing-extra").
    """
    with needing("map", "positions on the globe need pyproj"):
        from pyproj import Transformer
    project = Transformer.from_crs(4326, code, always_xy=True).transform
    axis = np.array([[-10.0, 0, 0], [10, 0, 0]])
    places = geographic(np.concatenate([axis, poses[:, :3, 3]]), origin)
    east, north = project(*places[:, :2].T)
    turn = rotation([0, 0, np.arctan2(north[1] - north[0], east[1] - east[0])])
    placed = poses.copy()
    placed[:, :3, :3] = turn @ poses[:, :3, :3]
    placed[:, :3, 3] = np.stack([east, north, places[:, 2]], axis=1)[2:]
    return placed


def _turn(origin: MapOrigin) -> Floats:
    """East and north of a map's x and y, float64 (2, 2)."""
    return rotation([0, 0, np.radians(origin.heading)])[:2, :2]


def _enu_from_geographic(origin: MapOrigin) -> Any:
    """PROJ's way from longitude, latitude and height to metres east, north and up."""
    with needing("map", "positions on the globe need pyproj"):
        from pyproj import Transformer
    return Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad "
        "+step +proj=cart +ellps=WGS84 +step +proj=topocentric +ellps=WGS84 "
        f"+lat_0={origin.latitude!r} +lon_0={origin.longitude!r} +h_0={origin.altitude!r}"
    )
