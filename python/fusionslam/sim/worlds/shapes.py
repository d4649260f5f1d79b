# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The simple shapes of SDF as triangles, centred where SDF centres them."""

import numpy as np
from numpy.typing import NDArray

from fusionslam.sim.worlds.surfaces import triangles_of

Triangles = NDArray[np.float64]

# A ball of 1280 triangles: 1.2 mm off at a radius of 0.3 m. A column of 64 sides: as good.
_BALL_SUBDIVISIONS = 3
_COLUMN_SIDES = 64
_UNIT_SQUARE = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float)


def box(size: NDArray[np.float64]) -> Triangles:
    """Twelve triangles; size (3,) in metres."""
    import trimesh

    return triangles_of(trimesh.creation.box(extents=size))


def cylinder(radius: float, length: float) -> Triangles:
    """A closed column along z."""
    import trimesh

    return triangles_of(
        trimesh.creation.cylinder(radius=radius, height=length, sections=_COLUMN_SIDES)
    )


def sphere(radius: float) -> Triangles:
    """A ball of near-equal triangles whose corners lie on the sphere."""
    import trimesh

    return triangles_of(trimesh.creation.icosphere(subdivisions=_BALL_SUBDIVISIONS, radius=radius))


def plane(normal: NDArray[np.float64], size: NDArray[np.float64]) -> Triangles:
    """Two triangles of a given size (2,) across a normal (3,); SDF's planes end there for us."""
    upward = normal / np.linalg.norm(normal)
    helper = np.eye(3)[1 if abs(upward[1]) < 0.9 else 0]
    along = np.cross(helper, upward)
    along /= np.linalg.norm(along)
    across = np.cross(upward, along)
    steps = (_UNIT_SQUARE - 0.5) * size
    corners = steps[:, :1] * along + steps[:, 1:] * across
    halves: Triangles = corners[np.array([(0, 1, 2), (0, 2, 3)])]
    return halves
