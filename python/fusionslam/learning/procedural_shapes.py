# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Procedural shapes, without a download: object classes with random proportions, z up, metres.

Each maker takes a random generator and returns a mesh; ``SHAPES`` lists the makers by name.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from trimesh import Trimesh, creation, util
from trimesh.sample import sample_surface
from trimesh.transformations import rotation_matrix

from fusionslam.errors import DataError

Rng = np.random.Generator

_SEGMENTS = 20


def sample_points(mesh: Trimesh, count: int, rng: Rng) -> NDArray[np.float32]:
    """Points spread evenly over a mesh: float32 (count, 3).

    Raises:
        DataError: the mesh has no area, or one that is not finite.
    """
    area = float(mesh.area)
    if not (np.isfinite(area) and area > 0):
        raise DataError(f"{len(mesh.faces)} triangles of area {area:g}, expected some surface")
    points: NDArray[np.float32] = np.asarray(sample_surface(mesh, count, seed=rng)[0], np.float32)
    return points


def box(size: Sequence[float], at: Sequence[float] = (0, 0, 0)) -> Trimesh:
    """A box of sizes x, y, z; ``at`` is the centre of its bottom face."""
    return _shift(creation.box(size), (at[0], at[1], at[2] + size[2] / 2))


def revolve(
    profile: Sequence[tuple[float, float]],
    at: Sequence[float] = (0, 0, 0),
    segments: int = _SEGMENTS,
) -> Trimesh:
    """The surface of revolution of a (radius, height) profile around the z axis through ``at``.

    Three or four segments make it a prism or a pyramid.
    """
    return _shift(creation.revolve(profile, sections=segments), at)


def cylinder(radius: float, height: float, at: Sequence[float] = (0, 0, 0)) -> Trimesh:
    """A closed cylinder that stands on ``at``."""
    return cone(radius, radius, height, at)


def cone(low: float, high: float, height: float, at: Sequence[float] = (0, 0, 0)) -> Trimesh:
    """A closed cone or frustum of two radii that stands on ``at``."""
    return revolve([(0, 0), (low, 0), (high, height), (0, height)], at)


def ellipsoid(radii: tuple[float, float], at: Sequence[float] = (0, 0, 0)) -> Trimesh:
    """An ellipsoid of horizontal and vertical radius around ``at``."""
    ball = creation.icosphere(subdivisions=2)
    ball.apply_scale((radii[0], radii[0], radii[1]))
    return _shift(ball, at)


def torus(radius: float, thickness: float) -> Trimesh:
    """A torus around the z axis."""
    mesh: Trimesh = creation.torus(radius, thickness, _SEGMENTS, minor_sections=10)
    return mesh


def rotate(mesh: Trimesh, axis: int, angle: float) -> Trimesh:
    """Turn a mesh about the x (0), y (1) or z (2) axis by an angle, radians."""
    mesh.apply_transform(rotation_matrix(angle, np.eye(3)[axis]))  # type: ignore[no-untyped-call]
    return mesh


def _shift(mesh: Trimesh, by: Sequence[float]) -> Trimesh:
    mesh.apply_translation(by)
    return mesh


def _join(*parts: Trimesh) -> Trimesh:
    joined: Trimesh = util.concatenate(parts)  # type: ignore[assignment]
    return joined


def _legs(size: tuple[float, float], height: float, thickness: float) -> Trimesh:
    """Four legs at the corners of a rectangle."""
    x, y = (size[0] - thickness) / 2, (size[1] - thickness) / 2
    return _join(
        *(box((thickness, thickness, height), (a * x, b * y, 0)) for a in (-1, 1) for b in (-1, 1))
    )


def _pyramid(rng: Rng) -> Trimesh:
    return revolve([(0, 0), (0.7, 0), (0, rng.uniform(0.6, 1.5))], segments=int(rng.integers(3, 5)))


def _capsule(rng: Rng) -> Trimesh:
    radius, length = 0.4, rng.uniform(0.6, 1.6)
    angle = np.linspace(0, np.pi / 2, 6)
    low = [(radius * np.sin(t), -radius * np.cos(t)) for t in angle]
    return revolve([*low, *((r, length - h) for r, h in reversed(low))])


