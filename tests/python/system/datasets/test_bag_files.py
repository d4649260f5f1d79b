# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Bags as files: written, and read again the same."""

import dataclasses
import io
import json
import resource
import subprocess
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from bags import (
    SECOND,
    START,
    SUFFIXES,
    drive,
    extrinsics,
    odometry,
    picture,
    same,
    scan,
    write_bag,
)
from error_codes import has_code
from fusionslam.datasets import open_bag, open_writer
from fusionslam.errors import ConfigError, DataError
from fusionslam.sensors.messages import Event, FrameTransforms, Picture, Scan
from rows import rows

SYSTEM_PYTHON = Path("/usr/bin/python3")
KINDS = {"bag": "rosbag1", "db3": "rosbag2", "mcap": "mcap"}


def all_kinds_of_messages() -> list[Event]:
    """A drive, with clouds of every make and grey images besides."""
    rng = np.random.default_rng(2)
    points = rng.normal(size=(12, 3)).astype(np.float32)
    points[3] = np.nan
    names = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")
    fields = {name: np.arange(12, dtype=name) for name in names}
    colors = rng.integers(0, 256, (12, 3), dtype=np.uint8)
    about: dict[str, Any] = {"stamp_ns": START, "frame_id": "top"}
    full = Scan(**about, points=points, fields=fields, colors=colors, width=4)
    empty = Scan(**about, points=np.zeros((0, 3), np.float32))
    grey = Picture(stamp_ns=START, frame_id="", image=rng.integers(0, 256, (5, 3), dtype=np.uint8))
    later = START + 3 * SECOND
    return [
        *drive(),
        *(Event("/top", later, s) for s in (full, empty)),
        Event("/grey", later, grey),
    ]


@rows("images", ["raw", "png"])
@rows("suffix", SUFFIXES)
def test_what_is_written_is_read_field_by_field(tmp_path: Path, suffix: str, images: str) -> None:
    events = all_kinds_of_messages()
    with open_bag(write_bag(tmp_path / f"drive.{suffix}", events, images=images)) as bag:
        found = list(bag.events())
        assert bag.kind == KINDS[suffix] and not bag.is_cut
        assert {name: topic.count for name, topic in bag.topics.items()} == Counter(
            event.topic for event in events
        )
        assert (bag.start_ns, bag.stop_ns) == (START, START + 3 * SECOND)
    for topic in {event.topic for event in events}:
        wanted = [(e.time_ns, e.message) for e in events if e.topic == topic]
        got = [(e.time_ns, e.message) for e in found if e.topic == topic]
        assert same(tuple(got), tuple(wanted)), topic
    assert not list(tmp_path.glob(".*")), "temporary files are gone"


@rows("suffix", SUFFIXES)
def test_jpeg_pictures_are_those_that_pillow_writes(tmp_path: Path, suffix: str) -> None:
    noise = np.random.default_rng(5).integers(0, 256, (16, 16, 3), dtype=np.uint8)
    event = Event("/image", START, dataclasses.replace(picture(), image=noise))
    path = write_bag(tmp_path / f"drive.{suffix}", [event], images={"/image": "jpeg"})
    memory = io.BytesIO()
    Image.fromarray(noise).save(memory, "JPEG", quality=95)
    with open_bag(path) as bag:
        (raw,) = bag.raw()
        assert raw.type == "sensor_msgs/CompressedImage"
        assert raw.content.data.tobytes() == memory.getvalue()
        assert raw.content.format == "rgb8; jpeg compressed bgr8"
        (event,) = bag.events()
    np.testing.assert_array_equal(event.message.image, np.array(Image.open(memory)))


READ_WITH_ROSBAG = """
import json, rosbag
bag = rosbag.Bag({path!r})
found = dict()
for topic, message, time in bag.read_messages():
    found.setdefault(topic, []).append([message._type, time.to_nsec()])
    if topic == "/odom":
        position = message.pose.pose.position.x
    if topic == "/points":
        points = [message.width, message.point_step, [f.name for f in message.fields]]
        data = message.data.hex()
print(json.dumps([found, position, points, data]))
"""


