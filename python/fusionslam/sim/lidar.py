# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A spinning multi-beam LiDAR: the rays it shoots and the returns it measures.

Frame: x forward, y left, z up. A sweep has ``azimuths`` columns of ``rings`` rays each.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from fusionslam.base.arrays import Floats, Floats32, Mask
from fusionslam.config import Section, option
from fusionslam.sim.scene import Hits

Vector = tuple[float, float, float]
Field = Literal["intensity", "ring", "time", "t", "offset_time", "timestamp", "object", "moving"]


class LidarConfig(Section):
    """Rays, mounting position and errors of a LiDAR. The defaults are those of the town's car."""

    rings: int = option(64, "laser beams", ge=1, le=256)
    azimuths: int = option(800, "measurements per turn and beam", ge=1, le=8192)
    top_deg: float = option(2.0, "elevation of the highest beam", unit="deg", ge=-90, le=90)
    bottom_deg: float = option(-24.8, "elevation of the lowest beam", unit="deg", ge=-90, le=90)
    sector_rad: tuple[float, float] | None = option(
        None, "first and last azimuth, positive to the left; none: full circle to the right"
    )
    range_m: float = option(80.0, "longest range", unit="m", gt=0)
    min_range_m: float = option(
        0.0, "shortest range; nearer surfaces return nothing", unit="m", ge=0
    )
    noise_m: float = option(0.02, "standard deviation of the range", unit="m", ge=0)
    dropout: float = option(0.04, "share of measurements lost at any range and angle", ge=0, le=1)
    grazing_dropout: float = option(
        0.30, "further share lost as the beam becomes parallel to the surface", ge=0, le=1
    )
    far_dropout: float = option(0.30, "further share lost towards the longest range", ge=0, le=1)
    position_m: Vector = option((0.0, 0.0, 1.73), "position in the parent frame", unit="m")

    @model_validator(mode="after")
    def _limits_are_in_order(self) -> "LidarConfig":
        if self.bottom_deg > self.top_deg:
            raise ValueError(f"bottom_deg is {self.bottom_deg}, above top_deg {self.top_deg}")
        if self.min_range_m >= self.range_m:
            raise ValueError(f"min_range_m is {self.min_range_m}, range_m only {self.range_m}")
        if self.sector_rad and np.ptp(self.sector_rad) > 2 * np.pi:
            raise ValueError(f"sector_rad is {self.sector_rad}, more than a full circle")
        return self


class LidarMount(LidarConfig):
    """A LiDAR mounted on a robot, and how it publishes its scans."""

    topic: str = option("/points", "topic of the clouds", min_length=1)
    frame_id: str = option("lidar", "frame of the points", min_length=1)
    parent: str = option("base_footprint", "parent frame", min_length=1)
    tilt_deg: Vector = option((0.0, 0.0, 0.0), "roll, pitch, yaw in the parent frame", unit="deg")
    rate_hz: float = option(10.0, "clouds per second", unit="Hz", gt=0, le=1000)
    shapes: Literal["collision", "visual"] = option("visual", "shapes that the rays hit")
    scan_motion: bool = option(False, "measure each column at its own time and pose")
    fields: tuple[Field, ...] = option(
        ("intensity", "ring", "time"),
        "values of each point; times as Velodyne (time), Ouster (t), Livox (offset_time) and Hesai "
        "(timestamp) write them; object: number of the object hit, from 1; moving: 1 on what moves "
        "(both are ground truth)",
    )


class Caster(Protocol):
    """The interface through which sensors see the world: one ``RayCaster`` or a combination."""

    def cast(self, origin: Floats32, directions: Floats32) -> Hits:
        """First hits of rays from ``origin`` (3,) or (R, 3) along ``directions`` (R, 3)."""

    def incidence(self, hits: Hits, directions: Floats32) -> Floats32:
        """Cosine between ray and surface normal, (R,), of what ``cast`` found for these rays."""

    def brightness(self, hits: Hits) -> Floats32:
        """Grey value of the surface at each hit, (R,)."""

    def colors(self, hits: Hits, directions: Floats32, pixel: float) -> Floats32:
        """RGB that a camera sees along each ray, (R, 3), of what ``cast`` found for these rays."""


@dataclass(frozen=True, eq=False)
class Sweep:
    """The N returns of one sweep, in the order of their rays.

    Attributes:
        points: float32 (N, 3), metres, in the LiDAR's frame at the time of the shot.
        intensity: float32 (N,), 0 .. 1, from the surface's brightness and angle of incidence.
        ray: int64 (N,), index of the ray: column + azimuths * row, the highest beam is row 0.
        hits: intersections with the world, without noise.
    """

    points: Floats32
    intensity: Floats32
    ray: NDArray[np.int64]
    hits: Hits


