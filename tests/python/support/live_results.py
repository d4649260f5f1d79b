# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What live nodes publish compared with what the offline commands give on the same bag."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from artefacts import artefact
from cli import succeeds
from fusionslam.base.arrays import Floats
from fusionslam.datasets.bags import open_bag
from fusionslam.datasets.bags.messages import stamp_of, value_of
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.fusion import ROBOT_FUSION
from fusionslam.geometry.se2 import compose, places_of, wrapped
from fusionslam.loop_closure import LoopDetector
from fusionslam.ratslam.map_export import link_offsets
from fusionslam.registration import RegistrationConfig
from fusionslam.sensors.frame import Cloud
from fusionslam.sensors.messages import NANOSECONDS, Odometry, Scan
from ros_master import PlayedBag

POINTS = ("--topic", "points=/velodyne_points")
CLOUD = ("--set", "fusion.frame=robot", "--set", "fusion.ground=height")
CONNECTIONS = {
    "lv_builder": "/rgb_cloud",
    "lv_matching": "/current_scene_description",
    "ratslam": "/LocalView/Template",
}
"""Of whom nodes hear that turn clouds into a map."""
PATIENT_PAIRING: dict[str, Any] = {"wait": 600.0, "history": 600.0, "sync": {"buffer": 1000}}
"""``online`` of nodes that pair messages however far a topic is behind others.

DDS sends a message that was lost again with its next heartbeat, up to 3 s later; those after it
wait. In a bag that is played five times as fast that is more than is kept by default.
"""
OUTPUTS = (
    "/rgb_cloud",
    "/LocalView/Template",
    "/PoseCell/TopologicalAction",
    "/ExperienceMap/RobotPose",
    "/ExperienceMap/Map",
    "/ExperienceMap/MapMarker",
    "/ExperienceMap/Path",
    "/tf",
)


@dataclass(frozen=True)
class Offline:
    """Results of the commands on the bag."""

    bag: PlayedBag
    clouds: list[Scan]
    run: RatSlamRun


def run_offline(bag: PlayedBag) -> Offline:
    """Results of the commands on a bag, which run once."""

    def make(folder: Path) -> None:
        succeeds("fuse", bag.path, "-o", folder / "fused.bag", *POINTS, *CLOUD)
        succeeds("ratslam", bag.path, "-o", folder / "map", *POINTS, "--no-report")

    folder = artefact(f"played_bag_{bag.scans}_offline", make)
    with open_bag(folder / "fused.bag") as fused:
        values = [event.message for event in fused.events(["/rgb_cloud"])]
    clouds = [value for value in values if isinstance(value, Scan)]
    return Offline(bag, clouds, RatSlamRun.load(folder / "map" / "run.npz"))


def assert_same_results(found: dict[str, list[Any]], offline: Offline) -> None:
    """All messages of ``OUTPUTS`` are what the commands give, whose steps end with the last view.

    Odometry after it waits for another one until the node ends. What that then says reaches those
    who still listen, or some of it.
    """
    last_ns = int(offline.run.stamps_ns[-1])
    found = {
        topic: [each for each in messages if topic == "/tf" or last_ns >= _stamp(each)]
        for topic, messages in found.items()
    }
    assert_same_clouds(found["/rgb_cloud"], offline.clouds)
    assert_same_views(found["/LocalView/Template"], offline.run)
    assert_same_steps(found, offline.run)
    assert_same_map(found["/ExperienceMap/Map"][-1], offline.run)
    assert_same_pictures(found, offline.run)
    assert_same_places(found, offline)


def _stamp(message: Any) -> int:
    of_markers = hasattr(message, "markers")
    return stamp_of((message.markers[0] if of_markers else message).header.stamp)


def stamps(messages: list[Any]) -> list[int]:
    return [stamp_of(message.header.stamp) for message in messages]


def assert_same_clouds(messages: list[Any], clouds: list[Scan]) -> None:
    assert stamps(messages) == [cloud.stamp_ns for cloud in clouds]
    for message, cloud in zip(messages, clouds, strict=True):
        scan = value_of(message, "sensor_msgs/PointCloud2", "/rgb_cloud")
        assert isinstance(scan, Scan) and scan.frame_id == "base_footprint"
        np.testing.assert_array_equal(scan.points, cloud.points)
        np.testing.assert_array_equal(scan.colors, cloud.colors)


def assert_same_views(messages: list[Any], run: RatSlamRun) -> None:
    assert stamps(messages) == run.stamps_ns[run.is_view].tolist()
    assert [message.current_id for message in messages] == run.view_ids[run.is_view].tolist()


def assert_same_steps(found: dict[str, list[Any]], run: RatSlamRun) -> None:
    poses = found["/ExperienceMap/RobotPose"]
    assert stamps(poses) == run.stamps_ns.tolist()
    np.testing.assert_array_equal([place(each.pose) for each in poses], run.poses[:, :2])
    np.testing.assert_allclose(
        [heading(each.pose.orientation) for each in poses],
        np.angle(np.exp(1j * run.poses[:, 2])),
        atol=1e-9,
    )
    done = run.actions[:, 0] > 0
    actions = found["/PoseCell/TopologicalAction"]
    assert stamps(actions) == run.stamps_ns[done].tolist()
    found_actions = [(each.action, each.src_id, each.dest_id) for each in actions]
    assert found_actions == [tuple(row) for row in run.actions[done].tolist()]


