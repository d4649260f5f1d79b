# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Trees, lamps, signs, fences and cars. Each stands on the origin and faces -y."""

from dataclasses import replace

import numpy as np

from fusionslam.base.arrays import Floats
from fusionslam.sim.mesh import (
    Mesh,
    Rgb,
    box,
    join_meshes,
    paint,
    tapered_box,
    triangles,
    tube,
)
from fusionslam.sim.town.textures import Look

CAR_TINTS: tuple[Rgb, ...] = (
    (0.85, 0.86, 0.87),
    (0.10, 0.10, 0.12),
    (0.42, 0.44, 0.47),
    (0.66, 0.10, 0.10),
    (0.12, 0.22, 0.50),
    (0.90, 0.90, 0.86),
    (0.14, 0.34, 0.24),
    (0.86, 0.66, 0.16),
)
_METAL: Rgb = (0.45, 0.46, 0.48)
_RUBBER: Rgb = (0.09, 0.09, 0.09)


def tree(rng: np.random.Generator) -> Mesh:
    """A trunk with a few limbs under a crown of leaf clumps, 5 to 10 m high."""
    height, spread = rng.uniform(5.0, 10.0), rng.uniform(1.4, 2.8)
    crown = np.array((0, 0, height * 0.64))
    radii = np.array((spread, spread * rng.uniform(0.8, 1.2), height * 0.36))
    bark = paint(Look.BARK)
    thick = 0.02 * height + 0.06
    limbs = crown + radii * rng.uniform(-0.6, 0.6, (3, 3))
    fork = (0, 0, height * 0.38)
    wood = [tube((0, 0, 0), fork, (thick, thick * 0.7), bark)]
    wood += [tube(fork, end, (thick * 0.5, 0.03), bark, sides=4) for end in limbs]
    return join_meshes([*wood, _crown(rng, crown, radii, _green(rng))])


def conifer(rng: np.random.Generator) -> Mesh:
    """A slender tree of stacked clumps, 5 to 9 m high."""
    height = rng.uniform(5.0, 9.0)
    trunk = tube((0, 0, 0), (0, 0, height * 0.9), (0.16, 0.04), paint(Look.BARK), sides=5)
    shade = rng.uniform(0.8, 1.1)
    tint = (0.30 * shade, 0.45 * shade, 0.30 * shade)
    layers = [
        _crown(rng, np.array((0, 0, height * z)), np.array((1.7, 1.7, 0.8)) * (1.12 - z), tint, 90)
        for z in (0.25, 0.42, 0.58, 0.74, 0.90)
    ]
    return join_meshes([trunk, *layers])


def bush(rng: np.random.Generator) -> Mesh:
    """A round bush about 1.2 m high."""
    radii = rng.uniform((0.5, 0.5, 0.5), (1.0, 1.0, 0.8))
    return _crown(rng, np.array((0, 0, radii[2] * 0.8)), radii, _green(rng), 110)


# Depth and cover of what encloses gardens.
_BORDERS = {
    "hedge": (0.6, paint(Look.LEAVES, (0.36, 0.50, 0.24))),
    "fence": (0.08, paint(Look.WOOD)),
    "wall": (0.25, paint(Look.PLASTER, (0.70, 0.66, 0.60))),
}


def border(kind: str, length: float, height: float) -> Mesh:
    """A clipped hedge, a fence of boards or a wall along x."""
    depth, cover = _BORDERS[kind]
    return box((0, 0, 0), (length, depth, height), cover)


def lamp(rng: np.random.Generator) -> Mesh:
    """A street lamp whose arm reaches over the street (-y)."""
    metal, height = paint(Look.PLAIN, _METAL), rng.uniform(5.0, 6.5)
    pole = tube((0, 0, 0), (0, 0, height), (0.10, 0.06), metal)
    arm = tube((0, 0, height), (0, -1.6, height + 0.2), (0.05, 0.04), metal, sides=4)
    head = box((-0.15, -2.0, height + 0.1), (0.15, -1.4, height + 0.25), paint(Look.PLAIN))
    return join_meshes([pole, arm, head])


def sign(rng: np.random.Generator) -> Mesh:
    """A traffic sign that faces along the street."""
    tints: tuple[Rgb, ...] = ((0.8, 0.1, 0.1), (0.1, 0.2, 0.7), (0.95, 0.75, 0.1))
    pole = tube((0, 0, 0), (0, 0, 2.8), (0.035, 0.035), paint(Look.PLAIN, _METAL), sides=5)
    face = paint(Look.SIGN, tints[rng.integers(3)])
    plate = box((-0.03, -0.35, 2.1), (0.03, 0.35, 2.8), face)
    return join_meshes([pole, plate])


def litter_bin(rng: np.random.Generator) -> Mesh:
    """A waste bin or a distribution box."""
    tint: Rgb = ((0.25, 0.35, 0.25), (0.55, 0.55, 0.5), (0.6, 0.35, 0.1))[rng.integers(3)]
    size = rng.uniform((0.4, 0.35, 0.8), (1.1, 0.5, 1.3))
    return box((-size[0] / 2, 0, 0), (size[0] / 2, size[1], size[2]), paint(Look.PLAIN, tint))


