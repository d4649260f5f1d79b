# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Bags whose compressed parts expand to more than a limit, and bags that name other files."""

import bz2
from pathlib import Path
from typing import Any

import pytest

from bags import drive, same, write_bag
from rows import rows

pytest.importorskip("rosbags", reason="bags are an extra")

from fusionslam.datasets.bags import decompression, open_bag
from fusionslam.datasets.bags.decompression import bound_decompression
from fusionslam.errors import DataError
from fusionslam.storage import files

lz4 = pytest.importorskip("lz4.frame")

ZEROS = bytes(1 << 20)


@pytest.fixture(autouse=True)
def low_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    bound_decompression()
    for module in (files, decompression):
        monkeypatch.setattr(module, "MOST_EXPANDED", 1 << 19)


def expanders() -> dict[str, tuple[Any, bytes]]:
    from rosbags.rosbag1 import reader as first
    from rosbags.rosbag2 import reader as second
    from rosbags.rosbag2 import storage_mcap as mcap
    from rosbags.rosbag2 import writer

    packed = writer.zstd.compress(ZEROS)  # of Python, or its backport
    return {
        "bz2": (first.decompressors["bz2"], bz2.compress(ZEROS)),
        "lz4": (first.decompressors["lz4"], lz4.compress(ZEROS)),
        "zstd message": (second.zstd.decompress, packed),
        "mcap lz4": (lambda d: mcap.DECOMPRESSORS["lz4"](d, 1000), lz4.compress(ZEROS)),
        "mcap zstd": (lambda d: mcap.DECOMPRESSORS["zstd"](d, 1000), packed),
        "mcap zstd, declared": (lambda d: mcap.DECOMPRESSORS["zstd"](d, 1 << 40), packed),
    }


@rows("name", [*expanders()])
def test_what_expands_beyond_the_limit_is_refused(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    expand, data = expanders()[name]
    with pytest.raises(ValueError, match="expand"):
        expand(data)
    if "declared" not in name and "mcap" not in name:
        monkeypatch.setattr(decompression, "MOST_EXPANDED", 1 << 21)
        assert expand(data) == ZEROS
        with pytest.raises((ValueError, EOFError)):
            expand(data[: len(data) // 2])


def test_two_frames_expand_one_after_the_other() -> None:
    expand, _ = expanders()["lz4"]
    assert expand(lz4.compress(b"one") + lz4.compress(b"two")) == b"onetwo"


@rows("compression", ["BZ2", "LZ4"])
def test_a_compressed_bag_is_read_as_before_and_refused_beyond_the_limit(
    tmp_path: Path, compression: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rosbags.rosbag1 import Reader, Writer

    monkeypatch.setattr(decompression, "MOST_EXPANDED", 1 << 26)
    plain, path = write_bag(tmp_path / "plain.bag", drive(0.5)), tmp_path / "a.bag"
    writer = Writer(path)
    writer.set_compression(Writer.CompressionFormat[compression])
    with Reader(plain) as read, writer:
        made = {
            each.id: writer.add_connection(
                each.topic, each.msgtype, msgdef=each.msgdef.data, md5sum=each.digest
            )
            for each in read.connections
        }
        for connection, time_ns, data in read.messages():
            writer.write(made[connection.id], time_ns, data)
    with open_bag(plain) as one, open_bag(path) as other:
        pairs = list(zip(one.events(), other.events(), strict=True))
    assert len(pairs) > 10 and all(same(*pair) for pair in pairs)
    for module in (files, decompression):
        monkeypatch.setattr(module, "MOST_EXPANDED", 1)
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
