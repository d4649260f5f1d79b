# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of processes that are killed, that may not write, or whose disk is full."""

import os
import random
import shutil
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
from fuzz.bit_flips import flipped
from fuzz.changed_files import HOWS, change_at_random_moments
from fuzz.killed_writers import (
    ACKNOWLEDGED,
    WRITERS,
    KillCount,
    add_to_map,
    check_map,
    kill_writer,
)
from map_fixtures import FRAMES, STORED
from permissions import bound_by_permissions, exit_code_of, fork, small_disk
from refusals import refuses
from rows import rows
from streets import OPTIONS

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
    with small_disk(tmp_path, "4m"):
        path = tmp_path / "site.fsmap"
        kept = 0
        with PlaceMap.open(path, "monday", **OPTIONS) as site:
            with pytest.raises(DataError, check=lambda e: e.code == "cannot-write"):
                for frame in FRAMES * 9:
                    kept += site.add(frame).keyframe is not None
            assert len(site) == kept > 2
        with PlaceMap.open(path, read_only=True) as site:
            assert len(site) == kept and site.check() == []


@rows("read_only", [True, False])
def test_a_map_whose_maker_was_killed_is_made_again(tmp_path: Path, read_only: bool) -> None:
    path = tmp_path / "a.fsmap"

    def make() -> None:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(MapFile, "_write_state", lambda *_: os.kill(os.getpid(), signal.SIGKILL))
            MapFile(path)

    assert exit_code_of(fork(make)) == -signal.SIGKILL
    if read_only:
        with refuses("other-format"):
            MapFile(path, read_only=True)
        return
    with MapFile(path) as file:
        add_setting(file, 1)
    with MapFile(path, read_only=True) as file:
        assert file.setting("a") == 1 and file.check() == []


def add_setting(file: MapFile, value: object) -> None:
    with file.transaction():
        file.store_setting("a", value)


def killed_writer(path: Path, *, changes: int = 3) -> None:
    """Leave the log and the lock of a process that is killed after some changes."""

    def write() -> None:
        file = MapFile(path)
        for number in range(changes):
            add_setting(file, f"change {number}")
        os.kill(os.getpid(), signal.SIGKILL)

    assert exit_code_of(fork(write)) == -signal.SIGKILL


def files_of(path: Path) -> dict[str, bytes]:
    """Without the index of the log, which SQLite makes anew."""
    kept = (each for each in path.parent.glob("a.*") if not each.name.endswith("-shm"))
    return {each.name: each.read_bytes() for each in kept}


@rows("how", ["replaced", "deleted", "moved"])
@rows("moment", ["before a change", "within a change", "before the end"])
def test_a_file_that_is_replaced_while_it_is_open_is_told(
    tmp_path: Path, how: str, moment: str
) -> None:
    path, other = tmp_path / "a.fsmap", tmp_path / "b.fsmap"
    MapFile(other).close()

    def take_away() -> None:
        if how == "replaced":
            os.replace(other, path)
        elif how == "deleted":
            path.unlink()
        else:
            path.rename(tmp_path / "c.fsmap")

    file = MapFile(path)
    add_setting(file, 1)
    if moment == "before the end":
        take_away()
    else:
        with refuses("replaced", str(path)):
            if moment == "before a change":
                take_away()
            with file.transaction():
                file.store_setting("a", 2)
                if moment == "within a change":
                    take_away()
    with refuses("replaced", str(path)):
        file.close()
    file.close()
    assert not path.with_name("a.fsmap-lock").exists()


@rows("read_only", [True, False])
@rows("backup", ["older", "of another map", "of now"])
def test_a_backup_beside_the_log_of_a_killed_process_is_told(
    tmp_path: Path, backup: str, read_only: bool
) -> None:
    path, saved = tmp_path / "a.fsmap", tmp_path / "saved"
    MapFile(path).close()
    saved.mkdir()
    for number in range(2 if backup == "of now" else 1):
        with MapFile(path) as file:
            add_setting(file, number)
    if backup == "of another map":
        MapFile(saved / "a.fsmap").close()
    else:
        shutil.copyfile(path, saved / "a.fsmap")
    if backup != "of now":
        with MapFile(path) as file:  # is in the file when the log begins
            add_setting(file, "later")
    killed_writer(path)
    whole = files_of(path)
    shutil.copyfile(saved / "a.fsmap", path)
    if backup == "of now":
        with MapFile(path, read_only=read_only) as file:
            assert file.setting("a") == "change 2"
        return
    before = files_of(path)
    with refuses("other-log", str(path)):
        MapFile(path, read_only=read_only)
    assert files_of(path) == before  # so that the damage is not for ever
    path.write_bytes(whole["a.fsmap"])
    with MapFile(path, read_only=True) as file:
        assert file.setting("a") == "change 2"
    shutil.copyfile(saved / "a.fsmap", path)  # as the page says
    for suffix in ("-wal", "-shm", "-lock"):
        path.with_name(f"a.fsmap{suffix}").unlink(missing_ok=True)
    with MapFile(path, read_only=read_only) as file:
        assert file.setting("a") == (None if backup == "of another map" else 0)


@rows("read_only", [True, False])
@rows("damage", ["flipped", "deleted"])
def test_lost_changes_of_a_killed_process_are_told(
    tmp_path: Path, damage: str, read_only: bool
) -> None:
    path = tmp_path / "a.fsmap"
    MapFile(path).close()
    killed_writer(path)
    log = path.with_name("a.fsmap-wal")
    whole = log.read_bytes()
    rng = random.Random(3)
    for place in [40, len(whole) - 30_000, *rng.sample(range(len(whole)), 8)]:
        damaged = flipped(whole, 8 * place + rng.randrange(8))
        log.write_bytes(damaged) if damage == "flipped" else log.unlink(missing_ok=True)
        with refuses("lost-changes"):
            MapFile(path, read_only=read_only)
    log.write_bytes(whole)
    with MapFile(path, read_only=read_only) as file:
        assert file.setting("a") == "change 2"


def test_a_child_process_leaves_the_map_of_its_parent_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.fsmap"
    with MapFile(path) as file:
        add_setting(file, 1)

        def use() -> None:
            with refuses("forked", str(path)):
                file.setting("a")
            with refuses("forked", str(path)):
                add_setting(file, 2)
            file.close()
            with MapFile(path, read_only=True) as own:
                assert own.setting("a") == 1
            with refuses("locked"):
                MapFile(path)

        assert exit_code_of(fork(use)) == 0
        assert path.with_name("a.fsmap-lock").exists()
        add_setting(file, 2)
        with MapFile(path, read_only=True) as reader:
            assert reader.setting("a") == 2
    assert [*tmp_path.iterdir()] == [path]


@pytest.mark.parametrize("rounds", [1, pytest.param(20, marks=pytest.mark.nightly)])
def test_files_that_change_at_random_moments_lose_nothing_without_a_word(rounds: int) -> None:
    ends = change_at_random_moments(rounds * len(HOWS))
    assert ends.total() == rounds * len(HOWS)
    assert {end for _, end in ends} <= {"kept", "told"}, ends
