# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Kills workers, nodes and drivers that describe a fleet, fills the disk, and compares the bytes.

    python -m benchmarks.fleet.killed_workers [--frames 1000] [--case NAME ...] [--write]

Eight made recordings are described by one process first. Then by others, to which something
happens; every frame must be there once, and the digests of all files be those of one process.
Times are compared with that of one process: run it on a machine that does nothing else. The cases
"nodes", "ray" and "ray killed" need Ray, "disk full" Linux with namespaces of users.
"""

import hashlib
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any
from unittest import mock

import numpy as np
import typer

from benchmarks.accuracy.data import ROOT
from benchmarks.accuracy.markdown import table, write_between
from fusionslam.config import merged
from fusionslam.datasets import write_cloud
from fusionslam.datasets.pose_files import write_poses_tum
from fusionslam.fleet import work
from fusionslam.fleet.chunk import Chunk, StoredChunk, describe_chunk
from fusionslam.fleet.config import FleetConfig, FleetSettings
from fusionslam.fleet.engines import Engine, open_engine
from fusionslam.fleet.recordings import Labels, find_recordings
from fusionslam.fleet.settings import settle_settings
from fusionslam.fleet.work import Failure, Plan, describe_recordings
from fusionslam.pipelines.describe import PipelineConfig
from fusionslam.sensors.frame import Cloud

PAGE = ROOT / "docs" / "results" / "fleet.md"
POISONOUS = "drive-1"
_POINTS = 20_000
_DISTINCT = 200  # clouds; frames share their files
_KILLED_AT = (0.25, 0.5)
_CHILD = "import sys; from benchmarks.fleet.killed_workers import fill_disk; fill_disk(sys.argv)"

app = typer.Typer(add_completion=False)


@dataclass(frozen=True)
class Case:
    """What came of a case.

    Attributes:
        name: of the case.
        frames: that are there.
        doubled: of these, there more than once.
        other: files whose bytes are not those of one process.
        missing: files that one process made.
        seconds: it took.
        note: what is particular.
    """

    name: str
    frames: int
    doubled: int
    other: int
    missing: int
    seconds: float
    note: str = ""


@dataclass(frozen=True)
class Fleet:
    """The recordings, where results go, and those of one process."""

    root: Path
    out: Path
    frames: int
    chunk: int
    expected: dict[str, str]

    def folder(self, name: str) -> Path:
        """An empty folder of results."""
        folder = self.out / name.replace(" ", "-")
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        return folder


def make_recordings(root: Path, recordings: int, frames: int) -> Path:
    """Drives along walls that are elsewhere in each cloud; done once."""
    if (root / "done").exists():
        return root
    shutil.rmtree(root, ignore_errors=True)
    pool = root.with_name(f"{root.name}-clouds")
    rng = np.random.default_rng(0)
    for number in range(_DISTINCT):
        path = pool / f"{number:03d}.bin"
        if not path.exists():
            write_cloud(path, Cloud(_walls(rng)))
    for drive in range(recordings):
        folder = root / f"drive-{drive}"
        (folder / "clouds").mkdir(parents=True)
        for frame in range(frames):
            source = pool / f"{(frame + 23 * drive) % _DISTINCT:03d}.bin"
            os.link(source, folder / "clouds" / f"{frame:06d}.bin")
        stamps = np.arange(frames) * 10**8
        (folder / "times.txt").write_text("".join(f"{stamp / 1e9:.1f}\n" for stamp in stamps))
        poses = np.tile(np.eye(4), (frames, 1, 1))
        poses[:, 0, 3] = np.arange(frames)
        write_poses_tum(folder / "odometry.txt", stamps, poses)
    (root / "done").touch()
    return root


def _walls(rng: np.random.Generator) -> Any:
    """float32 (N, 3): ground, and boxes around the scanner."""
    count = _POINTS // 2
    middles = rng.uniform(-30, 30, (40, 2))
    sizes = rng.uniform([1, 1, 1], [8, 8, 6], (40, 3))
    box, points = rng.integers(0, 40, count), rng.uniform(-0.5, 0.5, (count, 3))
    side = rng.integers(0, 2, count)
    points[np.arange(count), side] = np.sign(points[np.arange(count), side]) / 2
    walls = np.c_[middles[box], sizes[box, 2] / 2 - 1.7] + points * sizes[box]
    ground = rng.uniform([-30, -30, -1.75], [30, 30, -1.65], (_POINTS - count, 3))
    return np.concatenate([walls, ground]).astype(np.float32)


# Work, which other processes import from here.


def noted_chunk(chunk: Chunk, settings: FleetSettings, folder: Path) -> None:
    """Describe a chunk, and leave the number of the process, so that it can be killed."""
    (folder / "processes").mkdir(exist_ok=True)
    (folder / "processes" / str(os.getpid())).touch()
    describe_chunk(chunk, settings, folder)


def poisonous_chunk(chunk: Chunk, settings: FleetSettings, folder: Path) -> None:
    """Describe a chunk; no process survives the first of one recording."""
    if (chunk.recording.session, chunk.first) == (POISONOUS, 0):
        os.kill(os.getpid(), signal.SIGKILL)
    describe_chunk(chunk, settings, folder)


def other_work(function: Callable[..., None]) -> "mock._patch[Callable[..., None]]":
    """Let chunks be described by another function."""
    return mock.patch.object(work, "describe_chunk", function)


def describe(
    fleet: Fleet,
    folder: Path,
    engine: Engine,
    at: Callable[[float], None] = lambda share: None,
) -> tuple[list[Failure], float]:
    """Describe all; return what failed, and how long it took, with the start of processes.

    The start of Ray, which takes as long for eight recordings as for eight thousand, is left out.

    Args:
        fleet: to describe.
        folder: of the results.
        engine: runs the work, and is closed.
        at: called with the share that is done.
    """
    found = find_recordings(fleet.root, Labels())
    config = PipelineConfig()
    config = config.model_copy(update={"fusion": merged(config.fusion, {"source": "cloud"})})
    given = FleetConfig(chunk=fleet.chunk, clouds=False)
    settings = settle_settings(found, ["m2dp"], config, given, folder)
    plan = Plan.make(fleet.root, found, settings)
    try:
        started = time.monotonic()
        failures = describe_recordings(
            plan, settings, folder, engine, progress=lambda done, total: at(done / total)
        )
        return failures, time.monotonic() - started
    finally:
        engine.close()


def check(fleet: Fleet, name: str, folder: Path, seconds: float, note: str = "") -> Case:
    """Count the frames of a case, and compare its files with those of one process."""
    found, frames = digests(folder), Counter[tuple[str, int]]()
    for path in (folder / "chunks").rglob("*.npz"):
        chunk = StoredChunk.load(path)
        frames.update((chunk.about["session"], n) for n in chunk.arrays["frames"].tolist())
    expected = fleet.expected or found
    other = sum(expected.get(name) != digest for name, digest in found.items())
    doubled = sum(count > 1 for count in frames.values())
    missing = len(expected.keys() - found.keys())
    return Case(name, len(frames), doubled, other, missing, seconds, note)


def digests(folder: Path) -> dict[str, str]:
    """SHA-256 of every file of a chunk, whatever it is, by its name."""
    files = [path for path in (folder / "chunks").rglob("*") if path.is_file()]
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


# Cases.


def run_plainly(fleet: Fleet, name: str, engine: str, jobs: int) -> Case:
    """Nothing happens."""
    folder = fleet.folder(name)
    failures, seconds = describe(fleet, folder, open_engine(engine, jobs))
    return check(fleet, name, folder, seconds, _named(failures))


def kill_workers(fleet: Fleet, name: str, engine: str, jobs: int) -> Case:
    """Each worker that began is killed once."""
    folder = fleet.folder(name)
    killed: list[int] = []

    def kill(share: float) -> None:
        if len(killed) < jobs and share >= _KILLED_AT[len(killed)]:
            processes = (int(path.name) for path in (folder / "processes").iterdir())
            killed.append(next(pid for pid in processes if pid not in killed))
            os.kill(killed[-1], signal.SIGKILL)

    with other_work(noted_chunk):
        failures, seconds = describe(fleet, folder, open_engine(engine, jobs), kill)
    return check(fleet, name, folder, seconds, f"{len(killed)} killed{_named(failures)}")


def remove_node(fleet: Fleet, name: str) -> Case:
    """One of three nodes of Ray, each with a core, is lost in the middle."""
    from ray.cluster_utils import Cluster

    folder = fleet.folder(name)
    node: dict[str, Any] = {"num_cpus": 1, "object_store_memory": 100_000_000}
    cluster: Any = Cluster(
        initialize_head=True, head_node_args={**node, "include_dashboard": False}
    )
    lost = [cluster.add_node(**node) for _ in range(2)][:1]

    def remove(share: float) -> None:
        if lost and share >= 0.4:
            cluster.remove_node(lost.pop(), allow_graceful=False)

    os.environ["RAY_ADDRESS"] = cluster.address
    try:
        cluster.wait_for_nodes()
        failures, seconds = describe(fleet, folder, open_engine("ray", 3), remove)
    finally:
        del os.environ["RAY_ADDRESS"]
        cluster.shutdown()
    return check(fleet, name, folder, seconds, f"{1 - len(lost)} removed{_named(failures)}")


def kill_driver(fleet: Fleet, name: str) -> Case:
    """The driver is killed at 30 %, and another one goes on."""
    folder = fleet.folder(name)
    context = multiprocessing.get_context("spawn")
    driver = context.Process(target=_drive, args=(fleet, folder))
    driver.start()
    while len(files := chunks_there(folder)) < 0.3 * len(fleet.expected):
        time.sleep(0.02)
    driver.kill()
    driver.join()
    time.sleep(1)  # its workers follow it
    had = len(chunks_there(folder))
    failures, seconds = describe(fleet, folder, open_engine("local", 2))
    share = 1 - had / len(fleet.expected)
    note = f"killed at {len(files) / len(fleet.expected):.0%}; the rerun did {share:.0%}"
    return check(fleet, name, folder, seconds, note + _named(failures))


def chunks_there(folder: Path) -> list[Path]:
    """Whole files of chunks."""
    return [*(folder / "chunks").rglob("*.npz")]


def _drive(fleet: Fleet, folder: Path) -> None:
    describe(fleet, folder, open_engine("local", 2))


def poison(fleet: Fleet, name: str) -> Case:
    """A recording of which each worker dies that begins with it."""
    folder = fleet.folder(name)
    with other_work(poisonous_chunk):
        failures, seconds = describe(fleet, folder, open_engine("local", 2))
    return check(fleet, name, folder, seconds, _named(failures).removeprefix("; "))


def full_disk(fleet: Fleet, name: str) -> Case:
    """The disk has space for half of it; then for all, and another run completes it."""
    folder = fleet.folder(name)
    space = sum(path.stat().st_size for path in chunks_there(fleet.out / "1-process")) // 2
    command = [sys.executable, "-c", _CHILD, fleet.root, folder, fleet.frames, fleet.chunk, space]
    started = time.monotonic()
    done = subprocess.run(
        ["unshare", "--map-root-user", "--mount", *map(str, command)],
        check=True,
        stdout=subprocess.PIPE,
        text=True,
    )
    seconds = time.monotonic() - started
    return check(fleet, name, folder, seconds, done.stdout.strip().splitlines()[-1])


def fill_disk(arguments: list[str]) -> None:
    """In a process that may mount: describe on a disk that is too small, then on a larger one."""
    root, folder = map(Path, arguments[1:3])
    fleet = Fleet(root, folder, int(arguments[3]), int(arguments[4]), {})
    disk, space = folder / "disk", int(arguments[5])
    disk.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={space}", "none", disk], check=True)
    failures, _ = describe(fleet, disk, open_engine("local", 2))
    first = len(chunks_there(disk))
    reasons = {each.reason.rpartition(": ")[2] for each in failures}
    subprocess.run(["mount", "-o", f"remount,size={8 * space}", disk], check=True)
    again, _ = describe(fleet, disk, open_engine("local", 2))
    shutil.copytree(disk / "chunks", folder / "chunks")
    print(
        f"{first} chunks, then {len(failures)} failed: {', '.join(sorted(reasons))}; "
        f"the rerun had {len(again)} failures"
    )


def _named(failures: list[Failure]) -> str:
    if not failures:
        return ""
    tries, code = max(each.tries for each in failures), failures[0].code
    return f"; {len(failures)} failed after {tries} tries: {code} ({failures[0].session})"


CASES: dict[str, Callable[[Fleet, str], Case]] = {
    "2 processes": lambda fleet, name: run_plainly(fleet, name, "local", 2),
    "2 processes, each killed once": lambda fleet, name: kill_workers(fleet, name, "local", 2),
    "2 workers of Ray": lambda fleet, name: run_plainly(fleet, name, "ray", 2),
    "2 workers of Ray, each killed once": lambda fleet, name: kill_workers(fleet, name, "ray", 2),
    "Ray, one of three nodes lost": remove_node,
    "driver killed, run again": kill_driver,
    "disk full, then enlarged": full_disk,
    "poisonous recording": poison,
}


def measure(
    out: Path,
    recordings: int = 8,
    frames: int = 1000,
    chunk: int = 50,
    cases: list[str] | None = None,
) -> Iterator[Case]:
    """Yield one process's results, and those of cases, by default all."""
    root = make_recordings(out / f"recordings-{recordings}x{frames}", recordings, frames)
    fleet = Fleet(root, out / "results", frames, chunk, {})
    name = "1 process"
    folder = fleet.folder(name)
    _, seconds = describe(fleet, folder, open_engine("local", 1))
    fleet = Fleet(root, out / "results", frames, chunk, digests(folder))
    yield check(fleet, name, folder, seconds)
    for name in cases or CASES:
        yield CASES[name](fleet, name)


