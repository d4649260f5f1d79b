# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of a map's database, and how rows are known to be those that were written."""

import json
import sqlite3
import struct
import zlib
from collections.abc import Iterable, Mapping
from contextlib import closing
from functools import cache
from typing import Any, NamedTuple

APPLICATION_ID = 0x66736D70
VERSION = 3

TABLES = """
CREATE TABLE state (
  id INTEGER PRIMARY KEY CHECK (id = 0),
  map BLOB NOT NULL,
  number INTEGER NOT NULL,
  base INTEGER NOT NULL,
  seals TEXT NOT NULL,
  crc INTEGER NOT NULL
);
CREATE TABLE setting (
  name TEXT PRIMARY KEY,
  value TEXT NOT NULL,
  crc INTEGER NOT NULL
);
CREATE TABLE session (
  id INTEGER PRIMARY KEY,
  name TEXT NOT NULL UNIQUE,
  crc INTEGER NOT NULL
);
CREATE TABLE keyframe (
  id INTEGER PRIMARY KEY,
  session INTEGER NOT NULL REFERENCES session (id) ON DELETE CASCADE,
  frame INTEGER NOT NULL,
  stamp_ns INTEGER NOT NULL,
  odometry BLOB NOT NULL,
  robot_from_cloud BLOB NOT NULL,
  crc INTEGER NOT NULL
);
CREATE INDEX keyframe_session ON keyframe (session);
CREATE TABLE frame (
  keyframe INTEGER NOT NULL REFERENCES keyframe (id) ON DELETE CASCADE,
  first INTEGER NOT NULL,
  numbers BLOB NOT NULL,
  stamps BLOB NOT NULL,
  motions BLOB NOT NULL,
  crc INTEGER NOT NULL,
  PRIMARY KEY (keyframe, first)
);
CREATE TABLE cloud (
  keyframe INTEGER PRIMARY KEY REFERENCES keyframe (id) ON DELETE CASCADE,
  evidence BLOB NOT NULL,
  image BLOB,
  ground_level REAL NOT NULL,
  points BLOB NOT NULL,
  crc INTEGER NOT NULL
);
CREATE TABLE vector (
  descriptor TEXT NOT NULL,
  first INTEGER NOT NULL,
  keyframes BLOB NOT NULL,
  rows BLOB NOT NULL,
  crc INTEGER NOT NULL,
  PRIMARY KEY (descriptor, first)
);
CREATE TABLE edge (
  id INTEGER PRIMARY KEY,
  kind TEXT NOT NULL,
  a INTEGER NOT NULL REFERENCES keyframe (id) ON DELETE CASCADE,
  b INTEGER NOT NULL REFERENCES keyframe (id) ON DELETE CASCADE,
  pose BLOB NOT NULL,
  covariance BLOB NOT NULL,
  state TEXT NOT NULL,
  code TEXT,
  number REAL,
  text TEXT,
  crc INTEGER NOT NULL
);
CREATE INDEX edge_a ON edge (a);
CREATE INDEX edge_b ON edge (b);
CREATE TABLE solution (
  id INTEGER PRIMARY KEY CHECK (id = 0),
  keyframes BLOB NOT NULL,
  poses BLOB NOT NULL,
  parts BLOB NOT NULL,
  crc INTEGER NOT NULL
);
"""

KEYS: Mapping[str, tuple[str, ...]] = {
    "setting": ("name",),
    "session": ("id",),
    "keyframe": ("id",),
    "frame": ("keyframe", "first"),
    "cloud": ("keyframe",),
    "vector": ("descriptor", "first"),
    "edge": ("id",),
    "solution": ("id",),
}
"""Columns that tell the rows of a table apart, which come first."""


class MapState(NamedTuple):
    """The row of table ``state``.

    Attributes:
        map: number of the map, by which its log is known; copies of the file have the same.
        number: of the change that wrote this, from 1 on.
        base: number of the change up to which the file itself, without its log, has all.
        seals: by table, its rows' number x 2**32 + the sum of their CRCs: none is missing.
    """

    map: bytes
    number: int
    base: int
    seals: dict[str, int]


@cache
def schema() -> set[tuple[str, str, str, str | None]]:
    """Type, name, table and statement of all that a map's file has."""
    with closing(sqlite3.connect(":memory:")) as database:
        database.executescript(TABLES)
        return {*database.execute("SELECT type, name, tbl_name, sql FROM sqlite_master")}


def row_crc(values: Iterable[Any]) -> int:
    """CRC-32 of a row: of integers and numbers as int64 and float64, of texts as UTF-8."""
    crc = 0
    for value in values:
        if isinstance(value, int | float):
            value = struct.pack("<q" if isinstance(value, int) else "<d", value)
        elif isinstance(value, str):
            value = value.encode()
        crc = zlib.crc32(value or b"", crc)
    return crc


def seal(crcs: Iterable[int]) -> int:
    return sum(2**32 + crc for crc in crcs)


def decode_state(rows: list[tuple[Any, ...]]) -> MapState:
    """Raises ValueError or TypeError for rows that are not the one of table ``state``."""
    if len(rows) != 1 or row_crc(rows[0][:-1]) != rows[0][-1]:
        raise ValueError("table state: its CRC is another one")
    _, name, number, base, seals = rows[0][:-1]
    sums = {table: int(value) for table, value in json.loads(seals).items()}
    return MapState(bytes(name), int(number), int(base), sums)
