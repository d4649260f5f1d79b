# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Databases of places survive processes that are killed while they change them."""

from pathlib import Path

import pytest

pytest.importorskip("lancedb", reason="the table of places is an extra")

from benchmarks.fleet.killed_database import KillCount, check, kill


def test_killed_processes_lose_no_place_that_was_acknowledged(tmp_path: Path) -> None:
    count = kill(tmp_path, kills=6, seed=1)
    assert count.is_whole, count
    assert sum(count.kills.values()) == 6
    assert count.places > 0
    # What is lost would be noticed.
    worse = KillCount()
    check(tmp_path, {10**6}, {11}, worse)
    assert not worse.is_whole
