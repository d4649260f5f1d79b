# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Images of one camera on a drive."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fusionslam.base.arrays import Floats, Image
from fusionslam.sensors.frame import Camera


@dataclass(frozen=True, eq=False)
class ImageSeries:
    """Images of one camera in order of time.

    Attributes:
        seconds: float64 (n), increasing, on the clock of the scans.
        poses: float64 (n, 3), true x, y in metres and yaw in radians; None without ground truth.
        image: reads or renders the i-th, uint8 (H, W) or (H, W, 3); may be called by any thread.
        origin: their origin, for display.
        key: identifies their source in the cache; None for images that need not be cached.
        camera: calibration of the whole images; None if unknown.
    """

    seconds: Floats
    poses: Floats | None
    image: Callable[[int], Image]
    origin: str
    key: str | None = None
    camera: Camera | None = None

    def __len__(self) -> int:
        return len(self.seconds)

    @property
    def rate_hz(self) -> float:
        """Median rate in images per second; 0 for fewer than two."""
        return float(1 / np.median(np.diff(self.seconds))) if len(self) > 1 else 0.0
