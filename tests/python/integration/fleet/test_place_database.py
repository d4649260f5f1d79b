# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A database of places: what is added is found, what is deleted is not, and bad input is named."""

import errno
import json
import os
import shutil
import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.neighbors import NearestNeighbors

from error_codes import has_code
from fleet_places import LENGTH, SETTINGS, made_places, made_vectors
from fusionslam.base.archive import dump_sealed
from fusionslam.errors import ConfigError, DataError, FusionSlamError, ShapeError
from fusionslam.fleet import lance_extra
from fusionslam.fleet.place_database import DatabaseSettings, PlaceDatabase
from fusionslam.fleet.place_rows import LONGEST
from fusionslam.fleet.places import PlaceFilter
from fuzz.bit_flips import flipped
from rows import grouped, rows

lancedb = pytest.importorskip("lancedb", reason="the table of places is an extra")


@pytest.fixture
def empty(tmp_path: Path) -> Iterator[PlaceDatabase]:
    with PlaceDatabase.create(tmp_path / "database", SETTINGS) as database:
        yield database


@pytest.fixture
def drives(empty: PlaceDatabase) -> PlaceDatabase:
    """Two robots at one site, and one at another."""
    empty.add(made_places("monday", 60, seed=1, robot="r1", site="yard", region="north"))
    empty.add(made_places("tuesday", 40, seed=2, robot="r2", site="yard", region="north"))
    empty.add(made_places("o'clock", 30, seed=3, robot="r1", site="port", region="south"))
    return empty


def keys_of(database: PlaceDatabase, where: PlaceFilter | None = None) -> set[str]:
    (found,) = database.query(np.zeros(LENGTH), k=1000, where=where)
    return {candidate.key for candidate in found}


def test_neighbours_and_distances_are_those_of_scikit_learn(drives: PlaceDatabase) -> None:
    rows = np.vstack([made_vectors(n, seed=s) for n, s in ((60, 1), (40, 2), (30, 3))])
    queries = made_vectors(70, seed=9)
    peer = NearestNeighbors(n_neighbors=7, algorithm="brute").fit(rows.astype(np.float64))
    distances, _ = peer.kneighbors(queries.astype(np.float64))
    for exact in (False, True):
        found = drives.query(queries, k=7, exact=exact)
        assert_allclose([[one.distance for one in row] for row in found], distances, rtol=1e-5)


def test_a_stored_vector_finds_its_place_and_all_of_it(drives: PlaceDatabase) -> None:
    ((found,),) = drives.query(made_vectors(40, seed=2)[7], k=1)
    assert found.key == "tuesday:7"
    about = (found.session, found.robot, found.site, found.region)
    assert about == ("tuesday", "r2", "yard", "north")
    assert (found.frame, found.stamp_ns, found.distance) == (7, 7 * 10**9, 0.0)
    assert found.pose is not None
    assert_array_equal(found.pose[:3, 3], [7, 0, 0])
    ((first,),) = drives.query(made_vectors(40, seed=2)[0], k=1)
    assert (first.key, first.pose) == ("tuesday:0", None)


@rows(
    "where, expected",
    [
        ({}, 130),
        ({"site": "yard"}, 100),
        ({"robot": "r1"}, 90),
        ({"robot": "r1", "site": "yard"}, 60),
        ({"session": "o'clock"}, 30),
        ({"region": "east"}, 0),
        ({"since_ns": 38 * 10**9}, 24),
        ({"until_ns": 10**9}, 3),
        ({"site": "yard", "since_ns": 5 * 10**9, "until_ns": 7 * 10**9}, 4),
    ],
)
def test_filters_choose_first(drives: PlaceDatabase, where: dict[str, Any], expected: int) -> None:
    assert len(keys_of(drives, PlaceFilter(**where))) == expected


def test_an_empty_database_finds_nothing(empty: PlaceDatabase) -> None:
    assert len(empty) == 0
    assert empty.query(np.zeros((2, LENGTH)), k=3) == [[], []]
    assert empty.query(np.zeros((0, LENGTH))) == []
    assert empty.sessions() == []
    assert empty.count_by("site") == {}
    assert empty.add(made_places("none", 0)) == 0