def _pipe(rng: Rng) -> Trimesh:
    inner, height = rng.uniform(0.5, 0.85), rng.uniform(0.6, 2.0)
    return revolve([(inner, 0), (1, 0), (1, height), (inner, height), (inner, 0)])


def _chair(rng: Rng) -> Trimesh:
    width, depth = rng.uniform(0.4, 0.55, 2)
    seat, back, thick = rng.uniform(0.4, 0.5), rng.uniform(0.35, 0.6), rng.uniform(0.03, 0.06)
    return _join(
        _legs((width, depth), seat, thick),
        box((width, depth, 0.05), (0, 0, seat)),
        box((thick, width, back), ((thick - depth) / 2, 0, seat)),
    )


def _stool(rng: Rng) -> Trimesh:
    width, height = rng.uniform(0.3, 0.45), rng.uniform(0.4, 0.8)
    return _join(_legs((width, width), height, 0.04), cylinder(width * 0.7, 0.05, (0, 0, height)))


def _table(rng: Rng) -> Trimesh:
    size, height = (rng.uniform(0.9, 2.0), rng.uniform(0.7, 1.0)), rng.uniform(0.65, 0.8)
    return _join(_legs(size, height, rng.uniform(0.05, 0.09)), box((*size, 0.05), (0, 0, height)))


def _round_table(rng: Rng) -> Trimesh:
    radius, height = rng.uniform(0.4, 0.8), rng.uniform(0.6, 1.0)
    return _join(
        cylinder(radius * 0.5, 0.03),
        cylinder(0.05, height),
        cylinder(radius, 0.04, (0, 0, height)),
    )


def _shelf(rng: Rng) -> Trimesh:
    width, depth, height = rng.uniform(0.7, 1.2), rng.uniform(0.25, 0.4), rng.uniform(1.4, 2.1)
    boards = np.linspace(0, height - 0.03, int(rng.integers(4, 7)))
    return _join(
        *(box((width, depth, 0.03), (0, 0, z)) for z in boards),
        *(box((0.03, depth, height), (s * width / 2, 0, 0)) for s in (-1, 1)),
    )


def _rack(rng: Rng) -> Trimesh:
    width, depth, height = rng.uniform(2.2, 3.0), rng.uniform(0.8, 1.1), rng.uniform(2.5, 4.0)
    levels = np.linspace(0.1, height * 0.8, int(rng.integers(2, 5)))
    load = [
        box((width * 0.38, depth * 0.9, rng.uniform(0.4, 0.8)), (s * width / 4, 0, z))
        for z in levels
        for s in (-1, 1)
        if rng.random() < 0.7
    ]
    beams = [box((width, 0.08, 0.1), (0, s * depth / 2, z)) for z in levels for s in (-1, 1)]
    return _join(_legs((width, depth), height, 0.1), *beams, *load)


def _stairs(rng: Rng) -> Trimesh:
    steps, rise, run = int(rng.integers(4, 9)), rng.uniform(0.15, 0.2), rng.uniform(0.24, 0.3)
    width = rng.uniform(0.8, 1.4)
    return _join(*(box((run, width, rise * (n + 1)), (run * n, 0, 0)) for n in range(steps)))


def _bed(rng: Rng) -> Trimesh:
    width, height = rng.uniform(0.9, 1.8), rng.uniform(0.25, 0.4)
    return _join(
        _legs((2.0, width), height, 0.08),
        box((2.0, width, 0.2), (0, 0, height)),
        box((0.05, width, rng.uniform(0.7, 1.1)), (-1, 0, 0)),
        box((0.4, width * 0.7, 0.1), (-0.7, 0, height + 0.2)),
    )


def _sofa(rng: Rng) -> Trimesh:
    width, seat, back = rng.uniform(1.4, 2.4), rng.uniform(0.35, 0.45), rng.uniform(0.7, 0.95)
    return _join(
        box((0.85, width, seat)),
        box((0.2, width, back), (-0.35, 0, 0)),
        *(box((0.85, 0.2, seat + 0.2), (0, s * (width - 0.2) / 2, 0)) for s in (-1, 1)),
    )


def _floor_lamp(rng: Rng) -> Trimesh:
    height, shade = rng.uniform(1.2, 1.7), rng.uniform(0.18, 0.3)
    hood = revolve([(shade, 0), (shade * rng.uniform(0.4, 0.8), 0.3)], (0, 0, height - 0.05))
    return _join(cylinder(0.16, 0.03), cylinder(0.02, height), hood)


