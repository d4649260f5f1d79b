# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Where there is room for a robot."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class OccupancyMap:
    """A grid over the ground, in the layout of ROS map_server.

    Attributes:
        occupied: bool (rows, columns), row 0 at the lowest y, column 0 at the lowest x.
        reachable: bool (rows, columns), free cells that belong together; False where occupied.
        resolution_m: side of a cell.
        origin: x, y of the lower left corner of cell (0, 0), metres.
    """

    occupied: NDArray[np.bool_]
    reachable: NDArray[np.bool_]
    resolution_m: float
    origin: tuple[float, float]
