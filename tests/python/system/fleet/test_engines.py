# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What runs the work: one process, several and Ray give the same bytes, whoever dies."""

import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import fleets
from error_codes import has_code
from fleets import FRAMES, describe_fleet, digests
from fusionslam.errors import ConfigError, DataError, FusionSlamError
from fusionslam.fleet import work
from fusionslam.fleet.chunk import Chunk
from fusionslam.fleet.engines import Engine, check_engine, local, open_engine
from fusionslam.fleet.engines.local import LocalEngine
from fusionslam.fleet.recordings import FleetRecording
from fusionslam.pipelines.recording import Recording
from project import SUPPORT
from refusals import refuses

SUPPORT = str(SUPPORT)


@pytest.fixture(scope="module")
def processes() -> Iterator[Engine]:
    """Two processes of this machine; starting them takes long."""
    engine = LocalEngine(2)
    yield engine
    engine.close()


@pytest.fixture(scope="module")
def ray_workers() -> Iterator[Engine]:
    """Two workers of a Ray that ends with them."""
    pytest.importorskip("ray", reason="Ray is of an extra")
    with pytest.MonkeyPatch.context() as patched:
        patched.delenv("RAY_ADDRESS", raising=False)
        patched.setenv("PYTHONPATH", os.pathsep.join([SUPPORT, *filter(None, sys.path)]))
        engine = open_engine("ray", 2)
    yield engine
    engine.close()


@pytest.fixture(params=["processes", "ray_workers"])
def engine(request: pytest.FixtureRequest) -> Engine:
    found: Engine = request.getfixturevalue(request.param)
    return found


def chunks_of(*names: str) -> list[Chunk]:
    return [
        Chunk(FleetRecording(name, Recording.at("/none")), first, 1, f"{name}{first}")
        for first, name in enumerate(names)
    ]


def test_all_engines_give_the_same_bytes(
    fleet: Path, described: Path, engine: Engine, tmp_path: Path
) -> None:
    assert describe_fleet(fleet, tmp_path, engine) == []
    assert digests(tmp_path) == digests(described)


