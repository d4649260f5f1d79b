# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Two scanners on a moving robot: merged clouds against true places, and live as from a bag."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bags
from error_codes import has_code
from fusionslam import Frame, FrameBuilder, open_dataset
from fusionslam.base.arrays import Floats
from fusionslam.cli.data import parse_topics
from fusionslam.datasets.bags import open_bag
from fusionslam.errors import ConfigError, DataError
from fusionslam.geometry.se3 import exp, inverse
from fusionslam.pipelines.lidar_odometry import track_lidar
from fusionslam.sensors.frame_builder import OnlineConfig
from fusionslam.sensors.messages import Event, FrameTransforms, Odometry, Scan
from fusionslam.sensors.synchronizer import SyncConfig
from rows import rows

S = bags.SECOND
START = bags.START
MOUNTS = {
    "front": exp(np.array([0.4, 0.1, 0.5, 0.0, 0.1, 0.3])),
    "rear": exp(np.array([-0.5, -0.2, 0.7, 0.1, 0.0, 2.9])),
}
"""base_from_scanner."""
TOPICS = {"points": "/front", "rear_points": "/rear"}
BEGINS = (0.2, 0.5, 0.8)
REAR_LATER_S = 0.03
SCAN_S = 0.1
MOTION = [5.0, 0.0, 0.05, 0.2, 0.0, 2.0]
"""A small motion a second."""
Logs = pytest.LogCaptureFixture


def in_odom(frame: str, seconds: Floats) -> Floats:
    """odom_from_scanner at times, (N, 4, 4)."""
    return exp(np.multiply.outer(seconds, MOTION)) @ MOUNTS[frame]


def seen_from(poses: Floats, places: Floats) -> Floats:
    """Places (N, 3) in odom as seen from N poses, or from one."""
    inverses = inverse(poses)
    return np.einsum("...ij,...j->...i", inverses[..., :3, :3], places) + inverses[..., :3, 3]


def drive(until: float = 1.1) -> tuple[list[Event], dict[str, Floats]]:
    """Odometry and scans of both scanners, each with a ray that does not return; true places."""
    links = [bags.static("base", name, mount) for name, mount in MOUNTS.items()]
    events = [Event("/tf_static", START, FrameTransforms(transforms=tuple(links)))]
    for k in range(round(50 * until)):
        stamp = START + k * S // 50
        pose = exp(np.array(MOTION) * k / 50)
        moved = Odometry(stamp_ns=stamp, frame_id="odom", child_frame_id="base", pose=pose)
        events.append(Event("/odom", stamp, moved))
    random, times, places = np.random.default_rng(5), np.linspace(0, SCAN_S, 200), {}
    for name in MOUNTS:
        places[name] = random.uniform((-10, -20, -2), (20, 20, 4), (200, 3))
        for at in BEGINS:
            at += REAR_LATER_S * (name == "rear")
            points = seen_from(in_odom(name, at + times), places[name]).astype(np.float32)
            points[7] = np.nan
            fields = {"time": times.astype(np.float32), "intensity": times.astype(np.float32)}
            stamp = START + round(at * S)
            scan = Scan(stamp_ns=stamp, frame_id=name, points=points, fields=fields)
            events.append(Event(f"/{name}", stamp + round(SCAN_S * S), scan))
    return sorted(events, key=lambda event: event.time_ns), places


def build(builder: FrameBuilder, events: Iterable[Event]) -> list[Frame]:
    names = {topic: role for role, topic in TOPICS.items()}
    frames = [
        frame
        for event in events
        for frame in builder.process(event.message, names.get(event.topic, "left"))
    ]
    return frames + builder.flush()


def merging(config: OnlineConfig | None = None) -> FrameBuilder:
    return FrameBuilder(config, cameras=(), scanners=("rear_points",))


def read(path: Path, **options: Any) -> list[Frame]:
    options = {"topics": TOPICS, "sensors": ["points"], **options}
    return [*open_dataset(path, **options)]


def same_clouds(frames: list[Frame], others: list[Frame]) -> bool:
    """Whether clouds of frames are equal, bit for bit."""
    assert len(frames) == len(others)
    for one, other in zip(frames, others, strict=True):
        for each in ("points", "intensities", "point_seconds"):
            first, second = getattr(one, each), getattr(other, each)
            if (first is None) != (second is None) or not np.array_equal(first, second):
                return False
    return True


def test_all_points_are_where_the_leading_scanner_would_have_seen_them_at_its_stamp() -> None:
    events, places = drive()
    frames = build(builder := merging(), events)
    assert len(frames) == 3 and not builder.skewed and not builder.scanners.missing
    true = np.concatenate([np.delete(places[name], 7, axis=0) for name in MOUNTS])
    for frame in frames:
        assert frame.points is not None and frame.deskew is not None
        at = np.array((frame.stamp_ns - START) / S)
        off = np.linalg.norm(frame.points - seen_from(in_odom("front", at), true), axis=1)
        # The bound that is asked for is 2 cm.
        assert off.max() < 0.004
        assert frame.deskew.span == pytest.approx((0.0, REAR_LATER_S + SCAN_S))


