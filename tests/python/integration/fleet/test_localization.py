# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Has any robot been here: which one, when, and where exactly."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from clouds import scan_blocks
from fleets import chunk_files, describe_fleet
from fusionslam import Cloud, Frame, FusionConfig
from fusionslam.fleet.chunk_store import ChunkStore, PlaceCloud
from fusionslam.fleet.config import FleetConfig, FleetSettings
from fusionslam.fleet.localization import FleetLocalization, FleetLocator
from fusionslam.fleet.places import ABOUT, Candidate, PlaceFilter, join_places
from fusionslam.fleet.recordings import Labels, find_recordings
from fusionslam.fleet.settings import settle_settings
from fusionslam.pipelines.describe import PipelineConfig
from fusionslam.storage.arrays import Floats32, Matrix
from rows import rows
from streets import WAY, at


class Brute:
    """What a database of places finds, by comparing all."""

    def __init__(self, folder: Path) -> None:
        store = ChunkStore(folder, FleetSettings.load(folder))
        places = join_places([store.places(path.stem) for path in chunk_files(folder)])
        assert places is not None and places.poses is not None
        self.places = places

    def query(
        self, vectors: Floats32, k: int = 10, where: PlaceFilter | None = None
    ) -> list[list[Candidate]]:
        return [self._nearest(vector, k, where or PlaceFilter()) for vector in vectors]

    def _nearest(self, vector: Floats32, k: int, where: PlaceFilter) -> list[Candidate]:
        distances = np.linalg.norm(self.places.vectors - vector, axis=1)
        found = [self._candidate(row, distances[row]) for row in np.argsort(distances).tolist()]
        asked = {name: getattr(where, name) for name in ABOUT}
        return [
            each
            for each in found
            if all(value in (None, getattr(each, name)) for name, value in asked.items())
        ][:k]

    def _candidate(self, row: int, distance: float) -> Candidate:
        places = self.places
        about = {name: places.column(name)[row] for name in ABOUT}
        return Candidate(
            key=places.keys[row],
            distance=float(distance),
            frame=int(places.frames[row]),
            stamp_ns=int(places.stamps_ns[row]),
            pose=places.poses[row],
            **about,
        )


@pytest.fixture(scope="module")
def locator(described: Path) -> FleetLocator:
    return locator_of(described)


def locator_of(folder: Path) -> FleetLocator:
    settings = FleetSettings.load(folder)
    return FleetLocator(Brute(folder), ChunkStore(folder, settings), settings)


def assert_near(found: Matrix | None, true: Matrix) -> None:
    assert found is not None
    off = np.linalg.inv(true) @ found
    assert np.linalg.norm(off[:3, 3]) < 0.2
    assert np.degrees(Rotation.from_matrix(off[:3, :3]).magnitude()) < 1


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
    assert_near(found.site_from_robot, pose)
    assert found.covariance is not None and (np.linalg.eigvalsh(found.covariance) > 0).all()


def test_the_pose_on_the_robot_that_saw_the_place_and_its_time_are_known(
    locator: FleetLocator,
) -> None:
    pose = at(-18, 0.5, 5)
    found = locator.localize(Cloud(scan_blocks(pose, 9001)), where=PlaceFilter(robot="r1"))
    assert found.place is not None and found.place.session == "north/r1/monday"
    assert found.place.stamp_ns == found.place.frame * 10**9
    assert_near(found.place_from_robot, np.linalg.inv(WAY[found.place.frame]) @ pose)


def test_a_frame_is_found_where_its_robot_is(locator: FleetLocator) -> None:
    pose = at(0.5, 0.2, 10)
    mount = at(0.3, 0, 90, z=0)
    scanner = pose @ mount
    frame = Frame(index=0, points=scan_blocks(scanner, 9002), robot_from_points=mount)
    assert_near(locator.localize(frame).site_from_robot, pose)


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


def test_without_clouds_nothing_is_proven(fleet: Path, tmp_path: Path) -> None:
    describe_fleet(fleet, tmp_path, clouds=False)
    found = locator_of(tmp_path).localize(Cloud(scan_blocks(at(0.5, 0.2, 10), 9005)))
    assert reason_of(found) == "no-cloud" and len(found.candidates) == 10


def test_chunks_that_are_gone_or_damaged_prove_nothing_and_the_others_do(
    own_places: Path, caplog: pytest.LogCaptureFixture
) -> None:
    locator, cloud = locator_of(own_places), Cloud(scan_blocks(at(0.5, 0.2, 10), 9006))
    first, *others = locator.find(cloud)
    path = next(path for path in chunk_files(own_places) if path.stem == first.key.split(":")[0])
    path.write_bytes(path.read_bytes()[:-1])
    found = locator.localize(cloud)
    assert found.place is not None and found.place.key in {each.key for each in others}
    assert path.name in caplog.text
    for path in chunk_files(own_places):
        path.unlink()
    # The same places, with nothing that was read before.
    settings = FleetSettings.load(own_places)
    locator = FleetLocator(locator._search, ChunkStore(own_places, settings), settings)
    assert reason_of(locator.localize(cloud)) == "no-cloud"


def test_a_place_without_a_pose_gives_none_in_its_site(described: Path) -> None:
    class Unknown(Brute):
        def _candidate(self, row: int, distance: float) -> Candidate:
            return replace(super()._candidate(row, distance), pose=None)

    settings = FleetSettings.load(described)
    locator = FleetLocator(Unknown(described), ChunkStore(described, settings), settings)
    found = locator.localize(Cloud(scan_blocks(at(0.5, 0.2, 10), 9007)))
    assert found.place_from_robot is not None and found.site_from_robot is None


def test_a_scan_is_treated_as_those_of_the_places_were(fleet: Path, tmp_path: Path) -> None:
    found = find_recordings(fleet, Labels(("site", "robot")))
    config = PipelineConfig(fusion=FusionConfig(source="cloud", voxel=0.7))
    settings = settle_settings(found, ["m2dp"], config, FleetConfig(), tmp_path)
    locator = FleetLocator(NoPlaces(), NoPlaces(), settings)
    frame = found.recordings[0].recording.open("cloud")[2]
    assert frame.points is not None
    holes = np.vstack([frame.points, np.full((5, 3), np.nan, np.float32)])
    np.testing.assert_array_equal(locator.describe(Cloud(holes)), locator.describe(frame))


class NoPlaces:
    """A database without places."""

    def query(
        self, vectors: Floats32, k: int = 10, where: PlaceFilter | None = None
    ) -> list[list[Candidate]]:
        return [[] for _ in vectors]

    def cloud(self, key: str) -> PlaceCloud:
        raise AssertionError(key)
