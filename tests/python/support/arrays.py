# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Arrays, calls into the core and indexes that tests share."""

from collections.abc import Callable
from typing import Any

import numpy as np

import fusionslam
from fusionslam import (
    CospairConfig,
    CvfhConfig,
    DescriptorIndex,
    GestaltConfig,
    OurCvfhConfig,
    VfhConfig,
)
from fusionslam.registration import count_overlap, nearest_ranges

RNG = np.random.default_rng(0)
POINTS = RNG.uniform([-20, -5, 0], [30, 6, 4], (400, 3)).astype(np.float32)
COLORS = RNG.integers(0, 256, (400, 3), dtype=np.uint8)
IMAGE = RNG.integers(0, 256, (48, 64, 3), dtype=np.uint8)
LEFT = RNG.integers(0, 256, (48, 128), dtype=np.uint8)
PROJECTION = np.array([[30.0, 0, 32, 0], [0, 30, 24, 0], [0, 0, 1, 1]])
RIGHT_PROJECTION = PROJECTION - [[0, 0, 0, 15], [0, 0, 0, 0], [0, 0, 0, 0]]
DESCRIPTORS = RNG.normal(size=(30, 8)).astype(np.float32)
# Regions of a cloud without a surface.
COARSE = {"leaf": 2.0, "min_points": 3, "max_curvature": 1.0, "max_angle": 0.5}
Call = Callable[[Any], Any]
POINT_CALLS: dict[str, Call] = {
    "m2dp": fusionslam.m2dp,
    "m2dp_signature": fusionslam.m2dp_signature,
    "cm2dp": lambda points: fusionslam.cm2dp(points, COLORS),
    "cm2dp_signature": lambda points: fusionslam.cm2dp_signature(points, COLORS),
    "scan_context": fusionslam.scan_context,
    "bev_spectrum": fusionslam.bev_spectrum,
    "cscan_context": lambda points: fusionslam.cscan_context(points, COLORS),
    "shot": fusionslam.shot,
    "cshot": lambda points: fusionslam.cshot(points, COLORS),
    "vfh": lambda points: fusionslam.vfh(points, config=VfhConfig(leaf=2.0)),
    "cvfh": lambda points: fusionslam.cvfh(points, config=CvfhConfig(**COARSE)),
    "our_cvfh": lambda points: fusionslam.our_cvfh(points, config=OurCvfhConfig(**COARSE)),
    "esf": fusionslam.esf,
    "gasd_color": lambda points: fusionslam.gasd_color(points, COLORS),
    "gestalt": lambda points: fusionslam.gestalt(points, config=GestaltConfig(min_points=5)),
    "gfh": fusionslam.gfh,
    "cospair": lambda points: fusionslam.cospair(points, COLORS, config=CospairConfig(leaf=2.0)),
    "cloud_resolution": fusionslam.cloud_resolution,
    "estimate_normals": lambda points: fusionslam.estimate_normals(points, radius=5.0),
    "colorize": lambda points: fusionslam.colorize(points, IMAGE, PROJECTION),
    "depth_image": lambda points: fusionslam.depth_image(points, PROJECTION, width=64, height=48),
    "above_height": lambda points: fusionslam.above_height(points, 1.0),
    "remove_ground_plane": fusionslam.remove_ground_plane,
    "voxel_downsample": lambda points: fusionslam.voxel_downsample(points, COLORS, size=2.0),
    "drop_invalid": fusionslam.drop_invalid,
    "nearest_ranges": nearest_ranges,
    "count_overlap": lambda points: np.array(
        [*count_overlap(points, POINTS, nearest_ranges(POINTS), np.eye(4)).values()]
    ),
}
COLOR_CALLS: dict[str, Call] = {
    "cm2dp": lambda colors: fusionslam.cm2dp(POINTS, colors),
    "cm2dp_signature": lambda colors: fusionslam.cm2dp_signature(POINTS, colors),
    "cshot": lambda colors: fusionslam.cshot(POINTS, colors),
    "cscan_context": lambda colors: fusionslam.cscan_context(POINTS, colors),
    "gasd_color": lambda colors: fusionslam.gasd_color(POINTS, colors),
    "cospair": lambda colors: fusionslam.cospair(POINTS, colors, config=CospairConfig(leaf=2.0)),
    "voxel_downsample": lambda colors: fusionslam.voxel_downsample(POINTS, colors, size=2.0),
}
IMAGE_CALLS: dict[str, Call] = {
    "colorize": lambda image: fusionslam.colorize(POINTS, image, PROJECTION),
    "stereo_disparity": lambda image: fusionslam.stereo_disparity(image, image),
}
MATRIX_CALLS: dict[str, Call] = {
    "colorize": lambda matrix: fusionslam.colorize(POINTS, IMAGE, matrix),
    "depth_image": lambda matrix: fusionslam.depth_image(POINTS, matrix, width=64, height=48),
    "cloud_from_disparity": lambda matrix: fusionslam.cloud_from_disparity(
        np.full((48, 64), 4, np.float32), IMAGE, matrix, RIGHT_PROJECTION
    ),
}


SECOND = 1_000_000_000


def filled(count: int = 20, dimension: int = 7) -> DescriptorIndex:
    rng = np.random.default_rng(3)
    index = DescriptorIndex(dimension, window=2, window_seconds=1.5)
    for number in range(count):
        index.add(rng.normal(size=dimension).astype(np.float32), stamp_ns=number * SECOND)
    return index
