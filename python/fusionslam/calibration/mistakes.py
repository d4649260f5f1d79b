# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tells a calibration that was written another way: inverse extrinsics, or another image size.

Depth edges of scans lie on edges of images by the right calibration. By that of a mistake they meet
them by chance, and by its remedy they do not.
"""

import logging
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fusionslam.calibration.edges import edge_map
from fusionslam.calibration.search import CalibrationCheckConfig, Trial, edge_view, sensor_data
from fusionslam.errors import FusionSlamError
from fusionslam.geometry.se3 import inverse
from fusionslam.sensors.frame import Camera

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset

logger = logging.getLogger(__name__)

_FRAMES = 8
_FEWEST = 200
"""Depth edges in the images, of which the score of a calibration is believed."""
_MEETS, _BY_CHANCE = 0.05, 1 / 3
"""Score of a calibration by which edges meet; one that scores less than this share of it is wrong.
Right ones score 0.08 to 0.11 in streets and in houses, wrong ones -0.01 to 0.04."""
_SURE = 4.0
"""Standard errors by which the score of a remedy exceeds that of chance."""


def _scale(camera: Camera, factor: float) -> Camera:
    projection = camera.projection.copy()
    projection[:2] *= factor
    return replace(camera, projection=projection, size=None)


_REMEDIES: dict[str, Callable[[Camera], Camera]] = {
    "by the inverse of rectified_from_points: does it map points of the camera to the scan? "
    "Expected points of the scan to the camera": (
        lambda camera: replace(camera, rectified_from_points=inverse(camera.rectified_from_points))
    ),
    "by twice the focal length and centre: are they for images of half the size?": (
        lambda camera: _scale(camera, 2)
    ),
    "by half the focal length and centre: are they for images of twice the size?": (
        lambda camera: _scale(camera, 0.5)
    ),
}


def warn_of_wrong_calibration(dataset: "Dataset", source: str) -> None:
    """Warn if scans and images fit together by inverse extrinsics, or by other intrinsics, alone.

    Reads at most 8 frames. ``calib-check`` tells small errors.

    Args:
        dataset: the recording; nothing is said of one without scans, images or calibration.
        source: of the clouds; nothing is said of others than "lidar", which images colour.
    """
    if source != "lidar":
        return
    config = CalibrationCheckConfig()
    count = min(_FRAMES, len(dataset))
    seen = []
    for row in np.unique(np.linspace(0, max(len(dataset) - 1, 0), count).astype(int)).tolist():
        with suppress(FusionSlamError, ValueError):  # who uses the frame says what is wrong
            points, image, camera = sensor_data(dataset, row, dataset[row])
            seen.append((points, edge_map(image, config.reach), camera))
    present, _ = _score(seen, lambda camera: camera, config)
    if present >= _MEETS:
        return
    for words, remedy in _REMEDIES.items():
        score, errors = _score(seen, remedy, config)
        if score >= _MEETS and errors >= _SURE and present < _BY_CHANCE * score:
            logger.warning(
                "%s: its calibration does not fit: edges of its scans meet edges of its images no "
                "better than by chance (score %.3f), but with %.3f %s",
                *(dataset.name, present, score, words),
            )
            return


def _score(
    seen: list[tuple[NDArray[np.float32], NDArray[np.float32], Camera]],
    change: Callable[[Camera], Camera],
    config: CalibrationCheckConfig,
) -> tuple[float, float]:
    """Score, -1 to 1, of a changed calibration, and by how many standard errors it exceeds 0.

    ``seen`` are points of scans, edges of their images, and their cameras.
    """
    views = []
    for points, edges, present in seen:
        with suppress(FusionSlamError):  # extrinsics whose inverse is farther away than may be
            views.append(edge_view(points, edges, change(present), config))
    if sum(len(view.points) for view in views) < _FEWEST:
        return 0.0, 0.0
    parts = [view.scores(view.camera.rectified_from_points[None]) for view in views]
    trial = Trial.of(np.zeros(1), parts, views)
    return float(trial.scores[0]), trial.above_chance