def assert_same_map(found: Any, run: RatSlamRun) -> None:
    assert len(found.node) == found.node_count == len(run.nodes)
    np.testing.assert_array_equal([place(node.pose) for node in found.node], run.nodes[:, :2])
    assert [stamp_of(node.stamp) for node in found.node] == run.node_stamps_ns.tolist()
    links = [(edge.source_id, edge.destination_id) for edge in found.edge]
    assert links == [(link["source"], link["target"]) for link in run.links]
    ways = np.array(
        [ground(each.transform.translation, each.transform.rotation) for each in found.edge]
    )
    wanted = link_offsets(run.links)
    np.testing.assert_array_equal(ways[:, :2], wanted[:, :2])
    np.testing.assert_allclose(wrapped(ways[:, 2] - wanted[:, 2]), 0, atol=1e-9)
    durations = [stamp_of(each.duration) / NANOSECONDS for each in found.edge]
    np.testing.assert_allclose(durations, run.links["duration"], rtol=0, atol=1e-9)


def assert_same_pictures(found: dict[str, list[Any]], run: RatSlamRun) -> None:
    """Messages that RViz shows: the way from node to node, and nodes and links."""
    nodes = run.node_ids[run.node_ids >= 0]
    visits = nodes[np.r_[True, nodes[1:] != nodes[:-1]]]
    way = found["/ExperienceMap/Path"][-1].poses
    np.testing.assert_array_equal([place(each.pose) for each in way], run.nodes[visits, :2])
    dots, lines = found["/ExperienceMap/MapMarker"][-1].markers
    np.testing.assert_array_equal([(each.x, each.y) for each in dots.points], run.nodes[:, :2])
    ends = np.stack([run.links["source"], run.links["target"]], axis=1).ravel()
    np.testing.assert_array_equal([(each.x, each.y) for each in lines.points], run.nodes[ends, :2])


def assert_same_places(found: dict[str, list[Any]], offline: Offline) -> None:
    """Each odometry frame is that of a step, which it puts at its place; steps only go on.

    Of which step depends on the machine's load: the frame is sent as odometry arrives, while steps
    wait for views, on a busy machine the first of them for the last odometry.
    """
    places, odometry, stamps_ns = steps_with_odometry(found["/ExperienceMap/RobotPose"], offline)
    step, frames = 0, 0
    for message in found["/tf"]:
        (link, *others) = message.transforms
        if link.header.frame_id != "map":
            continue
        assert not others and link.child_frame_id == "odom"
        frame = np.array([ground(link.transform.translation, link.transform.rotation)])
        off = compose(frame, odometry[step:]) - places[step:]
        off[:, 2] = wrapped(off[:, 2])
        there = np.flatnonzero(np.abs(off).max(axis=1) < 1e-6)
        assert len(there), f"a frame is of no step from {step} on"
        step += int(there[0])
        assert stamps_ns[step] <= stamp_of(link.header.stamp)
        frames += 1
    assert frames


def steps_with_odometry(poses: list[Any], offline: Offline) -> tuple[Floats, Floats, list[int]]:
    """Of each step: the place on the map, the place by the last odometry until then, the stamp.

    Odometry is read from the bag: a listener that the player does not wait for may miss the first.
    """
    with open_bag(offline.bag.path) as bag:
        said = {
            event.message.stamp_ns: tuple(places_of(event.message.pose[None])[0])
            for event in bag.events(["/odom"])
            if isinstance(event.message, Odometry)
        }
    stamps_ns = stamps(poses)
    odometry: list[tuple[float, ...]] = []
    for stamp_ns, is_seen in zip(stamps_ns, offline.run.is_view[: len(poses)], strict=True):
        odometry.append(odometry[-1] if is_seen else said[stamp_ns])
    places = [ground(each.pose.position, each.pose.orientation) for each in poses]
    return np.array(places), np.array(odometry), stamps_ns


def place(pose: Any) -> tuple[float, float]:
    return pose.position.x, pose.position.y


def heading(rotation: Any) -> float:
    return 2 * float(np.arctan2(rotation.z, rotation.w))


def ground(position: Any, rotation: Any) -> tuple[float, float, float]:
    return position.x, position.y, heading(rotation)


def assert_same_loops(loops: list[Any], clouds: list[Any]) -> None:
    """Messages of loop_closure, with a window of 2, are what a detector finds in the clouds."""
    planar = RegistrationConfig(method="planar")
    detector = LoopDetector("cm2dp", window=2, fusion=ROBOT_FUSION, registration=planar)
    scans = [value_of(message, "sensor_msgs/PointCloud2", "") for message in clouds]
    wanted = []
    for scan in scans:
        assert isinstance(scan, Scan)
        loop = detector.add(Cloud(scan.points, scan.colors), stamp_ns=scan.stamp_ns)
        wanted += [loop] if loop else []
    assert len(wanted) > 3
    assert [(each.query, each.match) for each in loops] == [(w.query, w.match) for w in wanted]
    np.testing.assert_array_equal([each.distance for each in loops], [w.distance for w in wanted])
    found = [(each.probability, each.overlap) for each in loops]
    assert found == [(loop.probability, loop.overlap) for loop in wanted]
    stamps_ns = [stamp_of(message.header.stamp) for message in clouds]
    for each in loops:
        assert stamp_of(each.match_stamp) == stamps_ns[each.match]
