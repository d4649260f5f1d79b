# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Stored values: what is written is read again, and whatever else is there is refused by name."""

import io
import json
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from error_codes import has_code
from fusionslam.base import files
from fusionslam.base.archive import (
    array_names,
    format_of,
    load_archive,
    load_arrays,
    load_json,
    save_archive,
    save_json,
)
from fusionslam.errors import DataError
from rows import rows
from stored import change_archive, change_json

FORMAT = "fusionslam.test.1"
ROWS = np.arange(6, dtype=np.int64).reshape(2, 3)


@rows("compress", [False, True])
def test_an_archive_in_a_file_and_in_a_stream_holds_the_same(
    tmp_path: Path, compress: bool
) -> None:
    path, stream = tmp_path / "made" / "a.npz", io.BytesIO()
    for target in (path, stream):
        save_archive(target, FORMAT, {"name": "x"}, {"rows": ROWS, "no": None}, compress=compress)
    stream.seek(0)
    for source in (path, stream):
        with load_archive(source, FORMAT, "a test") as (about, arrays):
            assert about == {"name": "x"}
            assert arrays.keys() == {"rows"} and np.array_equal(arrays["rows"], ROWS)
    assert format_of(path) == FORMAT
    assert [other.name for other in path.parent.iterdir()] == ["a.npz"]


def test_numpy_and_json_alone_can_read_an_archive(tmp_path: Path) -> None:
    save_archive(tmp_path / "a.npz", FORMAT, {"name": "x"}, {"rows": ROWS})
    with np.load(tmp_path / "a.npz", allow_pickle=False) as stored:
        about = json.loads(str(stored["about"]))
        assert about["format"] == FORMAT and about["name"] == "x"
        assert np.array_equal(stored["rows"], ROWS)


@contextmanager
def refusal(code: str, *fields: object, says: str | None = None) -> Iterator[None]:
    with pytest.raises(DataError, match=says, check=has_code(code, *fields)):
        yield


def open_archive(path: Path, wanted: str = FORMAT) -> None:
    with load_archive(path, wanted, "a test"):
        pass


def open_json(path: Path, wanted: str | None = FORMAT) -> None:
    with load_json(path, wanted, "a test"):
        pass


def open_rows(path: Path) -> None:
    with load_arrays(path, "rows"):
        pass


def test_what_is_no_archive_of_the_format_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    save_archive(path, FORMAT, {}, {"rows": ROWS})
    whole = path.read_bytes()
    for content in (b"", b"text", whole[:50], whole[:-1]):
        path.write_bytes(content)
        with refusal("damaged-file", path):
            open_archive(path)
        assert format_of(path) is None
    path.write_bytes(whole)
    with refusal("format", FORMAT, "fusionslam.test.2", says=path.name):
        open_archive(path, "fusionslam.test.2")
    with refusal("missing-file", tmp_path / "b.npz"):
        open_archive(tmp_path / "b.npz")


