# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The one rule of when a frame is kept, against rotations by SciPy."""

import numpy as np
from scipy.spatial.transform import Rotation

from fusionslam.geometry.keyframes import is_keyframe


def test_a_frame_is_kept_once_the_robot_moved_or_turned_so_far() -> None:
    rng = np.random.default_rng(0)
    for turned, moved in ((0, 0), (29.9, 1.99), (30.1, 0), (180, 0), (0, 2.01), (45, 3)):
        for axis, way in rng.normal(size=(10, 2, 3)):
            step = np.eye(4)
            axis *= np.radians(turned) / np.linalg.norm(axis)
            step[:3, :3] = Rotation.from_rotvec(axis).as_matrix()
            step[:3, 3] = moved * way / np.linalg.norm(way)
            assert is_keyframe(step, 2.0, 30.0) == (moved >= 2 or turned >= 30)
