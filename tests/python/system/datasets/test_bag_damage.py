# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Bags that are cut, damaged, on full disks, or expand to more than a limit."""

import bz2
import struct
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Reader, Writer
from rosbags.rosbag1 import reader as rosbag1_reader
from rosbags.rosbag2 import reader as rosbag2_reader
from rosbags.rosbag2 import storage_mcap
from rosbags.rosbag2 import writer as rosbag2_writer

from bags import SECOND, START, SUFFIXES, drive, odometry, picture, same, without, write_bag
from cli import info_of, succeeds
from error_codes import has_code
from fusionslam.base import files
from fusionslam.datasets import open_bag, open_dataset, open_writer
from fusionslam.datasets.bags import stores
from fusionslam.datasets.bags.dataset import BagDataset
from fusionslam.datasets.bags.stores import bound_decompression
from fusionslam.errors import DataError
from fusionslam.sensors.messages import Event
from permissions import limited_files, small_disk
from rows import rows

Logs = pytest.LogCaptureFixture


@rows("suffix", ["bag", "mcap"])
def test_a_bag_cut_in_half_gives_what_is_whole(tmp_path: Path, suffix: str, caplog: Logs) -> None:
    big = [Event("/image", START + k, picture(START + k, (640, 480))) for k in range(12)]
    path = write_bag(tmp_path / f"drive.{suffix}", [*drive(0.1), *big])
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with open_bag(path) as bag:
        found = [event.message for event in bag.events(["/image"])]
        assert bag.is_cut and 4 <= len(found) <= 6 and len(found) == bag.topics["/image"].count
        assert all(same(a, b.message) for a, b in zip(found, big, strict=False))
        assert same(bag.message("/image", START + 3), big[3].message)
    assert [record.args[0] for record in caplog.records] == [path]


