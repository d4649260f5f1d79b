# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Stored indexes: whole, cut, changed and in the wrong place."""

import os
import re
import struct
from pathlib import Path

import numpy as np
import pytest

from arrays import SECOND, filled
from fusionslam import DataError, DescriptorIndex

VERSION_OFFSET = 8
"""Where the version stands in the file: after eight bytes of magic."""


def test_a_saved_index_continues_where_it_was(tmp_path: Path) -> None:
    index = filled()
    index.save(str(tmp_path / "places.index"))
    loaded = DescriptorIndex.load(str(tmp_path / "places.index"))
    assert (len(loaded), loaded.dimension) == (20, 7)
    assert (loaded.window, loaded.window_seconds) == (2, 1.5)
    rng = np.random.default_rng(4)
    for number in range(20, 30):
        row = rng.normal(size=7).astype(np.float32)
        for a, b in zip(
            index.query(row, k=5, stamp_ns=number * SECOND),
            loaded.query(row, k=5, stamp_ns=number * SECOND),
            strict=True,
        ):
            assert a.tobytes() == b.tobytes()
        assert index.add(row, stamp_ns=number * SECOND) == number
        assert loaded.add(row, stamp_ns=number * SECOND) == number
    for number in range(30):
        assert np.array_equal(index.descriptor(number), loaded.descriptor(number))


def test_saving_twice_gives_the_same_bytes_and_leaves_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "places.index"
    filled().save(str(path))
    first = path.read_bytes()
    filled().save(str(path))
    assert path.read_bytes() == first
    assert os.listdir(tmp_path) == ["places.index"]


def test_an_empty_index_can_be_saved(tmp_path: Path) -> None:
    DescriptorIndex(5, window=3).save(str(tmp_path / "empty.index"))
    loaded = DescriptorIndex.load(str(tmp_path / "empty.index"))
    assert (len(loaded), loaded.dimension, loaded.window) == (0, 5, 3)


@pytest.fixture
def stored(tmp_path: Path) -> Path:
    path = tmp_path / "places.index"
    filled().save(str(path))
    return path


def refusal(path: Path) -> str:
    """The message with which a file is refused; it begins with the path and is one line."""
    with pytest.raises(DataError) as error:
        DescriptorIndex.load(str(path))
    message = str(error.value)
    assert message.startswith(f"{path}: ") and "\n" not in message
    return message


def test_an_index_of_another_version_is_refused(stored: Path) -> None:
    content = bytearray(stored.read_bytes())
    (version,) = struct.unpack_from("<I", content, VERSION_OFFSET)
    struct.pack_into("<I", content, VERSION_OFFSET, version + 1)
    stored.write_bytes(content)
    assert re.search(rf"\b{version + 1}\b.*\b{version}\b", refusal(stored))


def test_an_index_cut_anywhere_is_refused(stored: Path) -> None:
    content = stored.read_bytes()
    for size in (0, 1, 7, 40, len(content) // 2, len(content) - 36, len(content) - 1):
        stored.write_bytes(content[:size])
        refusal(stored)


def test_a_changed_byte_anywhere_is_noticed(stored: Path) -> None:
    content = stored.read_bytes()
    for place in range(0, len(content), 5):
        changed = bytearray(content)
        changed[place] ^= 0x10
        stored.write_bytes(changed)
        refusal(stored)


def test_bytes_at_the_end_are_noticed(stored: Path) -> None:
    content = stored.read_bytes()
    for count in (1, 36):
        stored.write_bytes(content + bytes(count))
        assert re.search(rf"\b{count} bytes", refusal(stored))


def test_a_file_that_is_no_index_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("I am no index, but long enough to be one. " * 5)
    refusal(path)


def test_a_path_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    refusal(tmp_path / "nowhere.index")
    refusal(tmp_path)


@pytest.mark.parametrize("place", ["missing/places.index", "file/places.index", "folder"])
def test_a_path_that_cannot_be_written_is_named_and_nothing_is_left(
    tmp_path: Path, place: str
) -> None:
    (tmp_path / "file").write_text("not a folder")
    (tmp_path / "folder").mkdir()
    with pytest.raises(DataError) as error:
        filled().save(str(tmp_path / place))
    assert str(error.value).startswith(f"{tmp_path / place}: ")
    assert sorted(os.listdir(tmp_path)) == ["file", "folder"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission_is_named(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(DataError, match="Permission denied"):
        filled().save(str(tmp_path / "places.index"))


def test_a_failed_save_leaves_the_old_file_as_it_was(stored: Path) -> None:
    before = stored.read_bytes()
    blocker = stored.with_name(f"{stored.name}.{os.getpid()}.tmp")
    blocker.mkdir()  # where the temporary file would be written
    try:
        filled(5).save(str(stored))
    except DataError:
        assert stored.read_bytes() == before
    else:
        assert len(DescriptorIndex.load(str(stored))) == 5
