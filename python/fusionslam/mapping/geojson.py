# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A trajectory on the globe, as a file that geographic programs read."""

import json
from collections.abc import Iterable
from datetime import UTC, datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats
from fusionslam.base.files import PathLike, write_file
from fusionslam.geometry.globe import MapOrigin, geographic


def write_geojson(
    path: PathLike,
    tracks: Iterable[tuple[str, NDArray[np.int64], Floats, MapOrigin]],
) -> None:
    """Write trajectories as GeoJSON (RFC 7946): a line each, with the times of its points.

    Args:
        path: of the file.
        tracks: of each the name, stamps, int64 (n,), nanoseconds since 1970, poses, float64
            (n, 4, 4), map_from_robot, and the origin of the part of the map that they are in.

    Raises:
        DataError: the file cannot be written.
        FusionSlamError: the extra ``map`` is not installed (code "missing-extra").
    """
    features = [
        _feature(name, stamps, geographic(poses[:, :3, 3], origin))
        for name, stamps, poses, origin in tracks
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