def test_a_database_that_is_cut_or_damaged_is_refused_by_name(tmp_path: Path) -> None:
    cut = write_bag(tmp_path / "drive.db3", drive(10)) / "drive.db3"
    cut.write_bytes(cut.read_bytes()[: cut.stat().st_size // 2])
    damaged = tmp_path / "damaged.db3"
    damaged.write_bytes(b"SQLite format 3\0" + b"noise" * 500)
    for path in (cut, damaged):
        with pytest.raises(DataError) as error:
            open_bag(path)
        assert str(error.value).count(str(path)) == 1


@rows("suffix", SUFFIXES)
def test_files_that_are_no_bags_are_refused_by_name(tmp_path: Path, suffix: str) -> None:
    path, empty = tmp_path / f"drive.{suffix}", tmp_path / "empty"
    with pytest.raises(DataError, check=has_code("missing-file", path)):
        open_bag(path)
    path.write_bytes(b"")
    with pytest.raises(DataError, check=has_code("empty-file", path)):
        open_bag(path)
    path.write_bytes(b"what is this?" * 100)
    with pytest.raises(DataError, match=r"b'what is this\?wha'", check=has_code("not-a-bag", path)):
        open_bag(path)
    with pytest.raises(DataError, check=has_code("cannot-write")):
        write_bag(path / f"drive.{suffix}", drive(0.1))
    empty.mkdir()
    (empty / "drive.db3").symlink_to("drive.db3")
    with pytest.raises(DataError, match=r"drive\.db3"):
        open_bag(empty)
    (empty / "drive.db3").unlink()
    with pytest.raises(DataError, match=r"\.db3 .*\.mcap", check=has_code("not-a-bag", empty)):
        open_bag(empty)


@rows("start", [b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"SQLite format 3\0"])
def test_bytes_behind_the_first_of_a_bag_are_refused_in_words(tmp_path: Path, start: bytes) -> None:
    random = np.random.default_rng(0)
    for size in (0, 3, 90, 900):
        path = tmp_path / f"{size}.bag"
        path.write_bytes(start + random.bytes(size))
        with pytest.raises(DataError) as refused:
            open_bag(path)
        assert str(refused.value).startswith(str(path)) and "', " not in str(refused.value)


MIDDLE = START + SECOND


def open_with_one_refused(path: Path) -> BagDataset:
    dataset = open_dataset(path)
    assert isinstance(dataset, BagDataset)
    assert [count for count, _ in dataset.source.refused.values()] == [1]
    return dataset


@pytest.mark.parametrize("suffix", SUFFIXES)
@rows("topic", ["/odom", "/points", "/camera/image", "/camera/camera_info"])
def test_one_message_that_cannot_be_decoded_is_left_out_counted_and_named(
    tmp_path: Path, suffix: str, topic: str, caplog: Logs
) -> None:
    def cut(name: str, time_ns: int) -> bool:
        return (name, time_ns) == (topic, MIDDLE)

    path = write_bag(tmp_path / f"drive.{suffix}", drive(), cut=cut)
    dataset = open_with_one_refused(path)
    (warning,) = [str(record.args) for record in caplog.records if record.levelname == "WARNING"]
    assert topic in warning and f"{MIDDLE / 1e9:.3f} s" in warning
    assert len(dataset) == (4 if topic == "/points" else 5)
    assert all(len(frame.points) == 41 and frame.images["left"].any() for frame in dataset)
    assert len(dataset.motion("odometry")) == (100 if topic == "/odom" else 101)
    out = info_of(path)
    assert f"1 message: {topic}, arrived at {MIDDLE / 1e9:.3f} s" in out


# Height and width as stored, and wrong ones, by topic.
SIZES = {
    "/points": (struct.pack("<II", 1, 41), struct.pack("<II", 1, 42)),
    "/camera/image": (struct.pack("<II", 48, 64), struct.pack("<II", 96, 64)),
}


@pytest.mark.parametrize("topic", [*SIZES])
@rows("suffix", SUFFIXES)
def test_what_is_shorter_than_it_says_is_left_out_by_commands(
    tmp_path: Path, suffix: str, topic: str
) -> None:
    def bend(name: str, time_ns: int, data: bytes) -> bytes:
        return data.replace(*SIZES[topic], 1) if (name, time_ns) == (topic, MIDDLE) else data

    path = write_bag(tmp_path / f"drive.{suffix}", drive(), bend=bend)
    dataset = open_with_one_refused(path)
    assert len(dataset) == (4 if topic == "/points" else 5)
    assert all(len(frame.points) == 41 and frame.images["left"].any() for frame in dataset)
    images = dataset.camera_images()
    assert images is not None and len(images.seconds) == (21 if topic == "/points" else 20)
    assert all(images.image(row).any() for row in range(len(images.seconds)))
    for command in ("fuse", "views record"):
        to = tmp_path / f"{command}.npz" if command != "fuse" else tmp_path / command
        succeeds(*command.split(), path, "-o", to)


@rows("stored", ["jpeg", "png"])
def test_a_picture_that_is_cut_is_left_out(tmp_path: Path, stored: str) -> None:
    first = b"\xff\xd8" if stored == "jpeg" else b"\x89PNG"

    def bend(name: str, time_ns: int, data: bytes) -> bytes:
        if (name, time_ns) != ("/camera/image", MIDDLE):
            return data
        start = data.index(first)
        half = (len(data) - start) // 2
        return data[: start - 4] + struct.pack("<I", half) + data[start : start + half]

    path = write_bag(tmp_path / "drive.bag", drive(), bend=bend, images=stored)
    dataset = open_with_one_refused(path)
    assert dataset.counts["left"] == 20
    assert all(frame.images["left"].any() for frame in dataset)


@rows("suffix", SUFFIXES)
def test_messages_of_the_same_time_as_a_lost_one_are_found(tmp_path: Path, suffix: str) -> None:
    lost = iter([True])
    events = [Event("/image", START, picture(START + k, (8 + k, 6))) for k in range(3)]
    path = write_bag(tmp_path / f"drive.{suffix}", events, cut=lambda *_: next(lost, False))
    assert [frame.images["left"].shape[1] for frame in open_dataset(path)] == [9, 10]


def test_a_topic_of_which_no_message_can_be_decoded_is_an_error(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "drive.bag", drive(), cut=lambda topic, _: topic == "/odom")
    with pytest.raises(DataError, check=has_code("undecodable", "/odom")):
        open_dataset(path)
    assert len(open_dataset(path, topics={"odometry": ""})) == 5


@rows("suffix", SUFFIXES)
def test_a_bag_whose_transforms_cannot_be_decoded_opens_like_one_without(
    tmp_path: Path, suffix: str, caplog: Logs
) -> None:
    topic, scans = "/tf_static", without(drive(), "/camera/image")
    bare = open_dataset(write_bag(tmp_path / f"bare.{suffix}", without(scans, topic)))
    caplog.clear()
    path = write_bag(tmp_path / f"cut.{suffix}", scans, cut=lambda name, _: name == topic)
    dataset = open_with_one_refused(path)
    assert sum(f"{topic}, arrived at {START / 1e9:.3f} s" in text for text in caplog.messages) == 1
    assert (len(dataset), dataset.sensors) == (len(bare), bare.sensors) == (5, ("points",))
    for one, other in zip(dataset, bare, strict=True):
        assert np.array_equal(one.points, other.points)
        assert one.robot_from_points is other.robot_from_points is None
    succeeds("fuse", path, "-o", tmp_path / "out")


def test_a_topic_whose_messages_the_index_gives_to_another_is_an_error(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "drive.bag", drive(0.1))
    content = bytearray(path.read_bytes())
    # In the table of connections at the end, before each topic's name: "conn=" and its number.
    numbers = {
        topic: content.rindex(b"conn=", 0, content.rindex(b"topic=" + topic)) + 5
        for topic in (b"/odom", b"/points")
    }
    content[numbers[b"/odom"]] = content[numbers[b"/points"]]
    path.write_bytes(content)
    with pytest.raises(DataError, check=has_code("no-messages", "/odom")):
        open_dataset(path)


@rows("suffix", SUFFIXES)
def test_an_error_while_writing_keeps_what_was_written_and_the_bag_before(
    tmp_path: Path, suffix: str, caplog: Logs
) -> None:
    path = write_bag(tmp_path / f"drive.{suffix}", drive(0.1))

    def stops() -> Iterator[Event]:
        yield from drive(1)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_bag(path, stops())
    with open_bag(path) as bag, open_bag(tmp_path / f"drive.partial.{suffix}") as rest:
        assert bag.topics["/points"].count == 1 and rest.topics["/points"].count == 3
        assert not rest.is_cut
    assert f"{tmp_path}/drive.partial.{suffix}" in caplog.text


def fill(path: Path, limit: int | None = None) -> str:
    """Write pictures until they do not fit; what is said then."""
    with limited_files(limit), pytest.raises(DataError) as full, open_writer(path) as bag:
        for k in range(20):
            bag.write(Event("/image", START + k, picture(START + k, (640, 480))))
    return str(full.value)


def check_partial(path: Path, message: str) -> None:
    partial = path.with_name(f"{path.stem}.partial{path.suffix}")
    assert str(path) in message and str(partial) in message
    assert not path.exists() and not list(path.parent.glob(".*"))
    with open_bag(partial) as bag:
        found = [event.message for event in bag.events()]
        assert 3 <= len(found) < 20 and len(found) == bag.topics["/image"].count
    for k, event_message in enumerate(found):
        assert same(event_message, picture(START + k, (640, 480)))


@rows("suffix", SUFFIXES)
def test_a_file_that_may_not_grow_keeps_what_can_be_read(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"drive.{suffix}"
    for limit in (3_000, 300_000):
        assert str(path) in fill(path, limit)
        assert not list(tmp_path.iterdir())
    check_partial(path, fill(path, limit=12_000_000))


@rows("suffix", SUFFIXES)
def test_a_full_disk_keeps_what_is_whole(tmp_path: Path, suffix: str) -> None:
    with small_disk(tmp_path, "12m"):
        path = tmp_path / f"drive.{suffix}"
        message = fill(path)
        assert "No space left" in message or "disk is full" in message
        check_partial(path, message)


def test_a_broken_message_or_one_of_another_definition_is_refused(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "drive.bag", [Event("/odom", START, odometry(START))])
    content = path.read_bytes()
    for right, wrong, words in (
        (b"\x04\x00\x00\x00odom", b"\xff\xff\xff\x00odom", f"/odom.*{START / 1e9:.3f} s"),
        (
            b"md5sum=cd5e73d190d741a2f92e81eda573aca7",
            b"md5sum=" + b"0" * 32,
            "/odom .*nav_msgs/Odom",
        ),
    ):
        assert right in content
        path.write_bytes(content.replace(right, wrong))
        with open_bag(path) as bag, pytest.raises(DataError, match=words):
            list(bag.events())


def test_without_rosbags_its_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_bag(tmp_path / "drive.bag", drive(0.1))
    monkeypatch.setitem(sys.modules, "rosbags.rosbag1", None)
    with pytest.raises(DataError, check=has_code("missing-extra", "bags")):
        open_bag(path)


lz4 = pytest.importorskip("lz4.frame")
ZEROS = bytes(1 << 20)


def limit_expansion(monkeypatch: pytest.MonkeyPatch, most: int) -> None:
    bound_decompression()
    for module in (files, stores):
        monkeypatch.setattr(module, "MOST_EXPANDED", most)


def test_what_expands_beyond_the_limit_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    limit_expansion(monkeypatch, 1 << 19)
    packed = rosbag2_writer.zstd.compress(ZEROS)  # of Python, or its backport
    from_lz4, from_zstd = (storage_mcap.DECOMPRESSORS[name] for name in ("lz4", "zstd"))
    of_whole = (
        (rosbag1_reader.decompressors["bz2"], bz2.compress(ZEROS)),
        (rosbag1_reader.decompressors["lz4"], lz4.compress(ZEROS)),
        (rosbag2_reader.zstd.decompress, packed),
    )
    declared = (
        (lambda data: from_lz4(data, 1000), lz4.compress(ZEROS)),
        (lambda data: from_zstd(data, 1000), packed),
        (lambda data: from_zstd(data, 1 << 40), packed),
    )
    for expand, data in (*of_whole, *declared):
        with pytest.raises(ValueError, match="expand"):
            expand(data)
    limit_expansion(monkeypatch, 1 << 21)
    for expand, data in of_whole:
        assert expand(data) == ZEROS
        with pytest.raises((ValueError, EOFError)):
            expand(data[: len(data) // 2])
    two = lz4.compress(b"one") + lz4.compress(b"two")
    assert rosbag1_reader.decompressors["lz4"](two) == b"onetwo"


@rows("compression", ["BZ2", "LZ4"])
def test_a_compressed_bag_is_read_as_before_and_refused_beyond_the_limit(
    tmp_path: Path, compression: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    limit_expansion(monkeypatch, 1 << 26)
    plain, path = write_bag(tmp_path / "plain.bag", drive(0.5)), tmp_path / "a.bag"
    writer = Writer(path)
    writer.set_compression(Writer.CompressionFormat[compression])
    with Reader(plain) as read, writer:
        for each in read.connections:
            definition = {"msgdef": each.msgdef.data, "md5sum": each.digest}
            writer.add_connection(each.topic, each.msgtype, **definition)
        numbers = {each.topic: each for each in writer.connections}
        for connection, time_ns, data in read.messages():
            writer.write(numbers[connection.topic], time_ns, data)
    with open_bag(plain) as one, open_bag(path) as other:
        pairs = list(zip(one.events(), other.events(), strict=True))
    assert len(pairs) > 10 and all(same(*pair) for pair in pairs)
    limit_expansion(monkeypatch, 1)
    for module in (files, stores):
        monkeypatch.setattr(module, "EXPANSION", 1)
    with pytest.raises(DataError, match=r"a\.bag"), open_bag(path) as bag:
        list(bag.events())


def test_a_bag_that_names_files_elsewhere_reads_none_of_them(tmp_path: Path) -> None:
    folder = write_bag(tmp_path / "in" / "a.db3", drive(0.3))
    (database,) = folder.glob("*.db3")
    database.rename(folder.parent / "other.db3")
    about = folder / "metadata.yaml"
    about.write_text(about.read_text().replace(database.name, "../other.db3"))
    with pytest.raises(DataError), open_bag(folder) as bag:
        list(bag.events())
