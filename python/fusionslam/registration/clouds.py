# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds as registration needs them, computed once however many others they are compared with."""

from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from fusionslam._core import (
    GroundSegmentsConfig,
    nearest_ranges,
    remove_ground_segments,
    voxel_downsample,
)
from fusionslam.errors import DataError, ShapeError
from fusionslam.registration.birds_eye import Spectra, draw, draw_turned
from fusionslam.registration.config import RegistrationConfig
from fusionslam.registration.map_extra import (
    RefinedCloud,
    count_features,
    prepare_refinement,
)
from fusionslam.registration.planar import build_planar
from fusionslam.sensors.frame import Cloud
from fusionslam.storage.arrays import Floats32, Image, Integers, Points


class PreparedCloud:
    """A cloud that is registered with several others: what they all need is computed once.

    Its voxels and the range in each direction are kept, stored and sent between processes.

    Attributes:
        points: float32 (N, 3): one point for each voxel, to 8 mm.
        search_points: float32 (M, 3): one point for each voxel of the search by features, which is
            for clouds without ``gravity``; else empty.
        colors: uint8 (N, 3), sRGB, of the points; None if the cloud has none.
        scene: range image for method planar; None for others.
        ranges: float32 (rows, columns): how far the sensor saw, as ``nearest_ranges`` returns.

    Args:
        cloud: a Cloud, or float32 (N, 3), metres, the sensor at the origin; may be empty.
        config: that of the registrations.

    Raises:
        ShapeError: neither a cloud nor an array of points.
        DataError: no colours, which method planar needs (code "no-colors").
        DataError: NaN or infinity in a point; the message names it.
    """

    def __init__(self, cloud: Cloud | Points, config: RegistrationConfig | None = None) -> None:
        self.config = config or RegistrationConfig()
        points = _check_points(cloud.points if isinstance(cloud, Cloud) else cloud)
        colors = cloud.colors if isinstance(cloud, Cloud) else None
        voxels, self.colors = _voxels(points, colors, self.config.voxel)
        self.points = _round(voxels)
        # Of all points: voxels of voxels lose a part of the poses that features find.
        searched = points[:0] if self.config.gravity else points
        self.search_points = _round(_voxels(searched, None, self.config.search_voxel)[0])
        ranges: Floats32 = nearest_ranges(points, step=self.config.view_step)
        self.ranges: Floats32 = ranges.astype(np.float16).astype(np.float32)  # as it is stored
        is_planar = self.config.method == "planar"
        self.scene = build_planar(cloud) if is_planar else None

    def __len__(self) -> int:
        return len(self.points)

    def __getstate__(self) -> dict[str, Any]:
        kept = ("config", "points", "colors", "search_points", "ranges", "scene")
        return {name: getattr(self, name) for name in kept}

    @cached_property
    def above_ground(self) -> Points:
        """float32 (M, 3): the voxels that can tell places apart; all without ``gravity``."""
        above: Points = self.points[self._above]
        return above

    @cached_property
    def colors_above(self) -> Image | None:
        """uint8 (M, 3): those of ``above_ground``."""
        return None if self.colors is None else self.colors[self._above]

    @cached_property
    def tree_above(self) -> cKDTree:
        """Finds the nearest of ``above_ground``."""
        return cKDTree(self.above_ground)

    @cached_property
    def ground_level(self) -> float:
        """Height of the ground about the sensor; 0 without ``gravity``."""
        if not self.config.gravity or not len(self):
            return 0.0
        below = np.delete(self.points, self._above, axis=0)
        return float(np.median(below[:, 2]) if len(below) else self.points[:, 2].min())

    @cached_property
    def _above(self) -> Integers:
        """Indices of ``above_ground``."""
        if not self.config.gravity or not len(self):
            return np.arange(len(self))
        ground = GroundSegmentsConfig(distance=self.config.ground_height)
        kept: Integers = remove_ground_segments(self.points, config=ground)[0]
        return kept

    @cached_property
    def image(self) -> Spectra:
        """Spectrum of its image from above."""
        return draw(self.above_ground, self.ground_level, self.config.search_cell)

    @cached_property
    def turned_images(self) -> Spectra:
        """Spectra of its images from above, turned in steps: 1.5 MB."""
        return draw_turned(self.above_ground, self.ground_level, self.config.search_cell)

    @cached_property
    def features(self) -> int:
        """Number of search points that surely have features."""
        return count_features(self.search_points, self.config.search_voxel)

    @cached_property
    def refined(self) -> RefinedCloud:
        """Points, covariances and tree for the refinement."""
        return prepare_refinement(self.points)


def _check_points(points: Any) -> Points:
    array = np.asarray(points)
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind != "f":
        raise ShapeError(
            f"points: {array.dtype} {array.shape}, expected a Cloud or float32 (N, 3)",
            code="no-cloud",
        )
    broken = np.flatnonzero(~np.isfinite(array).all(axis=1))
    if broken.size:
        raise DataError(
            f"point {broken[0]} is {array[broken[0]].tolist()}, expected finite numbers: "
            "drop such points first (drop_invalid)"
        )
    return array.astype(np.float32)


_STEPS_PER_M = 128
"""Coordinates are multiples of this part of a metre: stored in 16 bits they stay as they are."""


def _round(points: Points) -> Points:
    rounded: Points = np.rint(points * np.float32(_STEPS_PER_M)) / np.float32(_STEPS_PER_M)
    return rounded


def _voxels(points: Points, colors: Image | None, size: float) -> tuple[Points, Image | None]:
    if not len(points):
        return points, colors
    voxels, voxel_colors, _ = voxel_downsample(points, colors, size=size)
    return voxels, None if colors is None else voxel_colors
