# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Direction of revisits, which decides what a forward camera can recognise."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import read_numbers
from fusionslam.errors import ShapeError
from fusionslam.evaluation.loops.protocols import DEFAULTS

DIRECTIONS = ("same", "opposite", "crossing")


@dataclass(frozen=True)
class Visit:
    """Relation of a frame to earlier ones ("new", "same", "opposite", "crossing"), and to which."""

    kind: str
    earlier: int | None = None


@checked
def visits(
    poses: NDArray[np.float64], *, radius: float = DEFAULTS.radius, window: int = DEFAULTS.window
) -> list[Visit]:
    """Find for each frame the nearest one within ``radius`` and more than ``window`` earlier.

    The kind is "same" if the rotation between the two poses is below 45 degrees, "opposite" if
    above 135, "crossing" in between.

    Args:
        poses: float64 (N, 4, 4), world_from_body, with any axis convention.
        radius: metres (exclusive). window: frames.

    Raises:
        ShapeError: the poses are not (N, 4, 4).
    """
    poses = read_numbers("poses", poses, "(N, 4, 4)")
    if poses.ndim != 3 or poses.shape[1:] != (4, 4):
        raise ShapeError(f"poses have shape {poses.shape}, expected (N, 4, 4)")
    return [_visit(poses, index, radius, window) for index in range(len(poses))]


def _visit(poses: NDArray[np.float64], index: int, radius: float, window: int) -> Visit:
    earlier = poses[: max(index - window, 0)]
    if not len(earlier):
        return Visit("new")
    distance = np.linalg.norm(earlier[:, :3, 3] - poses[index, :3, 3], axis=1)
    nearest = int(distance.argmin())
    if distance[nearest] >= radius:
        return Visit("new")
    # A rotation by the angle a has the trace 1 + 2 cos a.
    cosine = (float(np.sum(earlier[nearest, :3, :3] * poses[index, :3, :3])) - 1) / 2
    kind = "same" if cosine > np.sqrt(0.5) else "opposite" if cosine < -np.sqrt(0.5) else "crossing"
    return Visit(kind, nearest)
