# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Runs of descriptors over small drives."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fusionslam.evaluation import DescriptorRun


def poses_at(positions: ArrayLike) -> NDArray[np.float64]:
    """Poses (n, 4, 4) at positions (n, 3), none of them turned."""
    places = np.asarray(positions, np.float64)
    poses = np.tile(np.eye(4), (len(places), 1, 1))
    poses[:, :3, 3] = places
    return poses


def camera_laps(count: int) -> NDArray[np.float64]:
    """Poses (count, 4, 4) of two laps in the plane of x and z, as a KITTI camera moves."""
    angle = np.linspace(0, 4 * np.pi, count)
    return poses_at(np.stack([60 * np.sin(angle), 0 * angle, 40 * np.cos(angle)], axis=1))


def descriptor_run(descriptors: ArrayLike, **change: Any) -> DescriptorRun:
    """m2dp of KITTI 06, ten frames a second, without true poses; any field may be given."""
    rows = np.asarray(descriptors, np.float32)
    count = len(rows)
    fields: dict[str, Any] = {
        "source": "lidar",
        "descriptor": "m2dp",
        "dataset": "KITTI 06",
        "descriptors": rows,
        "frames": np.arange(count),
        "stamps_ns": np.arange(count) * 10**8,
        "poses": None,
        "seconds": {"load": np.full(count, 1e-3), "describe": np.linspace(0.01, 0.02, count)},
        "peak_memory_bytes": 3 * 2**20,
        "points": np.full(count, 2000),
        "config": {"bins": 8},
    }
    return DescriptorRun(**(fields | change))
