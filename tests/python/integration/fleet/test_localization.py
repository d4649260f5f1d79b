# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Has any robot been here: which one, when, and where exactly."""

import csv
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cli import error_of, run
from clouds import scan_blocks
from error_codes import has_code
from fleets import MONDAY, WEDNESDAY, chunk_files
from fusionslam import Cloud, Frame, FusionConfig
from fusionslam.base.arrays import Matrix
from fusionslam.datasets import write_cloud
from fusionslam.errors import ConfigError, FusionSlamError
from fusionslam.fleet.config import FleetConfig
from fusionslam.fleet.folder import FleetFolder
from fusionslam.fleet.localization import FleetLocalization, FleetLocator
from fusionslam.fleet.place_database import PlaceDatabase
from fusionslam.fleet.places import Candidate, PlaceFilter
from fusionslam.fleet.recordings import Labels, find_recordings
from fusionslam.fleet.scans import COLUMNS, list_scans, localize_scans, write_candidates
from fusionslam.fleet.settings import settle_settings
from fusionslam.pipelines.describe import PipelineConfig
from rows import rows
from streets import WAY, assert_near, at


@pytest.fixture(scope="module")
def locator(with_database: Path) -> Iterator[FleetLocator]:
    folder = FleetFolder.open(with_database)
    with folder.database() as database:
        yield folder.locator(database)


@rows(
    "pose, place, robots, site",
    [
        (at(-11, 0.4, 12), 12, ("r1", "r2"), "north"),
        (at(2.5, -0.3, 185), 12, ("r1", "r2"), "north"),
        (at(6, 0.5, 40), 7, ("r3",), "south"),
    ],
)
def test_a_scan_from_another_viewpoint_is_found_where_it_is(
    locator: FleetLocator, pose: Matrix, place: int, robots: Sequence[str], site: str
) -> None:
    found = locator.localize(Cloud(scan_blocks(pose, 9000, place=place)))
    assert found.reason is None and found.place is not None and found.probability > 0.5
    assert found.place.site == site and found.place.robot in robots
    assert_near(found.site_from_robot, pose, 0.2, 1)
    assert found.covariance is not None and (np.linalg.eigvalsh(found.covariance) > 0).all()


def test_the_pose_on_the_robot_that_saw_the_place_is_known(locator: FleetLocator) -> None:
    pose = at(-18, 0.5, 5)
    found = locator.localize(Cloud(scan_blocks(pose, 9001)), where=PlaceFilter(robot="r1"))
    assert found.place is not None and found.place.session == "north/r1/monday"
    assert found.place.stamp_ns == found.place.frame * 10**9
    assert_near(found.place_from_robot, np.linalg.inv(WAY[found.place.frame]) @ pose, 0.2, 1)


def test_a_frame_is_found_where_its_robot_is(locator: FleetLocator) -> None:
    pose = at(0.5, 0.2, 10)
    mount = at(0.3, 0, 90, z=0)
    scanner = pose @ mount
    frame = Frame(index=0, points=scan_blocks(scanner, 9002), robot_from_points=mount)
    assert_near(locator.localize(frame).site_from_robot, pose, 0.2, 1)


def reason_of(found: FleetLocalization) -> str:
    assert found.place is None and found.site_from_robot is None and found.reason is not None
    return found.reason.code


def test_an_unknown_place_is_not_found(locator: FleetLocator) -> None:
    found = locator.localize(Cloud(scan_blocks(at(0, 0, 0), 9003, place=99)))
    assert reason_of(found) and len(found.candidates) == 10


def test_places_of_another_site_are_not_asked(locator: FleetLocator) -> None:
    cloud = Cloud(scan_blocks(at(0.5, 0.2, 10), 9004))
    found = locator.localize(cloud, where=PlaceFilter(site="south"))
    assert reason_of(found)
    assert {each.site for each in found.candidates} == {"south"}
    assert len(locator.find(cloud, 3, PlaceFilter(site="north"))) == 3
    nowhere = locator.localize(cloud, where=PlaceFilter(site="nowhere"))
    assert reason_of(nowhere) == "no-candidates" and not nowhere.candidates


