# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""All nodes on a drive, without a live ROS: they give what commands and library give."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from artefacts import artefact, copy_artefact
from cli import succeeds
from fusionslam import LoopDetector
from fusionslam.datasets.bags.messages import stamp_of
from fusionslam.evaluation.views.judge import judge_views
from fusionslam.views.scene_set import SceneSet
from live_results import (
    OUTPUTS,
    Offline,
    assert_same_loops,
    assert_same_results,
    ground,
    place,
)
from place_maps import assert_same_map
from ros_master import PlayedBag, needs_ros
from ros_node import Chain, Desk

pytestmark = needs_ros

TOPICS = {
    "/velodyne_points": "velodyne_points",
    "/odom": "odom",
    "/tf": "/tf",
    "/tf_static": "/tf_static",
}
# So low a threshold takes other places for known ones, which the analyser has to notice.
OBJECTS = {"source": "objects", "views": {"threshold": 0.3}}
WATCHED = ("/loop_closures", "/LocalView/Template", "/view_statistics")


@dataclass(frozen=True)
class Driven:
    """Messages of a drive, and the folder that the nodes wrote to."""

    bag: PlayedBag
    folder: Path
    mapped: dict[str, list[Any]]
    watched: dict[str, list[Any]]


@pytest.fixture(scope="module")
def driven(played_bag: PlayedBag, tmp_path_factory: pytest.TempPathFactory) -> Driven:
    folder = tmp_path_factory.mktemp("driven")
    fusion = Desk("data_fusion")
    mapped = Chain(fusion, Desk("lv_builder"), Desk("lv_matching", odometry=True), Desk("ratslam"))
    watched = Chain(
        Desk("loop_closure", loop_closure={"window": 2}, memory={"file": str(folder / "loops")}),
        Desk("lv_dataset_creator", memory={"file": str(folder / "scenes.npz")}),
        Desk("lv_builder", **OBJECTS),
        Desk("lv_matching", **OBJECTS),
        Desk("lv_analyzer", output=str(folder / "judged")),
    )
    for topic, message in messages_of(played_bag):
        before = len(fusion.outlet.of("rgb_cloud"))
        mapped.give(topic, message)
        watched.give("ground_truth" if topic == "odom" else topic, message)
        watched.give("rgb_cloud", *fusion.outlet.of("rgb_cloud")[before:])
    before = len(fusion.outlet.of("rgb_cloud"))
    mapped.fall_silent()
    watched.give("rgb_cloud", *fusion.outlet.of("rgb_cloud")[before:])
    watched.fall_silent()
    for desk in watched.desks:
        desk.node.close()
    assert not any(desk.problems() for desk in (*mapped.desks, *watched.desks))
    return Driven(
        played_bag,
        folder,
        {name: mapped.of(name if name == "/tf" else name[1:]) for name in OUTPUTS},
        {name: watched.of(name[1:]) for name in WATCHED},
    )


def messages_of(bag: PlayedBag) -> Iterator[tuple[str, Any]]:
    """Messages of ROS, by the topics of the nodes."""
    import rosbag

    images = {bag.image: "camera/rgb/image_raw", bag.camera_info: "camera/rgb/camera_info"}
    names = TOPICS | images
    with rosbag.Bag(str(bag.path)) as opened:
        for topic, message, _ in opened.read_messages([*names]):
            yield names[topic], message


def odometry_of(bag: PlayedBag) -> list[Any]:
    return [message for topic, message in messages_of(bag) if topic == "odom"]


def test_clouds_ids_and_map_are_those_of_the_commands_even_if_the_last_nodes_fall_silent_first(
    driven: Driven, offline: Offline
) -> None:
    assert_same_results(driven.mapped, offline)


