# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Runs of RatSLAM that reports are written about: with all there is to say, and with little."""

from typing import Any

import numpy as np

from fusionslam.evaluation.maps.run import RatSlamRun
from little_maps import little_run, square_run

CORNERS = [(0.0, 0.0, 0.0), (10.0, 0.0, 1.5), (10.0, 10.0, 3.0), (0.0, 10.0, -1.5)]
HALL = [(float(x), 0.0, 0.0) for x in range(4)]


def drifting_run(**changes: Any) -> RatSlamRun:
    """The square with dead reckoning that grows, step times, activity, and two refused loops."""
    reckoned = np.array(CORNERS * 2) * np.linspace(1, 1.5, 8)[:, None]
    lit = {name: np.full((8, n), 1 / n, np.float32) for name, n in (("th", 36), ("x", 20))}
    given: dict[str, Any] = {
        "dead_reckoning": reckoned,
        "step_seconds": np.full((8, 3), 2e-3),
        "activity_th": lit["th"],
        "activity_x": lit["x"],
        "activity_y": lit["x"],
        "refused": [(120.0, 3, 1), (150.0, 0, 2)],
        "why": [f"view {k % 4}" for k in range(7)] + ["no loop: 1.00 m off; node 3"],
        "notes": ["odometry stopped for 3.0 s"],
        "config": {"preset": "robust"},
    }
    return square_run(**given | changes)


def wrong_run(**changes: Any) -> RatSlamRun:
    """Takes the third corner for the first one."""
    actions = [(1, 0, 0), (1, 0, 1), (1, 1, 2), (2, 2, 0), (1, 0, 3)]
    given: dict[str, Any] = {"truth": [*CORNERS[:3], CORNERS[2], CORNERS[3]], "nodes": CORNERS}
    links = [(0, 1), (1, 2), (2, 0), (0, 3)]
    return little_run(**given | {"actions": actions, "links": links, "views": "eyes"} | changes)


def alone(**changes: Any) -> RatSlamRun:
    """Four nodes in a row, none seen again."""
    actions = [(1, max(k - 1, 0), k) for k in range(4)]
    given: dict[str, Any] = {"truth": HALL, "nodes": HALL, "links": [(0, 1), (1, 2), (2, 3)]}
    return little_run(**given | {"actions": actions} | changes)


def nodeless(**changes: Any) -> RatSlamRun:
    """Looked at nothing that made a node."""
    activity = {f"activity_{axis}": np.zeros((0, 20), np.float32) for axis in ("th", "x", "y")}
    given: dict[str, Any] = {"nodes": [], "actions": [(0, 0, 0)] * 4, "links": [], "why": []}
    return alone(**given | {"is_view": np.zeros(4, bool)} | activity | changes)
