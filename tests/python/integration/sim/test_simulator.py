# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The stream of a simulated drive: what is published, when, from where, and always alike."""

import pickle
import threading
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("embreex", reason="the simulator is an extra")

from error_codes import has_code
from fusionslam.base.arrays import Floats
from fusionslam.config import merged
from fusionslam.errors import DataError
from fusionslam.geometry.se3 import exp, inverse, log
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.sensors.frame_builder import FrameBuilder, OnlineConfig
from fusionslam.sensors.messages import (
    CameraInfo,
    Event,
    FrameTransforms,
    Imu,
    Odometry,
    Picture,
    Scan,
)
from fusionslam.sim.motion.riding import Hills, HillsConfig
from fusionslam.sim.robot import RobotConfig, base_from, base_from_camera, robot_named
from fusionslam.sim.simulator import SimulationConfig, event_count, simulate
from fusionslam.sim.world import World, scene_of
from rows import rows
from worlds import EVEN, PLAIN, bare_robot, block, floor, hall, straight

SECOND = 1_000_000_000
SMALL = {"width": 32, "height": 24, "view_rad": 1.0, "rate_hz": 15.0}
SENSORS = {"cameras": {"eye": SMALL}, "lidars": {"lidar": {"rings": 4, "azimuths": 60}}}
SHORT = SimulationConfig(seconds=1.0)
BLINK = SimulationConfig(seconds=0.1)


@pytest.fixture(scope="module")
def world() -> World:
    return hall()


@pytest.fixture(scope="module")
def robot() -> RobotConfig:
    return merged(bare_robot(noise_m=0.01, dropout=0.1), SENSORS, new_names=True)


def by_topic(events: list[Event] | Iterator[Event]) -> dict[str, list[Event]]:
    found: dict[str, list[Event]] = {}
    for event in events:
        found.setdefault(event.topic, []).append(event)
    return found


def stamp(event: Event) -> int:
    message = event.message
    return getattr(message, "transforms", (message,))[0].stamp_ns


def test_each_topic_has_its_messages_at_its_rate(world: World, robot: RobotConfig) -> None:
    found = by_topic(simulate(world, robot, straight(), SHORT))
    kinds = {
        "/tf_static": (FrameTransforms, 1, 1.0),
        "/tf": (FrameTransforms, 30, 30.0),
        "/odom": (Odometry, 30, 30.0),
        "/ground_truth": (Odometry, 30, 30.0),
        "/camera/camera_info": (CameraInfo, 15, 15.0),
        "/camera/image_raw/compressed": (Picture, 15, 15.0),
        "/points": (Scan, 10, 10.0),
    }
    assert set(found) == set(kinds)
    for topic, (kind, count, rate) in kinds.items():
        assert len(found[topic]) == count
        assert all(type(event.message) is kind for event in found[topic])
        expected = [1000 * SECOND + round(k * SECOND / rate) for k in range(count)]
        assert [stamp(event) for event in found[topic]] == expected
        assert [event.time_ns for event in found[topic]] == expected


def test_events_come_in_order_up_to_the_end_of_the_drive(world: World, robot: RobotConfig) -> None:
    events = list(simulate(world, robot, straight(), SHORT, jobs=3))
    times = [event.time_ns for event in events]
    assert times == sorted(times)
    assert events[0].topic == "/tf_static"
    assert len(events) == event_count(robot, straight(), SHORT)
    found = by_topic(simulate(world, robot, straight(0.5), SimulationConfig(seconds=60.0)))
    assert len(found["/points"]) == 5 and len(found["/odom"]) == 15


def test_a_seed_decides_all_with_any_number_of_jobs(world: World, robot: RobotConfig) -> None:
    config = merged(SHORT, {"obstacles": {"number": 2}, "seconds": 0.4})
    other = merged(config, {"seed": 1})
    one, three, seeded = (
        pickle.dumps(list(simulate(world, robot, straight(), each, jobs=jobs)))
        for each, jobs in ((config, 1), (config, 3), (other, 1))
    )
    assert one == three != seeded


