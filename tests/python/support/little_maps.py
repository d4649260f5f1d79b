# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Runs of RatSLAM made by hand, whose right figures are obvious."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from fusionslam.evaluation.maps.run import LINK, REFUSED, RatSlamRun

SECOND = 10**9


def rows(values: Any, width: int) -> Any:
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
    known = rows(truth if truth is not None else [(0.0, 0.0, 0.0)] * count, 3)
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
        "nodes": rows(nodes, 3),
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
    corners = [(0.0, 0.0, 0.0), (10.0, 0.0, 1.5), (10.0, 10.0, 3.0), (0.0, 10.0, -1.5)]
    made = [(1, max(k - 1, 0), k) for k in range(4)]
    met = [(2, 3, 0), (2, 0, 1), (2, 1, 2), (2, 2, 3)]
    links = [(0, 1), (1, 2), (2, 3), (3, 0)]
    given: dict[str, Any] = {"truth": corners * 2, "actions": made + met, "nodes": corners}
    return little_run(**given | {"links": links} | changes)
