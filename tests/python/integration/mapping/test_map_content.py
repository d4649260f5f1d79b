# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Work and writing for a keyframe do not grow with the map."""

from typing import Any

import numpy as np
import pytest

from fusionslam.geometry.se3 import inverse
from fusionslam.mapping.edge import Edge
from fusionslam.mapping.map_content import MapContent
from laps import LAP, Drive, circle

pytest.importorskip("gtsam", reason="the library of pose graphs is an extra")


class Writes:
    """A file that counts what is written."""

    def __init__(self) -> None:
        self.edges = self.solutions = 0

    def store_edge(self, edge: Edge) -> None:
        self.edges += 1

    def store_solution(self, *_: Any) -> None:
        self.solutions += 1


@pytest.mark.parametrize("laps", [4, pytest.param(12, marks=pytest.mark.nightly)])
def test_a_map_is_solved_whole_only_as_it_grows(laps: int) -> None:
    drive, way, file, writes = Drive(), circle(laps * LAP), Writes(), []
    for number in range(len(way)):
        loops = {number - LAP: way[number - LAP]} if number >= LAP and number % 2 == 0 else {}
        drive.add(1, way, number, loops)
        before = file.edges
        drive.content.save(file)
        drive.content.saved()
        writes.append(file.edges - before)
    assert 10 <= file.solutions <= 40  # 220 loops
    assert np.median(writes) <= 3
    off = drive.content.poses[:, :3, 3] - (inverse(way[0]) @ way)[:, :3, 3]
    assert np.linalg.norm(off, axis=1).max() < 0.5
    assert all(edge.state == "believed" for edge in drive.content.loops)


def test_three_loops_join_sessions_at_once() -> None:
    drive, way = Drive(), circle(2 * LAP)
    for number in range(LAP):
        drive.add(1, way, number, {})
    for number in range(6):
        assert {each.parts for each in drive.content.list_sessions()} <= {(0,), (LAP,)}
        drive.add(2, way[LAP:], number, {number: way[number]} if number % 2 == 0 else {})
        joined = drive.content.list_sessions()[1].parts == (0,)
        assert joined == (number >= 4)
    assert len(drive.content.poses) == LAP + 6


def test_poses_are_those_of_the_loops_once_a_map_is_loaded() -> None:
    drive, way = Drive(), circle(2 * LAP)
    for number in range(len(way)):
        drive.add(1, way, number, {number - LAP: way[number - LAP]} if number >= LAP else {})
    content = drive.content
    stale = MapContent(content.sessions, content.keyframes, content.edges.values(), None)
    content.solve()
    np.testing.assert_array_equal(stale.poses, content.poses)
    assert all(edge.state == "believed" for edge in stale.edges.values())
    assert all(
        np.array_equal(stale.poses[k], content.pose(each.id))
        for k, each in enumerate(content.keyframes)
    )


@pytest.mark.parametrize("solved", [0, 10])
def test_poses_of_steps_are_the_same_once_a_map_is_loaded(solved: int) -> None:
    drive, way = Drive(), circle(LAP)
    content, solution = drive.content, None
    for number in range(len(way) - 1):
        drive.add(1, way, number, {})
        if number == solved - 1:
            content.solve()
            solution = content.numbers, content.poses, np.array(content.parts)
    loaded = MapContent(content.sessions, content.keyframes, content.edges.values(), solution)
    np.testing.assert_allclose(loaded.poses, content.poses, atol=1e-9)
    steps = [edge.pose for edge in content.edges.values() if edge.kind == "odometry"]
    end = np.linalg.multi_dot(steps)  # by odometry alone, whose steps are too long
    assert np.linalg.norm(loaded.poses[-1, :3, 3] - end[:3, 3]) > 0.01