def test_two_sensors_have_noise_of_their_own(world: World) -> None:
    noisy = {"noise_m": 0.1, "rings": 2, "azimuths": 90}
    robot = bare_robot(**noisy, topic="/a")
    twin = robot.lidars["lidar"].model_copy(update={"topic": "/b", "frame_id": "second"})
    robot = robot.model_copy(update={"lidars": robot.lidars | {"second": twin}})
    found = by_topic(simulate(world, robot, straight(), BLINK))
    first, second = (found[topic][0].message.points for topic in ("/a", "/b"))
    assert len(first) and not np.array_equal(first[:50], second[:50])


def test_scans_hit_the_shapes_that_the_lidar_is_said_to_hit(world: World) -> None:
    # Only cameras and LiDARs of visual shapes know the blue block at (-3 .. -2, 2 .. 3).
    names = {}
    for shapes, scene in (("collision", world.collision), ("visual", world.visual)):
        robot = bare_robot(shapes=shapes, rings=2, azimuths=360, fields=("object",))
        found = by_topic(simulate(world, robot, straight(), BLINK))
        objects = found["/points"][0].message.fields["object"]
        names[shapes] = {scene.names[number - 1] for number in np.unique(objects)}
    assert names["visual"] - names["collision"] == {"blue"}


def test_points_are_where_the_static_transforms_say(world: World) -> None:
    robot = bare_robot(rings=1, top_deg=0, bottom_deg=0, azimuths=4)
    found = by_topic(simulate(world, robot, straight(), SHORT))
    links = {link.child: link for link in found["/tf_static"][0].message.transforms}
    base = links["mast"].parent_from_child @ links["lidar"].parent_from_child
    assert np.allclose(base, base_from(robot, "lidar"))
    truth = {event.time_ns: event.message.pose for event in found["/ground_truth"]}
    for event in found["/points"]:
        pose = truth[event.time_ns] @ base
        points = event.message.points @ pose[:3, :3].T + pose[:3, 3]
        x = pose[0, 3]
        walls = [(2, 0, 0.5), (x, -4, 0.5), (-6, 0, 0.5), (x, 4, 0.5)]
        assert np.allclose(points, walls, atol=1e-4)


def test_scan_motion_gives_each_column_the_time_and_place_of_its_shot(world: World) -> None:
    robot = bare_robot(rings=1, top_deg=0, bottom_deg=0, azimuths=4, rate_hz=2, scan_motion=True)
    found = by_topic(simulate(world, robot, straight(speed=1.0), SHORT))
    scan = found["/points"][1].message
    assert np.allclose(scan.fields["time"], (0, 0.125, 0.25, 0.375))
    ahead, _, behind, _ = np.linalg.norm(scan.points, axis=1)
    # Stamp 0.5 s: the LiDAR is at x = -3.4, and a quarter of a second later at -3.15.
    assert ahead == pytest.approx(2 + 3.4, abs=1e-4)
    assert behind == pytest.approx(6 - 3.15, abs=1e-4)


@pytest.mark.slow
@rows("odometry_hz, source", [(50.0, "odometry"), (4.5, "imu and odometry")])
def test_sweeps_on_the_move_are_undone_by_what_the_robot_publishes(
    world: World, odometry_hz: float, source: str
) -> None:
    """It drives and sways by up to 1 rad/s: by the pose at the stamp, points are on the walls."""
    robot = merged(
        bare_robot(rings=2, top_deg=1, bottom_deg=-1, azimuths=180, rate_hz=5, scan_motion=True),
        {"imus": {"imu": {"tilt_deg": (10, 0, 90)}}, "odometry": {"rate_hz": odometry_hz}},
        new_names=True,
    )
    times = np.linspace(0, 3, 301)
    way = Trajectory(times, -4 + 0.5 * times, 0 * times, 0.8 * np.sin(1.25 * times))
    events = [*simulate(world, robot, way, SimulationConfig(seed=2))]
    rates = by_topic(events)["/imu"]
    assert len(rates) == 600 and isinstance(rates[0].message, Imu)
    worst = {}
    for deskews in (True, False):
        builder = FrameBuilder(OnlineConfig(deskew=deskews), cameras=())
        frames = [frame for event in events for frame in builder.process(event.message)]
        off = []
        for frame in frames:
            assert frame.points is not None and frame.robot_from_points is not None
            assert (frame.deskew.source if frame.deskew else "") == (source if deskews else "")
            pose = way.at(frame.stamp_ns / SECOND - 1000)[0] @ frame.robot_from_points
            x, y, _ = np.abs(frame.points @ pose[:3, :3].T + pose[:3, 3]).T
            walls = np.minimum(np.abs(x - 6), np.abs(y - 4))
            off.append(walls[(x > 3.5) | (y > 1)])
        assert len(frames) > 8
        worst[deskews] = float(np.concatenate(off).max())
    assert worst[True] < 0.04 and worst[False] > 0.3


