# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Kills processes that change a database of places, and counts what is lost.

    python -m benchmarks.fleet.killed_database [--kills 100] [--write]

One process after the other adds places, deletes recordings, builds the index and compacts, until it
is killed by SIGKILL at a random moment. Then the database must open, hold each place that an
``add`` acknowledged exactly once and none of the deleted, and answer queries as brute force does.
"""

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from benchmarks.accuracy.data import ROOT
from benchmarks.accuracy.markdown import table, write_between
from fusionslam.base.arrays import Floats32
from fusionslam.fleet.place_database import DatabaseSettings, PlaceDatabase
from fusionslam.fleet.places import PlaceFilter, Places
from fusionslam.fleet.row_search import scan

PAGE = ROOT / "docs" / "results" / "fleet.md"
SETTINGS = DatabaseSettings("m2dp", 32)
ADDED = 500
"""Places that one ``add`` brings, the recording of one session."""

_STEPS = ("add", "delete", "index", "compact")
_ROUND = ("add", "add", "add", "add", "delete", "index", "add", "add", "compact")
_START = 6_000  # places before the first kill, which are enough for an index
_KILLED_AFTER_S = (0.0, 1.5)  # after the first step began
_CHILD = "import sys; from benchmarks.fleet.killed_database import change; change(*sys.argv[1:])"
_CHECKED = 20  # queries

app = typer.Typer(add_completion=False)


@dataclass
class KillCount:
    """What kills did.

    Attributes:
        kills: by the step that they interrupted.
        lost: places that were acknowledged, but are missing.
        doubled: places that are there more than once.
        returned: places that were deleted, but are there.
        wrong: queries with another answer than brute force has.
        places: in the database at the end.
    """

    kills: Counter[str] = field(default_factory=Counter)
    lost: int = 0
    doubled: int = 0
    returned: int = 0
    wrong: int = 0
    places: int = 0

    @property
    def is_whole(self) -> bool:
        """Whether nothing went wrong."""
        return not (self.lost or self.doubled or self.returned or self.wrong)


@app.command()
def main(
    kills: Annotated[int, typer.Option(help="Number of kills.")] = 100,
    write: Annotated[bool, typer.Option("--write", help="Put the table into the docs.")] = False,
) -> None:
    """Kill, check, and print a table."""
    with tempfile.TemporaryDirectory() as folder:
        count = kill(Path(folder), kills)
    text = table_of(count)
    print(text)
    if write:
        write_between(PAGE, "killed database", text)
    if not count.is_whole:
        sys.exit(1)


def kill(folder: Path, kills: int, seed: int = 0) -> KillCount:
    """Kill so many processes that change a database in an empty folder."""
    with PlaceDatabase.create(folder / "database", SETTINGS) as database:
        for session in range(_START // ADDED):
            database.add(places_of(session))
        database.build_index()
    acknowledged, deleted = set(range(_START // ADDED)), set[int]()
    count, rng = KillCount(), np.random.default_rng(seed)
    for number in range(kills):
        step = _kill_one(folder, rng.uniform(*_KILLED_AFTER_S), number, acknowledged, deleted)
        count.kills[step] += 1
        check(folder, acknowledged, deleted, count)
        print(f"{number + 1}: killed in {step}, {count.places} places", file=sys.stderr, flush=True)
    return count


def change(folder: str, start: str) -> None:
    """Change the database until killed; say what begins and what is done."""
    with PlaceDatabase.open(Path(folder) / "database") as database:
        sessions = [int(one.session) for one in database.sessions()]
        following = max(sessions) + 1
        for number in range(10**6):
            step = _ROUND[(int(start) + number) % len(_ROUND)]
            about = following if step == "add" else min(sessions)
            print(f"begin {step} {about}", flush=True)
            if step == "add":
                database.add(places_of(about))
                sessions.append(about)
                following += 1
            elif step == "delete":
                database.delete(PlaceFilter(session=str(about)))
                sessions.remove(about)
            elif step == "index":
                database.build_index()
            else:
                database.compact(keep_s=0)
            print(f"done {step} {about}", flush=True)


def places_of(session: int) -> Places:
    """The places of a session, the same whenever they are made."""
    rng = np.random.default_rng(session)
    centres = np.repeat(rng.standard_normal((ADDED // 50, SETTINGS.length)), 50, axis=0)
    rows = centres + 0.3 * rng.standard_normal(centres.shape)
    frames = np.arange(ADDED)
    keys = [f"{session}:{frame}" for frame in frames]
    return Places(keys, rows.astype(np.float32), frames * 10**8, frames, str(session))


def check(folder: Path, acknowledged: set[int], deleted: set[int], count: KillCount) -> None:
    """Open the database and count what is wrong; what a killed step had done is noted."""
    with PlaceDatabase.open(folder / "database", read_only=True) as database:
        with database._reading() as rows:
            keys = [key for batch in scan(rows, ["key"]) for key in batch["key"].to_pylist()]
        found = Counter(int(key.split(":")[0]) for key in keys)
        count.doubled += len(keys) - len(set(keys))
        count.lost += sum(ADDED - found[one] for one in acknowledged)
        count.returned += sum(found[one] for one in deleted)
        unsure = set(found) - acknowledged - deleted
        count.lost += sum(ADDED - found[one] for one in unsure)  # whole, or not there
        acknowledged |= unsure
        queries = np.vstack([places_of(one).vectors[:2] for one in sorted(acknowledged)[-10:]])
        count.wrong += _wrong(database, queries[:_CHECKED])
        count.places = len(keys)


def table_of(count: KillCount) -> str:
    """The counts in Markdown."""
    head = ["killed while it", "times"]
    kills = table(head, [[f"does `{step}`", count.kills[step]] for step in _STEPS])
    wrong = table(
        [
            "acknowledged and lost",
            "there twice",
            "deleted and back",
            "wrong answers",
            "places left",
        ],
        [[count.lost, count.doubled, count.returned, count.wrong, f"{count.places:,}"]],
    )
    return f"{kills}\n\n{wrong}"


def _kill_one(
    folder: Path, after_s: float, number: int, acknowledged: set[int], deleted: set[int]
) -> str:
    """Let a process change the database, kill it, and return the step that it was at."""
    log = folder / "log"
    start = number * 5 % len(_ROUND)  # each kind of step comes first at times
    with log.open("w") as output:
        process = subprocess.Popen(
            [sys.executable, "-c", _CHILD, str(folder), str(start)],
            stdout=output,
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        )
    while "begin" not in log.read_text() and process.poll() is None:
        time.sleep(0.01)
    time.sleep(after_s)
    os.kill(process.pid, signal.SIGKILL)
    if process.wait() != -signal.SIGKILL:
        raise RuntimeError("the process that changes the database ended by itself")
    return _note(log.read_text(), acknowledged, deleted)


def _note(said: str, acknowledged: set[int], deleted: set[int]) -> str:
    """Note what a killed process said it had done; return the step that it was at."""
    step = "nothing"
    for line in said.splitlines(keepends=True):
        if not line.endswith("\n"):
            break
        state, step, session = line.split()
        if step == "add" and state == "done":
            acknowledged.add(int(session))
        if step == "delete":  # one that was interrupted may have been done
            acknowledged.discard(int(session))
            if state == "done":
                deleted.add(int(session))
    return step


def _wrong(database: PlaceDatabase, queries: Floats32) -> int:
    """Number of queries, stored vectors, whose nearest is another than by brute force."""
    pairs = zip(database.query(queries, k=3), database.query(queries, k=3, exact=True), strict=True)
    return sum(found[0].key != exact[0].key for found, exact in pairs)


if __name__ == "__main__":
    app()
