# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of the map and its changes (Ball et al. 2013), and markers for RViz."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.ratslam.map_export import link_offsets
from fusionslam.ratslam.slam import RatSlam, Step
from fusionslam.ros.messages.library import OWN, make, ros_duration, ros_time
from fusionslam.ros.messages.markers import color, marker, point
from fusionslam.ros.messages.types import (
    MARKERS,
    PATH,
    POSE,
    TOPOLOGICAL_ACTION,
    TOPOLOGICAL_MAP,
    ground_pose,
    ground_transform,
    header,
)
from fusionslam.sensors.messages import NANOSECONDS
from fusionslam.storage.arrays import Floats

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
