# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Work on a fleet: it goes on where it stopped, and what fails is named and keeps nothing else."""

import json
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from artefacts import copy_artefact
from fleets import (
    FRAMES,
    LABELS,
    MONDAY,
    TUESDAY,
    WEDNESDAY,
    InProcess,
    chunk_files,
    describe_fleet,
    digests,
    plan_of,
)
from fusionslam import FusionConfig
from fusionslam.datasets import open_dataset
from fusionslam.errors import DataError
from fusionslam.fleet import chunk as chunks
from fusionslam.fleet import work
from fusionslam.fleet.chunk import Chunk, StoredChunk
from fusionslam.fleet.config import FleetConfig, FleetSettings
from fusionslam.fleet.recordings import find_recordings
from fusionslam.fleet.settings import settle_settings
from fusionslam.fleet.work import (
    FAILED,
    PLAN,
    Failure,
    Plan,
    describe_recordings,
    list_status,
    load_failures,
    save_failures,
)
from fusionslam.pipelines.describe import PipelineConfig
from permissions import limited_files
from refusals import refuses


def test_a_second_run_does_nothing(fleet: Path, own_places: Path) -> None:
    before, engine = digests(own_places), InProcess()
    times = [path.stat().st_mtime_ns for path in chunk_files(own_places)]
    assert describe_fleet(fleet, own_places, engine) == []
    assert engine.begun == [] and digests(own_places) == before
    assert [path.stat().st_mtime_ns for path in chunk_files(own_places)] == times


def test_progress_counts_each_frame_once(fleet: Path, own_places: Path) -> None:
    for path in chunk_files(own_places)[::2]:
        path.unlink()
    plan, settings = plan_of(fleet, own_places)
    said: list[tuple[int, int]] = []
    describe_recordings(
        plan, settings, own_places, InProcess(), progress=lambda *now: said.append(now)
    )
    assert said == sorted(said) and said[-1] == (FRAMES, FRAMES)


def fail_for(
    monkeypatch: pytest.MonkeyPatch, when: Callable[[Chunk], BaseException | None]
) -> list[Chunk]:
    """Let chunks fail for which there is an error; return all that are tried."""
    tried: list[Chunk] = []

    def describe(chunk: Chunk, settings: FleetSettings, folder: Path) -> None:
        tried.append(chunk)
        if (error := when(chunk)) is not None:
            raise error
        chunks.describe_chunk(chunk, settings, folder)

    monkeypatch.setattr(work, "describe_chunk", describe)
    return tried


