# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of maps that last."""

from typing import Any

from numpy.typing import NDArray

from fusionslam.mapping import Localization
from fusionslam.mapping.grids import OccupancyGrid
from fusionslam.ros.messages.library import make, respond
from fusionslam.ros.messages.types import (
    GRID,
    LOCALIZE,
    LOCATED_POSE,
    PATH,
    POSE,
    ground_pose,
    header,
    pose_of,
    pose_with_covariance,
)
from fusionslam.storage.arrays import Floats


def grid_message(top: Any, grid: OccupancyGrid) -> Any:
    """Return a nav_msgs/OccupancyGrid."""
    rows, columns = grid.cells.shape
    info = make(
        "nav_msgs/MapMetaData",
        map_load_time=top.stamp,
        resolution=grid.resolution,
        width=columns,
        height=rows,
        origin=ground_pose((*grid.origin, 0.0)),
    )
    return make(GRID, header=top, info=info, data=grid.cells.ravel().tolist())


def trajectory_message(top: Any, stamps_ns: NDArray[Any], poses: Floats) -> Any:
    """Return a nav_msgs/Path.

    Args:
        top: its header, whose frame all poses have.
        stamps_ns: int64 (n,).
        poses: float64 (n, 4, 4).
    """
    placed = [
        make(POSE, header=header(stamp, top.frame_id), pose=pose_of(pose))
        for stamp, pose in zip(stamps_ns.tolist(), poses, strict=True)
    ]
    return make(PATH, header=top, poses=placed)


def located_pose(top: Any, found: Localization) -> Any:
    """Return the PoseWithCovarianceStamped of a robot that was found."""
    assert found.map_from_robot is not None and found.covariance is not None
    pose = pose_with_covariance(found.map_from_robot, found.covariance)
    return make(LOCATED_POSE, header=top, pose=pose)


def localize_response(top: Any, found: Localization) -> Any:
    """Return the response of Localize."""
    is_found = found.map_from_robot is not None
    return respond(
        LOCALIZE,
        found=is_found,
        pose=located_pose(top, found) if is_found else make(LOCATED_POSE, header=top),
        keyframe=-1 if found.keyframe is None else found.keyframe,
        code="" if found.reason is None else found.reason.code,
        reason="" if found.reason is None else found.reason.text,
    )
