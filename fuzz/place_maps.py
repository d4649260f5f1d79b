# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Files of maps: damaged ones, and forged ones with hostile values in their tables.

A map must be refused, or give something that works, even where the CRC of its rows is right.
"""

import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from functools import cache
from pathlib import Path
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from fusionslam.mapping.grids import GridConfig
from fusionslam.mapping.place_map import PlaceMap
from fusionslam.sensors.frame import Frame
from fuzz.hostile_values import GENERATE, Forged, driven_by_bytes, random_bytes
from fuzz.target import Target, check_numbers, refusing, scratch
from map_rows import restore_crcs
from streets import OPTIONS, WAY, frames

_VALUES: tuple[Any, ...] = (
    None, -1, 0, 1, 2**31, 2**63 - 1, -(2**63), 0.5, 1e300, float("inf"), "", "x", "\x00", "{",
    "[]", "[" * 5000, '{"a": 1}', "NaN", b"", b"\x00", bytes(128), b"\xff" * 128, bytes(8),
    bytes(10**6),
)  # fmt: skip


def place_map_targets() -> Iterator[Target]:
    """A damaged and a forged map."""
    yield Target("damaged/place_map", lambda: [valid_map()], _use_damaged)
    yield Target("forged/place_map", random_bytes, _Forged(), largest=512)


@cache
def _frames() -> list[Frame]:
    return frames(WAY)


@cache
def valid_map() -> bytes:
    """The file of a map of a few frames."""
    path = scratch() / "valid.fsmap"
    with PlaceMap.open(path, "monday", **OPTIONS) as site:
        for frame in (*_frames()[:3], *_frames()[-3:]):
            site.add(frame)
    return path.read_bytes()


def _use_damaged(data: bytes) -> bool:
    path = _fresh_path()
    path.write_bytes(data)
    return refusing(lambda: _use(path))


def _fresh_path() -> Path:
    path = scratch() / "hostile.fsmap"
    for suffix in ("", "-wal", "-shm", "-journal"):
        path.with_name(path.name + suffix).unlink(missing_ok=True)
    return path


def _use(path: Path) -> None:
    with PlaceMap.open(path, read_only=True) as site:
        site.check()
    with PlaceMap.open(path, "tuesday") as site:
        for session in site.sessions:
            check_numbers([site.trajectory(session.name), site.odometry(session.name)])
        check_numbers(site.edges)
        check_numbers(site.cloud(voxel=0.5).points)
        site.grid(resolution=1.0, config=GridConfig())
        check_numbers(site.localize(_frames()[1]))
        check_numbers(site.add(_frames()[4]))


class _Forged(Forged):
    """A map in which some values were replaced."""

    def _prepare(self) -> Callable[[bytes], bytes | None]:
        valid = valid_map()

        @GENERATE
        @given(st.data())
        def forge(data: st.DataObject) -> None:
            path = _fresh_path()
            path.write_bytes(valid)
            with closing(sqlite3.connect(path)) as database:
                columns = [
                    (table, column)
                    for (table,) in database.execute(
                        "SELECT name FROM sqlite_master WHERE type = 'table'"
                    ).fetchall()
                    for (_, column, *_) in database.execute(f"PRAGMA table_info({table})")
                ]
                for _ in range(data.draw(st.integers(1, 3))):
                    _replace(database, data, *data.draw(st.sampled_from(columns)))
                if data.draw(st.booleans()):
                    restore_crcs(database)
                database.commit()
            self._accepted = refusing(lambda: _use(path))

        return driven_by_bytes(forge)


def _replace(database: sqlite3.Connection, data: st.DataObject, table: str, column: str) -> None:
    """Write a hostile value, or damage the old one; SQLite may refuse."""
    rows = database.execute(f"SELECT {column} FROM {table}").fetchall()
    if not rows:
        return
    row = data.draw(st.integers(0, len(rows) - 1))
    value = rows[row][0]
    if isinstance(value, bytes) and value and data.draw(st.booleans()):
        place = data.draw(st.integers(0, len(value) - 1))
        piece = data.draw(st.sampled_from([b"", b"\xff", b"\x7f\xf8", b"\x00" * 8]))
        value = value[:place] + piece + value[place + len(piece) :]
    else:
        value = data.draw(st.sampled_from(_VALUES))
    key = {"setting": "name", "vector": "first"}.get(table, "rowid")
    chosen = database.execute(f"SELECT {key} FROM {table}").fetchall()[row][0]
    try:
        database.execute(f"UPDATE {table} SET {column} = ? WHERE {key} = ?", (value, chosen))
    except sqlite3.Error:
        return