def test_merged_clouds_are_the_same_live_and_from_a_bag(tmp_path: Path) -> None:
    path = bags.write_bag(tmp_path / "drive.bag", drive()[0])
    with open_bag(path) as bag:
        events = list(bag.events())
    live, stored = build(merging(), events), read(path)
    assert [len(frame.points) for frame in stored if frame.points is not None] == [398] * 3
    assert same_clouds(live, stored)
    raw = build(merging(OnlineConfig(deskew=False)), events)
    assert raw[0].point_seconds is not None and raw[0].point_seconds.max() > SCAN_S
    assert same_clouds(raw, read(path, deskew=False))
    # Only a scanner that is named is merged, and which ones were is in the recording's name.
    alone = read(path, topics={"points": "/front"})
    assert same_clouds(alone, build(FrameBuilder(cameras=()), bags.without(events, "/rear")))
    dataset = open_dataset(path, topics=TOPICS, sensors=["points"])
    assert "/front, /rear" in dataset.name and dataset.counts == dict.fromkeys(TOPICS, 3)
    assert same_clouds([*dataset.of_leader()], alone) and same_clouds(list(dataset[1:]), stored[1:])


def test_messages_in_any_order_give_the_same_clouds() -> None:
    events = drive()[0]
    late = sorted(events, key=lambda each: each.time_ns + 2 * 10**8 * (each.topic == "/rear"))
    static_last = [*events[1:10], events[0], *events[10:]]
    for other in (late, static_last):
        assert same_clouds(build(merging(OnlineConfig(wait=1.0)), other), build(merging(), events))


def test_a_frame_waits_for_the_scan_of_its_partner_and_its_last_point_only() -> None:
    builder, late = merging(), []
    for event in drive()[0]:
        sensor = "rear_points" if event.topic == "/rear" else ""
        late += [event.time_ns - each.stamp_ns for each in builder.process(event.message, sensor)]
    assert len(late) == 3
    assert max(late) <= (REAR_LATER_S + SCAN_S + 0.02) * S


def test_a_scan_without_partner_is_used_alone_and_counted(tmp_path: Path, caplog: Logs) -> None:
    events = [e for e in drive()[0] if e.topic != "/rear" or e.time_ns > START + 0.4 * S]
    frames = build(builder := merging(), events)
    assert builder.scanners.missing == {"rear_points": 1}
    assert [len(frame.points) for frame in frames if frame.points is not None] == [199, 398, 398]
    assert "no scan of rear_points lies within 0.05 s" in caplog.text
    caplog.clear()
    assert same_clouds(frames, read(bags.put_bag(tmp_path, events)))
    assert "1 of 3 scans have no message of /rear near" in caplog.text


def test_a_scanner_that_fell_silent_holds_up_no_frame() -> None:
    events = [e for e in drive()[0] if e.topic != "/rear" or e.time_ns < START + 0.4 * S]
    builder, frames = merging(OnlineConfig(wait=0.31)), []
    for event in events:
        frames += builder.process(event.message, "rear_points" if event.topic == "/rear" else "")
    assert len(frames) == 3 and builder.scanners.missing == {"rear_points": 2}


def moved_clock(seconds: float) -> Callable[[Event], Event]:
    def change(event: Event) -> Event:
        scan = event.message
        if event.topic != "/rear" or not isinstance(scan, Scan):
            return event
        return replace(event, message=replace(scan, stamp_ns=scan.stamp_ns + round(seconds * S)))

    return change


@rows("seconds", [3600.0, -3600.0, 0.12])
def test_a_scanner_by_another_clock_is_named(tmp_path: Path, caplog: Logs, seconds: float) -> None:
    events = [*map(moved_clock(seconds), drive()[0])]
    path = bags.write_bag(tmp_path / f"{seconds:g}.bag", events)
    with pytest.raises(
        DataError, match=r"/rear .*stamps are .*", check=has_code("no-pairs", "/front", "/rear")
    ):
        read(path)
    caplog.clear()
    frames = build(builder := merging(), events)
    assert len(frames) == 3 and builder.scanners.missing == {"rear_points": 3}
    assert f"its newest is {'+' if seconds > 0 else '-'}" in caplog.text


def test_times_of_arrival_find_the_partners_of_another_clock(tmp_path: Path) -> None:
    path = bags.put_bag(tmp_path, map(moved_clock(3600.0), drive()[0]))
    frames = read(path, stamps="bag")
    assert [len(frame.points) for frame in frames if frame.points is not None] == [398] * 3
    near = SyncConfig(scan_difference=0.01)
    with pytest.raises(DataError, check=has_code("no-pairs", "/front", "/rear")):
        read(path, stamps="bag", sync=near)


def test_a_scanner_that_tf_does_not_place_is_named(tmp_path: Path, caplog: Logs) -> None:
    link = FrameTransforms(transforms=(bags.static("base", "front", MOUNTS["front"]),))
    events = [replace(e, message=link) if e.topic == "/tf_static" else e for e in drive()[0]]
    with pytest.raises(DataError, match="/rear", check=has_code("no-frame", "rear")):
        read(bags.put_bag(tmp_path, events))
    caplog.clear()
    frames = build(builder := merging(), events)
    assert builder.scanners.missing == {"rear_points": 3}
    assert same_clouds(frames, build(FrameBuilder(cameras=()), bags.without(events, "/rear")))
    assert "no frame 'rear'" in caplog.text


