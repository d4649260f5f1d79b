# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""From which side a place is seen again: what a forward camera can recognise depends on it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusionslam.evaluation.loops.protocols import DEFAULTS

DIRECTIONS = ("same", "opposite", "crossing")


@dataclass(frozen=True)
class Visit:
    """How a frame meets earlier ones: "new", "same", "opposite" or "crossing", and which one."""

    kind: str
    earlier: int | None = None


def visits(
    poses: NDArray[np.float64], *, radius: float = DEFAULTS.radius, window: int = DEFAULTS.window
) -> list[Visit]:
    """For each frame, the nearest one less than ``radius`` away and more than ``window`` earlier.

    The kind is "same" if the rotation between the two poses is below 45 degrees, "opposite" if
    above 135, "crossing" in between.

    Args:
        poses: float64 (N, 4, 4), world_from_body, in any convention of axes.
        radius: metres. window: frames.
    """
    return [_visit(poses, index, radius, window) for index in range(len(poses))]


def _visit(poses: NDArray[np.float64], index: int, radius: float, window: int) -> Visit:
    earlier = poses[: max(index - window, 0)]
    if not len(earlier):
        return Visit("new")
    distance = np.linalg.norm(earlier[:, :3, 3] - poses[index, :3, 3], axis=1)
    nearest = int(distance.argmin())
    if distance[nearest] >= radius:
        return Visit("new")
    # Of a rotation by the angle a the trace is 1 + 2 cos a.
    cosine = (float(np.sum(earlier[nearest, :3, :3] * poses[index, :3, :3])) - 1) / 2
    kind = "same" if cosine > np.sqrt(0.5) else "opposite" if cosine < -np.sqrt(0.5) else "crossing"
    return Visit(kind, nearest)
