# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A folder of places: recordings change, robots are forgotten, and its database follows."""

import shutil
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from error_codes import has_code
from fleets import (
    FRAMES,
    LABELS,
    InProcess,
    chunk_files,
    digests,
    plan_of,
    settings_for,
)
from fleets import (
    describe_with_database as describe,
)
from fusionslam.datasets import write_cloud
from fusionslam.errors import ConfigError, DataError
from fusionslam.fleet import folder as folders
from fusionslam.fleet.chunk import Chunk
from fusionslam.fleet.config import FleetSettings
from fusionslam.fleet.encounters import find_encounters
from fusionslam.fleet.engines import Work
from fusionslam.fleet.folder import FORGOTTEN, FleetFolder
from fusionslam.fleet.places import PlaceFilter
from fusionslam.fleet.recordings import find_recordings
from fusionslam.fleet.work import Failure, Plan, load_failures
from fusionslam.fleet.write_lock import WriteLock
from fusionslam.sensors.frame import Cloud

pytest.importorskip("lancedb", reason="the table of places is an extra")
pytest.importorskip("pyarrow", reason="the table of places is an extra")


@pytest.fixture(scope="module")
def with_database(fleet: Path, described: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("with_database") / "places"
    shutil.copytree(described, path)
    assert describe(fleet, path)[0] == []
    return path


@pytest.fixture
def places(with_database: Path, tmp_path: Path) -> Iterator[Path]:
    shutil.copytree(with_database, tmp_path / "places")
    yield tmp_path / "places"


def counts(path: Path, column: str = "session") -> dict[str, int]:
    with FleetFolder.open(path).database() as database:
        return database.count_by(column)


ALL = {"north/r1/monday": 9, "north/r2/tuesday": 9, "south/r3/wednesday": 9}


def test_each_frame_is_a_place_once(fleet: Path, places: Path) -> None:
    assert counts(places) == ALL and sum(ALL.values()) == FRAMES
    for _ in range(2):
        failures, engine = describe(fleet, places)
        assert failures == [] and engine.begun == []
    assert counts(places) == ALL
    assert counts(places, "robot") == {"r1": 9, "r2": 9, "r3": 9}


def test_a_rerun_reads_no_chunk_that_the_database_knows(
    fleet: Path, places: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(folders, "places_of", None)
    assert describe(fleet, places)[0] == []


def test_places_that_a_killed_run_did_not_add_are_added_by_the_next(
    fleet: Path, places: Path
) -> None:
    with FleetFolder.open(places).database(read_only=False) as database:
        database.delete(PlaceFilter(session="north/r1/monday"))
    failures, engine = describe(fleet, places)
    assert failures == [] and engine.begun == [] and counts(places) == ALL


def test_a_recording_that_changed_replaces_its_places(own_fleet: Path, tmp_path: Path) -> None:
    places = tmp_path / "places"
    describe(own_fleet, places)
    others = {key for key in digests(places)}
    for number in (7, 8):
        (own_fleet / f"north/r1/monday/clouds/{number:06d}.bin").unlink()
    for name in ("times.txt", "poses.txt"):
        path = own_fleet / "north/r1/monday" / name
        path.write_text("".join(path.read_text().splitlines(keepends=True)[:7]))
    failures, engine = describe(own_fleet, places)
    assert failures == []
    assert {each.recording.session for each in engine.begun} == {"north/r1/monday"}
    assert counts(places) == ALL | {"north/r1/monday": 7}
    assert len(digests(places).keys() - others) == 2 and len(chunk_files(places)) == 8


def test_a_recording_that_is_damaged_later_keeps_its_places(
    own_fleet: Path, tmp_path: Path
) -> None:
    places = tmp_path / "places"
    describe(own_fleet, places)
    shutil.rmtree(own_fleet / "north/r1/monday/clouds")
    (own_fleet / "north/r1/monday/clouds").mkdir()
    describe(own_fleet, places)
    assert counts(places) == ALL


def test_recordings_that_were_moved_are_the_same(own_fleet: Path, tmp_path: Path) -> None:
    describe(own_fleet, tmp_path / "places")
    own_fleet.rename(tmp_path / "moved")
    failures, engine = describe(tmp_path / "moved", tmp_path / "places")
    assert failures == [] and engine.begun == [] and counts(tmp_path / "places") == ALL
    (planned, *_) = Plan.load(tmp_path / "places").recordings
    assert planned.recording.recording.path == str(tmp_path / "moved/north/r1/monday")


def test_robots_that_were_forgotten_stay_forgotten(fleet: Path, places: Path) -> None:
    folder = FleetFolder.open(places)
    assert folder.forget(PlaceFilter(robot="r1")) == 9
    left = {name: count for name, count in ALL.items() if "r1" not in name}
    assert counts(places) == left and len(chunk_files(places)) == 6
    failures, engine = describe(fleet, places)
    assert failures == [] and engine.begun == [] and counts(places) == left
    assert [each.recording.robot for each in Plan.load(places).recordings] == ["r2", "r3"]
    assert folder.forget(PlaceFilter(site="nowhere")) == 0 and counts(places) == left


@pytest.mark.parametrize("stop", ["delete", "_delete_chunks"])
def test_forgetting_that_was_interrupted_is_completed_by_the_next_run(
    fleet: Path, places: Path, stop: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = FleetFolder.open(places)
    with monkeypatch.context() as patched:
        owner = folders.PlaceDatabase if stop == "delete" else FleetFolder
        patched.setattr(owner, stop, interrupt)
        with pytest.raises(KeyboardInterrupt):
            folder.forget(PlaceFilter(robot="r1"))
    describe(fleet, places)
    assert "north/r1/monday" not in counts(places) and len(chunk_files(places)) == 6


def interrupt(*_: object) -> None:
    raise KeyboardInterrupt


@pytest.mark.parametrize(
    "where", [PlaceFilter(), PlaceFilter(since_ns=3), PlaceFilter(robot="r1", until_ns=3)]
)
def test_whole_recordings_are_forgotten_or_none(places: Path, where: PlaceFilter) -> None:
    with pytest.raises(ConfigError, check=has_code("choice")):
        FleetFolder.open(places).forget(where)
    assert counts(places) == ALL and not (places / FORGOTTEN).exists()


def test_a_damaged_list_of_what_was_forgotten_ends_the_run_before_it_does_harm(
    fleet: Path, places: Path
) -> None:
    FleetFolder.open(places).forget(PlaceFilter(robot="r1"))
    (places / FORGOTTEN).write_text((places / FORGOTTEN).read_text()[:-9])
    with pytest.raises(DataError, check=has_code("damaged-file", places / FORGOTTEN)):
        describe(fleet, places)
    assert "north/r1/monday" not in counts(places)


def test_two_processes_do_not_describe_into_one_folder(fleet: Path, places: Path) -> None:
    lock = WriteLock(places)
    with pytest.raises(DataError, check=has_code("locked", places)):
        describe(fleet, places)
    lock.release()
    assert describe(fleet, places)[0] == []


@pytest.mark.parametrize("patience_s", [0.0, 0.2])
def test_a_database_that_others_change_is_waited_for(
    places: Path, patience_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(folders, "PATIENCE_S", patience_s)
    monkeypatch.setattr(folders, "_PAUSE_S", 0.02)
    folder = FleetFolder.open(places)
    other = folder.database(read_only=False)
    begun = time.monotonic()
    with pytest.raises(DataError, check=has_code("locked", places / "database")):
        folder.forget(PlaceFilter(robot="r1"))
    assert time.monotonic() - begun >= patience_s
    monkeypatch.setattr(folders, "PATIENCE_S", 30.0)
    threading.Timer(0.1, other.close).start()
    assert folder.forget(PlaceFilter(robot="r1")) == 9


class Meanwhile(InProcess):
    """Does something in another process's stead once so many chunks are described."""

    def __init__(self, count: int, act: Callable[[], object]) -> None:
        super().__init__()
        self._count, self._act = count, act

    def run(
        self, chunks: Iterable[Chunk], work: Work
    ) -> Iterator[tuple[Chunk, BaseException | None]]:
        for number, done in enumerate(super().run(chunks, work)):
            if number == self._count:
                self._act()
            yield done


def describe_meanwhile(
    root: Path, path: Path, count: int, act: Callable[[], object]
) -> list[Failure]:
    plan, settings = plan_of(root, path)
    return FleetFolder(path, settings).describe(plan, Meanwhile(count, act))


def test_the_database_may_be_changed_while_describe_runs(
    fleet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(folders, "_TAKEN_TOGETHER", 4)
    monkeypatch.setattr(folders, "PATIENCE_S", 0.0)

    def compact() -> None:
        with FleetFolder.open(tmp_path).database(read_only=False) as database:
            assert len(database) == 13
            database.compact()

    assert describe_meanwhile(fleet, tmp_path, 4, compact) == []
    assert counts(tmp_path) == ALL


@pytest.mark.parametrize("together", [4, 1000])
@pytest.mark.parametrize("robot", ["r1", "r2", "r3"])
def test_a_robot_that_is_forgotten_while_describe_runs_stays_forgotten(
    fleet: Path, tmp_path: Path, together: int, robot: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(folders, "_TAKEN_TOGETHER", together)

    def forget() -> None:
        FleetFolder.open(tmp_path).forget(PlaceFilter(robot=robot))

    assert describe_meanwhile(fleet, tmp_path, 4, forget) == []
    left = {name: count for name, count in ALL.items() if robot not in name}
    assert counts(tmp_path) == left and len(chunk_files(tmp_path)) == 6
    assert {each.recording.session for each in Plan.load(tmp_path).recordings} == {*left}
    failures, engine = describe(fleet, tmp_path)
    assert failures == [] and engine.begun == [] and counts(tmp_path) == left


def test_chunks_that_a_killed_run_left_of_a_forgotten_robot_are_deleted_by_the_next(
    fleet: Path, places: Path, described: Path
) -> None:
    FleetFolder.open(places).forget(PlaceFilter(robot="r2"))
    shutil.copytree(described / "chunks", places / "chunks", dirs_exist_ok=True)
    assert len(chunk_files(places)) == 9
    describe(fleet, places)
    assert len(chunk_files(places)) == 6 and "north/r2/tuesday" not in counts(places)


def test_places_that_a_database_in_use_cannot_take_are_added_by_the_next_run(
    fleet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(folders, "_TAKEN_TOGETHER", 4)
    monkeypatch.setattr(folders, "PATIENCE_S", 0.0)
    others = []

    def hold() -> None:
        others.append(FleetFolder.open(tmp_path).database(read_only=False))

    (failure,) = describe_meanwhile(fleet, tmp_path, 4, hold)
    assert failure.code == "locked" and "14" in failure.reason
    assert load_failures(tmp_path) == [failure]
    others.pop().close()
    failures, engine = describe(fleet, tmp_path)
    assert failures == [] and engine.begun == [] and counts(tmp_path) == ALL


def test_a_database_that_cannot_be_written_is_named_and_chunks_are_kept(
    fleet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> int:
        raise DataError("cannot write: No space left on device", code="cannot-write")

    with monkeypatch.context() as patched:
        patched.setattr(folders.PlaceDatabase, "add", full)
        (failure,), engine = describe(fleet, tmp_path / "places")
    assert failure.code == "cannot-write" and "No space left" in failure.reason
    assert str(FRAMES) in failure.reason and len(chunk_files(tmp_path / "places")) == 9
    assert load_failures(tmp_path / "places") == [failure]
    failures, engine = describe(fleet, tmp_path / "places")
    assert failures == [] and engine.begun == [] and counts(tmp_path / "places") == ALL


def test_a_robot_without_a_place_is_no_error(own_fleet: Path, tmp_path: Path) -> None:
    for path in (own_fleet / "south/r3/wednesday/clouds").iterdir():
        path.write_bytes(b"12345")
    failures, _ = describe(own_fleet, tmp_path / "places")
    assert [(each.session, each.count, each.code) for each in failures] == [
        ("south/r3/wednesday", 4, "bad-frames"),
        ("south/r3/wednesday", 4, "bad-frames"),
        ("south/r3/wednesday", 1, "bad-frames"),
    ]
    assert describe(own_fleet, tmp_path / "places")[0] == failures


def test_other_names_of_robots_make_other_places(fleet: Path, places: Path) -> None:
    settings = FleetFolder.open(places).settings
    found = find_recordings(fleet, replace(LABELS, folders=("region", "robot")))
    plan = Plan.make(fleet, found, settings)
    FleetFolder(places, settings).describe(plan, InProcess())
    assert counts(places, "region") == {"north": 18, "south": 9}
    assert counts(places, "site") == {"": FRAMES}


def test_a_plan_without_a_database_is_described(fleet: Path, own_places: Path) -> None:
    plan_of(fleet, own_places)
    assert describe(fleet, own_places)[0] == [] and counts(own_places) == ALL


def test_clouds_that_are_empty_are_no_places(own_fleet: Path, tmp_path: Path) -> None:
    import numpy as np

    path = own_fleet / "south/r3/wednesday/clouds/000000.bin"
    write_cloud(path, Cloud(np.empty((0, 3), np.float32)))
    describe(own_fleet, tmp_path / "places")
    assert counts(tmp_path / "places") == ALL | {"south/r3/wednesday": 8}


class Interrupted(InProcess):
    """Ends before its first chunk."""

    def run(
        self, chunks: Iterable[Chunk], work: Work
    ) -> Iterator[tuple[Chunk, BaseException | None]]:
        raise KeyboardInterrupt
        yield


def test_places_of_a_changed_recording_stay_until_the_new_ones_are_there(
    own_fleet: Path, tmp_path: Path
) -> None:
    places = tmp_path / "places"
    describe(own_fleet, places)
    (own_fleet / "north/r1/monday/clouds/000003.bin").touch()
    settings = FleetSettings.load(places)
    for _ in range(2):
        plan = Plan.make(own_fleet, find_recordings(own_fleet, LABELS), settings)
        with pytest.raises(KeyboardInterrupt):
            FleetFolder(places, settings).describe(plan, Interrupted())
        assert counts(places) == ALL and len(chunk_files(places)) == 9
    assert describe(own_fleet, places)[0] == []
    assert counts(places) == ALL and len(chunk_files(places)) == 9
    assert Plan.load(places).outdated == []


def test_a_database_that_was_not_finished_is_made_anew(fleet: Path, places: Path) -> None:
    shutil.rmtree(places / "database")
    (places / "database").mkdir()
    (places / "database/.lock").touch()
    failures, engine = describe(fleet, places)
    assert failures == [] and engine.begun == [] and counts(places) == ALL


def test_places_without_clouds_are_not_looked_for_and_the_others_are(
    fleet: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    settings = settings_for(find_recordings(fleet, LABELS), tmp_path, clouds=False)
    folder = FleetFolder(tmp_path, settings)
    folder.describe(Plan.make(fleet, find_recordings(fleet, LABELS), settings), InProcess())
    with folder.database() as database:
        assert find_encounters(folder, database, Plan.load(tmp_path)) == []
    assert len(caplog.records) == 3


def test_drives_of_one_site_meet_and_no_others(places: Path) -> None:
    folder = FleetFolder.open(places)
    with folder.database() as database:
        found = find_encounters(folder, database, Plan.load(places), most=3)
    met = {each.session: each.found.place for each in found if each.found.place is not None}
    assert {name: place.session for name, place in met.items()} == {
        "north/r1/monday": "north/r2/tuesday",
        "north/r2/tuesday": "north/r1/monday",
    }