def test_what_cannot_be_made_of_an_archive_is_an_error_of_its_file(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    save_archive(path, FORMAT, {}, {"rows": ROWS})
    with (
        refusal("damaged-file", path, says="'columns'"),
        load_archive(path, FORMAT, "a test") as (_, arrays),
    ):
        arrays["columns"]
    with (
        refusal("wrong-rows", 2, says=r"a\.npz"),
        load_archive(path, FORMAT, "a test") as (_, arrays),
    ):
        raise DataError(code="wrong-rows", fields=[str(len(arrays["rows"]))])
    with (
        refusal("damaged-file", says="another"),
        load_archive(path, FORMAT, "a test"),
        load_archive(io.BytesIO(b"text"), FORMAT, "another"),
    ):
        pass


def test_json_is_refused_by_name_as_archives_are(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    save_json(path, FORMAT, {"name": "x"})
    with load_json(path, FORMAT, "a test") as content:
        assert content == {"name": "x"}
    for text in ("", "[]", '{"format": 1}', "{}", path.read_text()[:-4]):
        path.write_text(text)
        with pytest.raises(DataError, match=r"a\.json"):
            open_json(path)
    for text in ('{"a":' * 100_000, "[" * 100_000, '{"a": ' + "9" * 5000 + "}"):
        path.write_text(text)
        with refusal("damaged-file", path):
            open_json(path, None)


def test_files_of_earlier_versions_have_no_digests_and_are_read(tmp_path: Path) -> None:
    save_archive(tmp_path / "a.npz", FORMAT, {"name": "x"}, {"rows": ROWS})
    change_archive(tmp_path / "a.npz", rows=ROWS + 1)
    with load_archive(tmp_path / "a.npz", FORMAT, "a test") as (about, arrays):
        assert about == {"name": "x"} and np.array_equal(arrays["rows"], ROWS + 1)
    save_json(tmp_path / "a.json", FORMAT, {"name": "x"})
    change_json(tmp_path / "a.json", name="y")
    with load_json(tmp_path / "a.json", FORMAT, "a test") as content:
        assert content == {"name": "y"}


@rows(
    "change",
    [
        lambda content: content.update(rows=ROWS + 1),
        lambda content: content.update(more=ROWS),
        lambda content: content.pop("no"),
        lambda content: content.update(rows=ROWS.T),
        lambda content: content.update(about=np.array(str(content["about"]).replace('"x"', '"y"'))),
    ],
)
def test_a_file_changed_by_another_program_is_refused(
    tmp_path: Path, change: Callable[[dict[str, Any]], object]
) -> None:
    path = tmp_path / "a.npz"
    save_archive(path, FORMAT, {"name": "x"}, {"rows": ROWS, "no": np.zeros(0)})
    with np.load(path) as stored:
        content = dict(stored)
    change(content)
    np.savez(path, **content)
    with refusal("wrong-digest", says=r"a\.npz"):
        open_archive(path)


def test_json_that_was_edited_is_refused_and_says_how_to_accept_it(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    given = {"name": "x", "numbers": [0.1, 1e300, -3], "text": "a \u0416"}
    save_json(path, FORMAT, given, indent=1)
    with load_json(path, FORMAT, "a test") as content:
        assert content == given
    path.write_text(path.read_text().replace('"x"', '"y"'))
    with refusal("wrong-digest", says=r"a\.json.*digest"):
        open_json(path)


def npy(shape: str, dtype: str = "<f4", data: bytes = bytes(16), version: int = 1) -> bytes:
    """An array of numpy's format with a header of one's own."""
    header = f"{{'descr': {dtype!r}, 'fortran_order': False, 'shape': {shape}, }}".encode()
    return b"\x93NUMPY" + bytes([version, 0]) + len(header).to_bytes(2, "little") + header + data


HOSTILE: dict[str, bytes] = {
    "bytes left over": npy("(3,)"),
    "bytes missing": npy("(5,)"),
    "2**60 numbers": npy("(1152921504606846976,)"),
    "negative lengths": npy("(-2, -2)"),
    "Python objects": npy("(2,)", "|O"),
    "a type that is none": npy("(2,)", "(((("),
    "another version": npy("(4,)", version=9),
    "nested brackets": npy("(" * 5000),
    "no array": b"text",
    "nothing": b"",
}


@rows("content", HOSTILE)
def test_an_array_that_its_header_does_not_describe_is_refused(
    tmp_path: Path, content: str
) -> None:
    path = tmp_path / "a.npz"
    with zipfile.ZipFile(path, "w") as written:
        written.writestr("rows.npy", HOSTILE[content])
    with refusal("damaged-file", path):
        open_rows(path)


@pytest.mark.filterwarnings("ignore:Duplicate name")
@rows("names", [["rows"], ["../rows.npy.py"], ["rows.txt"], ["rows.npy", "rows.npy"]])
def test_members_that_are_no_arrays_or_have_one_name_are_refused(
    tmp_path: Path, names: list[str]
) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as written:
        for name in names:
            written.writestr(name, npy("(4,)"))
    with pytest.raises(DataError):
        open_rows(tmp_path / "a.npz")
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


def test_a_small_file_that_expands_beyond_the_limit_is_refused_unread(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.npz"
    np.savez_compressed(path, rows=np.zeros(1 << 20, np.uint8))
    with load_arrays(path, "rows") as arrays:
        assert len(arrays["rows"]) == 1 << 20
    monkeypatch.setattr(files, "MOST_EXPANDED", 1 << 19)
    monkeypatch.setattr(np, "ndarray", None)  # nothing may be read
    with refusal("damaged-file", path):
        open_rows(path)
    assert array_names(path) == {"rows"}


def test_members_that_overlap_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    with zipfile.ZipFile(path, "w") as written:
        written.writestr("a.npy", npy("(400,)", data=bytes(1600)))
        for name in "bcd":  # entries of the directory that all point to the first member
            written.writestr(f"{name}.npy", b"")
        first = written.infolist()[0]
        for other in written.infolist()[1:]:
            other.header_offset, other.CRC = first.header_offset, first.CRC
            other.file_size = other.compress_size = first.file_size
    with refusal("damaged-file", path):
        open_rows(path)
