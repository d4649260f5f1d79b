# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The car's sensors: a LiDAR that sees all round and a rectified colour stereo pair.

Frames: car and LiDAR are x forward, y left, z up; cameras x right, y down, z forward.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from fusionslam.config import Section, option
from fusionslam.sim.drive import Array, rotation
from fusionslam.sim.mesh import Floats
from fusionslam.sim.scene import RayCaster

Vector = tuple[float, float, float]

_CAMERA_AXES = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], np.float64)


class LidarConfig(Section):
    """A spinning LiDAR. The sweep is taken at one instant."""

    rings: int = option(64, "laser beams", ge=1, le=256)
    azimuths: int = option(800, "shots per turn and beam", ge=4, le=8192)
    top_deg: float = option(2.0, "elevation of the highest beam", unit="deg", ge=-90, le=90)
    bottom_deg: float = option(-24.8, "elevation of the lowest beam", unit="deg", ge=-90, le=90)
    range_m: float = option(80.0, "longest range", unit="m", gt=0)
    noise_m: float = option(0.02, "deviation of the range", unit="m", ge=0)
    dropout: float = option(0.04, "share of shots lost anywhere", ge=0, le=1)
    grazing_dropout: float = option(
        0.30, "further share lost as the beam becomes parallel to the surface", ge=0, le=1
    )
    far_dropout: float = option(0.30, "further share lost towards the longest range", ge=0, le=1)
    position_m: Vector = option((0.0, 0.0, 1.73), "place in the car's frame", unit="m")


class StereoConfig(Section):
    """Two rectified colour cameras, half the resolution of KITTI's."""

    width: int = option(620, "columns", unit="px", ge=8, le=4096)
    height: int = option(188, "rows", unit="px", ge=8, le=4096)
    focal_px: float = option(359.0, "focal length", unit="px", gt=0)
    centre_px: tuple[float, float] = option((303.0, 92.0), "principal point", unit="px")
    baseline_m: float = option(0.54, "distance of the right camera", unit="m", gt=0)
    position_m: Vector = option((0.27, 0.0, 1.65), "left camera in the car's frame", unit="m")
    tilt_deg: Vector = option(
        (0.3, 0.6, -0.4), "roll, pitch and yaw of the pair in the car's frame", unit="deg"
    )
    noise: float = option(1.2, "deviation of a pixel's value", unit="of 255", ge=0)
    exposure: tuple[Vector, ...] = option(
        ((1.0, 1.0, 1.0), (0.70, 0.72, 0.78), (0.88, 0.86, 0.80)),
        "gain of red, green and blue on each lap (the last one serves later laps)",
        min_length=1,
    )


class CarConfig(Section):
    """The sensors and their places on the car."""

    lidar: LidarConfig = option(LidarConfig(), "the LiDAR")
    camera: StereoConfig = option(StereoConfig(), "the stereo pair")


def car_from_lidar(config: CarConfig) -> Array:
    """Pose of the LiDAR, float64 (4, 4)."""
    pose = np.eye(4)
    pose[:3, 3] = config.lidar.position_m
    return pose


def car_from_camera(config: CarConfig, *, right: bool = False) -> Array:
    """Pose of the left or right camera, float64 (4, 4)."""
    pose = np.eye(4)
    pose[:3, :3] = rotation(np.deg2rad(config.camera.tilt_deg).tolist()) @ _CAMERA_AXES
    pose[:3, 3] = config.camera.position_m
    if right:
        pose[:3, 3] += pose[:3, 0] * config.camera.baseline_m
    return pose


def projection(config: StereoConfig, *, right: bool = False) -> Array:
    """KITTI's projection from the left camera's frame, float64 (3, 4)."""
    matrix = np.zeros((3, 4))
    matrix[0, 0] = matrix[1, 1] = config.focal_px
    matrix[:2, 2] = config.centre_px
    matrix[2, 2] = 1
    matrix[0, 3] = -config.focal_px * config.baseline_m if right else 0.0
    return matrix


