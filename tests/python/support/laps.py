# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of laps on a circle, without clouds; the true poses are known."""

import numpy as np

from fusionslam.base.arrays import Floats
from fusionslam.geometry.se3 import exp, inverse
from fusionslam.mapping.edge import Edge, Kind
from fusionslam.mapping.map_content import MapContent
from fusionslam.mapping.map_file import StoredKeyframe
from streets import at

FIRM = np.diag([0.02] * 3 + [0.002] * 3) ** 2
ROUGH = np.diag([0.1] * 3 + [0.01] * 3) ** 2
LAP = 40


def circle(keyframes: int) -> Floats:
    angles = np.arange(keyframes) * 2 * np.pi / LAP
    return np.array([at(20 * np.cos(a), 20 * np.sin(a), np.degrees(a) + 90) for a in angles])


class Drive:
    """Laps on a circle: odometry that is 1 % too long, firm steps, and a loop to the lap before."""

    def __init__(self, seed: int = 0) -> None:
        self.content, self._random = MapContent({}, [], [], None), np.random.default_rng(seed)

    def add(self, session: int, way: Floats, number: int, loops: dict[int, Floats]) -> None:
        """Add the next pose of a way, with loops to keyframes by their true poses."""
        content, name = self.content, f"drive {session}"
        content.sessions.setdefault(name, session)
        keyframe = StoredKeyframe(len(content), session, number, 0, way[number], np.eye(4))
        edges: list[Edge] = []
        if number:
            step = inverse(way[number - 1]) @ way[number]
            long = step.copy()
            long[:3, 3] *= 1.01
            ends = keyframe.id - 1, keyframe.id
            edges = [
                Edge(content.next_edge, "odometry", *ends, long, ROUGH, "believed"),
                Edge(content.next_edge + 1, "loop", *ends, step, FIRM, "pending"),
            ]
        for match, pose in loops.items():
            measured = inverse(pose) @ way[number] @ exp(self._random.normal(0, 0.01, 6))
            kind: Kind = "loop" if content.keyframes[match].session == session else "merge"
            number_of = content.next_edge + len(edges)
            ends = match, keyframe.id
            edges.append(Edge(number_of, kind, *ends, measured, ROUGH, "pending"))
        content.add(keyframe, edges)
