# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Hills under a world, and how a robot's body sways: what makes a planned drive one in space."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats, Floats32
from fusionslam.config import Section, option
from fusionslam.geometry.se3 import exp
from fusionslam.sim.mesh import Mesh, join_meshes
from fusionslam.sim.scene import Scene

Rows = NDArray[np.intp]

_WAVES = 12
_TONES = 5
_EDGES = 40.0
"""Per wave of the hills: so fine is the ground that bends with them."""
_RAMP_S = 1.0


class HillsConfig(Section):
    """Hills on which a world stands: everything in it is moved up or down, upright."""

    height_m: float = option(0.0, "standard deviation of the ground's height", unit="m", ge=0)
    length_m: float = option(100.0, "from crest to crest, about", unit="m", ge=5)


class SwayConfig(Section):
    """How a robot's body, or a hand, moves beside its planned way: standard deviations."""

    along_m: float = option(0.0, "ahead and back", unit="m", ge=0, le=1)
    aside_m: float = option(0.0, "to the left and right", unit="m", ge=0, le=1)
    heave_m: float = option(0.0, "up and down", unit="m", ge=0, le=1)
    roll_deg: float = option(0.0, "about the axis ahead", unit="deg", ge=0, le=45)
    pitch_deg: float = option(0.0, "about the axis to the left", unit="deg", ge=0, le=45)
    yaw_deg: float = option(0.0, "about the axis up", unit="deg", ge=0, le=45)
    rate_hz: float = option(1.5, "so often, give or take a half", unit="Hz", gt=0, le=20)


class Hills:
    """Waves of random directions and lengths, smooth everywhere.

    Args:
        config: height and length.
        seed: decides everything else.
    """

    def __init__(self, config: HillsConfig, seed: int) -> None:
        rng = np.random.default_rng([seed, 6])
        self._config = config
        towards, length = rng.uniform(0, 2 * np.pi, _WAVES), rng.uniform(0.7, 1.5, _WAVES)
        numbers = 2 * np.pi / (config.length_m * length)
        self._waves = numbers * np.stack([np.cos(towards), np.sin(towards)])
        self._phases = rng.uniform(0, 2 * np.pi, _WAVES)
        self._size = config.height_m * np.sqrt(2 / _WAVES)

    @property
    def is_flat(self) -> bool:
        """Whether there are none."""
        return not self._config.height_m

    def height(self, places: Floats) -> Floats:
        """Metres above z = 0 at places (..., 2) or more columns, of which the first two count."""
        waves = np.sin(places[..., :2] @ self._waves + self._phases)
        return np.asarray(self._size * waves.sum(axis=-1))

    def slope(self, places: Floats) -> Floats:
        """(..., 2): metres up for a metre along x and y."""
        waves = np.cos(places[..., :2] @ self._waves + self._phases)
        return np.asarray(self._size * waves @ self._waves.T)

    def stand(self, poses: Floats) -> Floats:
        """Poses (M, 4, 4) on flat ground, put on the hills: higher, and upright on the slope."""
        if self.is_flat:
            return poses
        places, ahead = poses[:, :3, 3].copy(), poses[:, :3, 0].copy()
        slope = self.slope(places)
        places[:, 2] += self.height(places)
        ahead[:, 2] += np.einsum("ni,ni->n", slope, ahead[:, :2])
        ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
        up = np.c_[-slope, np.ones(len(slope))]
        up /= np.linalg.norm(up, axis=1, keepdims=True)
        found = poses.copy()
        found[:, :3, :3] = np.stack([ahead, np.cross(up, ahead), up], axis=-1)
        found[:, :3, 3] = places
        return found

    def lift(self, mesh: Mesh) -> Mesh:
        """The mesh on the hills, corner by corner."""
        if self.is_flat:
            return mesh
        corners: Floats32 = mesh.triangles.copy()
        corners[..., 2] += self.height(corners.astype(np.float64)).astype(np.float32)
        return replace(mesh, triangles=corners)

    def raise_scene(self, scene: Scene) -> Scene:
        """A scene on the hills, its triangles split until they bend with them."""
        if self.is_flat:
            return scene
        mesh, whose = self._refine(scene.mesh)
        part = scene.part[whose] if len(scene.part) else scene.part
        return replace(scene, mesh=self.lift(mesh), part=part)

    def _refine(self, mesh: Mesh) -> tuple[Mesh, Rows]:
        """Split triangles; also of each, which one it is part of."""
        whose: Rows = np.arange(len(mesh))
        longest = self._config.length_m / _EDGES
        while True:
            flat = mesh.triangles[..., :2]
            edges = np.linalg.norm(flat - np.roll(flat, -1, axis=1), axis=2)
            long = edges.max(axis=1) > longest
            if not long.any():
                return mesh, whose
            # In halves, through the middle of the longest edge: so no triangle gets slimmer.
            first = edges[long].argmax(axis=1)
            halves = [_halves(mesh.select(long), first, end) for end in (0, 1)]
            mesh = join_meshes([mesh.select(~long), *halves])
            whose = np.concatenate([whose[~long], whose[long], whose[long]])


class Sway:
    """Sums of tones of random phases, which begin gently.

    Args:
        config: sizes and rate.
        seed: decides everything else.
    """

    def __init__(self, config: SwayConfig, seed: int) -> None:
        rng = np.random.default_rng([seed, 7])
        metres = [config.along_m, config.aside_m, config.heave_m]
        degrees = [config.roll_deg, config.pitch_deg, config.yaw_deg]
        self._sizes = np.r_[metres, np.radians(degrees)] * np.sqrt(2 / _TONES)
        self._rates = 2 * np.pi * config.rate_hz * rng.uniform(0.5, 1.5, (6, _TONES))
        self._phases = rng.uniform(0, 2 * np.pi, (6, _TONES))

    @property
    def is_still(self) -> bool:
        """Whether there is none."""
        return not self._sizes.any()

    def at(self, seconds: Floats) -> Floats:
        """base_from_swayed, (M, 4, 4), at times (M,) since the drive began."""
        if self.is_still:
            return np.tile(np.eye(4), (len(seconds), 1, 1))
        tones = np.sin(seconds[:, None, None] * self._rates + self._phases).sum(axis=2)
        part = np.clip(seconds / _RAMP_S, 0, 1)
        return exp((part**2 * (3 - 2 * part))[:, None] * tones * self._sizes)


def _halves(mesh: Mesh, first: Rows, end: int) -> Mesh:
    """One half of each triangle, whose longest edge begins at corner ``first``."""
    rows = np.arange(len(mesh))
    ends = first, (first + 1) % 3

    def cut(values: Floats32) -> Floats32:
        found = values.copy()
        found[rows, ends[end]] = (values[rows, ends[0]] + values[rows, ends[1]]) / 2
        return found

    return replace(mesh, triangles=cut(mesh.triangles), uv=cut(mesh.uv))
