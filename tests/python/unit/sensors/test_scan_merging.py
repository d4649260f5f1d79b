# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Scans of several scanners become one: places, times and values of its points."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fusionslam.sensors.messages import FrameTransform, Scan
from fusionslam.sensors.scan_merging import Partner, merge_scans, time_remarks
from fusionslam.sensors.transforms import TransformError, TransformTree

S = 1_000_000_000
STAMP = 1_700_000_000 * S
RNG = np.random.default_rng(3)
REAR = np.eye(4)
REAR[:3, :3] = Rotation.from_euler("xyz", (10, -5, 170), degrees=True).as_matrix()
REAR[:3, 3] = -0.6, 0.1, 0.2
"""front_from_rear."""


def scan(frame: str, count: int = 5, stamp_ns: int = STAMP, **fields: Any) -> Scan:
    points = RNG.uniform(-20, 20, (count, 3)).astype(np.float32)
    return Scan(stamp_ns=stamp_ns, frame_id=frame, points=points, fields=fields)


def tree() -> TransformTree:
    found = TransformTree()
    found.add(
        FrameTransform(
            stamp_ns=0, parent="front", child="rear", parent_from_child=REAR, static=True
        )
    )
    return found


def refuse(name: str, error: TransformError) -> None:
    raise error


def merge(leader: Scan, rear: Scan, frames: TransformTree | None = None) -> Scan:
    partners = {"rear_points": Partner(rear.stamp_ns - leader.stamp_ns, rear)}
    return merge_scans(leader, partners, frames or tree(), refuse)


def in_front(points: NDArray[np.float32]) -> NDArray[np.float64]:
    """Points of the rear scanner in the leader's frame, by a matrix product in double precision."""
    return np.asarray((np.c_[points.astype(float), np.ones(len(points))] @ REAR.T)[:, :3])


def test_each_point_has_its_place_and_its_time_after_the_leaders_stamp() -> None:
    seconds = np.linspace(0, 0.1, 5, dtype=np.float32)
    leader = scan("front", time=seconds)
    rear = scan("rear", 7, STAMP - 30_000_000, t=np.arange(7, dtype=np.uint32) * 10_000_000)
    merged = merge(leader, rear)
    assert (merged.stamp_ns, merged.frame_id) == (STAMP, "front")
    np.testing.assert_array_equal(merged.points[:5], leader.points)
    np.testing.assert_allclose(merged.points[5:], in_front(rear.points), atol=1e-5)
    expected = np.r_[seconds.astype(float), -0.03 + 0.01 * np.arange(7)]
    np.testing.assert_allclose(merged.point_seconds, expected, rtol=0, atol=1e-12)
    assert merged.span == pytest.approx((-0.03, 0.1))


def test_rays_without_return_and_values_that_differ_by_scanner_are_left_out() -> None:
    brightness, rings = np.arange(5, dtype=np.float32), np.arange(5, dtype=np.uint16)
    leader = scan("front", intensity=brightness, ring=rings)
    leader.points[1] = np.nan
    rear = scan("rear", intensity=10 * brightness, ring=rings, object=rings)
    rear.points[4, 2] = np.inf
    merged = merge(leader, rear)
    assert merged.points.shape == (8, 3) and {*merged.fields} == {"intensity"}
    np.testing.assert_array_equal(merged.fields["intensity"], [0, 2, 3, 4, 0, 10, 20, 30])
    assert merged.point_seconds is None and merged.colors is None
    both = [
        replace(each, colors=np.full((5, 3), k, np.uint8)) for k, each in enumerate((leader, rear))
    ]
    colors = merge(*both).colors
    assert colors is not None and colors[:, 0].tolist() == [0] * 4 + [1] * 4


def test_scans_without_times_of_points_are_of_their_stamps() -> None:
    rear = scan("rear", 3, STAMP + 40_000_000)
    np.testing.assert_allclose(merge(scan("front", 2), rear).point_seconds, [0, 0, *[0.04] * 3])
    timed = scan("front", 2, time=np.array([0.0, 0.1]))
    np.testing.assert_allclose(merge(timed, rear).point_seconds, [0, 0.1, *[0.04] * 3])
    assert "'rear' have no times" in remarks(timed, rear)["rear_points"]
    assert "'rear' have no times" in remarks(rear, timed)["rear_points"]
    assert not remarks(timed, replace(timed, frame_id="rear"))
    assert not remarks(rear, scan("front"))


def remarks(leader: Scan, rear: Scan) -> dict[str, str]:
    return time_remarks(leader, {"rear_points": Partner(0, rear)}, leader)


def test_what_is_unusual_about_the_times_of_each_scanner_is_said() -> None:
    usual = scan("front", 600, time=np.linspace(0, 0.1, 600))
    slow = scan("rear", 600, time=np.linspace(0, 100, 600))
    other = scan("rear", 600, time=np.linspace(5, 5.1, 600))
    assert "milliseconds" in remarks(usual, slow)["rear_points"]
    assert "another clock" in remarks(usual, other)["rear_points"]
    assert [*remarks(slow, usual)] == ["points"]


def test_an_empty_scan_adds_nothing() -> None:
    leader, lost = scan("front", time=np.linspace(0, 0.1, 5)), scan("rear")
    lost.points[:] = np.nan
    for empty in (lost, scan("rear", 0)):
        np.testing.assert_array_equal(merge(leader, empty).points, leader.points)
    alone = merge(replace(leader, points=np.full((5, 3), np.nan, np.float32)), scan("rear"))
    assert len(alone.points) == 5


def test_a_scanner_that_turns_on_the_robot_is_placed_at_the_time_of_each_point() -> None:
    frames, rate = TransformTree(), 2.0
    for k in range(21):
        place = REAR.copy()
        place[:3, :3] = Rotation.from_euler("z", rate * 0.01 * k).as_matrix() @ REAR[:3, :3]
        frames.add(
            FrameTransform(
                stamp_ns=STAMP + k * 10_000_000,
                parent="front",
                child="rear",
                parent_from_child=place,
            )
        )
    seconds = np.linspace(0, 0.1, 200)
    rear = scan("rear", 200, STAMP + 50_000_000, time=seconds)
    turns = Rotation.from_rotvec(
        np.outer(rate * (0.05 + seconds), [0, 0, 1])
    ) * Rotation.from_matrix(REAR[:3, :3])
    true = turns.apply(rear.points) + REAR[:3, 3]
    found = merge(scan("front"), rear, frames).points[5:]
    assert np.linalg.norm(found - true, axis=1).max() < 0.001


def test_a_scan_that_cannot_be_placed_is_named_and_the_others_are_merged() -> None:
    leader, rear, side = scan("front"), scan("rear"), scan("side")
    partners = {"side_points": Partner(0, side), "rear_points": Partner(0, rear)}
    said: dict[str, str] = {}
    merged = merge_scans(
        leader, partners, tree(), lambda name, error: said.update({name: error.code})
    )
    assert said == {"side_points": "no-frame"}
    assert len(merged.points) == 10
    with pytest.raises(TransformError):
        merge(leader, side)
    assert merge_scans(leader, {}, tree(), refuse) is leader
