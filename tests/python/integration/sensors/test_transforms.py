# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Transforms at any time: against scipy's Slerp, closed forms and the odometry of a real bag."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation, Slerp

from error_codes import has_code
from fusionslam.errors import ConfigError, DataError
from fusionslam.sensors.messages import FrameTransform
from fusionslam.sensors.transforms import TransformError, TransformTree
from rows import rows

S = 1_000_000_000


def matrix(rotation: Rotation, translation: object) -> NDArray[np.float64]:
    return RigidTransform.from_components(np.asarray(translation), rotation).as_matrix()


def yaw_at(angle: float, x: float = 0, y: float = 0) -> NDArray[np.float64]:
    return matrix(Rotation.from_euler("z", angle), [x, y, 0.0])


def link(
    parent: str, child: str, pose: NDArray[np.float64], stamp: float = 0, static: bool = False
) -> FrameTransform:
    return FrameTransform(
        stamp_ns=round(stamp * S), parent=parent, child=child, parent_from_child=pose, static=static
    )


def tree_of(*links: FrameTransform, **options: float | None) -> TransformTree:
    tree = TransformTree(**options)
    for each in links:
        tree.add(each)
    return tree


def robot(**options: float | None) -> TransformTree:
    """Turns left at 0.5 rad/s from t = 0 s to 2 s while it drives 1 m/s along x of odom."""
    poses = [link("odom", "base", yaw_at(0.5 * t, x=t), t) for t in (0, 1, 2)]
    lidar = link("base", "lidar", yaw_at(np.pi / 2, x=0.3), static=True)
    camera = link("base", "camera", yaw_at(0, y=0.2), static=True)
    return tree_of(*poses, lidar, camera, **options)