@lru_cache(maxsize=4)
def lidar_rays(config: LidarConfig) -> Floats:
    """Unit directions in the LiDAR's frame, float32 (rings * azimuths, 3), ring by ring."""
    elevation = np.deg2rad(np.linspace(config.top_deg, config.bottom_deg, config.rings))[:, None]
    azimuth = -2 * np.pi * np.arange(config.azimuths) / config.azimuths
    flat = np.cos(elevation)
    up = np.broadcast_to(np.sin(elevation), (config.rings, config.azimuths))
    rays = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), up], axis=-1)
    return rays.reshape(-1, 3).astype(np.float32)


@lru_cache(maxsize=4)
def camera_rays(config: StereoConfig) -> Floats:
    """Directions through the pixels' centres, z = 1, camera frame, float32 (H * W, 3)."""
    columns = (np.arange(config.width) - config.centre_px[0]) / config.focal_px
    rows = (np.arange(config.height) - config.centre_px[1]) / config.focal_px
    x, y = np.meshgrid(columns, rows)
    return np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3).astype(np.float32)


def scan(
    caster: RayCaster, config: LidarConfig, pose: Array, rng: np.random.Generator
) -> NDArray[np.float32]:
    """One LiDAR sweep.

    Args:
        caster: the world.
        config: the LiDAR.
        pose: float64 (4, 4), world_from_lidar.
        rng: source of noise and drop-outs.

    Returns:
        float32 (N, 4): x, y, z in the LiDAR's frame (metres) and reflectance (0 .. 1).
    """
    rays = lidar_rays(config)
    directions = _turned(rays, pose)
    hits = caster.cast(pose[:3, 3].astype(np.float32), directions)
    # Every ray draws its numbers, hit or not: a change of the world moves no other point's noise.
    chance = rng.random(len(rays), dtype=np.float32)
    noise = np.float32(config.noise_m) * rng.standard_normal(len(rays), dtype=np.float32)
    cosine = np.abs(caster.incidence(hits, directions))
    kept = (hits.distance < config.range_m) & (chance >= _lost(config, hits.distance, cosine))
    points = rays[kept] * (hits.distance + noise)[kept, None]
    reflectance = caster.brightness(hits)[kept] * (0.4 + 0.6 * cosine[kept])
    return np.column_stack([points, reflectance.clip(0, 1)]).astype(np.float32)


def _turned(rays: Floats, pose: Array) -> Floats:
    # Not a matrix product: BLAS would wake all its threads for three columns.
    turned: Floats = np.einsum("ij,kj->ik", rays, pose[:3, :3].astype(np.float32))
    return turned


def _lost(config: LidarConfig, distance: Floats, cosine: Floats) -> Floats:
    """Probability that a shot returns nothing."""
    far = np.minimum(distance / np.float32(config.range_m), 1)
    grazing = config.grazing_dropout * (1 - cosine) ** 8
    lost: Floats = config.dropout + grazing + config.far_dropout * far**3
    return lost


def photograph(
    caster: RayCaster, config: StereoConfig, pose: Array, gain: Vector, rng: np.random.Generator
) -> NDArray[np.uint8]:
    """One picture, uint8 (H, W, 3) RGB, from world_from_camera ``pose`` with gains per channel."""
    rays = camera_rays(config)
    directions = _turned(rays, pose)
    hits = caster.cast(pose[:3, 3].astype(np.float32), directions)
    rgb = caster.colors(hits, directions, 1 / config.focal_px)
    rgb *= 255 * np.asarray(gain, np.float32)
    rgb += np.float32(config.noise) * rng.standard_normal(rgb.shape, dtype=np.float32)
    picture = np.clip(np.rint(rgb), 0, 255).astype(np.uint8)
    return picture.reshape(config.height, config.width, 3)