def text_of(cases: list[Case]) -> str:
    """A table in Markdown."""
    rows = [
        [
            each.name,
            f"{each.frames:,}",
            each.doubled,
            each.other,
            f"{each.seconds:.0f}",
            f"{each.seconds / cases[0].seconds:.2f}",
            each.note,
        ]
        for each in cases
    ]
    head = ["case", "frames there", "more than once", "files of other bytes", "s", "ratio", ""]
    return table(head, rows)


@app.command()
def main(
    recordings: Annotated[int, typer.Option(help="Number of recordings.")] = 8,
    frames: Annotated[int, typer.Option(help="Frames of each.")] = 1000,
    chunk: Annotated[int, typer.Option(help="Frames of a chunk.")] = 50,
    case: Annotated[list[str] | None, typer.Option(help="Of these alone.")] = None,
    out: Annotated[Path, typer.Option(help="Folder of recordings and results.")] = ROOT
    / "out/killed_workers",
    write: Annotated[bool, typer.Option("--write", help="Put the table into the docs.")] = False,
) -> None:
    """Kill what describes a fleet, and compare what is there."""
    prepare_environment()
    done: list[Case] = []
    for each in measure(out.resolve(), recordings, frames, chunk, case):
        print(each, flush=True)
        done.append(each)
    print(text_of(done))
    print("load:", *os.getloadavg())
    if write:
        write_between(PAGE, "killed workers", text_of(done))


def prepare_environment() -> None:
    """Let workers of Ray import this module, and Ray listen on 127.0.0.1 alone."""
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(ROOT), *sys.path]))
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"


if __name__ == "__main__":
    app()
