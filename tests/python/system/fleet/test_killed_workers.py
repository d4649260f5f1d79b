# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Fleets and databases of places whose processes are killed."""

import os
import select
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from benchmarks.fleet import killed_database, killed_workers
from fleet_places import LENGTH, SETTINGS, made_places, made_segment
from fleets import FRAMES, InProcess, chunk_files, describe_fleet, digests
from fusionslam.fleet.chunk import StoredChunk
from fusionslam.fleet.place_database import PlaceDatabase
from fusionslam.fleet.segment import delete_segments
from permissions import small_disk
from project import SUPPORT
from refusals import refuses
from rows import rows

pytest.importorskip("lancedb", reason="the table of places is an extra")

DONE = "done\n"
DRIVER = """
import sys
from pathlib import Path
from fleets import InProcess, describe_fleet
from fusionslam.fleet.engines.local import LocalEngine

class Telling:
    def __init__(self, engine):
        self.engine = engine
    def run(self, chunks, work):
        for done in self.engine.run(chunks, work):
            print("done", flush=True)
            yield done
if __name__ == "__main__":
    engine = LocalEngine(1) if sys.argv[3] == "local" else InProcess()
    try:
        describe_fleet(Path(sys.argv[1]), Path(sys.argv[2]), Telling(engine), chunk=1)
    finally:
        engine.close()
"""
WRITER = """
import sys
from fleet_places import made_places
from fusionslam.fleet.place_database import PlaceDatabase
with PlaceDatabase.open(sys.argv[1]) as database:
    database.add(made_places("elsewhere", 15, seed=7))
    print("done", flush=True)
    sys.stdin.readline()
"""


@contextmanager
def started(folder: Path, program: str, *words: object) -> Iterator["subprocess.Popen[str]"]:
    """Yield a process that runs a program; it is ended if the test did not."""
    script = folder / "program.py"
    script.write_text(program)
    with subprocess.Popen(
        [sys.executable, str(script), *map(str, words)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(SUPPORT), *filter(None, sys.path)])},
    ) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.mark.slow
def test_a_killed_driver_leaves_whole_chunks_to_the_next_one(fleet: Path, tmp_path: Path) -> None:
    places = tmp_path / "places"
    describe_fleet(fleet, tmp_path / "whole", chunk=1)
    with started(tmp_path, DRIVER, fleet, places, "here") as driver:
        for _ in range(FRAMES // 3):
            assert driver.stdout.readline() == DONE
        driver.kill()
    whole = [path for path in chunk_files(places) if path.suffix == ".npz"]
    assert len(whole) >= FRAMES // 3 and all(StoredChunk.load(path) for path in whole)
    engine = InProcess()
    assert describe_fleet(fleet, places, engine, chunk=1) == []
    assert len(engine.begun) == FRAMES - len(whole)
    assert digests(places) == digests(tmp_path / "whole")


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_no_worker_outlives_its_driver(fleet: Path, tmp_path: Path, number: int) -> None:
    with started(tmp_path, DRIVER, fleet, tmp_path / "places", "local") as driver:
        assert driver.stdout.readline() == DONE
        children = Path(f"/proc/{driver.pid}/task/{driver.pid}/children").read_text().split()
        workers = [os.pidfd_open(int(pid)) for pid in children]
        assert workers
        driver.send_signal(number)
        driver.wait()
    for worker in workers:  # can be read once it has ended
        assert select.select([worker], [], [], 300)[0], "a process is left"
        os.close(worker)


@pytest.mark.nightly
def test_another_process_writes_while_this_one_reads(tmp_path: Path) -> None:
    with PlaceDatabase.create(tmp_path / "database", SETTINGS) as database:
        database.add(made_places("here", 10))
    with (
        PlaceDatabase.open(tmp_path / "database", read_only=True) as reader,
        started(tmp_path, WRITER, tmp_path / "database") as writer,
    ):
        assert len(reader) == 10
        assert writer.stdout.readline() == DONE
        assert len(reader.query(np.zeros(LENGTH), k=100)[0]) == 25
        with refuses("locked"):
            PlaceDatabase.open(tmp_path / "database")
        writer.communicate("\n")
    PlaceDatabase.open(tmp_path / "database").close()


@pytest.mark.slow
@pytest.mark.parametrize("kills", [1, pytest.param(6, marks=pytest.mark.nightly)])
def test_killed_processes_lose_no_place_that_was_acknowledged(tmp_path: Path, kills: int) -> None:
    count = killed_database.kill(tmp_path, kills=kills, seed=1)
    assert count.is_whole, count
    assert sum(count.kills.values()) == kills
    assert count.places > 0
    # What is lost would be noticed.
    worse = killed_database.KillCount()
    killed_database.check(tmp_path, {10**6}, {11}, worse)
    assert not worse.is_whole


@pytest.mark.nightly
def test_a_lost_node_and_a_killed_driver_leave_the_bytes_of_one_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("ray", reason="Ray is of an extra")
    for name in ("PYTHONPATH", "RAY_USAGE_STATS_ENABLED", "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"):
        monkeypatch.setenv(name, os.environ.get(name, ""))
    killed_workers.prepare_environment()
    # Another test may have imported Ray before.
    monkeypatch.setattr("ray._private.ray_constants.ENABLE_RAY_CLUSTER", False)
    names = ["Ray, one of three nodes lost", "driver killed, run again"]
    with TemporaryDirectory(ignore_cleanup_errors=True) as folder:  # Ray needs a short path
        monkeypatch.setenv("RAY_TMPDIR", folder)
        cases = [*killed_workers.measure(tmp_path, recordings=2, frames=40, chunk=4, cases=names)]
    assert [each.name for each in cases] == ["1 process", *names]
    for each in cases:
        assert (each.frames, each.doubled, each.other, each.missing) == (80, 0, 0, 0), each
    assert cases[1].note == "1 removed"
    assert int(cases[2].note.rpartition(" ")[2].rstrip("%")) < 75


def test_the_table_of_what_dies_has_a_row_for_each_case() -> None:
    plain = killed_workers.Case("one", 8000, 0, 0, 0, 10.0)
    killed = killed_workers.Case("two", 8000, 0, 0, 0, 7.0, "2 killed")
    lines = killed_workers.text_of([plain, killed]).splitlines()
    assert lines[-1] == "| two | 8,000 | 0 | 0 | 7 | 0.70 | 2 killed |"
    assert len(lines) == 4


@rows("space", ["1m", "1700k"])
def test_a_full_disk_is_named_and_no_segment_is_left(tmp_path: Path, space: str) -> None:
    """The vectors take 1.6 MB, FAISS's file 0.5 MB."""
    pytest.importorskip("faiss", reason="FAISS is of an extra")
    with small_disk(tmp_path, space):
        with refuses("cannot-write"):
            made_segment(tmp_path / "segments")
        assert not [path for path in tmp_path.rglob("*") if path.suffix == ".faiss"]
        delete_segments(tmp_path / "segments", but="")
