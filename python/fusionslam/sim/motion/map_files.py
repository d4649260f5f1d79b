# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Read and write occupancy maps as ROS map_server files: a YAML description and a grey image."""

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import (
    BaseModel,
    BeforeValidator,
    Field,
    ValidationError,
    ValidationInfo,
    field_validator,
)

from fusionslam.base.files import PathLike, atomic_path, read_yaml, reading, write_file
from fusionslam.datasets.cloud_files import read_image
from fusionslam.errors import DataError, reason_of
from fusionslam.sim.motion.occupancy import OccupancyMap, largest_part

_OCCUPIED, _REACHABLE, _OTHER = 0, 254, 205
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
    values = _read_description(path)
    image = read_image(path.parent / values.image)
    if image.ndim != 2:
        raise DataError(f"{path.parent / values.image} has colours, expected a map in grey")
    grey = image[::-1].astype(np.float64)  # row 0 at the lowest y
    occupancy = (grey if values.negate else 255 - grey) / 255
    occupied = occupancy > values.occupied_thresh
    free = largest_part(occupancy < values.free_thresh)
    return OccupancyMap(occupied, free, values.resolution, values.origin[:2])


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
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    }
    write_file(path, yaml.safe_dump(values, sort_keys=False, default_flow_style=None))


def _refuse_bool(value: Any) -> Any:
    if isinstance(value, bool):
        raise ValueError("expected a number")
    return value


# Also a number in quotes: YAML 1.1 parses 1e-05, as other programs write it, as a string.
_Number = Annotated[float, Field(allow_inf_nan=False), BeforeValidator(_refuse_bool)]


class _Description(BaseModel):
    """The keys of map_server's YAML file."""

    image: str
    resolution: Annotated[_Number, Field(gt=0)]
    origin: tuple[_Number, _Number, _Number]
    negate: bool = False
    occupied_thresh: Annotated[_Number, Field(le=1)] = 0.65
    free_thresh: Annotated[_Number, Field(ge=0)] = 0.196
    mode: Literal["trinary"] = "trinary"

    @field_validator("origin")
    @classmethod
    def _map_is_not_rotated(cls, origin: tuple[float, float, float]) -> tuple[float, float, float]:
        if origin[2] != 0:
            raise ValueError("expected a yaw of 0, the third number")
        return origin

    @field_validator("free_thresh")
    @classmethod
    def _thresholds_are_in_order(cls, free: float, info: ValidationInfo) -> float:
        if free > info.data.get("occupied_thresh", 1.0):
            raise ValueError("expected at most occupied_thresh")
        return free


def _read_description(path: Path) -> _Description:
    with reading(path, _EXPECTED):
        values = read_yaml(path)
    try:
        return _Description.model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        key = str(first["loc"][0]) if first["loc"] else ""
        why = f"{key} is {first['input']!r}" if first["type"] != "missing" else f"no {key!r}"
        raise DataError(
            f"{path}: {why if key else 'no keys'}: {reason_of(first)}; expected {_EXPECTED}",
            code="map-file",
            fields=(key,),
        ) from error
