# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The library of the extra ``odometry``: KISS-ICP."""

import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from fusionslam.errors import FusionSlamError
from fusionslam.storage.arrays import Floats, Matrix, Points


class KissIcp:
    """KISS-ICP (Vizzo et al., RA-L 2023): scans registered to a local map, on one thread.

    Its own deskewing is off: it takes the pose for that of the last point, whatever the stamp, and
    ends the process where all points have the same time.

    Args:
        voxel: of the local map, metres.
        max_range: farther points are not used, metres.

    Raises:
        FusionSlamError: KISS-ICP is not installed (code "missing-extra"), or has no package for
            this Python ("no-package").
    """

    def __init__(self, voxel: float, max_range: float) -> None:
        pipeline, sections = _load()
        # Its own class of the whole configuration takes values from the environment, too.
        self._odometry = pipeline.KissICP(
            SimpleNamespace(
                data=sections.DataConfig(max_range=max_range, min_range=0.0, deskew=False),
                mapping=sections.MappingConfig(voxel_size=voxel, max_points_per_voxel=20),
                registration=sections.RegistrationConfig(max_num_threads=1),
                adaptive_threshold=sections.AdaptiveThresholdConfig(),
            )
        )

    def register(self, points: Points, expected: Matrix) -> Matrix:
        """Register the next scan.

        Args:
            points: float32 (N, 3), metres.
            expected: float64 (4, 4), where it may be in the frame of the scan before.

        Returns:
            float64 (4, 4), first_from_scan.
        """
        self._odometry.last_delta = expected
        self._odometry.register_frame(points.astype(np.float64), np.zeros(0))
        pose: Matrix = self._odometry.last_pose.copy()
        return pose


def take_part(motion: Matrix, parts: Floats) -> Floats:
    """float64 (K, 4, 4): parts or multiples (K) of a motion, turn and translation on their own."""
    result = np.tile(np.eye(4), (len(parts), 1, 1))
    turn = Rotation.from_matrix(motion[:3, :3]).as_rotvec()
    result[:, :3, :3] = Rotation.from_rotvec(parts[:, None] * turn).as_matrix()
    result[:, :3, 3] = parts[:, None] * motion[:3, 3]
    return result


def _load() -> tuple[Any, Any]:
    """Its modules of the pipeline and of the sections of its configuration."""
    try:
        from kiss_icp import kiss_icp
        from kiss_icp.config import config
    except ImportError as error:
        if sys.version_info >= (3, 14):
            raise FusionSlamError(
                "odometry by LiDAR needs KISS-ICP, which has no package for Python 3.14 and later",
                code="no-package",
                fields=("kiss-icp",),
            ) from error
        raise FusionSlamError(
            f"odometry by LiDAR needs KISS-ICP, which is not installed ({error}): "
            "pip install 'fusionslam[odometry]'",
            code="missing-extra",
            fields=("odometry",),
        ) from error
    return kiss_icp, config
