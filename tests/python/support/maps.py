# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Small runs of RatSLAM whose maps are known."""

import gzip
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fusionslam.evaluation.maps.run import LINK, REFUSED, RatSlamRun

SECOND = 10**9


def reference_table(path: Path) -> Any:
    """A table of the reference run of OpenRatSLAM."""
    with gzip.open(path, "rt") as file:
        return np.genfromtxt(file, delimiter=",", names=True)


def matrix(values: Any, width: int) -> Any:
    return np.array(values, np.float64).reshape(-1, width)


def little_run(
    truth: Sequence[tuple[float, float, float]] | None,
    actions: Sequence[tuple[int, int, int]],
    nodes: Sequence[tuple[float, float, float]],
    links: Sequence[tuple[int, int]],
    *,
    seconds: Sequence[float] | None = None,
    refused: Sequence[tuple[float, int, int]] = (),
    **changes: Any,
) -> RatSlamRun:
    """A run that looks in every step, 30 s apart, and whose odometry is the truth.

    Node k is made by the kth action of kind 1; links have the geometry of the nodes.
    """
    count = len(actions)
    stamps = np.array([30.0 * i for i in range(count)] if seconds is None else seconds)
    stamps_ns = np.rint(stamps * SECOND).astype(np.int64)
    done = np.array(actions, np.int64).reshape(-1, 3)
    current, ids = -1, []
    for kind, _, target in actions:
        current = target if kind else current
        ids.append(current)
    known = matrix(truth if truth is not None else [(0.0, 0.0, 0.0)] * count, 3)
    values: dict[str, Any] = {
        "name": "by hand",
        "views": "given",
        "odometry": "perfect",
        "preset": "robust",
        "stamps_ns": stamps_ns,
        "is_view": np.ones(count, np.bool_),
        "view_ids": np.array(ids, np.int64),
        "poses": known.copy(),
        "dead_reckoning": known.copy(),
        "node_ids": np.array(ids, np.int64),
        "offsets": np.zeros((count, 3)),
        "actions": done,
        "cells": np.zeros((count, 3)),
        "step_seconds": np.zeros((count, 3)),
        "truth": None if truth is None else known,
        "why": ["by hand"] * count,
        "nodes": matrix(nodes, 3),
        "node_stamps_ns": stamps_ns[done[:, 0] == 1],
        "node_views": np.arange(len(nodes)),
        "links": little_links(nodes, links),
        "refused": np.array(
            [(round(t * SECOND), a, b, 1.0, 0.1, 0.5, 0.2) for t, a, b in refused], REFUSED
        ),
        "activity_th": np.zeros((count, 36), np.float32),
        "activity_x": np.zeros((count, 20), np.float32),
        "activity_y": np.zeros((count, 20), np.float32),
    }
    return RatSlamRun(**values | changes)


def little_links(
    nodes: Sequence[tuple[float, float, float]], pairs: Sequence[tuple[int, int]]
) -> Any:
    """Links that fit the nodes exactly, 2 s long, known to 1 m and 0.5 rad."""
    links = np.zeros(len(pairs), LINK)
    for link, (source, target) in zip(links, pairs, strict=True):
        one, other = nodes[source], nodes[target]
        dx, dy = other[0] - one[0], other[1] - one[1]
        link["source"], link["target"] = source, target
        link["distance"] = np.hypot(dx, dy)
        link["heading"] = np.arctan2(dy, dx) - one[2]
        link["facing"] = other[2] - one[2]
        link["duration"] = 2.0
        link["sd_m"], link["sd_rad"] = 1.0, 0.5
    return links


def square_run(**changes: Any) -> RatSlamRun:
    """Twice round a square of four nodes, 10 m a side; the second lap meets the first."""
    made = [(1, max(k - 1, 0), k) for k in range(4)]
    met = [(2, 3, 0), (2, 0, 1), (2, 1, 2), (2, 2, 3)]
    links = [(0, 1), (1, 2), (2, 3), (3, 0)]
    given: dict[str, Any] = {"truth": CORNERS * 2, "actions": made + met, "nodes": CORNERS}
    return little_run(**given | {"links": links} | changes)


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
