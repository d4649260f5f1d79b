# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of RatSLAM's map (Ball et al. 2013) and of maps that last."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats, Matrix
from fusionslam.mapping import Localization
from fusionslam.mapping.grids import OccupancyGrid
from fusionslam.ratslam.map_export import link_offsets
from fusionslam.ratslam.slam import RatSlam, Step
from fusionslam.ros.messages.library import OWN, make, respond, ros_duration, ros_time
from fusionslam.ros.messages.types import (
    GRID,
    LOCALIZE,
    LOCATED_POSE,
    MARKERS,
    PATH,
    POSE,
    TOPOLOGICAL_ACTION,
    TOPOLOGICAL_MAP,
    color,
    ground_pose,
    ground_transform,
    header,
    marker,
    point,
    pose_of,
    pose_with_covariance,
)
from fusionslam.sensors.messages import NANOSECONDS

_SPHERES, _LINES = 7, 5
_NODE_M, _LINE_M = 0.12, 0.03
_NODES, _LINKS = (0.95, 0.75, 0.2), (0.35, 0.65, 0.95)


def action_message(step: Step, frame_id: str) -> Any:
    """Return the TopologicalAction of a step."""
    action = step.action
    x, y = action.relative_place
    return make(
        TOPOLOGICAL_ACTION,
        header=header(step.stamp_ns, frame_id),
        action=int(action.kind),
        src_id=action.source,
        dest_id=action.target,
        relative_rad=action.relative_rotation,
        relative_x=x,
        relative_y=y,
    )


def map_message(top: Any, slam: RatSlam) -> Any:
    """Return the current TopologicalMap."""
    graph, memory = slam.map, slam.memory
    rows = zip(graph.nodes.tolist(), memory.node_stamps_ns, memory.node_views, strict=True)
    nodes = [
        make(
            f"{OWN}/TopologicalNode",
            id=number,
            pose=ground_pose((x, y, heading)),
            stamp=ros_time(stamp_ns),
            view_id=view,
        )
        for number, ((x, y, heading), stamp_ns, view) in enumerate(rows)
    ]
    edges = _edges(graph.links)
    return make(
        TOPOLOGICAL_MAP,
        header=top,
        node_count=len(nodes),
        node=nodes,
        edge_count=len(edges),
        edge=edges,
    )


def _edges(links: NDArray[np.void]) -> list[Any]:
    ways = link_offsets(links).tolist()
    return [
        make(
            f"{OWN}/TopologicalEdge",
            id=number,
            source_id=int(link["source"]),
            destination_id=int(link["target"]),
            duration=ros_duration(round(float(link["duration"]) * NANOSECONDS)),
            transform=ground_transform((x, y, facing)),
        )
        for number, (link, (x, y, facing)) in enumerate(zip(links, ways, strict=True))
    ]


def map_markers(top: Any, slam: RatSlam) -> Any:
    """Return markers with nodes as dots and links as lines."""
    nodes, links = slam.map.nodes, slam.map.links
    ends = np.stack([links["source"], links["target"]], axis=1).ravel()
    dots = marker(top, "nodes", 0, _SPHERES, [_NODE_M] * 3, color(_NODES))
    dots.points = [point(x, y) for x, y, _ in nodes.tolist()]
    lines = marker(top, "links", 0, _LINES, [_LINE_M, 0.0, 0.0], color(_LINKS))
    lines.points = [point(x, y) for x, y, _ in nodes[ends].tolist()]
    return make(MARKERS, markers=[dots, lines])


def path_message(top: Any, nodes: Floats, visits: Sequence[int]) -> Any:
    """Return the path over the nodes that the robot visited, at their current positions."""
    poses = [
        make(POSE, header=top, pose=ground_pose((x, y, heading)))
        for x, y, heading in nodes[list(visits)].tolist()
    ]
    return make(PATH, header=top, poses=poses)


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


def located_pose(top: Any, pose: Matrix, covariance: Matrix) -> Any:
    """Return the PoseWithCovarianceStamped of a robot; arguments as of ``pose_with_covariance``."""
    return make(LOCATED_POSE, header=top, pose=pose_with_covariance(pose, covariance))


def localize_response(top: Any, found: Localization) -> Any:
    """Return the response of Localize."""
    pose = make(LOCATED_POSE, header=top)
    if found.map_from_robot is not None and found.covariance is not None:
        pose = located_pose(top, found.map_from_robot, found.covariance)
    return respond(
        LOCALIZE,
        found=found.map_from_robot is not None,
        pose=pose,
        keyframe=-1 if found.keyframe is None else found.keyframe,
        code="" if found.reason is None else found.reason.code,
        reason="" if found.reason is None else found.reason.text,
    )
