# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The benchmark of what dies while a fleet is described, made short."""

import os
from pathlib import Path

import pytest

from benchmarks.fleet import killed_workers
from benchmarks.fleet.killed_workers import Case, measure, text_of


@pytest.fixture(autouse=True)
def environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("PYTHONPATH", "RAY_USAGE_STATS_ENABLED", "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"):
        monkeypatch.setenv(name, os.environ.get(name, ""))
    killed_workers.prepare_environment()


@pytest.mark.slow
def test_a_lost_node_and_a_killed_driver_leave_the_bytes_of_one_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("ray", reason="Ray is of an extra")
    # Another test may have imported Ray before.
    monkeypatch.setattr("ray._private.ray_constants.ENABLE_RAY_CLUSTER", False)
    names = ["Ray, one of three nodes lost", "driver killed, run again"]
    cases = [*measure(tmp_path, recordings=2, frames=40, chunk=4, cases=names)]
    assert [each.name for each in cases] == ["1 process", *names]
    for each in cases:
        assert (each.frames, each.doubled, each.other, each.missing) == (80, 0, 0, 0), each
    assert cases[1].note == "1 removed"
    assert int(cases[2].note.rpartition(" ")[2].rstrip("%")) < 75


def test_the_table_has_a_row_for_each_case() -> None:
    cases = [Case("one", 8000, 0, 0, 0, 10.0), Case("two", 8000, 0, 0, 0, 7.0, "2 killed")]
    lines = text_of(cases).splitlines()
    assert lines[-1] == "| two | 8,000 | 0 | 0 | 7 | 0.70 | 2 killed |"
    assert len(lines) == 4