def test_workers_that_are_killed_are_replaced_and_nothing_is_lost(
    fleet: Path,
    described: Path,
    engine: Engine,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(work, "describe_chunk", fleets.deadly_chunk)
    assert describe_fleet(fleet, tmp_path, engine) == []
    assert len([*tmp_path.glob("killed-*")]) == 2
    assert digests(tmp_path) == digests(described)


def test_a_poisonous_recording_is_named_after_its_tries_and_takes_no_other_with_it(
    fleet: Path,
    described: Path,
    engine: Engine,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(work, "describe_chunk", fleets.poisonous_chunk)
    (failure,) = describe_fleet(fleet, tmp_path, engine, tries=2)
    assert (failure.session, failure.first, failure.count) == ("north/r2/tuesday", 4, 4)
    assert (failure.code, failure.tries) == ("worker-died", 2)
    whole, part = digests(described), digests(tmp_path)
    assert part.items() <= whole.items() and len(part) == len(whole) - 1


def test_errors_keep_their_code_and_a_worker_that_ends_is_named(
    engine: Engine, tmp_path: Path
) -> None:
    names = ["fine", "fault", "refused", "strange", "exit", "fine"]
    found = {chunk.first: error for chunk, error in engine.run(chunks_of(*names), Faults(tmp_path))}
    assert sorted(found) == [*range(6)]
    assert found[0] is None and found[5] is None
    assert isinstance(found[1], ZeroDivisionError) and str(found[1]) == "a fault"
    assert isinstance(found[2], DataError)
    assert (found[2].code, found[2].fields) == ("some-code", ("a", "b"))
    assert "StrangeError" in repr(found[3]) or "strange" in str(found[3]).lower()
    assert isinstance(found[4], DataError) and found[4].code == "worker-died"
    assert len([*tmp_path.iterdir()]) == 6  # each was begun once


class Faults:
    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __call__(self, chunk: Chunk) -> None:
        fleets.chunk_of_faults(chunk, self.folder)


def test_chunks_are_taken_one_at_a_time(engine: Engine, tmp_path: Path) -> None:
    taken: list[int] = []

    def some() -> Iterator[Chunk]:
        for chunk in chunks_of(*["fine"] * 20):
            taken.append(chunk.first)
            yield chunk

    run = engine.run(some(), Faults(tmp_path))
    next(run)
    assert len(taken) <= 6
    assert len([*run]) == 19


def test_nothing_of_ray_listens_to_the_network(ray_workers: Engine) -> None:
    """Addresses of TCP sockets that processes of this session listen at."""
    here = {inode for pid in processes_of_ray() for inode in sockets_of(pid)}
    listening = [
        (address, inode)
        for address, state, inode in tcp_sockets()
        if state == "0A" and inode in here
    ]
    assert listening
    loopback = {"0100007F", "00000000000000000000000001000000", "0000000000000000FFFF00000100007F"}
    assert {address for address, _ in listening} <= loopback


def processes_of_ray() -> list[int]:
    import ray

    folder = ray._private.worker._global_node.get_session_dir_path()
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            command = (path / "cmdline").read_bytes().decode(errors="replace")
        except OSError:
            continue
        if folder in command:
            found.append(int(path.name))
    return found


def sockets_of(pid: int) -> set[str]:
    found = set()
    for path in Path(f"/proc/{pid}/fd").glob("*"):
        try:
            target = os.readlink(path)
        except OSError:
            continue
        if target.startswith("socket:["):
            found.add(target[8:-1])
    return found


def tcp_sockets() -> Iterator[tuple[str, str, str]]:
    """Address, state and inode."""
    for name in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{name}").read_text().splitlines()[1:]:
            fields = line.split()
            yield fields[1].partition(":")[0], fields[3], fields[9]


@pytest.mark.parametrize(
    "name", ["", "dask", "Ray", "ray:", "ray://", "ray://host", "ray://host:port", "local:1"]
)
def test_unknown_engines_are_refused(name: str) -> None:
    with pytest.raises(ConfigError, check=has_code("choice", "--engine", name)):
        check_engine(name)
    with pytest.raises(ConfigError):
        open_engine(name, 1)


def test_known_engines_are_not_refused() -> None:
    for name in ("local", "ray", "ray://127.0.0.1:10001", "ray://[::1]:10001"):
        check_engine(name)


@pytest.mark.parametrize("variable", [False, True])
def test_a_cluster_that_cannot_be_reached_is_named_in_seconds(
    variable: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("ray", reason="Ray is of an extra")
    address = "127.0.0.1:1" if variable else "ray://127.0.0.1:1"
    if variable:
        monkeypatch.setenv("RAY_ADDRESS", address)
    else:
        pytest.importorskip("grpc", reason="clients of Ray need it")
    started = time.monotonic()
    with refuses("no-cluster", address):
        open_engine("ray" if variable else address, 1)
    assert time.monotonic() - started < 15


def test_without_ray_it_is_said_what_installs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(FusionSlamError, check=has_code("missing-extra", "fleet")):
        open_engine("ray", 1)


def test_all_frames_are_counted(fleet: Path) -> None:
    assert len([*fleet.rglob("*.bin")]) == FRAMES


class TwoArgumentsError(Exception):
    """Can be pickled, but not unpickled: then it is made with one argument."""

    def __init__(self, one: str, two: str) -> None:
        super().__init__(f"{one} and {two}")


def test_an_error_that_cannot_be_sent_is_described_instead() -> None:
    sent = local._portable(TwoArgumentsError("this", "that"))
    assert type(sent) is RuntimeError and str(sent) == "TwoArgumentsError: this and that"
    assert local._portable(None) is None
    fine = ZeroDivisionError("fine")
    assert local._portable(fine) is fine
