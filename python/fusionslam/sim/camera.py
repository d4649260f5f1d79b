# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A pinhole camera with optional distortion, and the images it renders.

Optical frame: x right, y down, z forward; (0, 0) is the centre of the upper left pixel.
"""

from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import model_validator

from fusionslam.base.arrays import Floats, Floats32
from fusionslam.config import Section, option
from fusionslam.errors import ConfigError
from fusionslam.geometry.rigid import rotation
from fusionslam.sensors.messages import CameraInfo
from fusionslam.sim.lidar import Caster, Vector

# Columns: the axes of the optical frame in a frame with x forward, y left, z up.
_OPTICAL = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], np.float64)
_STEPS, _CLOSE = 200, 1e-10


class LensConfig(Section):
    """Geometry and noise of a camera's images. The defaults are those of the town's car."""

    width: int = option(620, "columns", unit="px", ge=8, le=4096)
    height: int = option(188, "rows", unit="px", ge=8, le=4096)
    focal_px: float = option(359.0, "focal length", unit="px", gt=0)
    centre_px: tuple[float, float] = option((303.0, 92.0), "principal point", unit="px")
    baseline_m: float = option(0.54, "distance of the right camera", unit="m", gt=0)
    position_m: Vector = option(
        (0.27, 0.0, 1.65), "position of the (left) camera in its parent frame", unit="m"
    )
    tilt_deg: Vector = option(
        (0.3, 0.6, -0.4), "roll, pitch and yaw in the parent frame", unit="deg"
    )
    noise: float = option(1.2, "standard deviation of a pixel's value", unit="of 255", ge=0)

    def matrix(self) -> Floats:
        """K, float64 (3, 3)."""
        return _matrix(self.focal_px, self.centre_px)

    def coefficients(self) -> tuple[float, ...]:
        """Distortion coefficients; always empty."""
        return ()


class CameraMount(LensConfig):
    """A camera mounted on a robot, and how it publishes its images."""

    topic: str = option(
        "/camera/image_raw", "topic of the images; compressed ones use a subtopic", min_length=1
    )
    info_topic: str = option("/camera/camera_info", "topic of the camera model", min_length=1)
    frame_id: str = option("camera_optical", "frame of the images", min_length=1)
    parent: str = option("base_footprint", "parent frame", min_length=1)
    side: Literal["left", "right"] = option(
        "left", "side in a stereo pair; left for a single camera"
    )
    view_rad: float | None = option(
        None,
        "horizontal field of view, centred; replaces focal_px and centre_px",
        unit="rad",
        gt=0,
        lt=float(np.pi),
    )
    distortion: tuple[float, ...] = option(
        (), "k1, k2, p1, p2, k3 (plumb bob), or none", min_length=0, max_length=5
    )
    rate_hz: float = option(10.0, "images per second", unit="Hz", gt=0, le=1000)
    stored: Literal["jpeg", "png", "raw"] = option("jpeg", "encoding of the images in bags")
    gain_drift: Vector = option(
        (0.0, 0.0, 0.0), "standard deviation of slow changes of exposure in red, green and blue"
    )
    gain_period_s: float = option(20.0, "typical period of these changes", unit="s", gt=0)

    @model_validator(mode="after")
    def _model_is_complete(self) -> "CameraMount":
        if len(self.distortion) not in (0, 5):
            raise ValueError(f"distortion has {len(self.distortion)} numbers, expected 5 or none")
        if self.coefficients():
            columns, rows = np.arange(self.width), np.arange(self.height)
            # Distortion is strongest at the edge: if it has an inverse there, it has one inside.
            for edge in (
                _places(self, columns, np.array([0, self.height - 1])),
                _places(self, np.array([0, self.width - 1]), rows),
            ):
                undistort(edge, self.distortion)
        return self

    def picture_topic(self) -> str:
        """Topic of the images; image_transport publishes compressed ones on a subtopic."""
        return self.topic if self.stored == "raw" else f"{self.topic}/compressed"

    def matrix(self) -> Floats:
        """K, float64 (3, 3). With a field of view, the centre is at half width and height."""
        if self.view_rad is None:
            return super().matrix()
        focal = self.width / 2 / np.tan(self.view_rad / 2)
        return _matrix(focal, (self.width / 2, self.height / 2))

    def coefficients(self) -> tuple[float, ...]:
        """Distortion coefficients; empty if all are zero."""
        return self.distortion if any(self.distortion) else ()


def _matrix(focal: float, centre: tuple[float, float]) -> Floats:
    return np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1]], np.float64)


def parent_from_camera(config: LensConfig, *, right: bool = False) -> Floats:
    """Pose of the left or right camera in the frame it is fixed to, float64 (4, 4)."""
    pose = np.eye(4)
    pose[:3, :3] = rotation(np.deg2rad(config.tilt_deg).tolist()) @ _OPTICAL
    pose[:3, 3] = config.position_m
    if right:
        pose[:3, 3] += pose[:3, 0] * config.baseline_m
    return pose


def projection(config: LensConfig, *, right: bool = False) -> Floats:
    """P from the left camera's frame to the undistorted image, float64 (3, 4)."""
    matrix = np.hstack([config.matrix(), np.zeros((3, 1))])
    matrix[0, 3] = -matrix[0, 0] * config.baseline_m if right else 0.0
    return matrix