def test_sessions_counts_and_positions_tell_of_all_places(drives: PlaceDatabase) -> None:
    monday, clock, tuesday = drives.sessions()
    assert [one.session for one in (monday, clock, tuesday)] == ["monday", "o'clock", "tuesday"]
    assert (monday.robot, monday.site, monday.region) == ("r1", "yard", "north")
    assert (monday.places, monday.first_ns, monday.last_ns) == (60, 0, 59 * 10**9)
    assert drives.count_by("robot") == {"r1": 90, "r2": 40}
    yard = drives.positions("yard")
    assert yard.sessions == ["monday"] * 60 + ["tuesday"] * 40
    assert_array_equal(yard.frames, [*range(60), *range(40)])
    assert_array_equal(yard.stamps_ns, yard.frames * 10**9)
    assert_array_equal(np.flatnonzero(np.isnan(yard.poses[:, 0, 0])), [0, 60])
    assert_array_equal(yard.poses[61:, 0, 3], np.arange(1, 40))
    assert yard.every == 1 and yard.counts == {"monday": 60, "tuesday": 40}
    assert drives.positions("nowhere").poses.shape == (0, 4, 4)


def test_of_many_positions_every_nth_of_each_session_is_read(
    drives: PlaceDatabase, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fusionslam.fleet.row_search._BLOCK", 7)  # rows of a batch
    yard = drives.positions("yard", most=34)
    assert yard.every == 3 and yard.counts == {"monday": 60, "tuesday": 40}
    assert_array_equal(yard.frames, [*range(0, 60, 3), *range(0, 40, 3)])
    assert yard.sessions == ["monday"] * 20 + ["tuesday"] * 14
    assert_array_equal(yard.poses[1:20, 0, 3], np.arange(3, 60, 3))


def test_keys_that_are_there_are_left_out(drives: PlaceDatabase) -> None:
    assert drives.add(made_places("monday", 60, seed=1)) == 0
    assert drives.add(made_places("monday", 65, seed=1)) == 5
    assert len(drives) == 135
    assert len(keys_of(drives)) == 135


def test_a_key_that_is_there_twice_is_found_once(drives: PlaceDatabase) -> None:
    drives._table.add(drives._table.search().where("session = 'monday'").to_arrow())
    found = drives.query(made_vectors(60, seed=1)[3], k=130)[0]
    assert len({one.key for one in found}) == len(found) == 130


def test_deleted_places_are_never_found_again(drives: PlaceDatabase) -> None:
    with PlaceDatabase.open(drives.location, read_only=True) as reader:
        assert len(keys_of(reader, PlaceFilter(robot="r1"))) == 90
        assert drives.delete(PlaceFilter(robot="r1")) == 90
        for database in (drives, reader):
            assert keys_of(database) == {f"tuesday:{row}" for row in range(40)}
            assert len(database) == 40
    assert drives.delete(PlaceFilter(robot="r1")) == 0


def test_readers_see_new_places_at_their_next_query(drives: PlaceDatabase) -> None:
    with PlaceDatabase.open(drives.location, read_only=True) as reader:
        before = keys_of(reader)
        drives.add(made_places("wednesday", 10, seed=4))
        assert keys_of(reader) - before == {f"wednesday:{row}" for row in range(10)}


def test_a_version_shows_the_database_as_it_was(drives: PlaceDatabase) -> None:
    number = drives.versions()[-1].number
    drives.delete(PlaceFilter(site="yard"))
    before = drives.at_version(number)
    assert (len(before), len(drives)) == (130, 30)
    assert len(keys_of(before)) == 130
    assert [one.places for one in drives.versions()][-2:] == [130, 30]
    with pytest.raises(DataError, check=has_code("read-only")):
        before.add(made_places("later"))
    with pytest.raises(DataError, check=has_code("not-found")):
        drives.at_version(99)


def test_compaction_keeps_all_places_and_drops_versions(drives: PlaceDatabase) -> None:
    for day in range(5):
        drives.add(made_places(f"day{day}", 10, seed=10 + day))
    drives.delete(PlaceFilter(session="day2"))
    before = keys_of(drives)
    drives.compact(keep_s=0)
    assert keys_of(drives) == before
    assert len(drives) == 170
    assert len(drives.versions()) == 1


def test_a_database_opens_again_as_it_was(drives: PlaceDatabase) -> None:
    before = keys_of(drives)
    drives.close()
    with PlaceDatabase.open(drives.location, expected=SETTINGS) as again:
        assert again.settings == SETTINGS
        assert keys_of(again) == before
    with pytest.raises(DataError, check=has_code("closed")):
        len(drives)


def test_a_second_writer_is_refused_until_the_first_is_done(drives: PlaceDatabase) -> None:
    with pytest.raises(DataError, check=has_code("locked", drives.location)):
        PlaceDatabase.open(drives.location)
    drives.close()
    PlaceDatabase.open(drives.location).close()


@rows(
    "expected, changes",
    grouped(
        {
            ("shape", "vectors"): [
                *({"vectors": np.zeros(shape)} for shape in ((3, 5), LENGTH, (2, LENGTH))),
                {"keys": ["a"]},
            ],
            ("not-finite", "vectors"): [
                {"vectors": np.full((3, LENGTH), wrong)} for wrong in (np.nan, 1e300)
            ],
            ("too-long", "vectors"): [{"vectors": np.full((3, LENGTH), 1e19)}],
            ("duplicate-key", "keys"): [{"keys": ["a", "b", "a"]}],
            ("bad-key", "keys"): [{"keys": ["a", wrong, "b"]} for wrong in ("", 7, "\ud800")],
            ("shape", "frames"): [{"frames": np.arange(2)}, {"frames": np.zeros(3)}],
            ("shape", "stamps_ns"): [{"stamps_ns": np.arange(4)}],
            ("shape", "robot"): [{"robot": ["r1"]}],
            ("shape", "site"): [{"site": [1, 2, 3]}],
            ("shape", "poses"): [{"poses": np.zeros((3, 3, 4))}, {"poses": np.zeros((2, 4, 4))}],
        }
    ),
)
def test_places_that_cannot_be_added_are_refused_as_a_whole(
    drives: PlaceDatabase, expected: tuple[str, str], changes: dict[str, Any]
) -> None:
    error = ShapeError if expected[0] == "shape" else DataError
    with pytest.raises(error, check=has_code(*expected)):
        drives.add(replace(made_places("monday", 3), **changes))
    assert len(drives) == 130


def test_distances_between_the_longest_vectors_are_finite(empty: PlaceDatabase) -> None:
    longest = np.zeros((2, LENGTH))
    longest[:, 3] = LONGEST, -LONGEST
    empty.add(replace(made_places("far", 2), vectors=0.999 * longest))
    for row, exact in ((0, True), (1, False)):
        (found,) = empty.query(0.999 * longest[row], exact=exact)
        assert [each.frame for each in found] == [row, 1 - row]
        assert found[1].distance == pytest.approx(1.998 * LONGEST)


def test_queries_that_cannot_be_answered_are_refused(drives: PlaceDatabase) -> None:
    with pytest.raises(ShapeError, check=has_code("shape", "vectors")):
        drives.query(np.zeros(LENGTH + 1))
    with pytest.raises(ShapeError, check=has_code("shape", "vectors")):
        drives.query(np.zeros((2, 2, LENGTH)))
    with pytest.raises(DataError, check=has_code("not-finite", "vectors", 1)):
        drives.query([np.zeros(LENGTH), np.full(LENGTH, np.inf)])
    with pytest.raises(ConfigError, check=has_code("limit", "k")):
        drives.query(np.zeros(LENGTH), k=0)
    with pytest.raises(DataError, check=has_code("bad-text")):
        drives.query(np.zeros(LENGTH), where=PlaceFilter(robot="\ud800"))
    with pytest.raises(ConfigError, check=has_code("choice", "column")):
        drives.count_by("pose")
    with pytest.raises(ConfigError, check=has_code("empty-filter")):
        drives.delete(PlaceFilter())
    with pytest.raises(ConfigError, check=has_code("limit", "recall")):
        drives.build_index(recall=1.5)


@rows("name", ["a' OR '1'='1", "%", "\\", "日本", "a\nb", '"'])
def test_names_are_taken_as_they_are(drives: PlaceDatabase, name: str) -> None:
    assert drives.delete(PlaceFilter(robot=name)) == 0
    drives.add(made_places("odd", 4, seed=5, robot=name))
    assert drives.count_by("robot")[name] == 4
    assert drives.delete(PlaceFilter(robot=name)) == 4
    assert len(drives) == 130


def test_a_database_of_other_settings_is_refused(drives: PlaceDatabase) -> None:
    others: dict[str, Any] = {"descriptor": "m2dp:other", "length": 17, "config": {}}
    for field, value in others.items():
        expected = replace(SETTINGS, **{field: value})
        with pytest.raises(ConfigError, check=has_code("other-descriptor", field)):
            PlaceDatabase.open(drives.location, expected=expected, read_only=True)


def test_settings_that_no_database_takes_are_refused(tmp_path: Path) -> None:
    for settings, code in (
        (DatabaseSettings("no such", 8), "unknown-name"),
        (DatabaseSettings("scan_context", 8), "choice"),
        (DatabaseSettings("m2dp", 8, metric="cosine"), "choice"),
        (DatabaseSettings("m2dp", 0), "limit"),
        (DatabaseSettings("m2dp", 8, config={"a": float("nan")}), "config"),
    ):
        with pytest.raises(ConfigError, check=has_code(code)):
            PlaceDatabase.create(tmp_path / "new", settings)
    assert not (tmp_path / "new").exists()


def test_what_is_no_database_is_named(tmp_path: Path, drives: PlaceDatabase) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").touch()
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "notes.txt").touch()
    names = {"not-found": ("missing", "empty"), "other-format": ("file", "other")}
    for code, name in grouped(names):
        with pytest.raises(DataError, check=has_code(code, tmp_path / name)):
            PlaceDatabase.open(tmp_path / name)
    assert not (tmp_path / "missing").exists()
    with pytest.raises(DataError, check=has_code("exists", drives.location)):
        PlaceDatabase.create(drives.location, SETTINGS)
    with pytest.raises(DataError, check=has_code("cannot-write")):
        PlaceDatabase.create(tmp_path / "file" / "in it", SETTINGS)


