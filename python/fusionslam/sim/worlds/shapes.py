# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""SDF's primitive shapes as triangles, with the origin where SDF has it."""

import numpy as np
from numpy.typing import NDArray

from fusionslam.sim.worlds.surfaces import triangles_of

Triangles = NDArray[np.float64]

# A sphere of 1280 triangles is 1.2 mm off at a radius of 0.3 m, a cylinder of 64 sides no more.
_BALL_SUBDIVISIONS = 3
_COLUMN_SIDES = 64
_UNIT_SQUARE = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float)


def box(size: NDArray[np.float64]) -> Triangles:
    """A box of twelve triangles; size (3,) in metres."""
    import trimesh

    return triangles_of(trimesh.creation.box(extents=size))


def cylinder(radius: NDArray[np.float64], length: NDArray[np.float64]) -> Triangles:
    """A closed cylinder along z; radius and length (1,) in metres."""
    import trimesh

    (width,), (height,) = radius.tolist(), length.tolist()
    return triangles_of(
        trimesh.creation.cylinder(radius=width, height=height, sections=_COLUMN_SIDES)
    )


def sphere(radius: NDArray[np.float64]) -> Triangles:
    """A sphere of nearly equal triangles whose corners lie on it; radius (1,) in metres."""
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=_BALL_SUBDIVISIONS, radius=float(radius[0]))
    return triangles_of(ball)


def plane(normal: NDArray[np.float64], size: NDArray[np.float64]) -> Triangles:
    """Two triangles of a given size (2,) perpendicular to a normal (3,); SDF's planes end there."""
    upward = normal / np.linalg.norm(normal)
    helper = np.eye(3)[1 if abs(upward[1]) < 0.9 else 0]
    along = np.cross(helper, upward)
    along /= np.linalg.norm(along)
    across = np.cross(upward, along)
    steps = (_UNIT_SQUARE - 0.5) * size
    corners = steps[:, :1] * along + steps[:, 1:] * across
    halves: Triangles = corners[np.array([(0, 1, 2), (0, 2, 3)])]
    return halves