def test_the_rosbag_tool_of_debian_reads_our_ros_1_bags(tmp_path: Path) -> None:
    clean = {"PATH": "/usr/bin:/bin"}
    probe = [SYSTEM_PYTHON, "-c", "import rosbag, sensor_msgs.msg, tf2_msgs.msg"]
    if (
        not SYSTEM_PYTHON.exists()
        or subprocess.run(probe, env=clean, capture_output=True).returncode
    ):
        pytest.skip("python3-rosbag is not installed for /usr/bin/python3")
    events = drive()
    path = write_bag(tmp_path / "drive.bag", events, images="jpeg")
    script = READ_WITH_ROSBAG.format(path=str(path))
    result = subprocess.run(
        [SYSTEM_PYTHON, "-c", script], env=clean, capture_output=True, text=True, timeout=300
    )
    assert result.returncode == 0, result.stderr
    found, position, (width, step, names), data = json.loads(result.stdout)
    assert {topic: len(each) for topic, each in found.items()} == Counter(
        event.topic for event in events
    )
    assert found["/tf_static"] == [["tf2_msgs/TFMessage", START]]
    assert position == 1.0  # after 2 s at 0.5 m/s
    last = [event.message for event in events if event.topic == "/points"][-1]
    assert (width, names) == (41, ["x", "y", "z", "intensity", "ring"])
    assert np.frombuffer(bytes.fromhex(data)[:12], "<f4").tolist() == last.points[0].tolist()
    assert step == 18


