# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The nodes beside the map: loops, judged views and recorded scenes are those of the library."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli import succeeds
from fusionslam import LoopDetector
from fusionslam.datasets.bags.messages import stamp_of
from fusionslam.evaluation.views.judge import judge_views
from fusionslam.views.scene_set import SceneSet
from live_results import assert_same_loops
from ros_master import PlayedBag, RosWorld, needs_ros

pytestmark = needs_ros

TRUTH = "ground_truth:=/odom"
LOOPS = ("_loop_closure/window:=2",)
# So low a threshold takes other places for known ones, which the analyser has to notice.
OBJECTS = ("_source:=objects", "_views/threshold:=0.3")


@dataclass(frozen=True)
class Driven:
    """Messages of a drive, and the folder that the nodes wrote to."""

    bag: Path
    folder: Path
    messages: dict[str, list[Any]]
    log: str


@pytest.fixture(scope="module")
def driven(played_bag: PlayedBag, tmp_path_factory: pytest.TempPathFactory) -> Driven:
    bag, folder = played_bag.path, tmp_path_factory.mktemp("driven")
    image, info = played_bag.sensors
    with RosWorld(folder) as world:
        listener = world.listen(
            "/rgb_cloud", "/loop_closures", "/LocalView/Template", "/view_statistics"
        )
        watchers = [
            world.node("lv_analyzer", TRUTH, image, "_output:=judged"),
            world.node("lv_dataset_creator", TRUTH, "_memory/file:=made/scenes.npz"),
            world.node("loop_closure", *LOOPS, "_memory/file:=loops"),
        ]
        world.node("lv_matching", *OBJECTS)
        world.node("lv_builder", *OBJECTS)
        world.node("data_fusion", image, info)
        world.play(bag, "-r", "4")
        listener.settle()
        for process in watchers:
            assert world.end(process) == 0
        return Driven(bag, folder, listener.messages(), world.log("lv_analyzer"))


def test_loops_are_those_of_the_detector(driven: Driven) -> None:
    clouds = driven.messages["/rgb_cloud"]
    assert_same_loops(driven.messages["/loop_closures"], clouds)
    assert len(LoopDetector.load(driven.folder / "loops")) == len(clouds)


def test_a_loop_says_where_the_robot_is_against_then(driven: Driven) -> None:
    places = {stamp: pose for stamp, *pose in true_places(driven)}
    errors = []
    for each in driven.messages["/loop_closures"]:
        if each.probability > 0.9:
            x, y, yaw = places[stamp_of(each.match_stamp)]
            now = places[stamp_of(each.header.stamp)]
            c, s = np.cos(yaw), np.sin(yaw)
            moved = (now[0] - x) * c + (now[1] - y) * s, (now[1] - y) * c - (now[0] - x) * s
            errors.append(np.hypot(*(np.array(moved) - place(each.pose))))
    assert len(errors) > 3
    assert np.median(errors) < 0.05


def test_views_are_judged_as_the_library_judges_them(driven: Driven) -> None:
    templates = driven.messages["/LocalView/Template"]
    stamps, *poses = np.array(true_places(driven)).T
    ids = [each.current_id for each in templates]
    wanted = judge_views(ids, np.array(poses).T, stamps / 1e9)
    last = driven.messages["/view_statistics"][-1]
    assert wanted.false_positives > 0
    assert (last.views, last.places) == (wanted.n, wanted.views)
    assert (last.false_positives, last.false_negatives) == (
        wanted.false_positives,
        wanted.false_negatives,
    )
    assert last.accuracy == wanted.accuracy
    written = json.loads((driven.folder / "judged" / "views.json").read_text())
    metrics = wanted.metrics()
    assert written.pop("limits") == metrics.pop("limits")
    # Truth at a stamp is interpolated, here by another library.
    assert written == pytest.approx(metrics)
    assert "accuracy" in driven.log
    pictures = {path.name for path in (driven.folder / "judged").glob("*.jpg")}
    assert pictures == {f"false_positive_{scan:06d}.jpg" for scan in wanted.false_positive_indices}


def test_the_recorded_scenes_are_those_of_views_record(driven: Driven, tmp_path: Path) -> None:
    topics = ("--topic", "points=/velodyne_points", "--topic", "truth=/odom")
    succeeds("views", "record", driven.bag, "-o", tmp_path / "wanted.npz", *topics)
    wanted = SceneSet.load(tmp_path / "wanted.npz")
    found = SceneSet.load(driven.folder / "made" / "scenes.npz")
    assert found.stamps_ns.tolist() == wanted.stamps_ns.tolist()
    assert found.clouds is not None and wanted.clouds is not None
    np.testing.assert_array_equal(found.clouds.points, wanted.clouds.points)
    np.testing.assert_array_equal(found.clouds.colors, wanted.clouds.colors)
    np.testing.assert_allclose(found.poses, wanted.poses, atol=1e-9)


def true_places(driven: Driven) -> list[tuple[int, float, float, float]]:
    """Stamp, x, y, yaw of the scans, by the odometry of the bag as another library reads it."""
    rows = odometry_of(driven.bag)
    times, x, y, yaw = (np.array(column) for column in zip(*rows, strict=True))
    stamps = [stamp_of(each.header.stamp) for each in driven.messages["/LocalView/Template"]]
    turned = np.unwrap(yaw)
    return [
        (t, *(float(np.interp(t - times[0], times - times[0], row)) for row in (x, y, turned)))
        for t in stamps
    ]


def odometry_of(bag: Path) -> list[tuple[int, float, float, float]]:
    from fusionslam.ros.ros1.environment import need_ros

    need_ros()
    import rosbag

    rows = []
    with rosbag.Bag(str(bag)) as opened:
        for _, message, _ in opened.read_messages(["/odom"]):
            pose = message.pose.pose
            yaw = 2 * np.arctan2(pose.orientation.z, pose.orientation.w)
            rows.append((stamp_of(message.header.stamp), *place(pose), yaw))
    return rows


def place(pose: Any) -> tuple[float, float]:
    return pose.position.x, pose.position.y
