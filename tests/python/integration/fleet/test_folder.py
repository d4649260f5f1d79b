# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A folder of places: recordings change, robots are forgotten, and its database follows."""

import json
import shutil
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from artefacts import copy_artefact
from clouds import scan_blocks
from error_codes import has_code
from fleets import (
    FRAMES,
    LABELS,
    MONDAY,
    TUESDAY,
    WEDNESDAY,
    InProcess,
    chunk_files,
    digests,
    plan_of,
)
from fleets import describe_with_database as describe
from fusionslam.base.write_lock import lock_folder
from fusionslam.errors import ConfigError, DataError
from fusionslam.fleet import folder as folders
from fusionslam.fleet.chunk import Chunk
from fusionslam.fleet.encounters import find_encounters
from fusionslam.fleet.engines import Work
from fusionslam.fleet.folder import FORGOTTEN, FleetFolder
from fusionslam.fleet.places import PlaceFilter
from fusionslam.fleet.recordings import find_recordings
from fusionslam.fleet.work import PLAN, Failure, Plan, load_failures
from fusionslam.sensors.frame import Cloud
from fuzz.crafted_files import KEYS
from refusals import refuses
from rows import rows
from streets import WAY

pytest.importorskip("lancedb", reason="the table of places is an extra")
pytest.importorskip("pyarrow", reason="the table of places is an extra")

ALL = {MONDAY: 9, TUESDAY: 9, WEDNESDAY: 9}


def counts(path: Path, column: str = "session") -> dict[str, int]:
    with FleetFolder.open(path).database() as database:
        return database.count_by(column)


def assert_nothing_to_do(root: Path, path: Path, expected: dict[str, int] = ALL) -> None:
    """Another run describes no chunk, and leaves these places."""
    failures, engine = describe(root, path)
    assert failures == [] and engine.begun == [] and counts(path) == expected


