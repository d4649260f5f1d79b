# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How much better than it states odometry is, by the loops that it agrees with."""

import numpy as np

from fusionslam._core import OdometryTree
from fusionslam.geometry.se3 import exp
from fusionslam.mapping.edge import Edge
from fusionslam.mapping.guard import agreeing_scale
from rows import rows

STEP_SD = np.repeat([0.02, 0.002], 3)
LOOP_SD = np.repeat([0.05, 0.005], 3)
LAP = 1200
"""Nodes: drift is far more than what loops err by."""


def measure_scale(odometry: float, loops: float, seed: int, laps: int = 2) -> float:
    """Of laps of a circle whose errors are these factors of what is stated."""
    rng, nodes = np.random.default_rng(seed), laps * LAP
    step = exp(np.array([1.0, 0, 0, 0, 0, 2 * np.pi / LAP]))
    driven = step @ exp(odometry * STEP_SD * rng.normal(size=(nodes, 6)))
    tree = OdometryTree()
    tree.add_root(np.eye(4))
    for node in range(1, nodes):
        tree.add(node - 1, driven[node], np.diag(STEP_SD**2))
    found = []
    for number, b in enumerate(range(max(LAP, nodes - 200), nodes)):
        pose = exp(loops * LOOP_SD * rng.normal(size=6))  # the robot is where it was a lap before
        found.append(Edge(number, "loop", b - LAP, b, pose, np.diag(LOOP_SD**2), "pending"))
    return agreeing_scale(tree, found)


@rows(
    "odometry, loops, low, high",
    [
        (1.0, 1.0, 1.0, 1.0),
        (0.5, 1.0, 1.0, 1.0),  # within a factor of three stated deviations are believed
        (0.05, 1.0, 0.1, 1 / 3),
        (0.1, 0.1, 1.0, 1.0),  # both are better than stated: neither counts for more
    ],
)
def test_odometry_counts_for_more_only_where_it_is_far_better_than_loops_state(
    odometry: float, loops: float, low: float, high: float
) -> None:
    for seed in range(2):
        assert low <= measure_scale(odometry, loops, seed) <= high


def test_few_loops_tell_nothing() -> None:
    assert measure_scale(0.05, 1.0, 0, laps=1) == 1.0
