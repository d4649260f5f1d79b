# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Registers what a robot on a floor saw, by the alignment of range images.

The alignment finds x, y and yaw; z, roll and pitch are those of a floor, with stated deviations.
"""

import numpy as np

from fusionslam._core import RangeImage, align_scenes
from fusionslam.base.arrays import Floats, Matrix, Points
from fusionslam.errors import DataError
from fusionslam.geometry.trajectory import ground_poses
from fusionslam.registration.config import RegistrationConfig
from fusionslam.registration.result import Refusal, Registration
from fusionslam.registration.uncertainty import weak_directions
from fusionslam.sensors.frame import Cloud
from fusionslam.views.alignment_comparison import FEWEST_CELLS
from fusionslam.views.scenes import Scene, build_scene

_LEAST = 0.96
"""Less probable poses are refused, unless it is configured."""


def build_planar(cloud: Cloud | Points) -> Scene:
    """Build the range image of a coloured cloud, as a scene without objects.

    Raises:
        DataError: no colours (code "no-colors").
    """
    if not isinstance(cloud, Cloud) or cloud.colors is None:
        raise DataError(
            "planar registration needs clouds with colours; method=global needs none",
            code="no-colors",
        )
    scene = build_scene(cloud.points, cloud.colors)
    return Scene(scene.objects[:0], scene.image)


def register_planar(
    source: Scene, target: Scene, guess: Matrix | None, config: RegistrationConfig
) -> Registration:
    """Align two range images; of a guess its turn about z is used, in whole cells."""
    fewest = min(len(source.image), len(target.image))
    if fewest < FEWEST_CELLS:
        text = f"{fewest} cells of a range image have points, fewer than {FEWEST_CELLS}"
        return Registration(None, None, reason=Refusal("few-points", fewest, text))
    columns = (
        0
        if guess is None
        else round(
            float(np.degrees(np.arctan2(guess[1, 0], guess[0, 0]))) / source.image.azimuth_step
        )
    )
    found = align_scenes(_turned(source, columns), target)
    if not found.information.any():
        text = "the range images show no common surfaces"
        return Registration(None, None, reason=Refusal("no-match", 0, text))
    yaw = found.yaw + np.radians(columns * source.image.azimuth_step)
    (pose,) = ground_poses(*np.array([[found.x], [found.y], [yaw]]))
    covariance, degenerate = _uncertainty(found.information, pose[:2, :2], config)
    overlap = found.evidence["agreeing"]
    least = _LEAST if config.min_probability is None else config.min_probability
    accepted = found.probability >= least
    text = f"probability {found.probability:.2f}, less than {least:g}"
    return Registration(
        target_from_source=pose if accepted else None,
        covariance=covariance if accepted else None,
        overlap=overlap,
        degenerate=degenerate,
        reason=None if accepted else Refusal("improbable", found.probability, text),
        estimate=pose,
        probability=found.probability,
    )


def _turned(scene: Scene, columns: int) -> Scene:
    """Turn a range image about z; that is exact in whole columns, as the sensor is on the axis."""
    if not columns:
        return scene
    image = scene.image
    circle = round(360 / image.azimuth_step)
    cells = image.cells.copy()
    cells["column"] = (cells["column"] + columns + circle // 2) % circle - circle // 2
    cells = cells[np.lexsort((cells["column"], cells["row"]))]
    turned = RangeImage(cells, image.azimuth_step, image.elevation_step, image.sensor)
    return Scene(scene.objects, turned)


def _uncertainty(
    information: Floats, turn: Matrix, config: RegistrationConfig
) -> tuple[Floats, Floats]:
    """Covariance of six degrees of freedom, and degenerate directions, in the source's frame."""
    frame = np.eye(3)
    frame[:2, :2] = turn
    in_source = frame.T @ information @ frame
    weak = weak_directions(in_source[:2, :2], config.degenerate_ratio)
    prior = np.diag([1 / 100**2, 1 / 100**2, 1 / np.pi**2])
    plane = np.linalg.inv(in_source + prior)
    plane[:2, :2] += config.degenerate_sd**2 * weak.T @ weak
    level, angle = config.position_sd, np.radians(config.angle_sd)
    upright = np.radians(config.floor_tilt_sd)
    covariance = np.diag([level, level, config.floor_height_sd, upright, upright, angle]) ** 2
    planar = np.ix_([0, 1, 5], [0, 1, 5])
    covariance[planar] += (plane + plane.T) / 2
    return covariance, np.pad(weak, ((0, 0), (0, 1)))