def _monitor(rng: Rng) -> Trimesh:
    width = rng.uniform(0.45, 0.8)
    height, foot = width * rng.uniform(0.55, 0.7), rng.uniform(0.08, 0.15)
    return _join(
        box((0.18, width * 0.45, 0.02)),
        box((0.03, 0.06, foot + 0.1)),
        box((0.04, width, height), (0.03, 0, foot)),
    )


def _bottle(rng: Rng) -> Trimesh:
    body, neck = rng.uniform(0.5, 0.7), rng.uniform(0.06, 0.09)
    return revolve(
        [
            (0, 0),
            (0.16, 0),
            (0.16, body),
            (neck, body + 0.15),
            (neck, body + 0.35),
            (0, body + 0.35),
        ]
    )


def _cup(rng: Rng) -> Trimesh:
    height, flare = rng.uniform(0.8, 1.2), rng.uniform(0.8, 1.0)
    bowl = revolve([(0, 0), (0.5 * flare, 0), (0.5, height), (0.45, height), (0.45 * flare, 0.06)])
    handle = _shift(rotate(torus(0.25, 0.05), 0, np.pi / 2), (0.55, 0, height / 2))
    return _join(bowl, handle)


def _ladder(rng: Rng) -> Trimesh:
    width, height = rng.uniform(0.35, 0.55), rng.uniform(1.8, 3.2)
    rungs = np.arange(0.2, height - 0.1, rng.uniform(0.25, 0.33))
    whole = _join(
        *(box((0.05, 0.05, height), (0, s * width / 2, 0)) for s in (-1, 1)),
        *(box((0.04, width, 0.04), (0, 0, z)) for z in rungs),
    )
    return rotate(whole, 1, rng.uniform(0, 0.3))


def _bench(rng: Rng) -> Trimesh:
    width, height = rng.uniform(1.2, 2.0), rng.uniform(0.4, 0.5)
    return _join(
        *(box((0.4, 0.08, height), (0, s * width * 0.4, 0)) for s in (-1, 1)),
        *(box((0.1, width, 0.04), (x, 0, height)) for x in (-0.15, 0, 0.15)),
        box((0.04, width, 0.12), (-0.2, 0, height + rng.uniform(0.2, 0.35))),
    )


def _door_frame(rng: Rng) -> Trimesh:
    width, height, post = rng.uniform(0.8, 1.6), rng.uniform(1.9, 2.3), rng.uniform(0.1, 0.25)
    return _join(
        *(box((0.2, post, height), (0, s * (width + post) / 2, 0)) for s in (-1, 1)),
        box((0.2, width + 2 * post, post), (0, 0, height)),
    )


def _plant(rng: Rng) -> Trimesh:
    pot = cone(0.15, 0.22, 0.35)
    places = rng.normal(0, 0.16, (int(rng.integers(5, 9)), 3))
    places[:, 2] += rng.uniform(0.7, 1.0)
    return _join(pot, cylinder(0.02, 0.7), *(ellipsoid((0.14, 0.1), place) for place in places))


def _car(rng: Rng) -> Trimesh:
    length, cabin, wheel = (
        rng.uniform(3.6, 4.8),
        rng.uniform(0.4, 0.6),
        rotate(cylinder(0.33, 0.2), 0, np.pi / 2),
    )
    places = [(x * length * 0.3, y * 0.8 + 0.1, 0.33) for x in (-1, 1) for y in (-1, 1)]
    return _join(
        box((length, 1.7, 0.6), (0, 0, 0.25)),
        box((length * cabin, 1.5, 0.55), (-0.2, 0, 0.85)),
        *(_shift(wheel.copy(), place) for place in places),
    )


def _barrel(rng: Rng) -> Trimesh:
    bulge, height = rng.uniform(1.15, 1.4), rng.uniform(0.8, 1.1)
    z = np.linspace(0, height, 7)
    side = [(0.3 * (1 + (bulge - 1) * np.sin(np.pi * h / height)), h) for h in z]
    return revolve([(0, 0), *side, (0, height)])