def test_each_frame_is_a_place_once(
    fleet: Path, places: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert counts(places) == ALL and sum(ALL.values()) == FRAMES
    assert_nothing_to_do(fleet, places)
    assert counts(places, "robot") == {"r1": 9, "r2": 9, "r3": 9}
    # No chunk is read that the database knows.
    monkeypatch.setattr(folders, "places_of", None)
    assert_nothing_to_do(fleet, places)


def test_places_that_a_killed_run_did_not_add_are_added_later(fleet: Path, places: Path) -> None:
    with FleetFolder.open(places).database(read_only=False) as database:
        database.delete(PlaceFilter(session=MONDAY))
    assert_nothing_to_do(fleet, places)


@pytest.fixture
def changing(own_fleet: Path, tmp_path: Path) -> Path:
    """Results of recordings that the test changes."""
    assert describe(own_fleet, tmp_path / "places")[0] == []
    return tmp_path / "places"


def test_places_of_a_changed_recording_stay_until_replaced(own_fleet: Path, changing: Path) -> None:
    (own_fleet / MONDAY / "clouds/000003.bin").touch()
    for _ in range(2):
        plan, settings = plan_of(own_fleet, changing)
        with pytest.raises(KeyboardInterrupt):
            FleetFolder(changing, settings).describe(plan, Interrupted())
        assert counts(changing) == ALL and len(chunk_files(changing)) == 9
    assert describe(own_fleet, changing)[0] == []
    assert counts(changing) == ALL and len(chunk_files(changing)) == 9
    assert Plan.load(changing).outdated == []
    before = {*digests(changing)}
    for number in (7, 8):
        (own_fleet / MONDAY / f"clouds/{number:06d}.bin").unlink()
    for name in ("times.txt", "poses.txt"):
        path = own_fleet / MONDAY / name
        path.write_text("".join(path.read_text().splitlines(keepends=True)[:7]))
    failures, engine = describe(own_fleet, changing)
    assert failures == []
    assert {each.recording.session for each in engine.begun} == {MONDAY}
    assert counts(changing) == ALL | {MONDAY: 7}
    assert len(digests(changing).keys() - before) == 2 and len(chunk_files(changing)) == 8


class Interrupted(InProcess):
    """Ends before its first chunk."""

    def run(
        self, chunks: Iterable[Chunk], work: Work
    ) -> Iterator[tuple[Chunk, BaseException | None]]:
        raise KeyboardInterrupt
        yield


def test_moved_or_damaged_recordings_keep_places(
    own_fleet: Path, changing: Path, tmp_path: Path
) -> None:
    moved = own_fleet.rename(tmp_path / "moved")
    assert_nothing_to_do(moved, changing)
    (planned, *_) = Plan.load(changing).recordings
    assert planned.recording.recording.path == str(moved / MONDAY)
    shutil.rmtree(moved / MONDAY / "clouds")
    (moved / MONDAY / "clouds").mkdir()
    describe(moved, changing)
    assert counts(changing) == ALL


def test_forgotten_robots_stay_forgotten(
    fleet: Path, places: Path, described: Path, tmp_path: Path
) -> None:
    folder = FleetFolder.open(places)
    assert folder.forget(PlaceFilter(robot="r1")) == 9
    left = {TUESDAY: 9, WEDNESDAY: 9}
    assert counts(places) == left and len(chunk_files(places)) == 6
    assert_nothing_to_do(fleet, places, left)
    assert [each.recording.robot for each in Plan.load(places).recordings] == ["r2", "r3"]
    assert folder.forget(PlaceFilter(site="nowhere")) == 0 and counts(places) == left
    # Chunks that a killed run left of the robot are deleted by the next.
    left_over = copy_artefact(described / "chunks", tmp_path / "chunks")
    shutil.copytree(left_over, places / "chunks", dirs_exist_ok=True)
    assert len(chunk_files(places)) == 9
    assert_nothing_to_do(fleet, places, left)
    assert len(chunk_files(places)) == 6


@pytest.mark.parametrize("stop", ["delete", "_delete_chunks"])
def test_forgetting_that_was_interrupted_is_completed_by_the_next_run(
    fleet: Path, places: Path, stop: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched:
        owner = folders.PlaceDatabase if stop == "delete" else FleetFolder
        patched.setattr(owner, stop, interrupt)
        with pytest.raises(KeyboardInterrupt):
            FleetFolder.open(places).forget(PlaceFilter(robot="r1"))
    describe(fleet, places)
    assert MONDAY not in counts(places) and len(chunk_files(places)) == 6


def interrupt(*_: object) -> None:
    raise KeyboardInterrupt


@rows("key", KEYS)
def test_a_key_that_is_no_name_of_ours_is_refused_and_nothing_is_deleted(
    fleet: Path, with_database: Path, tmp_path: Path, key: Any
) -> None:
    outside = tmp_path / "victim.npz"
    outside.write_bytes(b"mine")
    places = copy_artefact(with_database, tmp_path / "places")
    values = json.loads((places / PLAN).read_text())
    key = str(outside.with_suffix("")) if key == "{outside}" else key
    values["recordings"][0]["keys"].insert(0, key)
    del values["digest"]
    (places / PLAN).write_text(json.dumps(values))
    for act in (
        lambda: FleetFolder.open(places).forget(PlaceFilter(robot="r1")),
        lambda: describe(fleet, places),
    ):
        with refuses("bad-key", "keys", str(key)):
            act()
    assert outside.read_bytes() == b"mine" and not (places / FORGOTTEN).exists()
    assert counts(places) == ALL and len(chunk_files(places)) == 9


def test_a_list_of_too_few_chunks_is_refused(with_database: Path) -> None:
    planned = Plan.load(with_database).recordings[0]
    with refuses("damaged", MONDAY):
        replace(planned, keys=planned.keys[1:]).chunks(4)


def test_whole_recordings_are_forgotten_or_none(places: Path) -> None:
    for where in ({}, {"since_ns": 3}, {"robot": "r1", "until_ns": 3}):
        with pytest.raises(ConfigError, check=has_code("choice")):
            FleetFolder.open(places).forget(PlaceFilter(**where))
    assert counts(places) == ALL and not (places / FORGOTTEN).exists()


def test_a_damaged_list_of_what_was_forgotten_does_no_harm(fleet: Path, places: Path) -> None:
    FleetFolder.open(places).forget(PlaceFilter(robot="r1"))
    (places / FORGOTTEN).write_text((places / FORGOTTEN).read_text()[:-9])
    with pytest.raises(DataError, check=has_code("damaged-file", places / FORGOTTEN)):
        describe(fleet, places)
    assert MONDAY not in counts(places)


def test_two_processes_do_not_describe_into_one_folder(fleet: Path, places: Path) -> None:
    lock = lock_folder(places)
    with pytest.raises(DataError, check=has_code("locked", places)):
        describe(fleet, places)
    lock.release()
    assert describe(fleet, places)[0] == []


class Clock:
    """Stands in for ``time``; it goes on only while somebody sleeps."""

    def __init__(self, at_the_third: Callable[[], object] = lambda: None) -> None:
        self.sleeps: list[float] = []
        self._act = at_the_third

    def monotonic(self) -> float:
        return sum(self.sleeps)

    def sleep(self, seconds: float) -> None:
        self.sleeps.append(seconds)
        if len(self.sleeps) == 3:
            self._act()


def test_a_database_that_others_change_is_waited_for(
    places: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = FleetFolder.open(places)
    other = folder.database(read_only=False)
    monkeypatch.setattr(folders, "_PAUSE_S", 0.5)
    for patience_s, pauses in ((0.0, 0), (2.0, 4)):
        monkeypatch.setattr(folders, "time", clock := Clock())
        monkeypatch.setattr(folders, "PATIENCE_S", patience_s)
        with pytest.raises(DataError, check=has_code("locked", places / "database")):
            folder.forget(PlaceFilter(robot="r1"))
        assert clock.sleeps == [0.5] * pauses
    monkeypatch.setattr(folders, "time", clock := Clock(other.close))
    assert folder.forget(PlaceFilter(robot="r1")) == 9
    assert clock.sleeps == [0.5] * 3


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


def describe_meanwhile(root: Path, path: Path, act: Callable[[], object]) -> list[Failure]:
    """Describe all, and do something once four chunks are."""
    plan, settings = plan_of(root, path)
    return FleetFolder(path, settings).describe(plan, Meanwhile(4, act))


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Add the places of four chunks together; wait for no other process."""
    monkeypatch.setattr(folders, "_TAKEN_TOGETHER", 4)
    monkeypatch.setattr(folders, "PATIENCE_S", 0.0)


@pytest.mark.usefixtures("impatient")
def test_the_database_may_be_changed_while_describe_runs(fleet: Path, tmp_path: Path) -> None:
    def compact() -> None:
        with FleetFolder.open(tmp_path).database(read_only=False) as database:
            assert len(database) == 13
            database.compact()

    assert describe_meanwhile(fleet, tmp_path, compact) == []
    assert counts(tmp_path) == ALL


@pytest.mark.slow
@rows("robot, together", [("r1", 4), ("r1", 1000), ("r2", 4), ("r3", 4)])
def test_a_robot_that_is_forgotten_while_describe_runs_stays_forgotten(
    fleet: Path, tmp_path: Path, together: int, robot: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(folders, "_TAKEN_TOGETHER", together)

    def forget() -> None:
        FleetFolder.open(tmp_path).forget(PlaceFilter(robot=robot))

    assert describe_meanwhile(fleet, tmp_path, forget) == []
    left = {name: count for name, count in ALL.items() if robot not in name}
    assert counts(tmp_path) == left and len(chunk_files(tmp_path)) == 6
    assert {each.recording.session for each in Plan.load(tmp_path).recordings} == {*left}
    assert_nothing_to_do(fleet, tmp_path, left)


@pytest.mark.usefixtures("impatient")
def test_places_that_a_database_in_use_cannot_take_are_added_later(
    fleet: Path, tmp_path: Path
) -> None:
    others = []

    def hold() -> None:
        others.append(FleetFolder.open(tmp_path).database(read_only=False))

    (failure,) = describe_meanwhile(fleet, tmp_path, hold)
    assert failure.code == "locked" and "14" in failure.reason
    assert load_failures(tmp_path) == [failure]
    others.pop().close()
    assert_nothing_to_do(fleet, tmp_path)


def test_a_database_that_cannot_be_written_is_named_and_chunks_are_kept(
    fleet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> int:
        raise DataError("cannot write: No space left on device", code="cannot-write")

    with monkeypatch.context() as patched:
        patched.setattr(folders.PlaceDatabase, "add", full)
        (failure,), _ = describe(fleet, tmp_path / "places")
    assert failure.code == "cannot-write" and "No space left" in failure.reason
    assert str(FRAMES) in failure.reason and len(chunk_files(tmp_path / "places")) == 9
    assert load_failures(tmp_path / "places") == [failure]
    assert_nothing_to_do(fleet, tmp_path / "places")


def test_a_robot_without_a_place_is_no_error(own_fleet: Path, tmp_path: Path) -> None:
    for path in (own_fleet / WEDNESDAY / "clouds").iterdir():
        path.write_bytes(b"12345")
    failures, _ = describe(own_fleet, tmp_path / "places")
    assert [(each.session, each.count, each.code) for each in failures] == [
        (WEDNESDAY, count, "bad-frames") for count in (4, 4, 1)
    ]
    assert describe(own_fleet, tmp_path / "places")[0] == failures


def test_other_names_of_robots_make_other_places(fleet: Path, places: Path) -> None:
    settings = FleetFolder.open(places).settings
    found = find_recordings(fleet, replace(LABELS, folders=("region", "robot")))
    FleetFolder(places, settings).describe(Plan.make(fleet, found, settings), InProcess())
    assert counts(places, "region") == {"north": 18, "south": 9}
    assert counts(places, "site") == {"": FRAMES}


def test_a_plan_without_a_database_is_described(fleet: Path, own_places: Path) -> None:
    plan_of(fleet, own_places)
    assert describe(fleet, own_places)[0] == [] and counts(own_places) == ALL


def test_a_database_that_was_not_finished_is_made_anew(fleet: Path, places: Path) -> None:
    shutil.rmtree(places / "database")
    (places / "database").mkdir()
    (places / "database/.lock").touch()
    assert_nothing_to_do(fleet, places)


def test_places_without_clouds_are_not_looked_for_and_the_others_are(
    fleet: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    plan, settings = plan_of(fleet, tmp_path, clouds=False)
    folder = FleetFolder(tmp_path, settings)
    folder.describe(plan, InProcess())
    with folder.database() as database:
        assert find_encounters(folder, database, Plan.load(tmp_path)) == []
        found = folder.locator(database).localize(Cloud(scan_blocks(WAY[2], 9005)))
    assert found.place is None and found.reason is not None and found.reason.code == "no-cloud"
    assert len(caplog.records) == 3


@pytest.mark.slow
def test_drives_of_one_site_meet_and_no_others(with_database: Path) -> None:
    folder = FleetFolder.open(with_database)
    with folder.database() as database:
        found = find_encounters(folder, database, Plan.load(with_database), most=3)
    met = {each.session: each.found.place for each in found if each.found.place is not None}
    sessions = {name: place.session for name, place in met.items()}
    assert sessions == {MONDAY: TUESDAY, TUESDAY: MONDAY}
