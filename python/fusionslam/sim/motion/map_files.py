# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Read and write occupancy maps as ROS map_server files: a YAML description and a grey image."""

import math
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.datasets.cloud_files import read_image
from fusionslam.errors import DataError
from fusionslam.sim.motion.occupancy import OccupancyMap, largest_part
from fusionslam.storage.files import PathLike, atomic_path, reading

_OCCUPIED, _REACHABLE, _OTHER = 0, 254, 205
_OCCUPIED_ABOVE, _FREE_BELOW = 0.65, 0.196
_EXPECTED = "a map of ROS map_server (YAML with image, resolution, origin)"


def read_map(path: PathLike) -> OccupancyMap:
    """Read the map of a map_server YAML file; ``reachable`` is its largest free part.

    A pixel's occupancy is (255 - grey) / 255, or grey / 255 if ``negate`` is set: above
    ``occupied_thresh`` it is occupied, below ``free_thresh`` free, else unknown, which is neither.

    Raises:
        DataError: a file is missing, truncated or of another kind; a value is missing or invalid;
            the map is rotated (origin's third value), or its mode is not trinary.
    """
    path = Path(path)
    values = _description(path)
    image = path.parent / str(values["image"])
    resolution = _number(path, values, "resolution")
    if resolution <= 0:
        raise DataError(f"{path}: resolution is {resolution}, expected metres above 0")
    occupied_above, free_below = _thresholds(path, values)
    grey = _grey(image).astype(np.float64)
    occupancy = (grey if _is_negated(path, values) else 255 - grey) / 255
    occupied = occupancy > occupied_above
    free = occupancy < free_below
    return OccupancyMap(occupied, largest_part(free), resolution, _origin(path, values))


def write_map(path: PathLike, grid: OccupancyMap) -> None:
    """Write ``path`` (YAML) and the image beside it, with the same name and suffix ``.pgm``.

    Occupied cells are 0, reachable ones 254, others 205, which map_server reads as unknown.

    Raises:
        DataError: a file cannot be written, or ``path`` has the image's suffix.
    """
    import yaml
    from PIL import Image

    path = Path(path)
    image = path.with_suffix(".pgm")
    if image == path:
        raise DataError(f"{path}: expected the name of the YAML file, such as {path.stem}.yaml")
    grey = np.select([grid.occupied, grid.reachable], [_OCCUPIED, _REACHABLE], _OTHER)
    with atomic_path(image) as temporary:
        Image.fromarray(grey[::-1].astype(np.uint8)).save(temporary, format="PPM")
    values = {
        "image": image.name,
        "resolution": float(grid.resolution_m),
        "origin": [*map(float, grid.origin), 0.0],
        "negate": 0,
        "occupied_thresh": _OCCUPIED_ABOVE,
        "free_thresh": _FREE_BELOW,
    }
    with atomic_path(path) as temporary:
        text = yaml.safe_dump(values, sort_keys=False, default_flow_style=None)
        temporary.write_text(text, encoding="utf-8")


def _description(path: Path) -> Mapping[str, Any]:
    import yaml

    with reading(path, _EXPECTED):
        values = yaml.safe_load(path.read_text(encoding="utf-8"))
    if not isinstance(values, dict):
        raise DataError(f"{path} holds {type(values).__name__}: expected {_EXPECTED}")
    for key in ("image", "resolution", "origin"):
        if key not in values:
            raise DataError(f"{path} has no {key!r}: expected {_EXPECTED}")
    if values.get("mode", "trinary") != "trinary":
        raise DataError(f"{path}: mode is {values['mode']!r}, expected 'trinary'")
    return values


def _grey(path: Path) -> NDArray[np.uint8]:
    """The image, row 0 at the lowest y."""
    grey = read_image(path)
    if grey.ndim != 2:
        raise DataError(f"{path} has colours, expected a map in grey")
    return grey[::-1]


def _number(path: Path, values: Mapping[str, Any], key: str, default: float | None = None) -> float:
    return _finite(path, key, values.get(key, default))


def _finite(path: Path, key: str, value: Any) -> float:
    number = math.nan
    if isinstance(value, int | float | str) and not isinstance(value, bool):
        # YAML 1.1 parses 1e-05, as other programs write it, as a string.
        with suppress(ValueError):
            number = float(value)
    if not math.isfinite(number):
        raise DataError(f"{path}: {key} is {value!r}, expected a number")
    return number


def _thresholds(path: Path, values: Mapping[str, Any]) -> tuple[float, float]:
    above = _number(path, values, "occupied_thresh", _OCCUPIED_ABOVE)
    below = _number(path, values, "free_thresh", _FREE_BELOW)
    if not 0 <= below <= above <= 1:
        raise DataError(
            f"{path}: free_thresh is {below} and occupied_thresh {above}, "
            "expected 0 <= free_thresh <= occupied_thresh <= 1"
        )
    return above, below


def _is_negated(path: Path, values: Mapping[str, Any]) -> bool:
    negate = values.get("negate", 0)
    if negate not in (0, 1):
        raise DataError(f"{path}: negate is {negate!r}, expected 0 or 1")
    return bool(negate)


def _origin(path: Path, values: Mapping[str, Any]) -> tuple[float, float]:
    origin = values["origin"]
    if not isinstance(origin, list) or len(origin) != 3:
        raise DataError(f"{path}: origin is {origin!r}, expected [x, y, yaw]")
    x, y, yaw = (_finite(path, "origin", value) for value in origin)
    if yaw != 0:
        raise DataError(f"{path}: the map is turned by {yaw} rad, expected a yaw of 0 in origin")
    return x, y
