# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Where a robot on the ground is at each time."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Trajectory:
    """N places of a robot's base on the ground.

    Attributes:
        seconds: float64 (N), increasing.
        x, y: float64 (N), metres in the world's frame.
        yaw: float64 (N), radians, continuous (not wrapped), x towards y.
    """

    seconds: NDArray[np.float64]
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    yaw: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.seconds)
