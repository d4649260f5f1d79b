# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Rows of a map's file that were changed by hand."""

import json
import sqlite3

from fusionslam.mapping.map_schema import row_crc


def restore_crcs(database: sqlite3.Connection) -> None:
    """Give each row, and each table, the CRC of what it holds, as if a map had written it."""
    _restore_rows(database)
    seals = {
        table: database.execute(f"SELECT ifnull(sum((1 << 32) + crc), 0) FROM {table}").fetchone()[
            0
        ]
        for (table,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
        if table != "state"
    }
    database.execute("UPDATE state SET seals = ?", (json.dumps(seals),))
    _restore_rows(database)


def _restore_rows(database: sqlite3.Connection) -> None:
    tables = database.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall()
    for (table,) in tables:
        columns = [name for _, name, *_ in database.execute(f"PRAGMA table_info({table})")]
        if "crc" not in columns:
            continue
        for rowid, *values, _ in database.execute(f"SELECT rowid, * FROM {table}").fetchall():
            crc = row_crc(values)
            database.execute(f"UPDATE {table} SET crc = ? WHERE rowid = ?", (crc, rowid))
