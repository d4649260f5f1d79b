# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Sensors that are tilted, narrow or sparse: levelled clouds and local maps, made and real."""

import itertools
import pickle
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from clouds import scan_blocks
from fusionslam import Cloud, DataError, FusionConfig, Loop, LoopDetector, PlaceMap
from fusionslam.base.arrays import Floats, Matrix, Points
from fusionslam.errors import ShapeError
from fusionslam.loop_closure.local_maps import Piece, RecentFrames, pieces_to_join
from fusionslam.loop_closure.verification import PairComparisons, StoredFrame
from fusionslam.mapping.config import MapConfig
from fusionslam.registration import PreparedCloud, RegistrationConfig, register
from fusionslam.registration.clouds import pack_arrays, unpacking
from fusionslam.sensors.frame import Frame
from rows import rows
from streets import OPTIONS, WAY, assert_near, at

ONE, OTHER = at(0, 0, 20), at(3, -2, 200)


def turned(angles: tuple[float, float, float]) -> Matrix:
    """A sensor's mounting, turned about z, y and x."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("zyx", angles, degrees=True).as_matrix()
    return pose


def seen_by(mount: Matrix, points: Points) -> Points:
    return (points @ mount[:3, :3]).astype(np.float32)


@rows("tilts", [((0, 5, 0), (0, 5, 0)), ((0, 30, 9), (0, 10, -20)), ((90, 45, 0), (10, 0, -45))])
def test_clouds_of_tilted_sensors_are_registered_in_their_own_frames(
    tilts: tuple[tuple[float, float, float], tuple[float, float, float]],
) -> None:
    mounts = [turned(each) for each in tilts]
    clouds = [
        seen_by(mount, scan_blocks(pose, seed, 15_000))
        for seed, (mount, pose) in enumerate(zip(mounts, (ONE, OTHER), strict=True))
    ]
    found = register(*clouds)
    truth = np.linalg.inv(OTHER @ mounts[1]) @ ONE @ mounts[0]
    assert_near(found.target_from_source, truth, 0.1, 0.5)
    assert found.covariance is not None and found.tilt < 2
    np.testing.assert_allclose(found.covariance, found.covariance.T, atol=1e-12)
    guessed = register(*clouds, guess=truth, search=False)
    assert_near(guessed.target_from_source, truth, 0.1, 0.5)
    # What is stored is levelled alike.
    stored = [
        PreparedCloud.from_bytes(PreparedCloud(cloud).to_bytes(), RegistrationConfig())
        for cloud in clouds
    ]
    np.testing.assert_array_equal(register(*stored).estimate, found.estimate)


def test_without_auto_tilted_clouds_are_refused_as_before() -> None:
    config = RegistrationConfig(gravity=True)
    scans = [scan_blocks(pose, seed, 15_000) for seed, pose in enumerate((ONE, OTHER))]
    assert register(*scans, config=config).accepted
    refused = register(seen_by(turned((0, 30, 0)), scans[0]), scans[1], config=config)
    assert not refused.accepted


@rows("change", [{"level": np.eye(3) * 2}, {"views": np.zeros((1, 4, 4))}, {"level": np.eye(2)}])
def test_a_stored_level_or_view_that_is_no_rotation_is_damage(change: dict[str, Floats]) -> None:
    config = RegistrationConfig()
    cloud = PreparedCloud(
        seen_by(turned((0, 20, 0)), scan_blocks(ONE, 0, 5000)),
        further=[(np.ones((180, 360), np.float32), np.eye(4))],
    )
    with unpacking(cloud.to_bytes()) as arrays:
        damaged = pack_arrays({**arrays, **change})
    with pytest.raises(DataError, match="damaged"):
        PreparedCloud.from_bytes(damaged, config)


def drive(
    clouds: list[Points], way: list[Floats], detector: LoopDetector | None = None
) -> tuple[LoopDetector, list[Loop]]:
    if detector is None:
        detector = LoopDetector("m2dp", window=3)
    found = [
        detector.add(Cloud(cloud), stamp_ns=10 * k, odometry=pose)
        for k, (cloud, pose) in enumerate(zip(clouds, way, strict=True))
    ]
    return detector, [loop for loop in found if loop is not None]


SCANS = [scan_blocks(pose, seed, 15_000) for seed, pose in enumerate(WAY[:16])]


def assert_right(loops: list[Loop], way: list[Floats]) -> None:
    for loop in loops:
        assert_near(
            loop.match_from_query, np.linalg.inv(way[loop.match]) @ way[loop.query], 0.3, 1.0
        )


@pytest.mark.slow
def test_a_drive_with_a_tilted_sensor_finds_what_a_level_one_finds() -> None:
    mount = turned((15, 40, -10))
    way = [pose @ mount for pose in WAY[:16]]
    _, loops = drive([seen_by(mount, scan) for scan in SCANS], way)
    assert [loop.query for loop in loops] == [loop.query for loop in drive(SCANS, WAY[:16])[1]]
    assert_right(loops, way)


def narrow(scan: Points) -> Points:
    """What a sensor sees that looks ahead, 70 degrees wide."""
    ahead = np.abs(np.degrees(np.arctan2(scan[:, 1], scan[:, 0]))) < 35
    return scan[ahead]


TWICE = [at(2.0 * k, 0.3 * (k // 12), 0) for k in (*range(12), *range(12))]
"""Along a street, and again along it."""


@pytest.mark.slow
def test_narrow_clouds_are_joined_and_their_loops_are_right() -> None:
    clouds = [narrow(scan_blocks(pose, seed, 15_000)) for seed, pose in enumerate(TWICE)]
    detector, loops = drive(clouds, TWICE)
    assert detector.registration_config.local_map == pytest.approx(7, abs=2)
    # The first one after the jump back shows no more than a single cloud.
    assert {loop.query for loop in loops} >= set(range(13, 24))
    assert_right(loops, TWICE)
    last = detector.stored_frame(23).unpack()
    assert len(last.further) == 3 and len(last) > 1.3 * len(PreparedCloud(clouds[-1]))
    again = pickle.loads(pickle.dumps(detector)).stored_frame(23).unpack()
    np.testing.assert_array_equal(again.points, last.points)
    np.testing.assert_array_equal(again.further[0][0], last.further[0][0])


@pytest.mark.slow
def test_a_map_of_a_tilted_narrow_sensor_finds_its_robot(tmp_path: Path) -> None:
    pytest.importorskip("gtsam", reason="the library of pose graphs is an extra")
    mount = turned((0, 20, 5))
    frames = [
        Frame(
            index=k,
            stamp_ns=(k + 1) * 10**9,
            points=seen_by(mount, narrow(scan_blocks(pose, k, 15_000))),
            odometry=pose @ mount,  # the scanner is the robot
        )
        for k, pose in enumerate(TWICE)
    ]
    path = tmp_path / "site.fsmap"
    near = MapConfig(keyframe_distance=1.0)
    with PlaceMap.open(path, session="monday", config=near, **OPTIONS) as site:
        steps = [site.add(frame) for frame in frames[:12]]
        assert [step.keyframe for step in steps] == [*range(12)]
        # Local maps share their scans: steps are measured by the scans themselves.
        assert sum(edge.kind == "loop" and edge.b == edge.a + 1 for edge in site.edges) >= 8
    with PlaceMap.open(path, read_only=True) as site:
        assert site.config["registration"]["local_map"] == pytest.approx(7, abs=2)
        map_from_world = np.linalg.inv(TWICE[0] @ mount)
        found = [site.localize(frame) for frame in frames[12:]]
        assert sum(each.pose is not None for each in found) >= 10
        for each, pose in zip(found, TWICE[12:], strict=True):
            if each.pose is not None:
                assert_near(each.pose, map_from_world @ pose @ mount, 0.3, 1.0)


@pytest.mark.slow
def test_frames_of_one_local_map_are_no_loops_of_each_other() -> None:
    clouds = [narrow(scan_blocks(pose, seed, 15_000)) for seed, pose in enumerate(TWICE[:12])]
    detector = LoopDetector(
        "m2dp", window=0, registration=RegistrationConfig(local_map=5.0, voxel=0.5)
    )
    _, loops = drive(clouds, TWICE[:12], detector)
    assert all(loop.query - loop.match > 2 for loop in loops)  # two steps of 2 m are joined


@pytest.mark.slow
def test_odometry_that_jumps_makes_no_wrong_pose() -> None:
    """It jumps by 3 m, less than a local map is long: the joined cloud shows everything twice."""
    clouds = [narrow(scan_blocks(pose, seed, 15_000)) for seed, pose in enumerate(TWICE)]
    jumped = [np.array(pose) for pose in TWICE]
    for pose in jumped[18:]:
        pose[1, 3] += 3
    _, loops = drive(clouds, jumped)
    assert_right(loops, TWICE)


def piece(x: float, yaw: float = 0.0, circle: float = 0.0) -> Piece:
    """What a frame gives whose scanner saw a share of the directions around it."""
    cloud = Cloud(np.zeros((1, 3), np.float32))
    ranges = np.zeros((2, 40), np.float32)
    ranges[:, : round(40 * circle)] = 5.0
    return Piece(cloud, cloud, ranges, at(x, 0, yaw))


def test_local_maps_end_at_their_length_at_jumps_and_at_a_number_of_frames() -> None:
    pieces = [piece(x) for x in (0, 1, 2, 50, 51, 52)]
    joined = pieces_to_join(pieces, at(53, 0, 0), 2.5)
    assert [each.odometry[0, 3] for each in joined] == [51, 52]
    assert len(pieces_to_join(pieces, at(53, 0, 0), 40)) == 3  # the jump is longer
    assert not pieces_to_join(pieces, at(99, 0, 0), 40)
    near = RecentFrames()
    for number in range(100):  # 3 m in steps that are too small to show anything new
        near.add_piece(number, piece(0.03 * number), 6.0)
    places = [each.odometry[0, 3] for each in pieces_to_join(near.pieces, at(3, 0, 0), 6)]
    np.testing.assert_allclose(places, np.arange(0, 2.98, 0.21), atol=1e-9)
    assert near.numbers_since(2, 100) == range(91, 100)
    near.clear()
    assert not near.pieces and not near.numbers_since(2, 100)


def test_local_maps_of_scanners_that_see_all_round_end_at_turns() -> None:
    """Odometry that errs by one percent of a turn would bend them, and they show nothing new."""
    for circle, joined in ((0.2, [40, 30, 20, 10, 0]), (1.0, [10, 0])):
        pieces = [piece(0.0, yaw, circle) for yaw in (40, 30, 20, 10, 0)]
        found = pieces_to_join(pieces, at(0, 0, 0), 5.0)
        yaws = [np.degrees(np.arctan2(*each.odometry[[1, 0], 0])) for each in found]
        np.testing.assert_allclose(yaws, joined, atol=1e-9)


def test_without_odometry_clouds_stay_single() -> None:
    detector = LoopDetector("m2dp", window=3)
    for seed, pose in enumerate(TWICE[:3]):
        detector.add(Cloud(narrow(scan_blocks(pose, seed, 15_000))))
    assert detector.registration_config.local_map
    assert not detector.stored_frame(2).unpack().further


def test_poses_are_far_apart_as_of_single_clouds_where_none_is_joined() -> None:
    config = RegistrationConfig(local_map=7.0)
    points = scan_blocks(ONE, 0, 2000)
    seen = [(np.ones((180, 360), np.float32), np.eye(4))]
    single, joined = PreparedCloud(points, config), PreparedCloud(points, config, further=seen)
    for query, match, reach in (
        (single, single, 0.0),
        (joined, single, 7.0),
        (single, joined, 7.0),
    ):
        stored = {0: StoredFrame(0, None, None, [match].pop)}
        assert PairComparisons(query, stored.__getitem__).reach(0) == reach


def test_odometry_that_is_unknown_levels_nothing_and_one_that_is_no_pose_is_refused() -> None:
    detector = LoopDetector("m2dp", window=0, fusion=FusionConfig(source="cloud"))
    nothing = np.full((4, 4), np.nan)
    detector.add(Cloud(SCANS[0]), odometry=nothing)
    detector.add(Frame(points=SCANS[1], odometry=nothing))
    assert len(detector) == 2 and detector.stored_frame(1).odometry is None
    with pytest.raises(DataError, match="odometry is no rotation"):
        detector.add(Cloud(SCANS[2]), odometry=np.diag([2.0, 2, 2, 1]))
    with pytest.raises(ShapeError, match="odometry"):
        detector.add(Cloud(SCANS[2]), odometry=np.eye(4)[:3])
    assert len(detector) == 2


@pytest.mark.slow
def test_a_real_hand_held_sensor_finds_its_revisits(test_data: Path) -> None:
    """Livox Avia, 70 degrees wide, 314 keyframes: of each fourth, 10 come back to a place."""
    path = test_data / "real" / "hku_1.npz"
    if not path.exists():
        pytest.skip("no real recordings")
    with np.load(path) as stored:
        points, ends = stored["xyz_5mm"], stored["offsets"]
        clouds = [
            points[a:b].astype(np.float32) * np.float32(0.005) for a, b in itertools.pairwise(ends)
        ]
        stamps, poses = stored["stamps"], stored["optimised"]
        odometry = np.tile(np.eye(4), (len(clouds), 1, 1))
        odometry[:, :3] = stored["odometry"]
    frames = range(0, len(clouds), 4)
    detector = LoopDetector("m2dp", window=0, window_seconds=30.0)
    revisits, found = set(), set()
    for number, frame in enumerate(frames):
        loop = detector.add(
            Cloud(clouds[frame]), stamp_ns=int(stamps[frame] * 1e9), odometry=odometry[frame]
        )
        older = [k for k in frames if stamps[k] < stamps[frame] - 30]
        apart = [np.linalg.norm(poses[k][:, 3] - poses[frame][:, 3]) for k in older]
        if min(apart, default=np.inf) < 3:
            revisits.add(number)
        if loop is not None:
            found.add(number)
            there, here = (np.vstack([poses[4 * k], [0, 0, 0, 1]]) for k in (loop.match, number))
            assert_near(loop.match_from_query, np.linalg.inv(there) @ here, 1.0, 8.0)
    assert len(revisits) >= 9
    assert len(revisits & found) >= 0.9 * len(revisits)
