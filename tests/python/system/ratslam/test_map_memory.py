# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How much memory a large experience map takes, in a process of its own."""

import subprocess
import sys

import pytest


@pytest.mark.nightly
def test_a_hundred_thousand_nodes_take_no_more_than_200_megabytes() -> None:
    program = """
import resource
from fusionslam.ratslam import Action, ActionKind, ExperienceMap
def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
graph = ExperienceMap()
graph.apply(Action(ActionKind.CREATE_NODE))
before = peak()
for number in range(1, 100_000):
    graph.on_odometry(0.5, 0.01, 1.0)
    graph.apply(Action(ActionKind.CREATE_NODE, number - 1, number))
for target in range(0, 20_000, 50):
    graph.on_odometry(0.5, 0.01, 1.0)
    graph.apply(Action(ActionKind.CREATE_EDGE, graph.current, target))
held = peak() - before
graph.relax(whole=True)
print(len(graph), held, peak() - before)
"""
    out = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True)
    count, held, relaxed = out.stdout.split()
    assert int(count) == 100_000
    assert float(held) < 60
    assert float(relaxed) < 200