@pytest.fixture(scope="module")
def maps(played_bag: PlayedBag, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Those of the node mapper and of the command."""
    pytest.importorskip("gtsam", reason="the library of pose graphs is an extra")
    options = ("--session", "monday", "--no-report", "--topic", "points=/velodyne_points")

    def build(folder: Path) -> None:
        succeeds("map", "build", played_bag.path, "-o", folder / "site.fsmap", *options)

    folder = tmp_path_factory.mktemp("maps")
    path = folder / "site.fsmap"
    mapper = Chain(Desk("mapper", map={"file": str(path), "session": "monday"}))
    for topic, message in messages_of(played_bag):
        mapper.give(topic, message)
    mapper.fall_silent()
    mapper.desks[0].node.close()
    kept = artefact(f"played_bag_{played_bag.scans}_site", build)
    return path, copy_artefact(kept, folder / "command") / "site.fsmap"


def test_a_map_that_lasts_is_that_of_the_command(maps: tuple[Path, Path]) -> None:
    assert_same_map(*maps)


def test_loops_are_those_of_the_detector(driven: Driven) -> None:
    clouds = driven.mapped["/rgb_cloud"]
    assert_same_loops(driven.watched["/loop_closures"], clouds)
    assert len(LoopDetector.load(driven.folder / "loops")) == len(clouds)


def test_a_loop_says_where_the_robot_is_against_then(driven: Driven) -> None:
    places = {stamp: pose for stamp, *pose in true_places(driven)}
    errors = []
    for each in driven.watched["/loop_closures"]:
        if each.probability > 0.9:
            x, y, yaw = places[stamp_of(each.match_stamp)]
            now = places[stamp_of(each.header.stamp)]
            c, s = np.cos(yaw), np.sin(yaw)
            moved = (now[0] - x) * c + (now[1] - y) * s, (now[1] - y) * c - (now[0] - x) * s
            errors.append(np.hypot(*(np.array(moved) - place(each.pose))))
    assert len(errors) > 3
    assert np.median(errors) < 0.05


def test_views_are_judged_as_the_library_judges_them(driven: Driven) -> None:
    templates = driven.watched["/LocalView/Template"]
    stamps, *poses = np.array(true_places(driven)).T
    ids = [each.current_id for each in templates]
    wanted = judge_views(ids, np.array(poses).T, stamps / 1e9)
    last = driven.watched["/view_statistics"][-1]
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
    pictures = {path.name for path in (driven.folder / "judged").glob("*.jpg")}
    assert pictures == {f"false_positive_{scan:06d}.jpg" for scan in wanted.false_positive_indices}


def test_the_recorded_scenes_are_those_of_views_record(driven: Driven, tmp_path: Path) -> None:
    topics = ("--topic", "points=/velodyne_points", "--topic", "truth=/odom")
    succeeds("views", "record", driven.bag.path, "-o", tmp_path / "wanted.npz", *topics)
    wanted = SceneSet.load(tmp_path / "wanted.npz")
    found = SceneSet.load(driven.folder / "scenes.npz")
    assert found.stamps_ns.tolist() == wanted.stamps_ns.tolist()
    assert found.clouds is not None and wanted.clouds is not None
    np.testing.assert_array_equal(found.clouds.points, wanted.clouds.points)
    np.testing.assert_array_equal(found.clouds.colors, wanted.clouds.colors)
    np.testing.assert_allclose(found.poses, wanted.poses, atol=1e-9)


def true_places(driven: Driven) -> list[tuple[int, float, float, float]]:
    """Stamp, x, y, yaw of the scans, by odometry, which is without errors."""
    odometry = odometry_of(driven.bag)
    times = np.array([stamp_of(each.header.stamp) for each in odometry])
    poses = [each.pose.pose for each in odometry]
    x, y, yaw = np.array([ground(each.position, each.orientation) for each in poses]).T
    stamps = [stamp_of(each.header.stamp) for each in driven.watched["/LocalView/Template"]]
    rows = x, y, np.unwrap(yaw)
    return [
        (t, *(float(np.interp(t - times[0], times - times[0], row)) for row in rows))
        for t in stamps
    ]