@pytest.mark.slow
def test_a_robot_that_rides_over_hills_says_truly_where_it_is() -> None:
    """Its scans lie on the ground by the true poses, which an IMU's rates and felt weight tell."""
    ground = scene_of([floor(60.0)], [PLAIN], EVEN)
    world = World(name="field", visual=ground, collision=ground)
    robot = merged(
        bare_robot(rings=8, top_deg=-5, bottom_deg=-25, azimuths=90, scan_motion=True),
        {
            "imus": {"imu": {"gyro_noise": 0.0, "gyro_bias": 0.0, "gyro_walk": 0.0}},
            "sway": {"roll_deg": 3.0, "pitch_deg": 2.0, "yaw_deg": 2.0, "heave_m": 0.05},
        },
        new_names=True,
    )
    config = SimulationConfig(seed=4, hills=HillsConfig(height_m=1.5, length_m=40.0))
    found = by_topic(simulate(world, robot, straight(speed=1.0), config))
    truth = {event.time_ns: event.message for event in found["/ground_truth"]}
    hills = Hills(config.hills, config.seed)
    stamps_ns, poses = np.array([*truth]), np.stack([each.pose for each in truth.values()])

    def at(times_ns: Floats) -> Floats:
        before = np.searchsorted(stamps_ns, times_ns, side="right") - 1
        part = (times_ns - stamps_ns[before]) / (stamps_ns[before + 1] - stamps_ns[before])
        steps = log(inverse(poses[before]) @ poses[before + 1])
        return np.asarray(poses[before] @ exp(part[:, None] * steps))

    for event in found["/points"][1:-1]:
        scan = event.message
        times_ns = event.time_ns + np.round(scan.fields["time"].astype(np.float64) * SECOND)
        lidar = at(times_ns) @ base_from(robot, "lidar")
        places = np.einsum("nij,nj->ni", lidar[:, :3, :3], scan.points) + lidar[:, :3, 3]
        assert len(places) > 100
        np.testing.assert_allclose(places[:, 2], hills.height(places), atol=0.05)
    planned = straight(speed=1.0).at(np.array([2.0]))[0]
    ridden = truth[1002 * SECOND].pose
    assert np.abs(ridden - planned).max() > 0.1
    np.testing.assert_allclose(found["/odom"][60].message.pose, planned, atol=1e-9)
    rates = np.array([event.message.angular for event in found["/imu"]])
    turned = inverse(truth[1001 * SECOND].pose) @ truth[1003 * SECOND].pose
    steps = exp(np.c_[np.zeros((400, 3)), (rates[200:600] + rates[201:601]) / 400])
    summed = np.eye(4)
    for step in steps:
        summed = summed @ step
    np.testing.assert_allclose(summed[:3, :3], turned[:3, :3], atol=2e-3)


def test_pictures_are_taken_from_the_cameras_true_pose(world: World) -> None:
    robot = merged(robot_named("turtlebot3_waffle_pi"), {"cameras": {"camera": {"noise": 0.0}}})
    config = SimulationConfig(seconds=0.04)
    found = by_topic(simulate(world, robot, straight(), config))
    image = found["/camera/rgb/image_raw/compressed"][0].message.image
    matrix = found["/camera/rgb/camera_info"][0].message.camera_matrix
    pose = straight().at(0.0)[0] @ base_from_camera(robot, robot.cameras["camera"])
    red = (image[..., 0] > 150) & (image[..., 1] < 20)
    rows, columns = np.nonzero(red)
    # The front of the pillar: x = 2, y = -0.5 .. 0.5, top at 1.5.
    corner = np.linalg.inv(pose) @ (2, 0.5, 1.5, 1)
    u, v = (matrix @ corner[:3])[:2] / corner[2]
    assert columns.min() == pytest.approx(u, abs=1) and rows.min() == pytest.approx(v, abs=1)


