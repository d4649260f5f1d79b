# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Objects of the core that Python threads share: nothing is lost, and readers see whole states."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from fusionslam import DescriptorIndex, _core
from scenes import many_scenes

THREADS, ROUNDS = 4, 50


def run_together(work: Callable[[int], Any]) -> list[Any]:
    with ThreadPoolExecutor(THREADS) as pool:
        return [result for each in pool.map(work, range(THREADS)) for result in each]


def test_descriptors_added_by_several_threads_are_all_found() -> None:
    index = DescriptorIndex(2)

    def add_and_query(thread: int) -> list[int]:
        numbers = []
        for number in range(ROUNDS):
            row = np.array([thread, number], np.float32)
            numbers.append(index.add(row))
            assert index.query(row)[1][0] == 0
        return numbers

    assert sorted(run_together(add_and_query)) == list(range(THREADS * ROUNDS))
    rows = {tuple(index.descriptor(i)) for i in range(len(index))}
    assert rows == {(t, n) for t in range(THREADS) for n in range(ROUNDS)}


def test_scenes_added_by_several_threads_are_all_stored() -> None:
    scenes = many_scenes(ROUNDS, 4)
    for index in (_core.SceneIndex(), _core.AlignmentIndex()):

        def add_and_read(thread: int, index: Any = index) -> list[int]:
            numbers = []
            for scene in scenes:
                numbers.append(index.add(scene))
                if isinstance(index, _core.SceneIndex):
                    assert index.similarities(scene).max() > 0.999
                else:
                    index.query(scene)
            return numbers

        assert sorted(run_together(add_and_read)) == list(range(THREADS * ROUNDS))


def test_readers_of_a_map_and_of_pose_cells_see_whole_states() -> None:
    graph = _core.ExperienceMap(_core.ExperienceMapConfig())
    sheet = _core.PoseSheet(7)
    graph.apply(1, 0, 0, 0.0, (0.0, 0.0))

    def change_or_read(thread: int) -> list[int]:
        for number in range(ROUNDS):
            if thread == 0:
                graph.on_odometry(1.0, 0.1, 1.0)
                graph.apply(1, number, number + 1, 0.0, (0.0, 0.0))
                sheet.settle(1e-6)
            state = graph.state()
            assert len(state["ends"]) == len(state["loops"]) == len(state["nodes"]) - 1
            assert np.isclose(sheet.activity.sum(), 1)
        return []

    run_together(change_or_read)
    assert len(graph) == ROUNDS + 1
