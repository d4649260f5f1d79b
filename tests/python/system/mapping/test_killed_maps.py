# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Maps survive processes that are killed while they add keyframes."""

from pathlib import Path

import pytest

from fuzz.killed_writers import (
    ACKNOWLEDGED,
    WRITERS,
    KillCount,
    add_to_map,
    check_map,
    kill_writer,
)

pytest.importorskip("small_gicp", reason="the libraries of registration are an extra")
pytest.importorskip("gtsam", reason="the library of pose graphs is an extra")


def test_killed_processes_lose_no_keyframe_that_a_map_acknowledged(tmp_path: Path) -> None:
    assert kill_writer(WRITERS["map"], tmp_path, kills=50) == KillCount(50, lost=0, left=0)
    acknowledged = (tmp_path / ACKNOWLEDGED).read_text().split()
    assert len(acknowledged) > 3, "the sessions did not go on"


def test_a_lost_keyframe_is_noticed(tmp_path: Path) -> None:
    add_to_map(tmp_path)
    check_map(tmp_path)
    with (tmp_path / ACKNOWLEDGED).open("a") as noted:
        noted.write("77\n")
    with pytest.raises(AssertionError):
        check_map(tmp_path)