def test_a_scanner_that_moves_on_the_robot_is_merged_from_when_tf_places_it(tmp_path: Path) -> None:
    events = drive()[0]
    link = FrameTransforms(transforms=(bags.static("base", "front", MOUNTS["front"]),))
    events = [replace(e, message=link) if e.topic == "/tf_static" else e for e in events]
    for k in range(20, 55):
        stamp = START + k * S // 50
        place = bags.static("base", "rear", MOUNTS["rear"])
        turned = FrameTransforms(transforms=(replace(place, stamp_ns=stamp, static=False),))
        events.append(Event("/tf", stamp + S // 7, turned))
    events.sort(key=lambda event: event.time_ns)
    frames = build(builder := merging(), events)
    assert [len(frame.points) for frame in frames if frame.points is not None] == [199, 398, 398]
    assert builder.scanners.missing == {"rear_points": 1}
    assert same_clouds(frames, read(bags.put_bag(tmp_path, events)))


def test_a_scanner_without_times_of_points_is_named(tmp_path: Path, caplog: Logs) -> None:
    events = [*bags.changed(drive()[0], "/rear", fields={"intensity": np.zeros(200, np.float32)})]
    frames = build(merging(), events)
    assert caplog.text.count("points of 'rear' have no times") == 1
    caplog.clear()
    assert same_clouds(frames, read(bags.put_bag(tmp_path, events)))
    assert caplog.text.count("points of 'rear' have no times") == 1
    assert frames[0].deskew is not None


def test_a_bag_of_several_scanners_says_how_they_are_merged(tmp_path: Path, caplog: Logs) -> None:
    path = bags.put_bag(tmp_path, drive()[0])
    open_dataset(path)
    assert "--topic NAME_points=" in caplog.text


def test_a_role_that_is_given_twice_is_refused() -> None:
    assert parse_topics(["points=/front", "rear_points=/rear"]) == TOPICS
    with pytest.raises(
        ConfigError, match="NAME_points", check=has_code("given-twice", "--topic", "points")
    ):
        parse_topics(["points=/front", "points=/rear"])
    with pytest.raises(ConfigError, check=has_code("given-twice", "--topic", "imu")):
        parse_topics(["imu=/a", "imu=/a"])


@rows("role", ["_points", "a b_points", "rear_point"])
def test_wrong_names_of_scanners_are_refused(tmp_path: Path, role: str) -> None:
    path = bags.write_bag(tmp_path / "drive.bag", drive(0.5)[0])
    with pytest.raises(ConfigError):
        open_dataset(path, topics={"points": "/front", role: "/rear"})


def test_a_scanner_needs_a_topic_of_clouds(tmp_path: Path) -> None:
    path = bags.put_bag(tmp_path, drive(0.5)[0])
    with pytest.raises(DataError, check=has_code("topic-type", "/odom", "rear_points")):
        open_dataset(path, topics={"points": "/front", "rear_points": "/odom"})


@pytest.mark.slow
def test_a_simulated_robot_sees_the_walls_where_they_are_with_both_scanners(tmp_path: Path) -> None:
    pytest.importorskip("embreex", reason="the simulator is an extra")
    pytest.importorskip("kiss_icp", reason="odometry by scans is an extra")
    from fusionslam.sim.simulator import SimulationConfig, simulate
    from worlds import hall, two_scanners, winding

    way = winding()
    driven = simulate(hall(), two_scanners(), way, SimulationConfig(seed=2))
    path = bags.write_bag(tmp_path / "hall.bag", driven)
    dataset = open_dataset(path, topics=TOPICS, sensors=["points"])
    off, behind = [], 0
    for frame in dataset:
        assert frame.points is not None and frame.robot_from_points is not None
        if frame.deskew is None:  # odometry ends before the last sweep
            continue
        pose = way.at(frame.stamp_ns / S - 1000)[0] @ frame.robot_from_points
        x, y, z = (frame.points @ pose[:3, :3].T + pose[:3, 3]).T
        walls = np.min(np.abs([x - 6, x + 6, y - 4, y + 4]), axis=0)
        off.append(walls[(z > 0.1) & ~((np.abs(x - 2.5) < 0.6) & (np.abs(y) < 0.6))])
        behind += int((x < -5.9).sum())
    assert len(off) >= 27 and behind > 1000
    found = np.concatenate(off)
    # The bound that is asked for is 2 cm; the scanners' noise is 1 cm.
    assert np.median(found) < 0.01 and np.percentile(found, 95) < 0.025
    # Odometry by scans takes those of the leading scanner, as nodes do.
    alone = open_dataset(path, topics={"points": "/front"}, sensors=["points"])
    tracks = [track_lidar(each) for each in (dataset, alone)]
    np.testing.assert_array_equal(tracks[0].poses, tracks[1].poses)