def test_static_chains_multiply_in_both_directions() -> None:
    rng = np.random.default_rng(0)
    parts = {
        name: RigidTransform.from_components(rng.normal(size=3), Rotation.random(rng=rng))
        for name in ("b", "c", "d", "e")
    }
    parents = {"b": "a", "c": "b", "d": "a", "e": "d"}
    tree = tree_of(*(link(parents[n], n, t.as_matrix(), static=True) for n, t in parts.items()))
    down = (parts["d"] * parts["e"]).inv() * (parts["b"] * parts["c"])
    np.testing.assert_allclose(tree.lookup("e", "c", 5), down.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(tree.lookup("c", "e", 5), down.inv().as_matrix(), atol=1e-12)
    np.testing.assert_array_equal(tree.lookup("c", "c", 5), np.eye(4))
    assert tree.chain("e", "c") == ["e", "d", "a", "b", "c"]
    assert tree.chain("a", "c") == ["a", "b", "c"] and tree.chain("c", "b") == ["c", "b"]


def test_interpolation_is_slerp_and_linear() -> None:
    rng = np.random.default_rng(1)
    stamps = np.cumsum(rng.integers(1, S, 20))
    turns, places = Rotation.random(20, rng=rng), rng.normal(size=(20, 3))
    order = rng.permutation(20)
    tree = tree_of(
        *(link("odom", "base", matrix(turns[i], places[i]), stamps[i] / S) for i in order),
        history_s=None,
    )
    slerp = Slerp(stamps, turns)
    for at in rng.integers(stamps[0], stamps[-1], 100):
        place = [np.interp(at, stamps, places[:, axis]) for axis in range(3)]
        found = tree.lookup("odom", "base", int(at))
        np.testing.assert_allclose(found, matrix(slerp([at])[0], place), atol=1e-9)


def test_a_turn_at_constant_speed_goes_on_between_and_a_little_beyond_the_samples() -> None:
    tree = robot(extrapolation_s=0.1)
    for at in (1.3, 2.1, -0.1):
        found = tree.lookup("odom", "base", round(at * S))
        np.testing.assert_allclose(found, yaw_at(0.5 * at, x=at), atol=1e-12)
    with pytest.raises(TransformError):
        tree.lookup("odom", "base", round(2.2 * S))
    found = robot().lookup("odom", "base", round(1.3 * S))
    np.testing.assert_allclose(found, yaw_at(0.65, x=1.3), atol=1e-12)
    single = tree_of(link("odom", "base", yaw_at(1.0), 3))  # holds for its own time
    np.testing.assert_array_equal(single.lookup("odom", "base", 3 * S), yaw_at(1.0))


def test_many_times_at_once_give_what_each_gives_but_nothing_is_extrapolated() -> None:
    tree = robot(extrapolation_s=0.5)
    for t in np.arange(0, 2, 0.2):
        tree.add(link("odom", "base", yaw_at(0.5 * t, x=t), t))
    stamps = np.array([0, 0.3, 1.0, 1.7, 2.0]) * S
    for ends in (("odom", "lidar"), ("lidar", "odom"), ("camera", "lidar"), ("base", "base")):
        found = tree.lookup_all(*ends, stamps.astype(np.int64))
        each = [tree.lookup(*ends, int(stamp)) for stamp in stamps]
        # An arc of 0.1 rad and 0.2 m is 2.5 mm beside its chord.
        np.testing.assert_allclose(found, each, atol=2.6e-3)
        np.testing.assert_allclose(found[[0, 2, 4]], np.array(each)[[0, 2, 4]], atol=1e-12)
    for beyond in (-0.1, 2.1):
        tree.lookup("odom", "lidar", round(beyond * S))
        with pytest.raises(TransformError, match="is known from"):
            tree.lookup_all("odom", "lidar", (np.array([1.0, beyond]) * S).astype(np.int64))


def test_many_times_are_not_known_across_a_gap() -> None:
    within = (np.array([0.3, 0.4]) * S).astype(np.int64)
    with pytest.raises(TransformError, match=r"is not known for 1\.000 s") as error:
        robot().lookup_all("odom", "lidar", within)
    assert error.value.code == "gap" and not error.value.may_come
    robot().lookup_all("base", "lidar", within)


def test_a_time_before_or_after_what_is_known_is_refused_with_both() -> None:
    with pytest.raises(TransformError) as late:
        robot().lookup("camera", "odom", round(2.25 * S))
    assert late.value.may_come and has_code("too-late", "odom", "base")(late.value)
    assert all(text in str(late.value) for text in ("0.000 s", "2.000 s", "2.250 s", "0.250 s"))
    with pytest.raises(TransformError, check=has_code("too-early", "odom", "base")) as early:
        robot().lookup("odom", "base", -S)
    assert not early.value.may_come


def test_an_unknown_frame_is_named_with_the_nearest_one() -> None:
    with pytest.raises(TransformError, check=has_code("no-frame", "lidr")) as error:
        robot().lookup("base", "lidr", 0)
    assert "'lidar'" in str(error.value)
    with pytest.raises(TransformError, check=has_code("no-frame", "base")):
        TransformTree().lookup("lidar", "base", 0)


def test_frames_that_nothing_links_are_shown_with_their_trees() -> None:
    tree = robot()
    tree.add(link("map", "tag", np.eye(4), static=True))
    with pytest.raises(TransformError) as caught:
        tree.lookup("map", "lidar", 0)
    assert has_code("frames-not-linked", "map", "lidar")(caught.value)
    map_tree = ["map", "  tag (static)"]
    robot_tree = ["odom", "  base (moving)", "    camera (static)", "    lidar (static)"]
    assert str(caught.value).splitlines()[1:] == map_tree + robot_tree


@rows(
    "parent, child, code, frames",
    [
        ("lidar", "odom", "frame-loop", ("odom", "lidar", "base", "odom")),
        ("odom", "odom", "frame-loop", ("odom", "odom")),
        ("map", "base", "two-parents", ("base", "odom", "map")),
    ],
)
def test_loops_and_second_parents_are_refused(
    parent: str, child: str, code: str, frames: tuple[str, ...]
) -> None:
    tree = robot()
    with pytest.raises(DataError, check=has_code(code, *frames)):
        tree.add(link(parent, child, np.eye(4)))
    assert tree.draw() == robot().draw()


@rows(
    "pose",
    [
        np.full((4, 4), np.nan),
        np.eye(3),
        2 * np.eye(4),
        np.diag([1.0, 1, -1, 1]),
        np.full((4, 4), "x"),
    ],
)
def test_what_is_no_rotation_and_translation_is_refused(pose: NDArray[np.float64]) -> None:
    with pytest.raises(DataError, check=has_code("no-transform", "odom", "base")):
        TransformTree().add(link("odom", "base", pose))


@rows("stamp_ns", [0.5, 2**63])
def test_a_stamp_of_another_type_is_refused_and_changes_nothing(stamp_ns: Any) -> None:
    tree = TransformTree()
    with pytest.raises(DataError, check=has_code("stamp", str(stamp_ns))):
        tree.add(replace(link("odom", "base", np.eye(4)), stamp_ns=stamp_ns))
    assert tree.frames == []


def test_history_is_bounded_where_it_is_asked_for() -> None:
    stamps = np.arange(0, 100, 0.1)
    tree = tree_of(*(link("odom", "base", yaw_at(0), t) for t in stamps), history_s=5.0)
    tree.lookup("odom", "base", 95 * S)
    with pytest.raises(TransformError, match=r"94\.900 s"):
        tree.lookup("odom", "base", 94 * S)


def test_moving_counts_where_a_frame_is_both_and_slashes_do_not() -> None:
    tree = tree_of(
        link("/odom", "/base", yaw_at(0.1), static=True), link("odom", "base", yaw_at(1))
    )
    tree.add(link("odom", "base", yaw_at(0.1), static=True))
    np.testing.assert_array_equal(tree.lookup("/odom", "base", 0), yaw_at(1))
    assert tree.frames == ["base", "odom"]


def test_what_lies_after_the_time_that_a_clock_jumped_to_is_forgotten() -> None:
    tree = tree_of(
        link("base", "lidar", yaw_at(0.1), static=True),
        *(link("odom", "base", yaw_at(0.1 * t), t) for t in range(5)),
        link("map", "odom", yaw_at(0.2), 4),
    )
    tree.forget_after(2 * S)
    assert tree.newest("base") == 2 * S and tree.frames == ["base", "lidar", "odom"]
    np.testing.assert_allclose(tree.lookup("odom", "lidar", 2 * S), yaw_at(0.2) @ yaw_at(0.1))
    with pytest.raises(TransformError) as error:
        tree.lookup("odom", "base", 3 * S)
    assert error.value.may_come
    tree = robot()
    tree.forget_moving()  # then only what stands still is known
    assert tree.frames == ["base", "camera", "lidar"] and tree.newest("base") is None
    tree.add(link("odom", "base", yaw_at(0.3), -50))
    np.testing.assert_allclose(tree.lookup("odom", "base", -50 * S), yaw_at(0.3))


def test_a_recorded_robots_tf_agrees_with_its_odometry(test_data: Path) -> None:
    highlevel = pytest.importorskip("rosbags.highlevel")
    tree, odometry = TransformTree(history_s=None), {}
    with highlevel.AnyReader([test_data / "bags" / "small_house_20s.bag"]) as reader:
        for connection, _, raw in reader.messages():
            if connection.topic in ("/tf", "/tf_static"):
                for each in reader.deserialize(raw, connection.msgtype).transforms:
                    pose = _pose(each.transform.translation, each.transform.rotation)
                    parent, static = each.header.frame_id, connection.topic == "/tf_static"
                    tree.add(link(parent, each.child_frame_id, pose, _time(each), static))
            elif connection.topic == "/odom":
                message = reader.deserialize(raw, connection.msgtype)
                pose = message.pose.pose
                odometry[_time(message)] = _pose(pose.position, pose.orientation)
    assert len(odometry) == 600
    for stamp, pose in odometry.items():
        found = tree.lookup("odom", "base_footprint", round(stamp * S))
        np.testing.assert_allclose(found, pose, atol=1e-7)
    # The robot of Stastny 2022: LiDAR and camera above base_footprint (FACTS.md, section 8).
    middle = 1010 * S
    lidar = tree.lookup("base_footprint", "velodyne", middle)[:3, 3]
    camera = tree.lookup("base_footprint", "camera_rgb_optical_frame", middle)
    np.testing.assert_allclose(lidar, [-0.064, 0, 0.17], atol=5e-4)
    np.testing.assert_allclose(camera[:3, 3], [0.076, 0, 0.103], atol=5e-4)
    # x right, y down, z forward.
    np.testing.assert_allclose(camera[:3, :3], [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], atol=1e-6)


def _time(message: object) -> float:
    stamp = message.header.stamp
    return float(stamp.sec + stamp.nanosec * 1e-9)


def _pose(place: object, turn: object) -> NDArray[np.float64]:
    rotation = Rotation.from_quat([getattr(turn, axis) for axis in "xyzw"])
    return matrix(rotation, [getattr(place, axis) for axis in "xyz"])


@rows("seconds", [math.inf, math.nan, -1.0, 1e300, 10**400, np.ones(2)])
@rows("name", ["history_s", "extrapolation_s"])
def test_durations_that_are_no_finite_time_are_refused(name: str, seconds: Any) -> None:
    with pytest.raises(ConfigError, check=has_code("out-of-range", name)):
        TransformTree(**{name: seconds})
