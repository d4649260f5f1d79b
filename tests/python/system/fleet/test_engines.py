# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What runs the work: one process, several and Ray give the same bytes, whoever dies."""

import os
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

import fleets
from error_codes import has_code
from fleets import describe_fleet, digests
from fusionslam.errors import ConfigError, DataError, FusionSlamError
from fusionslam.fleet import work
from fusionslam.fleet.chunk import Chunk
from fusionslam.fleet.engines import Engine, check_engine, local, open_engine
from fusionslam.fleet.engines.local import LocalEngine
from fusionslam.fleet.recordings import FleetRecording
from fusionslam.pipelines.recording import Recording
from project import SUPPORT
from refusals import refuses


@pytest.fixture(scope="module")
def processes() -> Iterator[Engine]:
    """Two processes of this machine; starting them takes long."""
    engine = LocalEngine(2)
    yield engine
    engine.close()


@pytest.fixture(scope="module")
def ray_workers() -> Iterator[Engine]:
    """Two workers of a Ray that ends with them, and leaves nothing."""
    pytest.importorskip("ray", reason="Ray is of an extra")
    # The names of its sockets are too long for folders of pytest.
    with TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        with pytest.MonkeyPatch.context() as patched:
            patched.delenv("RAY_ADDRESS", raising=False)
            patched.setenv("RAY_TMPDIR", folder)
            paths = [str(SUPPORT), *filter(None, sys.path)]
            patched.setenv("PYTHONPATH", os.pathsep.join(paths))
            engine = open_engine("ray", 2)
        yield engine
        engine.close()


@pytest.fixture(
    params=["processes", pytest.param("ray_workers", marks=pytest.mark.nightly)], name="engine"
)
def _engine(request: pytest.FixtureRequest) -> Engine:
    found: Engine = request.getfixturevalue(request.param)
    return found


def chunks_of(*names: str) -> list[Chunk]:
    return [
        Chunk(FleetRecording(name, Recording.at("/none")), first, 1, f"{name}{first}")
        for first, name in enumerate(names)
    ]


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["processes", "ray_workers"], indirect=True)
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


@pytest.mark.nightly
def test_a_poisonous_recording_is_named_after_its_tries_and_takes_no_other_with_it(
    fleet: Path,
    described: Path,
    engine: Engine,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(work, "describe_chunk", fleets.poisonous_chunk)
    (failure,) = describe_fleet(fleet, tmp_path, engine, tries=2)
    assert (failure.session, failure.first, failure.count) == (fleets.TUESDAY, 4, 4)
    assert (failure.code, failure.tries) == ("worker-died", 2)
    whole, part = digests(described), digests(tmp_path)
    assert part.items() <= whole.items() and len(part) == len(whole) - 1


@pytest.mark.slow
def test_errors_keep_their_code_and_lost_workers_are_named(engine: Engine, tmp_path: Path) -> None:
    chunks = chunks_of("fine", "fault", "refused", "strange", "exit", "fine")
    faults = partial(fleets.chunk_of_faults, folder=tmp_path)
    found = {chunk.first: error for chunk, error in engine.run(chunks, faults)}
    assert sorted(found) == [*range(6)]
    assert found[0] is None and found[5] is None
    assert isinstance(found[1], ZeroDivisionError) and str(found[1]) == "a fault"
    assert isinstance(found[2], DataError)
    assert (found[2].code, found[2].fields) == ("some-code", ("a", "b"))
    assert "StrangeError" in repr(found[3]) or "strange" in str(found[3]).lower()
    assert isinstance(found[4], DataError) and found[4].code == "worker-died"
    assert len([*tmp_path.iterdir()]) == 6  # each was begun once


def test_chunks_are_taken_one_at_a_time(engine: Engine, tmp_path: Path) -> None:
    taken: list[int] = []

    def some() -> Iterator[Chunk]:
        for chunk in chunks_of(*["fine"] * 20):
            taken.append(chunk.first)
            yield chunk

    run = engine.run(some(), partial(fleets.chunk_of_faults, folder=tmp_path))
    next(run)
    assert len(taken) <= 6
    assert len([*run]) == 19


def test_nothing_of_ray_listens_to_the_network(ray_workers: Engine) -> None:
    """Addresses of TCP sockets that processes of this session listen at."""
    import ray

    session = ray._private.worker._global_node.get_session_dir_path()
    of_ray = {inode for process in processes_of(session) for inode in sockets_of(process)}
    listening = {address for address, inode in listening_sockets() if inode in of_ray}
    loopback = {"0100007F", "00000000000000000000000001000000", "0000000000000000FFFF00000100007F"}
    assert listening and listening <= loopback


def test_the_folder_of_ray_is_of_this_user_alone(ray_workers: Engine) -> None:
    import ray

    session = Path(ray._private.worker._global_node.get_session_dir_path())
    assert session.parents[1].stat().st_mode & 0o077 == 0


def test_a_cluster_that_is_not_there_leaves_no_token_mode(monkeypatch: pytest.MonkeyPatch) -> None:
    """A local Ray would ask for the token of the cluster afterwards."""
    pytest.importorskip("ray", reason="Ray is of an extra")
    monkeypatch.setenv("RAY_AUTH_TOKEN", "of-a-cluster")
    monkeypatch.delenv("RAY_AUTH_MODE", raising=False)
    with refuses("no-cluster", "ray://127.0.0.1:1"):
        open_engine("ray://127.0.0.1:1", 1)
    assert "RAY_AUTH_MODE" not in os.environ


def processes_of(session: str) -> Iterator[Path]:
    """Folders in /proc of processes whose command names a folder."""
    for path in Path("/proc").glob("[0-9]*"):
        try:
            if session in (path / "cmdline").read_bytes().decode(errors="replace"):
                yield path
        except OSError:
            continue


def sockets_of(process: Path) -> Iterator[str]:
    """Inodes."""
    for path in (process / "fd").glob("*"):
        try:
            target = os.readlink(path)
        except OSError:
            continue
        if target.startswith("socket:["):
            yield target[8:-1]


def listening_sockets() -> Iterator[tuple[str, str]]:
    """Address and inode."""
    for name in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{name}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[3] == "0A":
                yield fields[1].partition(":")[0], fields[9]


def test_unknown_engines_are_refused_and_no_others() -> None:
    for name in ("local", "ray", "ray://127.0.0.1:10001", "ray://[::1]:10001"):
        check_engine(name)
    wrong = ["", "dask", "Ray", "ray:", "ray://", "ray://host", "ray://host:port", "local:1"]
    for name in wrong:
        with pytest.raises(ConfigError, check=has_code("choice", "--engine", name)):
            check_engine(name)
        with pytest.raises(ConfigError):
            open_engine(name, 1)


def test_a_cluster_that_cannot_be_reached_is_named_without_starting_ray(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ray = pytest.importorskip("ray", reason="Ray is of an extra")
    monkeypatch.setattr(ray, "init", None)
    monkeypatch.setenv("RAY_ADDRESS", "127.0.0.1:1")
    with refuses("no-cluster", "127.0.0.1:1"):
        open_engine("ray", 1)
    pytest.importorskip("grpc", reason="clients of Ray need it")
    with refuses("no-cluster", "ray://127.0.0.1:1"):
        open_engine("ray://127.0.0.1:1", 1)


def test_without_ray_it_is_said_what_installs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(FusionSlamError, check=has_code("missing-extra", "fleet")):
        open_engine("ray", 1)


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
