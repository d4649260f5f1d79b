# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Every frame of a session has a pose, keyframe or not, and knows how sure it is."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from artefacts import artefact, copy_artefact
from fusionslam.geometry.se3 import exp, inverse, log
from fusionslam.mapping import map_writer
from fusionslam.mapping.config import MapConfig, odometry_covariance
from fusionslam.mapping.edge import Edge
from fusionslam.mapping.frame_poses import FramePoses, frame_poses
from fusionslam.mapping.map_content import MapContent
from fusionslam.mapping.map_file import StoredKeyframe
from fusionslam.mapping.marginals import keyframe_covariances
from fusionslam.mapping.place_map import PlaceMap
from fusionslam.pipelines.place_maps import name_tracks
from fusionslam.sensors.frame import Frame
from map_fixtures import FRAMES
from streets import OPTIONS, WAY, changed, error

pytest.importorskip("gtsam", reason="the library of pose graphs is an extra")

Floats = NDArray[np.float64]

BETWEEN = 3
"""Frames between two of the street: odometry and truth lead evenly from one to the next."""
SPARSE = OPTIONS | {"config": MapConfig(keyframe_distance=5.5)}


def refined(poses: list[Floats]) -> Floats:
    """Poses of all frames, float64 (n, 4, 4), from those of every fourth one."""
    given = np.array(poses)
    steps = log(inverse(given[:-1]) @ given[1:])
    parts = np.arange(BETWEEN + 1)[:, None] / (BETWEEN + 1)
    ways = [pose @ exp(parts * step) for pose, step in zip(given, steps, strict=False)]
    return np.concatenate([*ways, given[-1:]])


TRUTH = refined(WAY)