def distort(places: Floats, coefficients: tuple[float, ...]) -> Floats:
    """Plumb bob (Brown 1966): maps undistorted points x / z, y / z (N, 2) to distorted ones."""
    factor, shift = _distortion(places, coefficients)
    moved: Floats = places * factor + shift
    return moved


def undistort(places: Floats, coefficients: tuple[float, ...]) -> Floats:
    """The inverse of ``distort`` by fixed-point iteration, float64 (N, 2).

    Raises:
        ConfigError: it does not converge: a point corresponds to no ray, or to more than one.
    """
    found = places.copy()
    # A diverging iteration overflows before it is detected.
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        for _ in range(_STEPS):
            factor, shift = _distortion(found, coefficients)
            before, found = found, (places - shift) / factor
            if np.abs(found - before).max(initial=0) < _CLOSE:
                return found
    x, y = places[np.argmax(np.abs(np.nan_to_num(found - before, nan=np.inf)).max(axis=1))]
    raise ConfigError(f"distortion {coefficients} has no inverse at x/z = {x:.3f}, y/z = {y:.3f}")


def _distortion(places: Floats, coefficients: tuple[float, ...]) -> tuple[Floats, Floats]:
    """Radial factor (N, 1) and tangential shift (N, 2)."""
    k1, k2, p1, p2, k3 = coefficients
    x, y = places.T
    r2 = x * x + y * y
    factor = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    shift = (2 * p1 * x * y + p2 * (r2 + 2 * x * x), p1 * (r2 + 2 * y * y) + 2 * p2 * x * y)
    return factor[:, None], np.stack(shift, axis=1)


@lru_cache(maxsize=8)
def camera_rays(config: LensConfig) -> Floats32:
    """Directions through the pixel centres, z = 1, optical frame, float32 (H * W, 3).

    Raises:
        ConfigError: the distortion has no inverse at some pixel.
    """
    places = _places(config, np.arange(config.width), np.arange(config.height))
    if config.coefficients():
        places = undistort(places, config.coefficients())
    return np.column_stack([places, np.ones(len(places))]).astype(np.float32)


def _places(config: LensConfig, columns: NDArray[np.int64], rows: NDArray[np.int64]) -> Floats:
    """x / z and y / z of all pixels in these columns and rows, row by row, float64 (N, 2)."""
    matrix = config.matrix()
    x = (columns - matrix[0, 2]) / matrix[0, 0]
    y = (rows - matrix[1, 2]) / matrix[1, 1]
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def photograph(
    caster: Caster, config: LensConfig, pose: Floats, gain: ArrayLike, rng: np.random.Generator
) -> NDArray[np.uint8]:
    """Render one image, uint8 (H, W, 3) RGB, at world_from_camera ``pose``, one gain a channel."""
    rays = camera_rays(config)
    # einsum, not a matrix product: BLAS would wake all its threads for three columns.
    directions = np.einsum("ij,kj->ik", rays, pose[:3, :3].astype(np.float32))
    hits = caster.cast(pose[:3, 3].astype(np.float32), directions)
    rgb = caster.colors(hits, directions, float(1 / config.matrix()[0, 0]))
    rgb *= 255 * np.asarray(gain, np.float32)
    rgb += np.float32(config.noise) * rng.standard_normal(rgb.shape, dtype=np.float32)
    picture = np.clip(np.rint(rgb), 0, 255).astype(np.uint8)
    return picture.reshape(config.height, config.width, 3)


def gains(config: CameraMount, seconds: float, rng: np.random.Generator) -> Vector:
    """Exposure of red, green and blue at a time: each is the sum of four slow waves, around 1.

    A fresh generator with the same seed gives the same waves.
    """
    periods = config.gain_period_s * rng.uniform(0.5, 2.0, (4, 3))
    phases = rng.uniform(0, 2 * np.pi, (4, 3))
    waves = np.sin(2 * np.pi * seconds / periods + phases).sum(axis=0) / np.sqrt(2.0)
    red, green, blue = np.exp(np.asarray(config.gain_drift) * waves).tolist()
    return red, green, blue


def camera_info(config: CameraMount, stamp_ns: int) -> CameraInfo:
    """The camera model as published on ``info_topic``."""
    return CameraInfo(
        stamp_ns=stamp_ns,
        frame_id=config.frame_id,
        size=(config.width, config.height),
        camera_matrix=config.matrix(),
        distortion=np.array(config.distortion or (0.0,) * 5),
        projection=projection(config, right=config.side == "right"),
    )
