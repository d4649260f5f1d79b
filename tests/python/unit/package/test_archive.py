# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Stored values: what is written is read again, and whatever else is there is refused by name."""

import io
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from error_codes import has_code
from fusionslam.errors import DataError
from fusionslam.storage import files
from fusionslam.storage.archive import (
    array_names,
    format_of,
    load_archive,
    load_arrays,
    load_json,
    save_archive,
    save_json,
)
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


def test_what_is_no_archive_of_the_format_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    save_archive(path, FORMAT, {}, {"rows": ROWS})
    whole = path.read_bytes()
    for content in (b"", b"text", whole[:50], whole[:-1]):
        path.write_bytes(content)
        with (
            pytest.raises(DataError, check=has_code("damaged-file", path)),
            load_archive(path, FORMAT, "a test"),
        ):
            pass
        assert format_of(path) is None
    path.write_bytes(whole)
    with (
        pytest.raises(
            DataError, match=path.name, check=has_code("format", FORMAT, "fusionslam.test.2")
        ),
        load_archive(path, "fusionslam.test.2", "a test"),
    ):
        pass
    with (
        pytest.raises(DataError, check=has_code("missing-file", tmp_path / "b.npz")),
        load_archive(tmp_path / "b.npz", FORMAT, "a test"),
    ):
        pass


def test_what_cannot_be_made_of_an_archive_is_an_error_of_its_file(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    save_archive(path, FORMAT, {}, {"rows": ROWS})
    with (
        pytest.raises(DataError, match="'columns'", check=has_code("damaged-file", path)),
        load_archive(path, FORMAT, "a test") as (_, arrays),
    ):
        arrays["columns"]
    with (
        pytest.raises(DataError, match=r"a\.npz", check=has_code("wrong-rows", 2)),
        load_archive(path, FORMAT, "a test") as (_, arrays),
    ):
        raise DataError(code="wrong-rows", fields=[str(len(arrays["rows"]))])


def test_an_archive_inside_another_names_the_file_around_it(tmp_path: Path) -> None:
    inner = io.BytesIO(b"text")
    save_archive(tmp_path / "a.npz", FORMAT, {}, {})
    with (
        pytest.raises(DataError, match="another", check=has_code("damaged-file")),
        load_archive(tmp_path / "a.npz", FORMAT, "a test"),
        load_archive(inner, FORMAT, "another"),
    ):
        pass


def test_json_is_refused_by_name_as_archives_are(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    save_json(path, FORMAT, {"name": "x"})
    with load_json(path, FORMAT, "a test") as content:
        assert content == {"name": "x"}
    for text in ("", "[]", '{"format": 1}', "{}", path.read_text()[:-4]):
        path.write_text(text)
        with (
            pytest.raises(DataError, match=r"a\.json"),
            load_json(path, FORMAT, "a test"),
        ):
            pass


def test_files_of_earlier_versions_have_no_digests_and_are_read(tmp_path: Path) -> None:
    save_archive(tmp_path / "a.npz", FORMAT, {"name": "x"}, {"rows": ROWS})
    change_archive(tmp_path / "a.npz", rows=ROWS + 1)
    with load_archive(tmp_path / "a.npz", FORMAT, "a test") as (about, arrays):
        assert about == {"name": "x"} and np.array_equal(arrays["rows"], ROWS + 1)
    save_json(tmp_path / "a.json", FORMAT, {"name": "x"})
    change_json(tmp_path / "a.json", name="y")
    with load_json(tmp_path / "a.json", FORMAT, "a test") as content:
        assert content == {"name": "y"}


@rows("change", ["other numbers", "another", "one less", "other shape", "about"])
def test_a_file_changed_by_another_program_is_refused(tmp_path: Path, change: str) -> None:
    path = tmp_path / "a.npz"
    save_archive(path, FORMAT, {"name": "x"}, {"rows": ROWS, "no": np.zeros(0)})
    with np.load(path) as stored:
        content = dict(stored)
    if change == "other numbers":
        content["rows"] = ROWS + 1
    elif change == "another":
        content["more"] = ROWS
    elif change == "one less":
        del content["no"]
    elif change == "other shape":
        content["rows"] = ROWS.T
    else:
        content["about"] = np.array(str(content["about"]).replace('"x"', '"y"'))
    np.savez(path, **content)
    with (
        pytest.raises(DataError, match=r"a\.npz", check=has_code("wrong-digest")),
        load_archive(path, FORMAT, "a test"),
    ):
        pass


def test_json_that_was_edited_is_refused_and_says_how_to_accept_it(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    save_json(
        path, FORMAT, {"name": "x", "numbers": [0.1, 1e300, -3], "text": "a \u0416"}, indent=1
    )
    with load_json(path, FORMAT, "a test") as content:
        assert content == {"name": "x", "numbers": [0.1, 1e300, -3], "text": "a \u0416"}
    path.write_text(path.read_text().replace('"x"', '"y"'))
    with (
        pytest.raises(DataError, match=r"a\.json.*digest", check=has_code("wrong-digest")),
        load_json(path, FORMAT, "a test"),
    ):
        pass


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
    with pytest.raises(DataError, check=has_code("damaged-file", path)), load_arrays(path, "rows"):
        pass


@rows("name", ["rows", "../rows.npy.py", "rows.txt"])
def test_members_that_are_no_arrays_are_refused(tmp_path: Path, name: str) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as written:
        written.writestr(name, npy("(4,)"))
    with pytest.raises(DataError), load_arrays(tmp_path / "a.npz", "rows"):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_two_members_of_one_name_are_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as written:
        written.writestr("rows.npy", npy("(4,)"))
        written.writestr("rows.npy", npy("(2, 2)"))
    with pytest.raises(DataError), load_arrays(tmp_path / "a.npz", "rows"):
        pass


def test_a_small_file_that_expands_beyond_the_limit_is_refused_unread(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.npz"
    np.savez_compressed(path, rows=np.zeros(1 << 20, np.uint8))
    with load_arrays(path, "rows") as arrays:
        assert len(arrays["rows"]) == 1 << 20
    monkeypatch.setattr(files, "MOST_EXPANDED", 1 << 19)
    monkeypatch.setattr(np, "ndarray", None)  # nothing may be read
    with pytest.raises(DataError, check=has_code("damaged-file", path)), load_arrays(path, "rows"):
        pass
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
    with pytest.raises(DataError, check=has_code("damaged-file", path)), load_arrays(path, "rows"):
        pass


def test_json_nested_without_end_is_one_error_of_its_file(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    for text in ('{"a":' * 100_000, "[" * 100_000, '{"a": ' + "9" * 5000 + "}"):
        path.write_text(text)
        with (
            pytest.raises(DataError, check=has_code("damaged-file", path)),
            load_json(path, None, "a test"),
        ):
            pass
