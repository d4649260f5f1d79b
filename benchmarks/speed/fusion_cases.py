# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Colouring scans, and coloured clouds from stereo pairs."""

from collections.abc import Iterator
from typing import Any

import numpy as np

import fusionslam
from benchmarks.speed.cases import Agreement, Bound, Case, agree, times_faster
from benchmarks.speed.inputs import Inputs, Scene, StereoPair
from benchmarks.speed.peers import native, numpy_colorize
from benchmarks.speed.settings import Settings
from benchmarks.speed.timing import timer

# Of the four cameras: exposure to balance.
GAINS = (1.0, 0.8, 0.9, 0.7)


def colour_cases(inputs: Inputs, settings: Settings) -> Iterator[Case]:
    """A scan coloured from an image."""
    scene = inputs.scan
    height, width = scene.image.shape[:2]
    what = f"colouring {len(scene.points):,} points, image {width}x{height}"
    arguments = (scene.points, scene.image, scene.projection)
    yield Case(
        what,
        "NumPy",
        timer(fusionslam.colorize, *arguments),
        timer(numpy_colorize, *arguments),
        lambda: _as_numpy(scene),
        times_faster(20),
    )
    cloud = native.PclCloud(scene.points)
    yield Case(
        what,
        "a loop over PCL's and Eigen's types",
        timer(fusionslam.colorize, *arguments),
        timer(native.pcl_colorize, cloud, scene.image, scene.projection),
        lambda: _as_pcl(scene, cloud),
        Bound("median", "<=", 0.6),
    )


def all_round_cases(inputs: Inputs, settings: Settings) -> Iterator[Case]:
    """A scan coloured by four cameras, which look ahead, to the left, back and to the right."""
    scene = inputs.scan
    height, width = scene.image.shape[:2]
    images, projections = _ring(scene)
    arguments = (scene.points, images, projections)
    yield Case(
        f"colouring {len(scene.points):,} points by four cameras, images {width}x{height}",
        "colorize, once a camera",
        timer(fusionslam.colorize_all_round, *arguments),
        timer(_colorize_each, *arguments),
        lambda: _as_each(*arguments),
        Bound("median", "<=", 2.0),
    )


def _ring(scene: Scene) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """The scene's camera turned about the scan's vertical axis; every image has its own gain."""
    turn = np.diag([0.0, 0, 1, 1])
    turn[0, 1], turn[1, 0] = 1, -1
    projections = [np.ascontiguousarray(scene.projection)]
    for _ in range(3):
        projections.append(projections[-1] @ turn)
    images = [np.ascontiguousarray(np.rint(scene.image * gain).astype(np.uint8)) for gain in GAINS]
    return images, projections


def _colorize_each(
    points: np.ndarray, images: list[np.ndarray], projections: list[np.ndarray]
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    return [
        fusionslam.colorize(points, *camera) for camera in zip(images, projections, strict=True)
    ]


def _as_each(
    points: np.ndarray, images: list[np.ndarray], projections: list[np.ndarray]
) -> Agreement:
    """Each point has the colour that its camera alone gives it."""
    _, colors, indices, cameras, _ = fusionslam.colorize_all_round(
        points, images, projections, balance=False
    )
    alone = _colorize_each(points, images, projections)
    table = np.full((len(images), len(points), 3), -1)
    for number, (_, found, kept) in enumerate(alone):
        table[number, kept] = found
    missing = int((table[:, :, 0] >= 0).any(axis=0).sum()) - len(indices)
    differ = (table[cameras, indices] != colors).any(axis=1).sum()
    return agree("points lost or coloured otherwise", abs(missing) + int(differ), 0)


def _as_numpy(scene: Scene) -> Agreement:
    _, colors, kept = fusionslam.colorize(scene.points, scene.image, scene.projection)
    _, expected, indices = numpy_colorize(scene.points, scene.image, scene.projection)
    differ = len(np.setxor1d(kept, indices))
    if differ == 0:
        differ = int((colors != expected).any(axis=1).sum())
    return agree("points kept or coloured otherwise", differ, 0)


def _as_pcl(scene: Scene, cloud: Any) -> Agreement:
    points, colors, _ = fusionslam.colorize(scene.points, scene.image, scene.projection)
    xyz, rgb = native.pcl_colored_points(cloud, scene.image, scene.projection)
    if len(xyz) != len(points):
        return agree("points kept that PCL's types do not", abs(len(xyz) - len(points)), 0)
    differ = ((points != xyz) | (colors != rgb)).any(axis=1).sum()
    return agree("points kept or coloured otherwise", int(differ), 0)


def stereo_cases(inputs: Inputs, settings: Settings) -> Iterator[Case]:
    """Disparity, and the whole way from a pair to a coloured cloud."""
    pair = inputs.pair
    height, width = pair.left.shape
    yield Case(
        f"stereo disparity, {width}x{height}",
        "OpenCV StereoBM, medianBlur",
        timer(fusionslam.stereo_disparity, pair.left, pair.right),
        timer(native.opencv_disparity, pair.left, pair.right),
        lambda: _same_disparity(pair),
    )
    yield Case(
        f"stereo pair to coloured cloud, {width}x{height}",
        "OpenCV StereoBM, medianBlur, reprojectImageTo3D",
        timer(_our_cloud, pair),
        timer(_opencv_cloud, pair),
        lambda: _same_cloud(pair),
    )


def _same_disparity(pair: StereoPair) -> Agreement:
    ours = fusionslam.stereo_disparity(pair.left, pair.right)
    fixed = native.opencv_disparity(pair.left, pair.right)
    theirs = np.where(fixed >= 0, fixed / 16, 0)
    return agree("largest difference of a disparity, px", float(np.abs(ours - theirs).max()), 0)


def _our_cloud(pair: StereoPair) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    disparity = fusionslam.stereo_disparity(pair.left, pair.right)
    return fusionslam.cloud_from_disparity(disparity, pair.left, *pair.projections)


def _opencv_cloud(pair: StereoPair) -> tuple[np.ndarray, np.ndarray]:
    left, right = pair.projections
    config = fusionslam.StereoConfig()
    points, grey = native.opencv_stereo_cloud(
        pair.left,
        pair.right,
        focal=left[0, 0],
        center_x=left[0, 2],
        center_y=left[1, 2],
        baseline=(left[0, 3] - right[0, 3]) / left[0, 0],
        min_range=config.min_range,
        max_range=config.max_range,
    )
    return points, grey


def _same_cloud(pair: StereoPair) -> Agreement:
    """Single precision in OpenCV: relative to the distance."""
    points, colors, _ = _our_cloud(pair)
    theirs, grey = _opencv_cloud(pair)
    if len(points) != len(theirs) or (colors[:, 0] != grey).any():
        return agree("points or colours of other pixels", float("inf"), 0)
    error = np.abs(points - theirs).max(axis=1) / np.linalg.norm(theirs, axis=1)
    return agree("largest error of a point by its distance", float(error.max()), 1e-5)