@rows("suffix", SUFFIXES)
def test_events_can_be_chosen_by_topic_and_time_of_arrival(tmp_path: Path, suffix: str) -> None:
    together = [Event("/o", START, odometry(START + k)) for k in range(3)]
    with open_bag(write_bag(tmp_path / f"drive.{suffix}", [*drive(), *together])) as bag:
        events = bag.events(["/points"], start=START + SECOND // 2, stop=START + 2 * SECOND)
        times = [(event.time_ns - START) / SECOND for event in events]
        assert times == [0.5, 1.0, 1.5]
        assert same(bag.message("/points", START + SECOND), scan(START + SECOND, 3.5))
        stamps = [bag.message("/o", START, k).stamp_ns for k in range(3)]
        assert stamps == [START, START + 1, START + 2]
        with pytest.raises(DataError, check=has_code("no-message", "/o", START)):
            bag.message("/o", START, 3)
        # Two readers do not disturb each other.
        pairs = list(zip(bag.events(), bag.events(), strict=True))
        assert len(pairs) == len(drive()) + 3 and all(same(a.message, b.message) for a, b in pairs)


def test_values_that_have_no_message_are_refused(tmp_path: Path) -> None:
    bad = [
        (dataclasses.replace(scan(), fields={"id": np.zeros(41, np.int64)}), "'id' .*int64"),
        (dataclasses.replace(scan(), fields={"id": np.zeros(3)}), r"'id' .*\(3,\)"),
        (dataclasses.replace(scan(), width=7), "width 7"),
        (dataclasses.replace(scan(), stamp_ns=-1), "-1 ns"),
        (dataclasses.replace(picture(), image=np.zeros((2, 2, 4), np.uint8)), r"\(2, 2, 4\)"),
        (extrinsics(), "'velodyne'"),
    ]
    with open_writer(tmp_path / "x.bag") as bag:
        for message, word in bad:
            with pytest.raises(DataError, match=f"/x: .*{word}"):
                bag.write(Event("/x", START, message))
        bag.write(Event("/x", START, odometry(START)))
        with pytest.raises(DataError, match=r"/x: .*TFMessage.*Odometry"):
            bag.write(Event("/x", START, FrameTransforms(transforms=())))
        with pytest.raises(DataError, match=r"/x: .*-5 ns"):
            bag.write(Event("/x", -5, odometry(START)))
    with open_bag(tmp_path / "x.bag") as bag:
        assert [event.topic for event in bag.events()] == ["/x"]


def test_a_bag_replaces_a_bag_and_nothing_else(tmp_path: Path) -> None:
    for suffix in SUFFIXES:
        path = write_bag(tmp_path / f"drive.{suffix}", drive(1))
        write_bag(path, drive(0.1))
        with open_bag(path) as bag:
            assert bag.topics["/points"].count == 1
    (tmp_path / "drive.db3" / "thesis.txt").write_text("precious")
    refused: tuple[tuple[type[Exception], str, str, dict[str, Any]], ...] = (
        (DataError, "drive.db3", r"thesis\.txt", {}),
        (DataError, "drive.db3", r"drive\.db3", {"format": "mcap"}),
        (ConfigError, "drive", r"\.bag, \.db3, \.mcap", {}),
        (ConfigError, "drive.bag", r"images .*'tiff'", {"images": "tiff"}),
    )
    for error, name, words, options in refused:
        with pytest.raises(error, match=words):
            write_bag(tmp_path / name, drive(0.1), **options)


def test_memory_stays_flat_while_a_bag_is_read(tmp_path: Path) -> None:
    """120 MB of images are read within 40 MB more than a few of them take."""
    images = (Event("/i", START + k, picture(START + k, (640, 480))) for k in range(130))
    path = write_bag(tmp_path / "drive.mcap", images)
    with open_bag(path) as bag:
        next(bag.events())
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        assert sum(event.message.image.nbytes for event in bag.events()) > 115e6
        assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024 < 40e6


def test_a_bag_of_unknown_types_lists_them_and_reads_the_others(tmp_path: Path) -> None:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer(tmp_path / "x.bag") as writer:
        connection = writer.add_connection("/text", "std_msgs/msg/String", typestore=store)
        text = store.types["std_msgs/msg/String"](data="hello")
        writer.write(connection, START, store.serialize_ros1(text, "std_msgs/msg/String"))
    with open_bag(tmp_path / "x.bag") as bag:
        assert bag.topics["/text"].type == "std_msgs/String" and not list(bag.events())
        with pytest.raises(DataError, check=has_code("topic-type", "/text")):
            list(bag.events(["/text"]))
        with pytest.raises(DataError, check=has_code("no-topic", "/odom")):
            list(bag.events(["/odom"]))


@rows("suffix", SUFFIXES)
def test_a_bag_without_messages_has_no_topics(tmp_path: Path, suffix: str) -> None:
    with open_bag(write_bag(tmp_path / f"drive.{suffix}", [])) as bag:
        assert not bag.topics and not list(bag.events()) and bag.start_ns == bag.stop_ns == 0


@rows("mode", ["FILE", "MESSAGE", "STORAGE"])
def test_compressed_bags_of_ros_2_are_read(tmp_path: Path, mode: str) -> None:
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer

    plain = write_bag(tmp_path / "plain.db3", drive(0.5))
    plugin = StoragePlugin.MCAP if mode == "STORAGE" else StoragePlugin.SQLITE3
    packed = Writer(tmp_path / "packed", version=8, storage_plugin=plugin)
    packed.set_compression(CompressionMode[mode], CompressionFormat.ZSTD)
    with Reader(plain) as source, packed:
        connections = {
            each.topic: packed.add_connection(
                each.topic, each.msgtype, msgdef=each.msgdef.data, rihs01=each.digest
            )
            for each in source.connections
        }
        for connection, time_ns, data in source.messages():
            packed.write(connections[connection.topic], time_ns, data)
    with open_bag(plain) as first, open_bag(tmp_path / "packed") as second:
        assert second.kind == ("mcap" if mode == "STORAGE" else "rosbag2")
        pairs = zip(first.events(), second.events(), strict=True)
        assert all(same(a.message, b.message) for a, b in pairs)