def bench() -> Mesh:
    """A bench that faces -y."""
    seat = box((-0.9, 0, 0.35), (0.9, 0.5, 0.45), paint(Look.WOOD, (0.8, 0.6, 0.4)))
    back = box((-0.9, 0.45, 0.45), (0.9, 0.52, 0.95), paint(Look.WOOD, (0.8, 0.6, 0.4)))
    return join_meshes([seat, back])


def car(rng: np.random.Generator) -> Mesh:
    """A parked car along x: a hatchback, saloon, estate or van in one of eight colours."""
    shapes = (
        (3.9, 1.45, -1.7, 0.9),
        (4.5, 1.42, -1.4, 0.8),
        (4.7, 1.5, -2.2, 0.8),
        (5.0, 2.1, -2.4, 1.6),
    )
    length, height, back, front = shapes[rng.choice(4, p=(0.4, 0.25, 0.2, 0.15))]
    body = paint(Look.CARPAINT, CAR_TINTS[rng.integers(len(CAR_TINTS))])
    half, shoulder = length / 2, 0.58 * height
    hull = tapered_box((-half, -0.87, 0.22), (half, 0.87, shoulder), (0.97, 0.94), body)
    cabin = tapered_box(
        (back, -0.80, shoulder), (front, 0.80, height - 0.08), (0.82, 0.84), paint(Look.GLASS)
    )
    top = box((0.85 * back, -0.64, height - 0.12), (0.8 * front, 0.64, height), body)
    wheels = [_wheel(x, y) for x in (-0.31 * length, 0.31 * length) for y in (-0.88, 0.88)]
    lights = [
        _lights(half, rgb, end) for end, rgb in ((1, (0.95, 0.95, 0.9)), (-1, (0.7, 0.1, 0.1)))
    ]
    shadow = box((-half, -0.95, 0), (half, 0.95, 0.02), paint(Look.GRAVEL, (0.35, 0.35, 0.36)))
    return join_meshes([shadow, hull, cabin, top, *wheels, *lights])


def _wheel(x: float, y: float) -> Mesh:
    rubber = paint(Look.PLAIN, _RUBBER)
    rim = paint(Look.PLAIN, (0.5, 0.5, 0.52))
    side = float(np.sign(y))
    tread = tube((x, y - 0.1, 0.32), (x, y + 0.1, 0.32), (0.32, 0.32), rubber, sides=10)
    cap = tube(
        (x, y + side * 0.1, 0.32), (x, y + side * 0.11, 0.32), (0.32, 0.001), rubber, sides=10
    )
    hub = tube((x, y + side * 0.11, 0.32), (x, y + side * 0.12, 0.32), (0.18, 0.001), rim, sides=8)
    return join_meshes([tread, cap, hub])


def _lights(half: float, rgb: Rgb, end: int) -> Mesh:
    low, high = sorted((end * (half - 0.25), end * (half + 0.01)))
    lamps = [
        box((low, y - 0.16, 0.6), (high, y + 0.16, 0.76), paint(Look.PLAIN, rgb))
        for y in (-0.62, 0.62)
    ]
    return join_meshes(lamps)


def _green(rng: np.random.Generator) -> Rgb:
    tints: tuple[Rgb, ...] = (
        (0.36, 0.52, 0.22),
        (0.48, 0.58, 0.24),
        (0.28, 0.44, 0.22),
        (0.56, 0.50, 0.22),
    )
    chosen = np.array(tints[rng.integers(len(tints))]) * rng.uniform(0.85, 1.15)
    return (float(chosen[0]), float(chosen[1]), float(chosen[2]))


def _crown(
    rng: np.random.Generator, centre: Floats, radii: Floats, tint: Rgb, clumps: int = 320
) -> Mesh:
    """Leaf clumps: triangles of random orientation in an ellipsoid, denser near its surface.

    Their normals lean outwards, so that shading follows the crown and not each clump.
    """
    outward = rng.standard_normal((clumps, 3))
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    middle = centre + outward * radii * rng.uniform(0.45, 1.0, (clumps, 1))
    size = rng.uniform(0.10, 0.16) * float(radii.mean()) + 0.12
    corners = middle[:, None] + size * rng.standard_normal((clumps, 3, 3))
    uv = rng.uniform(0, 1, (clumps, 1, 2)) + np.array([(0, 0), (0.4, 0), (0.2, 0.35)])
    mesh = triangles(corners, uv, paint(Look.LEAVES, tint))
    lean = outward + 0.35 * rng.standard_normal((clumps, 3))
    normals = (lean / np.linalg.norm(lean, axis=1, keepdims=True)).astype(np.float32)
    shade = rng.uniform(0.75, 1.1, (clumps, 1)).astype(np.float32)
    return replace(mesh, normals=normals[: len(mesh)], tint=mesh.tint * shade[: len(mesh)])
