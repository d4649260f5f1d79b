# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Stored values: what is written is read again, and whatever else is there is refused by name."""

import io
import json
from pathlib import Path

import numpy as np
import pytest

from error_codes import has_code
from fusionslam.errors import DataError
from fusionslam.storage.archive import format_of, load_archive, load_json, save_archive, save_json

FORMAT = "fusionslam.test.1"
ROWS = np.arange(6, dtype=np.int64).reshape(2, 3)


@pytest.mark.parametrize("compress", [False, True])
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
        assert json.loads(str(stored["about"])) == {"format": FORMAT, "name": "x"}
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