def azimuths(config: LidarConfig) -> Floats:
    """Azimuth of each column, float64 (azimuths,), radians, positive to the left of x."""
    if config.sector_rad is None:
        return -2 * np.pi * np.arange(config.azimuths) / config.azimuths
    return np.linspace(*config.sector_rad, config.azimuths)


@lru_cache(maxsize=8)
def lidar_rays(config: LidarConfig) -> Floats32:
    """Unit directions of the rays in the LiDAR's frame, float32 (rings * azimuths, 3), by ring."""
    elevation = np.deg2rad(np.linspace(config.top_deg, config.bottom_deg, config.rings))[:, None]
    azimuth = azimuths(config)
    flat = np.cos(elevation)
    up = np.broadcast_to(np.sin(elevation), (config.rings, config.azimuths))
    rays = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), up], axis=-1)
    return rays.reshape(-1, 3).astype(np.float32)


def column_seconds(config: LidarMount) -> Floats:
    """Time of each column, float64 (azimuths,), seconds after the first, from the turn rate."""
    turned = azimuths(config)
    seconds: Floats = np.abs(turned - turned[0]) / (2 * np.pi * config.rate_hz)
    return seconds


def scan(caster: Caster, config: LidarConfig, poses: Floats, rng: np.random.Generator) -> Sweep:
    """Simulate one LiDAR sweep.

    Args:
        caster: the world.
        config: the LiDAR.
        poses: float64 (4, 4), world_from_lidar, or (azimuths, 4, 4), one for each column.
        rng: source of noise and drop-outs.
    """
    rays = lidar_rays(config)
    origins, directions = _transform_rays(config, rays, poses)
    hits = caster.cast(origins, directions)
    # Every ray draws its random numbers, hit or miss, so a change of the world does not alter the
    # noise of other points.
    chance = rng.random(len(rays), dtype=np.float32)
    noise = np.float32(config.noise_m) * rng.standard_normal(len(rays), dtype=np.float32)
    cosine = np.abs(caster.incidence(hits, directions))
    grazing = config.grazing_dropout * (1 - cosine) ** 8
    far = config.far_dropout * np.minimum(hits.distance / np.float32(config.range_m), 1) ** 3
    within = (hits.distance >= config.min_range_m) & (hits.distance < config.range_m)
    kept = np.flatnonzero(within & (chance >= config.dropout + grazing + far))
    found = hits[kept]
    intensity = caster.brightness(found) * (0.4 + 0.6 * cosine[kept])
    points = rays[kept] * (found.distance + noise[kept])[:, None]
    return Sweep(points, intensity.clip(0, 1), kept, found)


def _transform_rays(
    config: LidarConfig, rays: Floats32, poses: Floats
) -> tuple[Floats32, Floats32]:
    """Origins (3,) or (R, 3) and directions (R, 3) of the rays in the world."""
    turn, place = poses[..., :3, :3].astype(np.float32), poses[..., :3, 3].astype(np.float32)
    # einsum, not a matrix product: BLAS would wake all its threads for three columns.
    if poses.ndim == 2:
        return place, np.einsum("ij,kj->ik", rays, turn)
    columns = rays.reshape(config.rings, config.azimuths, 3)
    directions = np.einsum("rcj,ckj->rck", columns, turn).reshape(-1, 3)
    return np.tile(place, (config.rings, 1)), directions


def point_fields(
    config: LidarMount,
    sweep: Sweep,
    objects: NDArray[np.uint16],
    moving: Mask,
    stamp_ns: int,
) -> dict[str, NDArray[Any]]:
    """The values that the LiDAR publishes with each point, in the order of the configuration.

    Args:
        config: its ``fields`` selects the values.
        sweep: the returns.
        objects: uint16 (N,), number of the object behind each return.
        moving: bool (N,), whether that object moves.
        stamp_ns: of the sweep's first column.

    Returns:
        intensity float32, ring uint16 (0 is the lowest beam), time float32 (seconds after the
        first column, 0 if the sweep is taken at one instant), t and offset_time uint32
        (nanoseconds after it), timestamp float64 (seconds since 1970), object uint16,
        moving uint8; (N,) each.
    """
    row, column = np.divmod(sweep.ray, config.azimuths)
    seconds = (column_seconds(config) * config.scan_motion)[column]
    nanoseconds = np.round(seconds * 1e9).astype(np.uint32)
    values: dict[str, NDArray[Any]] = {
        "intensity": sweep.intensity,
        "ring": (config.rings - 1 - row).astype(np.uint16),
        "time": seconds.astype(np.float32),
        "t": nanoseconds,
        "offset_time": nanoseconds,
        "timestamp": stamp_ns / 1e9 + seconds,
        "object": objects,
        "moving": moving.astype(np.uint8),
    }
    return {name: values[name] for name in config.fields}