def drive() -> list[Frame]:
    """The street at four times the rate; what is seen between keyframes does not matter."""
    odometry = refined([each.odometry for each in FRAMES if each.odometry is not None])
    return [
        changed(FRAMES[k // 4], index=k, stamp_ns=(4 + k) * 10**9 // 4, odometry=pose)
        for k, pose in enumerate(odometry)
    ]


def build_sparse(folder: Path) -> None:
    with PlaceMap.open(folder / "site.fsmap", "monday", **SPARSE) as site:
        for frame in drive():
            site.add(frame)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    made = artefact("sparse-street-map", build_sparse) / "site.fsmap"
    return copy_artefact(made, tmp_path / "site.fsmap")


def poses_of(path: Path, session: str = "monday") -> FramePoses:
    with PlaceMap.open(path, read_only=True) as site:
        assert site.check() == []
        return frame_poses(site, session)


def test_frames_between_keyframes_follow_the_loops_too(path: Path) -> None:
    with PlaceMap.open(path, read_only=True) as site:
        found, rows = frame_poses(site, "monday"), site.frames("monday")
        stamps, keyframes = site.trajectory("monday")
    assert len(rows) < len(TRUTH) / 2 and found.numbers.tolist() == [*range(len(TRUTH))]
    np.testing.assert_allclose(found.poses[rows], keyframes, atol=1e-9)
    assert found.stamps_ns[rows].tolist() == stamps.tolist()
    assert found.keyframes.tolist() == (np.searchsorted(rows, found.numbers, "right") - 1).tolist()
    odometry = np.array([frame.odometry for frame in drive()])
    assert error(found.poses, [*TRUTH]) < 0.25 < 1.0 < error(odometry, [*TRUTH])
    # What keyframes differ from odometry is shared out: no frame jumps.
    off = log(inverse(odometry[:-1]) @ odometry[1:]) - log(
        inverse(found.poses[:-1]) @ found.poses[1:]
    )
    assert np.abs(off).max() < 0.1


def test_a_frame_in_the_middle_is_between_where_odometry_leads_from_both_sides(path: Path) -> None:
    found = poses_of(path)
    odometry = np.array([frame.odometry for frame in drive()])
    before, middle, after = 4, 6, 8
    sides = [found.poses[k] @ inverse(odometry[k]) @ odometry[middle] for k in (before, after)]
    halves = [log(inverse(side) @ found.poses[middle]) for side in sides]
    assert np.linalg.norm(halves[0]) > 1e-3
    np.testing.assert_allclose(halves[0], -halves[1], atol=1e-3 * np.linalg.norm(halves[0]))


@pytest.mark.slow
def test_a_drive_that_is_gone_on_with_has_each_frame_once(tmp_path: Path) -> None:
    path, driven = tmp_path / "a.fsmap", drive()[:18]
    while driven:
        with PlaceMap.open(path, "monday", **SPARSE) as site:
            for frame in driven[:7]:
                site.add(frame)
        with PlaceMap.open(path, "monday") as site:
            assert site.last_frame is not None
            driven = [frame for frame in driven if frame.number > site.last_frame]
    assert poses_of(path).numbers.tolist() == [*range(18)]


def test_a_robot_that_stands_long_is_written_meanwhile(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(map_writer, "_MOST_WAITING", 5)
    path = tmp_path / "a.fsmap"
    with PlaceMap.open(path, "monday", **SPARSE) as site:
        for k in range(13):
            site.add(changed(FRAMES[0], index=k, stamp_ns=(k + 1) * 10**9))
            assert len(poses_of(path).numbers) == 1 + k // 5 * 5
    found = poses_of(path)
    assert found.numbers.tolist() == [*range(13)]
    np.testing.assert_allclose(found.poses, np.tile(np.eye(4), (13, 1, 1)), atol=1e-9)


@pytest.mark.slow
def test_frames_go_with_their_session_and_come_with_a_merge(path: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.fsmap"
    with PlaceMap.open(other, "tuesday", **SPARSE) as site:
        for frame in drive()[:30]:
            site.add(frame)
    with PlaceMap.open(path) as site:
        assert site.merge(other).reason is None
    np.testing.assert_array_equal(poses_of(path, "tuesday").numbers, np.arange(30))
    with PlaceMap.open(path) as site:
        site.forget("monday")
        assert [len(each) for each in site.file.frames_after(0)] == [0, 0, 0]
    assert len(poses_of(path, "tuesday").numbers) == 30


def test_parts_of_a_drive_are_exported_apart(tmp_path: Path) -> None:
    far = np.eye(4)
    far[0, 3] = 1000
    with PlaceMap.open(tmp_path / "a.fsmap", "a/b", **SPARSE) as site:
        for frame in drive()[:10]:
            assert frame.odometry is not None
            jumped = frame.odometry if frame.number < 6 else far @ frame.odometry
            site.add(frame, odometry=jumped)
        site.solve()
        tracks = name_tracks(site)
    assert [*tracks] == ["a_b", "a_b-part-2"]
    assert [each.frames.numbers.tolist() for each in tracks.values()] == [[*range(6)], [6, 7, 8, 9]]
    np.testing.assert_allclose(tracks["a_b-part-2"].frames.poses[0], np.eye(4), atol=1e-9)


def line(count: int, way_m: float = 6.0) -> tuple[list[StoredKeyframe], list[Edge]]:
    """Keyframes along a curve, joined by odometry."""
    step = exp(np.array([way_m / (count - 1), 0, 0, 0, 0, 0.5 / (count - 1)]))
    poses = [np.linalg.matrix_power(step, k) for k in range(count)]
    keyframes = [StoredKeyframe(k, 1, k, k, pose, np.eye(4)) for k, pose in enumerate(poses)]
    spread = odometry_covariance(step, MapConfig())
    ends = [(k, k + 1) for k in range(count - 1)]
    edges = [Edge(k, "odometry", *ends[k], step, spread, "believed") for k in range(count - 1)]
    return keyframes, edges


def test_keyframes_have_the_covariances_of_a_dense_inverse() -> None:
    """Of the information matrix whose Jacobians are numeric."""
    keyframes, edges = line(5)
    edges.append(Edge(4, "loop", 0, 4, keyframes[4].odometry, np.diag([0.01] * 6), "believed"))
    edges.append(Edge(5, "loop", 1, 3, np.eye(4), np.eye(6) * 1e-9, "refused"))
    poses = np.array([each.odometry for each in keyframes])
    solution = np.arange(5), poses, np.zeros(5, np.int64)
    content = MapContent({"a": 1}, keyframes, edges, solution)
    information = np.zeros((30, 30))
    for edge in edges[:-1]:
        jacobian = np.zeros((6, 30))
        for column in range(30):
            moved = poses.copy()
            small = np.eye(6)[column % 6] * 1e-6
            moved[column // 6] = moved[column // 6] @ exp(small)
            step = inverse(moved[edge.a]) @ moved[edge.b]
            jacobian[:, column] = log(inverse(edge.pose) @ step) / 1e-6
        information += jacobian.T @ np.linalg.inv(edge.covariance) @ jacobian
    dense = np.linalg.inv(information[6:, 6:])
    found = keyframe_covariances(content)
    np.testing.assert_array_equal(found[0], 0)
    for k in range(1, 5):
        block = slice(6 * k - 6, 6 * k)
        np.testing.assert_allclose(found[k], dense[block, block], rtol=1e-4, atol=1e-9)


def test_between_keyframes_covariances_bound_those_of_a_graph_of_all_frames(path: Path) -> None:
    with PlaceMap.open(path, read_only=True) as site:
        found = frame_poses(site, "monday", covariance=True)
        content = site.content
        marginal = keyframe_covariances(content)
        assert found.covariances is not None
        np.testing.assert_allclose(found.covariances[site.frames("monday")], marginal, atol=1e-12)
        # The same graph with a node for each frame; odometry has the errors of its parts.
        keyframes, edges = [], [e for e in content.edges.values() if e.kind != "odometry"]
        rows = site.frames("monday")
        edges = [
            Edge(e.number, e.kind, int(rows[e.a]), int(rows[e.b]), e.pose, e.covariance, e.state)
            for e in edges
        ]
        for k, pose in enumerate(found.poses):
            keyframes.append(StoredKeyframe(k, 1, k, k, pose, np.eye(4)))
            if k:
                step = inverse(found.poses[k - 1]) @ pose
                spread = odometry_covariance(step, site.settings.map)
                ends = k - 1, k
                edges.append(Edge(10**6 + k, "odometry", *ends, step, spread, "believed"))
        count = len(keyframes)
        solution = np.arange(count), found.poses, np.zeros(count, np.int64)
        dense = keyframe_covariances(MapContent({"a": 1}, keyframes, edges, solution))
    sds, bounds = (np.sqrt(np.einsum("nii->ni", each)) for each in (dense, found.covariances))
    assert (sds[1:] < 1.1 * bounds[1:]).all()
    assert np.median(bounds[1:] / sds[1:]) < 1.5