@rows(
    "error",
    [OSError(errno.EIO, "Input/output error"), RuntimeError("LanceError: Permission denied")],
)
def test_what_the_system_refuses_names_whether_it_was_read_or_written(
    drives: PlaceDatabase, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise error

    for method in ("count_rows", "search", "add", "delete"):
        monkeypatch.setattr(type(drives._table), method, refuse)
    reads = (lambda: len(drives), lambda: drives.positions("yard"), drives.sessions)
    writes = (lambda: drives.delete(PlaceFilter(robot="r1")), lambda: drives.delete_keys(["a"]))
    for code, calls in (("cannot-read", reads), ("cannot-write", writes)):
        for call in calls:
            with pytest.raises(DataError, check=has_code(code, drives.location)):
                call()


def test_tables_of_others_and_of_other_versions_are_refused(tmp_path: Path) -> None:
    import pyarrow as pa

    about = {"version": 4, "descriptor": "m2dp", "length": 4, "metric": "l2", "config": {}}
    for name, text, code in (
        ("foreign", None, "other-format"),
        ("newer", json.dumps(about), "newer-version"),
        ("torn", '{"version": 3, ', "damaged"),
        ("changed", dump_sealed({**about, "version": 3, "more": 2}), "damaged"),
        ("columns", dump_sealed({**about, "version": 3}), "damaged"),
        ("flipped", dump_sealed({**about, "version": 3}).replace("m2dp", "m2dq"), "damaged"),
        ("unsealed", json.dumps({**about, "version": 3}), "damaged"),
        ("older", json.dumps({**about, "version": 1}), "older-version"),
    ):
        schema = pa.schema(
            [("frame", pa.int64())], None if text is None else {"fusionslam.places": text}
        )
        lancedb.connect(tmp_path / name).create_table("places", schema=schema)
        with pytest.raises(DataError, check=has_code(code, tmp_path / name)):
            PlaceDatabase.open(tmp_path / name)


@rows("part", ["data", "_versions"])
@rows("is_cut", [True, False])
def test_damage_is_found_at_once(
    drives: PlaceDatabase, tmp_path: Path, part: str, is_cut: bool
) -> None:
    drives.close()
    folder = shutil.copytree(drives.location, tmp_path / "copy")
    for path in (folder / "places.lance" / part).iterdir():
        if not is_cut:
            path.unlink()
        elif path.suffix != ".json":  # a hint, without which versions are listed
            path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(DataError, check=has_code("damaged", folder)):
        PlaceDatabase.open(folder)


@pytest.mark.parametrize("count", [12, pytest.param(1000, marks=pytest.mark.nightly)])
def test_a_flipped_bit_of_the_table_is_found_or_changes_nothing(
    drives: PlaceDatabase, count: int
) -> None:
    def read() -> Any:
        with PlaceDatabase.open(drives.location, read_only=True) as database:
            database.check()
            rows = database.query(made_vectors(50, seed=1)[::5], k=130)
            poses = database.positions("").poses
            return [[(e.key, e.distance, *vars(e).values()) for e in row] for row in rows], poses

    drives.close()
    (file, *_) = sorted((Path(drives.location) / "places.lance/data").iterdir())
    content, expected = file.read_bytes(), repr(read())
    found = 0
    for place in np.linspace(0, len(content) - 1, count).astype(int).tolist():
        file.write_bytes(flipped(content, 8 * place + place % 8))
        try:
            assert repr(read()) == expected, place
        except DataError as error:
            assert error.code == "damaged" and drives.location in str(error), place
            found += 1
    assert found > count // 4


def test_a_place_that_was_changed_is_named_by_whatever_uses_it(empty: PlaceDatabase) -> None:
    """As by a flipped bit of a row that can be read."""
    empty.add(made_places("monday", 20, site="harbour"))
    for change in ("frame = 21", "session = 'mondaz'", "stamp_ns = 7", "robot = 'r9'"):
        with empty._writing() as table:
            before = table.version
            table.update(where="frame = 13", values_sql=dict([change.split(" = ")]))
        query = partial(empty.query, made_vectors(20)[13], k=1)
        for use in (query, partial(empty.positions, "harbour"), empty.check):
            with pytest.raises(DataError, check=has_code("damaged", empty.location)):
                use()
        assert empty.query(made_vectors(20)[2], k=1)[0][0].frame == 2
        with empty._writing() as table:
            table.restore(before)
    empty.check()


def test_a_forked_process_is_told_to_be_spawned(
    drives: PlaceDatabase, monkeypatch: pytest.MonkeyPatch
) -> None:
    process = os.getpid()
    monkeypatch.setattr(os, "getpid", lambda: process + 1)
    calls = (drives.sessions, drives.check, lambda: len(drives), lambda: drives.delete_keys(["a"]))
    for call in (*calls, lambda: drives.query(np.zeros(LENGTH))):
        with pytest.raises(DataError, check=has_code("forked", drives.location)):
            call()
    drives.close()


def test_a_lock_that_is_a_link_is_not_followed(tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    (tmp_path / "places").mkdir()
    (tmp_path / "places/.lock").symlink_to(victim)
    with pytest.raises(DataError, check=has_code("cannot-write", tmp_path / "places")):
        PlaceDatabase.create(tmp_path / "places", SETTINGS)
    assert not victim.exists()


def test_damage_while_it_is_open_is_named(drives: PlaceDatabase) -> None:
    reader = PlaceDatabase.open(drives.location, read_only=True)
    drives.add(made_places("later", 10, seed=6))
    shutil.rmtree(Path(drives.location) / "places.lance" / "data")
    with pytest.raises(DataError, check=has_code("damaged", drives.location)):
        reader.query(np.zeros(LENGTH))


def test_without_the_extra_the_error_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "lancedb", None)
    with pytest.raises(FusionSlamError, check=has_code("missing-extra", "fleet")):
        lance_extra.load()