def test_odometry_without_errors_is_the_truth(world: World, robot: RobotConfig) -> None:
    found = by_topic(simulate(world, robot, straight(), SHORT))
    for told, true, moved in zip(found["/odom"], found["/ground_truth"], found["/tf"], strict=True):
        seconds = told.time_ns / SECOND - 1000
        assert np.array_equal(told.message.pose, true.message.pose)
        assert told.message.pose[0, 3] == pytest.approx(-4 + 0.5 * seconds)
        assert told.message.linear == pytest.approx((0.5, 0, 0), abs=1e-6)
        (link,) = moved.message.transforms
        assert (link.parent, link.child) == ("odom", "base_footprint")
        assert np.array_equal(link.parent_from_child, told.message.pose)
    assert (told.message.frame_id, true.message.frame_id) == ("odom", "world")


def test_odometry_with_errors_leaves_the_truth_alone(world: World, robot: RobotConfig) -> None:
    wrong = merged(robot, {"odometry": {"errors": {"scale": 1.1, "turn_noise": 0.05}}})
    found = by_topic(simulate(world, wrong, straight(), SHORT))
    told, true = (found[topic][-1].message.pose for topic in ("/odom", "/ground_truth"))
    assert np.hypot(*(told[:2, 3] - (-4, 0))) > 1.05 * np.hypot(*(true[:2, 3] - (-4, 0)))
    # Its seed is that of the recording unless it is set.
    again = by_topic(simulate(world, wrong, straight(), merged(SHORT, {"seed": 9})))
    assert not np.array_equal(told, again["/odom"][-1].message.pose)
    pinned = merged(wrong, {"odometry": {"errors": {"seed": 4}}})
    both = [
        by_topic(simulate(world, pinned, straight(), merged(SHORT, {"seed": seed})))["/odom"]
        for seed in (0, 9)
    ]
    assert np.array_equal(both[0][-1].message.pose, both[1][-1].message.pose)


def test_a_trajectory_through_a_wall_is_refused_with_time_and_place(robot: RobotConfig) -> None:
    through = Trajectory(np.array([0.0, 20.0]), np.array([-4.0, 4.0]), np.zeros(2), np.zeros(2))
    with pytest.raises(DataError) as error:
        simulate(hall(), robot, through)
    assert error.value.code == "blocked"
    seconds, x, y, _ = map(float, error.value.fields)
    assert 13 <= seconds < 15 and 1 <= x < 2 and y == 0
    # The blue block is no collision shape, but the robot's camera would be inside it.
    blue = Trajectory(np.array([0.0, 20.0]), np.array([-5.0, 0.0]), np.full(2, 2.5), np.zeros(2))
    with pytest.raises(DataError, check=has_code("blocked")):
        simulate(hall(), robot, blue)


def test_closing_the_stream_early_stops_the_threads(world: World, robot: RobotConfig) -> None:
    before = threading.active_count()
    events = simulate(world, robot, straight(), jobs=2)
    for _ in range(5):
        next(events)
    assert threading.active_count() > before
    events.close()
    assert threading.active_count() == before


def test_worlds_without_names_or_walls_can_be_driven() -> None:
    nameless = hall()
    none = np.zeros(0, np.int32)
    nameless = replace(nameless, collision=replace(nameless.collision, part=none, names=()))
    robot = bare_robot(rings=2, azimuths=30, fields=("object",))
    found = by_topic(simulate(nameless, robot, straight(), BLINK))
    objects = found["/points"][0].message.fields["object"]
    assert len(objects) and not objects.any()
    scene = scene_of([floor(), block("post", (3, 3, 0), (3.2, 3.2, 1))], [PLAIN], EVEN)
    open_world = World(name="field", visual=scene, collision=scene)
    robot = bare_robot(rings=2, azimuths=30)
    still = Trajectory(np.array([0.0, 1.0]), np.full(2, 2.6), np.full(2, 2.6), np.zeros(2))
    found = by_topic(simulate(open_world, robot, still, SHORT))
    assert len(found["/points"]) == 10
