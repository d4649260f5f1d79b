# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The page on the file of maps: its tables are those of a file, and its programs read one."""

import re
import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fusionslam.mapping import PlaceMap
from map_fixtures import FRAMES
from pages import DOCS, snippets

pytest.importorskip("small_gicp", reason="the libraries of registration are an extra")
pytest.importorskip("gtsam", reason="the library of pose graphs is an extra")


def test_the_tables_of_the_page_are_those_of_the_file(short: Path) -> None:
    database = sqlite3.connect(short)
    tables = database.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall()
    stored = {
        (table, column)
        for (table,) in tables
        for _, column, *_ in database.execute(f"PRAGMA table_info({table})")
    }
    version = database.execute("PRAGMA user_version").fetchone()[0]
    database.close()
    text = (DOCS / "reference" / "map_file.md").read_text(encoding="utf-8")
    told, table = set(), ""
    for cells in re.findall(r"^\|(.*?)\|(.*?)\|", text, re.MULTILINE):
        names = [re.findall(r"`(\w+)`", cell) for cell in cells]
        table = names[0][0] if names[0] else table
        told |= {(table, column) for column in names[1]}
    assert told == stored
    assert f"the version of the format, {version}." in " ".join(text.split())


def test_the_programs_of_the_page_read_what_the_map_has(
    short: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(short.parent)
    _, read_poses, read_cloud = snippets("reference/map_file")
    names: dict[str, Any] = {}
    exec(read_poses, names)
    exec(read_cloud, names)
    with PlaceMap.open(short, read_only=True) as site:
        np.testing.assert_array_equal([*names["odometry"].values()], site.odometry("monday"))
        assert names["colors"] is None
        shown = site.cloud(voxel=0.1).points
        first = FRAMES[0].points
    assert first is not None and len(shown) >= len(names["points"]) > 100
    np.testing.assert_allclose(np.ptp(names["points"], axis=0), np.ptp(first, axis=0), atol=0.3)