def _bathtub(rng: Rng) -> Trimesh:
    length, width, height = rng.uniform(1.5, 1.8), rng.uniform(0.7, 0.85), rng.uniform(0.45, 0.6)
    walls = [box((length, 0.06, height), (0, s * width / 2, 0)) for s in (-1, 1)]
    ends = [box((0.06, width, height), (s * length / 2, 0, 0)) for s in (-1, 1)]
    return _join(box((length, width, 0.08)), *walls, *ends)


def _fence(rng: Rng) -> Trimesh:
    count, pitch, height = int(rng.integers(6, 13)), rng.uniform(0.15, 0.25), rng.uniform(0.8, 1.3)
    y = (np.arange(count) - (count - 1) / 2) * pitch
    rails = [box((0.03, count * pitch, 0.06), (0, 0, height * f)) for f in (0.2, 0.8)]
    return _join(*(box((0.03, 0.08, height), (0, place, 0)) for place in y), *rails)


def _desk(rng: Rng) -> Trimesh:
    width, depth, height = rng.uniform(1.2, 1.7), rng.uniform(0.6, 0.8), rng.uniform(0.68, 0.78)
    drawers = box((depth * 0.95, width * 0.28, height), (0, width * 0.34, 0))
    side = box((depth * 0.95, 0.04, height), (0, -width * 0.47, 0))
    return _join(drawers, side, box((depth, width, 0.04), (0, 0, height)))


def _traffic_cone(rng: Rng) -> Trimesh:
    side, height = rng.uniform(0.35, 0.45), rng.uniform(0.45, 0.75)
    return _join(box((side, side, 0.03)), cone(side * 0.38, 0.03, height))


def _dumbbell(rng: Rng) -> Trimesh:
    radius, length = rng.uniform(0.2, 0.35), rng.uniform(0.6, 1.0)
    weights = [cylinder(radius, 0.25, (0, 0, z)) for z in (0, length)]
    return rotate(_join(*weights, cylinder(0.07, length)), 1, np.pi / 2)


def _pallet(rng: Rng) -> Trimesh:
    length, width, board = rng.uniform(1.0, 1.4), rng.uniform(0.7, 1.1), rng.uniform(0.07, 0.11)
    x, y = length / 2 - 0.06, width / 2 - 0.05
    blocks = [box((0.12, 0.1, 0.1), (a * x, b * y, 0)) for a in (-1, 0, 1) for b in (-1, 0, 1)]
    boards = np.linspace(-y, y, int(rng.integers(5, 8)))
    return _join(*blocks, *(box((length, board, 0.03), (0, place, 0.1)) for place in boards))


def _umbrella(rng: Rng) -> Trimesh:
    radius, height = rng.uniform(0.7, 1.3), rng.uniform(1.6, 2.2)
    top = revolve([(0, height), (radius * 0.6, height - 0.15), (radius, height - 0.45)])
    return _join(cylinder(0.03, height), cylinder(0.25, 0.06), top)


Maker = Callable[[Rng], Trimesh]

SHAPES: Mapping[str, Maker] = {
    "barrel": _barrel,
    "bathtub": _bathtub,
    "bed": _bed,
    "bench": _bench,
    "bottle": _bottle,
    "box": lambda rng: box(rng.uniform(0.4, 1.2, 3).tolist()),
    "capsule": _capsule,
    "car": _car,
    "chair": _chair,
    "cone": lambda rng: cone(rng.uniform(0.3, 0.6), 0, rng.uniform(0.6, 1.5)),
    "cup": _cup,
    "cylinder": lambda rng: cylinder(rng.uniform(0.2, 0.6), rng.uniform(0.5, 1.5)),
    "desk": _desk,
    "door_frame": _door_frame,
    "dumbbell": _dumbbell,
    "ellipsoid": lambda rng: ellipsoid((1, rng.uniform(0.75, 1.3))),
    "fence": _fence,
    "floor_lamp": _floor_lamp,
    "ladder": _ladder,
    "monitor": _monitor,
    "pallet": _pallet,
    "pipe": _pipe,
    "plant": _plant,
    "pyramid": _pyramid,
    "rack": _rack,
    "round_table": _round_table,
    "shelf": _shelf,
    "sofa": _sofa,
    "stairs": _stairs,
    "stool": _stool,
    "table": _table,
    "torus": lambda rng: torus(1, rng.uniform(0.15, 0.45)),
    "traffic_cone": _traffic_cone,
    "umbrella": _umbrella,
}
"""Makers of shapes by class name."""
