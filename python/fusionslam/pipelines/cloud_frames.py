# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Where the clouds of a recording lie in the body that its poses describe."""

from typing import TYPE_CHECKING

import numpy as np

from fusionslam.base.arrays import Floats
from fusionslam.fusion import FusionConfig, frame_from_points

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset


def body_from_clouds(dataset: "Dataset", config: FusionConfig) -> Floats | None:
    """Return the transforms from the frame of each cloud to the body of the poses.

    The body is fixed to the robot; a scanner that turns on it moves in the body.

    Returns:
        float64 (N, 4, 4), one of each frame; None if ``dataset.body_from_points`` is not known.

    Raises:
        DataError: a frame does not know the pose of its cloud's frame.
    """
    if dataset.body_from_points is None:
        return None
    body_from_robot = dataset.body_from_robot if len(dataset) else np.eye(4)
    moved = []
    for frame in dataset:
        place = frame.robot_from_points
        scan = dataset.body_from_points if place is None else body_from_robot @ place
        moved.append(scan @ np.linalg.inv(frame_from_points(frame, config.frame)))
    return np.array(moved, np.float64).reshape(-1, 4, 4)
