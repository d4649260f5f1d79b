# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes: built from coloured clouds and compared by the core, converted to exact arrays."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam._core import (
    RangeImage,
    Scene,
    SceneConfig,
    SceneIndex,
    SimilarityConfig,
    build_scene,
    ciede2000,
    color_difference,
    dbscan,
    scene_similarity,
)
from fusionslam.errors import DataError
from fusionslam.sensors.frame import Cloud, require_cloud

__all__ = [
    "Scene",
    "SceneConfig",
    "SceneIndex",
    "SimilarityConfig",
    "build_scene",
    "ciede2000",
    "color_difference",
    "dbscan",
    "scene_from_arrays",
    "scene_of_cloud",
    "scene_similarity",
    "scene_to_arrays",
]

_NOTHING = build_scene(np.empty((0, 3), np.float32), np.empty((0, 3), np.uint8))
_OBJECTS = _NOTHING.objects.dtype
_CELLS = _NOTHING.image.cells.dtype
# Without padding, whose bytes are undefined, so that equal scenes have equal bytes.
_PACKED_CELLS = np.dtype([(name, _CELLS[name]) for name in _CELLS.names or ()])


def scene_of_cloud(cloud: Cloud, config: SceneConfig) -> Scene:
    """Build the scene of a cloud. Raises DataError without colours, ShapeError for no cloud."""
    require_cloud(cloud)
    if cloud.colors is None:
        raise DataError(
            "scenes need colours and the cloud has none; descriptors such as m2dp recognise places "
            "without (views.method=m2dp, of ratslam --views m2dp)",
            code="no-colors",
        )
    return build_scene(cloud.points, cloud.colors, config=config)


def scene_to_arrays(scene: Scene) -> dict[str, NDArray[Any]]:
    """Convert a scene to exact arrays; ``Scene.to_bytes`` rounds instead.

    Returns:
        "objects" as ``Scene.objects``; "cells" as ``RangeImage.cells``, without padding;
        "directions", float32 (5): the image's azimuth_step, elevation_step and sensor.
    """
    image = scene.image
    directions = [image.azimuth_step, image.elevation_step, *image.sensor]
    return {
        "objects": scene.objects,
        "cells": image.cells.astype(_PACKED_CELLS),
        "directions": np.array(directions, np.float32),
    }


def scene_from_arrays(arrays: Mapping[str, NDArray[Any]]) -> Scene:
    """Rebuild a scene from ``scene_to_arrays``.

    Raises:
        DataError: a wrong dtype or shape, or values that no cloud gives, such as NaN.
        KeyError: an array is missing.
    """
    cells = _check_array(arrays, "cells", _PACKED_CELLS)
    directions = _check_array(arrays, "directions", np.dtype(np.float32))
    if directions.shape != (5,) or not np.isfinite(directions).all():
        raise DataError(f"directions are {directions.tolist()}, expected 5 finite numbers")
    azimuth_step, elevation_step, *sensor = directions.tolist()
    image = RangeImage(cells.astype(_CELLS), azimuth_step, elevation_step, sensor)
    return Scene(_check_array(arrays, "objects", _OBJECTS), image)


def _check_array(
    arrays: Mapping[str, NDArray[Any]], name: str, dtype: np.dtype[Any]
) -> NDArray[Any]:
    array = arrays[name]
    if array.ndim != 1 or array.dtype != dtype:
        raise DataError(f"{name} is {array.dtype} {array.shape}, expected {dtype} (n,)")
    return array