def test_what_fails_is_tried_three_times_and_named_and_the_rest_is_done(
    fleet: Path, described: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def is_bad(chunk: Chunk) -> BaseException | None:
        bad = (chunk.recording.session, chunk.first) == (TUESDAY, 4)
        return ZeroDivisionError("a fault") if bad else None

    tried = fail_for(monkeypatch, is_bad)
    failures = describe_fleet(fleet, tmp_path / "places")
    reason = "ZeroDivisionError: a fault"
    assert failures == [Failure(TUESDAY, 4, 4, "crash", reason, tries=3)]
    assert load_failures(tmp_path / "places") == failures
    assert len(tried) == 9 + 2
    whole, part = digests(described), digests(tmp_path / "places")
    assert part.items() <= whole.items() and len(part) == 8
    rows, _ = list_status(tmp_path / "places")
    assert {each.recording.session: (each.done, each.failed) for each in rows} == {
        MONDAY: (9, 0),
        TUESDAY: (5, 4),
        WEDNESDAY: (9, 0),
    }
    monkeypatch.undo()
    assert describe_fleet(fleet, tmp_path / "places") == []
    assert digests(tmp_path / "places") == whole and not load_failures(tmp_path / "places")


def test_what_succeeds_at_the_second_try_is_no_failure(
    fleet: Path, described: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: set[str] = set()

    def is_new(chunk: Chunk) -> BaseException | None:
        new = chunk.key not in seen
        seen.add(chunk.key)
        return OSError("the network") if new else None

    fail_for(monkeypatch, is_new)
    assert describe_fleet(fleet, tmp_path / "places") == []
    assert digests(tmp_path / "places") == digests(described)


def test_a_recording_that_always_fails_does_not_keep_the_others_waiting(
    fleet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def is_bad(chunk: Chunk) -> BaseException | None:
        bad = chunk.recording.session == WEDNESDAY
        return DataError("bad", code="bad") if bad else None

    tried = fail_for(monkeypatch, is_bad)
    failures = describe_fleet(fleet, tmp_path / "places", chunk=1, tries=100)
    assert [(each.session, each.first, each.code) for each in failures] == [
        (WEDNESDAY, first, "bad") for first in range(9)
    ]
    assert len(tried) == FRAMES + 10
    assert sum(each.tries - 1 for each in failures) == 10


def test_a_missing_calibration_is_named_and_the_others_go_on(kitti: Path, tmp_path: Path) -> None:
    root = tmp_path / "fleet"
    for name in "ab":
        copy_artefact(kitti, root / name / "sequences/03")
    (root / "b/sequences/03/calib.txt").unlink()
    found = find_recordings(root, LABELS)
    config = PipelineConfig(fusion=FusionConfig(source="lidar"))
    folder = tmp_path / "places"
    settings = settle_settings(found, ["cm2dp"], config, FleetConfig(), folder, source="lidar")
    plan = Plan.make(root, found, settings)
    failures = describe_recordings(plan, settings, folder, InProcess(), taker=Reader(folder))
    ((session, count, code),) = [(each.session, each.count, each.code) for each in failures]
    assert (session, count, code) == ("b", len(open_dataset(kitti)), "bad-frames")
    assert "calibration" in failures[0].reason
    plan.save(folder)
    rows, _ = list_status(folder)
    assert [(each.done, each.failed) for each in rows] == [(count, 0), (0, count)]


class Reader:
    """Takes in chunks, and says so only once, as a database does."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.known = folder, set[str]()

    def take(self, chunk: Chunk) -> Mapping[int, str] | None:
        if chunk.key in self.known:
            return None
        skipped = StoredChunk.load(chunk.path(self.folder)).skipped
        self.known.add(chunk.key)
        return skipped


def test_bad_frames_are_listed_until_they_are_good(own_fleet: Path, tmp_path: Path) -> None:
    scan = own_fleet / "north/r1/monday/clouds/000005.bin"
    whole = scan.read_bytes()
    scan.write_bytes(b"12345")
    folder, reader = tmp_path / "places", Reader(tmp_path / "places")
    for _ in range(2):
        plan, settings = plan_of(own_fleet, folder)
        (bad,) = describe_recordings(plan, settings, folder, InProcess(), taker=reader)
        assert (bad.session, bad.first, bad.count) == (MONDAY, 4, 1)
        assert "000005.bin" in bad.reason and load_failures(folder) == [bad]
    scan.write_bytes(whole)
    plan, settings = plan_of(own_fleet, folder)
    assert describe_recordings(plan, settings, folder, InProcess(), taker=reader) == []


def test_a_damaged_chunk_that_is_taken_in_is_made_again(fleet: Path, own_places: Path) -> None:
    expected, path = digests(own_places), chunk_files(own_places)[2]
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    plan, settings = plan_of(fleet, own_places)
    engine, reader = InProcess(), Reader(own_places)
    assert describe_recordings(plan, settings, own_places, engine, taker=reader) == []
    assert [each.key for each in engine.begun] == [path.stem] and len(reader.known) == 9
    assert digests(own_places) == expected


def test_a_full_disk_is_named_once_work_stops_and_a_rerun_completes(
    fleet: Path, described: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, engine = tmp_path / "places", InProcess()
    save = chunks.save_archive

    def save_some(path: Path, *rest: object) -> None:
        if len(chunk_files(folder)) >= 8:
            raise DataError(f"cannot write {path}: No space left", code="cannot-write")
        save(path, *rest)

    plan, settings = plan_of(fleet, folder, chunk=1)
    with monkeypatch.context() as patched:
        patched.setattr(chunks, "save_archive", save_some)
        said: list[tuple[int, int]] = []
        failures = describe_recordings(
            plan, settings, folder, engine, progress=lambda *now: said.append(now)
        )
    assert said[-1] == (FRAMES, FRAMES)
    assert len(chunk_files(folder)) == 8 and len(failures) == FRAMES - 8
    assert {each.code for each in failures} == {"cannot-write"}
    assert all("No space left" in each.reason for each in failures)
    # The others would be described for nothing.
    assert len(engine.begun) == 8 + 5
    assert {each.tries for each in failures} == {0, 1}
    assert describe_recordings(plan, settings, folder, InProcess()) == []
    assert len(chunk_files(folder)) == FRAMES


def test_a_limit_of_the_size_of_files_is_a_reason_as_well(fleet: Path, tmp_path: Path) -> None:
    plan, settings = plan_of(fleet, tmp_path / "places")
    with limited_files(10_000):
        failures = describe_recordings(plan, settings, tmp_path / "places", InProcess())
    assert len(failures) == 9 and all("File too large" in each.reason for each in failures)
    assert chunk_files(tmp_path / "places") == []  # no temporary ones either
    assert describe_recordings(plan, settings, tmp_path / "places", InProcess()) == []


def test_a_list_of_failures_that_cannot_be_written_stops_nothing(
    fleet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    plan, settings = plan_of(fleet, tmp_path / "places")

    def replace_by_a_folder(chunk: Chunk) -> BaseException | None:
        if (tmp_path / "places" / FAILED).is_file():
            (tmp_path / "places" / FAILED).unlink()
            (tmp_path / "places" / FAILED).mkdir()
        return DataError("bad") if chunk.first == 8 else None

    (tmp_path / "places" / FAILED).touch()
    fail_for(monkeypatch, replace_by_a_folder)
    failures = describe_recordings(plan, settings, tmp_path / "places", InProcess())
    assert len(failures) == 3 and len(chunk_files(tmp_path / "places")) == 6
    assert FAILED in caplog.text


def test_a_line_that_was_not_completed_is_left_out(tmp_path: Path) -> None:
    bad = Failure("a", 0, 4, "bad", "it is bad\n, twice", 3)
    failures = [bad, Failure("b", None, None, "c", "")]
    save_failures(tmp_path, failures)
    assert load_failures(tmp_path) == failures
    lines = (tmp_path / FAILED).read_text().splitlines()
    assert [json.loads(line)["session"] for line in lines] == ["a", "b"]
    with (tmp_path / FAILED).open("a") as file:
        file.write('{"session": "c", "fir')
    assert load_failures(tmp_path) == failures
    assert load_failures(tmp_path / "none") == []


def test_a_plan_is_the_same_after_it_was_stored(fleet: Path, own_places: Path) -> None:
    plan, _ = plan_of(fleet, own_places)
    assert Plan.load(own_places) == plan
    (own_places / PLAN).write_text((own_places / PLAN).read_text()[:100])
    with refuses("damaged-file"):
        list_status(own_places)


def test_status_says_why_there_is_none(own_places: Path, tmp_path: Path) -> None:
    (own_places / PLAN).unlink()
    with refuses("missing-file", str(own_places / PLAN)):
        list_status(own_places)
    with refuses("missing-file"):
        list_status(tmp_path)


def test_recordings_that_are_gone_stay_known_and_others_may_not_take_their_names(
    own_fleet: Path, own_places: Path
) -> None:
    earlier, settings = plan_of(own_fleet, own_places)
    moved = own_fleet.parent / "moved"
    shutil.copytree(own_fleet / "north", moved / "north")
    shutil.rmtree(moved / "north/r1")
    (moved / "north/r5").mkdir()
    shutil.copytree(own_fleet / MONDAY, moved / "north/r5/friday")
    later = Plan.make(moved, find_recordings(moved, LABELS), settings)
    joined = later.joined(earlier)
    sessions = [each.recording.session for each in joined.recordings]
    assert sessions == [MONDAY, TUESDAY, "north/r5/friday", WEDNESDAY]
    assert joined.outdated == []
    assert [(each.session, each.code) for each in joined.failures] == [(TUESDAY, "same-name")]


def test_a_recording_of_two_names_is_refused(own_fleet: Path, own_places: Path) -> None:
    earlier, settings = plan_of(own_fleet, own_places)
    below = Plan.make(own_fleet / "north", find_recordings(own_fleet / "north", LABELS), settings)
    joined = below.joined(earlier)
    assert joined.recordings == earlier.recordings
    assert [(each.session, each.code) for each in joined.failures] == [
        ("r1/monday", "same-recording"),
        ("r2/tuesday", "same-recording"),
    ]