def test_chunks_that_are_gone_or_damaged_prove_nothing_and_the_others_do(
    places: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder, cloud = FleetFolder.open(places), Cloud(scan_blocks(at(0.5, 0.2, 10), 9006))
    with folder.database() as database:
        locator = folder.locator(database)
        first, *others = locator.find(cloud)
        files = {path.stem: path for path in chunk_files(places)}
        path = files[first.key.split(":")[0]]
        path.write_bytes(path.read_bytes()[:-1])
        found = locator.localize(cloud)
        assert found.place is not None and found.place.key in {each.key for each in others}
        assert path.name in caplog.text
        for path in files.values():
            path.unlink()
        # Nothing is known that was read before.
        found = FleetFolder.open(places).locator(database).localize(cloud)
    assert reason_of(found) == "no-cloud" and len(found.candidates) == 10


def test_a_place_without_a_pose_gives_none_in_its_site(
    locator: FleetLocator, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = PlaceDatabase.query

    def query(*asked: Any, **more: Any) -> list[list[Candidate]]:
        return [[replace(one, pose=None) for one in row] for row in plain(*asked, **more)]

    monkeypatch.setattr(PlaceDatabase, "query", query)
    found = locator.localize(Cloud(scan_blocks(at(0.5, 0.2, 10), 9007)))
    assert found.place_from_robot is not None and found.site_from_robot is None


def test_a_scan_is_treated_as_those_of_the_places_were(fleet: Path, tmp_path: Path) -> None:
    found = find_recordings(fleet, Labels(("site", "robot")))
    config = PipelineConfig(fusion=FusionConfig(source="cloud", voxel=0.7))
    settings = settle_settings(found, ["m2dp"], config, FleetConfig(), tmp_path)
    nothing: Any = None
    locator = FleetLocator(nothing, nothing, settings)
    frame = found.recordings[0].recording.open("cloud")[2]
    assert frame.points is not None
    holes = np.vstack([frame.points, np.full((5, 3), np.nan, np.float32)])
    np.testing.assert_array_equal(locator.describe(Cloud(holes)), locator.describe(frame))


POSE = at(2.5, -0.3, 185)


@pytest.fixture
def scan(tmp_path: Path) -> Path:
    write_cloud(tmp_path / "scan.ply", Cloud(scan_blocks(POSE, 9100)))
    return tmp_path / "scan.ply"


def test_recordings_without_numbers_are_all_of_their_frames(fleet: Path, scan: Path) -> None:
    monday, wednesday = fleet / MONDAY, fleet / WEDNESDAY
    found = list_scans([scan, monday, wednesday], (), "cloud")
    assert [each.frame for each in found] == [None, *range(9), *range(9)]
    assert [each.path for each in found[::9]] == [scan, monday, wednesday]
    some = list_scans([wednesday, monday], (5, 2), "cloud")
    assert [(each.path, each.frame) for each in some] == [
        (path, frame) for path in (wednesday, monday) for frame in (5, 2)
    ]


def test_numbers_of_frames_that_are_not_there_are_refused(fleet: Path, scan: Path) -> None:
    for path in (scan, fleet / MONDAY):
        with pytest.raises(ConfigError, check=has_code("choice", "--frame", "9")):
            list_scans([path], (9,), "cloud")


def test_several_scans_are_found_by_one_search_as_each_alone(
    fleet: Path, with_database: Path, scan: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, where = FleetFolder.open(with_database), PlaceFilter(not_session=WEDNESDAY)
    scans = list_scans([scan, fleet / "nothing", fleet / WEDNESDAY], (), "cloud")[:4]
    searches = []
    plain = PlaceDatabase.query

    def query(self: PlaceDatabase, vectors: np.ndarray, *more: object) -> object:
        searches.append(len(vectors))
        return plain(self, vectors, *more)

    with folder.database() as database:
        locator = folder.locator(database)
        alone = locator.localize(scans[0].read(), 5, where)
        monkeypatch.setattr(PlaceDatabase, "query", query)
        first, missing, *others = localize_scans(locator, scans, 5, where)
        listed = localize_scans(locator, scans, 5, where, proves=False)
        assert localize_scans(locator, [], 5) == []
    assert searches == [3, 3]
    assert isinstance(missing, FusionSlamError) and missing.code == "missing-file"
    assert isinstance(first, FleetLocalization) and isinstance(listed[0], FleetLocalization)
    assert alone.place is not None and first.place is not None
    assert first.place.key == alone.place.key and first.probability == alone.probability
    np.testing.assert_array_equal(first.site_from_robot, alone.site_from_robot)
    assert listed[0].reason is None
    keys = [each.key for each in alone.candidates]
    assert [each.key for each in listed[0].candidates] == keys
    for each in others:
        assert isinstance(each, FleetLocalization)
        assert each.place is None and each.reason is not None and len(each.candidates) == 5


def test_the_table_has_all_candidates(
    fleet: Path, with_database: Path, scan: Path, tmp_path: Path
) -> None:
    folder = FleetFolder.open(with_database)
    scans = list_scans([scan, tmp_path / "nothing.ply"], (), "cloud")
    with folder.database() as database:
        found = localize_scans(folder.locator(database), scans, 3)
    write_candidates(tmp_path / "found.csv", scans, found)
    with (tmp_path / "found.csv").open(newline="") as file:
        rows = [*csv.DictReader(file)]
    assert tuple(rows[0]) == COLUMNS and [row["rank"] for row in rows] == ["1", "2", "3", ""]
    assert rows[3]["scan"] == str(tmp_path / "nothing.ply") and rows[3]["reason"] == "missing-file"
    (proven,) = (row for row in rows if row["x"])
    assert isinstance(found[0], FleetLocalization) and found[0].place is not None
    assert proven["session"] == found[0].place.session and float(proven["probability"]) > 0.5
    there, moved, pose = (pose_of(proven, begin) for begin in ("place_", "from_place_", ""))
    np.testing.assert_allclose(there @ moved, pose, atol=1e-5)
    assert np.linalg.norm(pose[:3, 3] - POSE[:3, 3]) < 0.2


def pose_of(row: dict[str, str], begin: str) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = [float(row[f"{begin}{name}"]) for name in "xyz"]
    turn = [float(row[f"{begin}q{name}"]) for name in "xyzw"]
    pose[:3, :3] = Rotation.from_quat(turn).as_matrix()
    return pose


def test_one_proven_scan_is_a_success(fleet: Path, with_database: Path, scan: Path) -> None:
    south = fleet / WEDNESDAY
    asked = ("--frame", 3, "-p", with_database, "-k", 3, "--site")
    assert run("fleet", "query", south, fleet / MONDAY, *asked, "north").exit_code == 0
    assert run("fleet", "query", south, fleet / MONDAY, *asked, "none").exit_code == 1
    assert run("fleet", "query", scan, scan, "-p", with_database).exit_code == 0
    bare = run("fleet", "query", scan, "nothing.ply", "-p", with_database, "--no-pose")
    assert bare.exit_code == 1


@rows(
    "field, options",
    [
        ("--since", ["yesterday"]),
        ("--until", ["2026-13-01"]),
        ("--until", ["0001-01-01"]),
        ("--since", ["9999-12-31T23:59"]),
        ("--until", ["2026-11-26T00:00Z", "--since", "2026-11-26"]),
    ],
)
def test_times_that_are_none_are_refused(
    with_database: Path, scan: Path, field: str, options: list[str]
) -> None:
    error = error_of(2, "fleet", "query", scan, "-p", with_database, field, *options)
    assert isinstance(error, ConfigError) and error.fields[0] == field


def test_a_time_has_an_offset_or_is_utc(with_database: Path, fleet: Path, tmp_path: Path) -> None:
    for begin, end in [
        ("1970-01-01T00:00:02", "1970-01-01T00:00:05"),
        ("1970-01-01T01:00:02+01:00", "1969-12-31T19:00:05-05:00"),
    ]:
        monday, path = fleet / MONDAY, tmp_path / "found.csv"
        asked = ("--no-pose", "--since", begin, "--until", end, "-p", with_database, "-o", path)
        assert run("fleet", "query", monday, "--frame", 4, *asked).exit_code == 0
        with path.open(newline="") as file:
            stamps = {int(row["stamp_ns"]) // 10**9 for row in csv.DictReader(file)}
        assert stamps == {2, 3, 4}
