# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of processes that are killed, that may not write, or whose disk is full."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from fusionslam import DataError
from fusionslam.mapping.map_database import is_map
from fusionslam.mapping.map_file import MapFile
from fusionslam.mapping.place_map import PlaceMap
from fuzz.killed_writers import (
    ACKNOWLEDGED,
    WRITERS,
    KillCount,
    add_to_map,
    check_map,
    kill_writer,
)
from map_fixtures import FRAMES, STORED
from permissions import bound_by_permissions, exit_code_of, fork
from refusals import refuses
from rows import rows
from streets import OPTIONS

pytest.importorskip("small_gicp", reason="the libraries of registration are an extra")
pytest.importorskip("gtsam", reason="the library of pose graphs is an extra")


@pytest.mark.slow
def test_killed_processes_lose_no_keyframe_that_a_map_acknowledged(tmp_path: Path) -> None:
    """Each is killed at a random moment after it has acknowledged some keyframe."""
    add_to_map(tmp_path)
    noted, moments = tmp_path / ACKNOWLEDGED, random.Random(2)

    def add() -> None:
        while True:
            add_to_map(tmp_path)

    for _ in range(4):
        before = noted.stat().st_size
        child = fork(add)
        while noted.stat().st_size == before:
            time.sleep(0.002)
        time.sleep(moments.uniform(0, 0.1))
        os.kill(child, signal.SIGKILL)
        assert exit_code_of(child) == -signal.SIGKILL
        check_map(tmp_path)
    with noted.open("a") as file:  # what is lost would be noticed
        file.write("77\n")
    with pytest.raises(AssertionError):
        check_map(tmp_path)


@pytest.mark.nightly
def test_many_killed_processes_lose_no_keyframe(tmp_path: Path) -> None:
    assert kill_writer(WRITERS["map"], tmp_path, kills=50) == KillCount(50, lost=0, left=0)


@pytest.mark.slow
@rows("touch", ["nothing", "is_map", "reader", "second writer"])
def test_looking_at_a_map_leaves_its_writer_alone(tmp_path: Path, touch: str) -> None:
    """Another program opens and closes the map between two commits; then the writer is killed."""
    path = tmp_path / "site.fsmap"
    look = f"import sqlite3; c = sqlite3.connect({str(path)!r}); "
    look += "c.execute('SELECT * FROM session'); c.close()"

    def write() -> None:
        site = MapFile(path)
        with site.transaction():
            site.add_session("one")
        if touch == "is_map":
            assert is_map(path)
        elif touch == "reader":
            MapFile(path, read_only=True).close()
        elif touch == "second writer":
            with refuses("locked"):
                MapFile(path)
        subprocess.run([sys.executable, "-c", look], check=True)
        with site.transaction():
            site.add_session("two")
        os.kill(os.getpid(), signal.SIGKILL)

    _, status = os.waitpid(fork(write), 0)
    assert os.waitstatus_to_exitcode(status) == -signal.SIGKILL
    with MapFile(path) as file:
        assert list(file.sessions()) == ["one", "two"]
    assert [*tmp_path.iterdir()] == [path]


def test_a_map_in_a_folder_that_cannot_be_written_is_read(short: Path) -> None:
    short.chmod(0o444)
    short.parent.chmod(0o555)

    def read() -> None:
        with PlaceMap.open(short, read_only=True) as site:
            assert len(site) == STORED and site.check() == []
        for path in (short, short.with_name("new.fsmap")):
            with refuses("cannot-write", str(path)):
                PlaceMap.open(path, "tuesday")

    bound_by_permissions(read)
    assert os.listdir(short.parent) == ["site.fsmap"]
    short.parent.chmod(0o755)


def test_a_map_that_may_not_be_read_is_named(short: Path) -> None:
    short.chmod(0o200)

    def read() -> None:
        assert not is_map(short)
        with refuses("cannot-read", str(short)):
            PlaceMap.open(short, read_only=True)

    bound_by_permissions(read)


def test_a_full_file_system_keeps_what_was_acknowledged(tmp_path: Path) -> None:
    mount = ["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", str(tmp_path)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("no file system can be mounted")
    try:
        path = tmp_path / "site.fsmap"
        kept = 0
        with PlaceMap.open(path, "monday", **OPTIONS) as site:
            with pytest.raises(DataError, check=lambda e: e.code == "cannot-write"):
                for frame in FRAMES * 9:
                    kept += site.add(frame).keyframe is not None
            assert len(site) == kept > 2
        with PlaceMap.open(path, read_only=True) as site:
            assert len(site) == kept and site.check() == []
    finally:
        subprocess.run(["umount", "--lazy", str(tmp_path)], check=True)
