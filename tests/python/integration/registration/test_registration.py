# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds are registered where they show one place, and refused with a reason where not."""

import os
import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from clouds import scan_blocks
from error_codes import has_code
from fusionslam import Cloud
from fusionslam.base.arrays import Floats, Matrix, Points
from fusionslam.errors import ConfigError, DataError, FusionSlamError, ShapeError
from fusionslam.registration import (
    PreparedCloud,
    Registration,
    RegistrationConfig,
    pose_estimation,
    register,
)
from fusionslam.registration.map_extra import search_pose
from rows import rows

pytest.importorskip("kiss_matcher", reason="the libraries of registration are an extra")


def pose_of(x: float, y: float, z: float, *angles_deg: float) -> Matrix:
    """Roll, pitch and yaw in degrees."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("xyz", angles_deg, degrees=True).as_matrix()
    pose[:3, 3] = x, y, z
    return pose


def error_between(found: Matrix | None, truth: Matrix) -> Floats:
    """Float64 (6,): metres, then radians, in the source's frame."""
    off = np.linalg.inv(truth) @ found
    return np.concatenate([off[:3, 3], Rotation.from_matrix(off[:3, :3]).as_rotvec()])


Scans = tuple[Points, Points]
HERE = pose_of(3, -2, 1.7, 0, 0, 20)
THERE = pose_of(8, 1, 1.9, 1, -2, 175)


@pytest.fixture(scope="module")
def scans() -> Scans:
    """A source and a target, 6 m apart and 155 degrees turned."""
    return scan_blocks(THERE, 1), scan_blocks(HERE, 2)


TRUTH = np.linalg.inv(HERE) @ THERE
FREE = RegistrationConfig(gravity=False)


@pytest.fixture(scope="module")
def found(scans: Scans) -> Registration:
    return register(*scans)


def test_a_pose_is_found_without_a_guess(found: Registration) -> None:
    assert found.accepted and found.reason is None
    error = error_between(found.target_from_source, TRUTH)
    assert np.linalg.norm(error[:3]) < 0.05 and np.degrees(np.linalg.norm(error[3:])) < 0.1
    assert found.overlap > 0.7
    upright = np.degrees(np.arccos(TRUTH[2, 2]))
    assert found.tilt == pytest.approx(upright, abs=0.1) and len(found.degenerate) == 0
    assert found.seconds > 0


def test_the_covariance_is_its_floor_where_the_clouds_hold_firmly(found: Registration) -> None:
    sds = np.sqrt(np.diag(found.covariance))
    np.testing.assert_allclose(sds[:3], 0.05, rtol=0.05)
    np.testing.assert_allclose(np.degrees(sds[3:]), 0.3, rtol=0.05)
    np.testing.assert_array_equal(found.covariance, found.covariance.T)


def test_a_guess_gives_the_same_pose_as_the_search(scans: Scans, found: Registration) -> None:
    guess = TRUTH @ pose_of(0.8, -0.6, 0, 0, 0, 3)
    again = register(*scans, guess)
    error = error_between(again.target_from_source, found.target_from_source)
    assert np.abs(error).max() < 2e-3


def test_a_wrong_guess_is_no_worse_than_none(scans: Scans, found: Registration) -> None:
    again = register(*scans, pose_of(-20, 5, 0, 0, 0, 90))
    np.testing.assert_array_equal(again.target_from_source, found.target_from_source)


def test_swapping_the_clouds_inverts_the_pose(scans: Scans, found: Registration) -> None:
    source, target = scans
    back = register(target, source)
    error = error_between(back.target_from_source @ found.target_from_source, np.eye(4))
    assert np.abs(error).max() < 0.02


def test_prepared_clouds_and_clouds_give_equal_bits(scans: Scans, found: Registration) -> None:
    source, target = PreparedCloud(Cloud(scans[0])), PreparedCloud(scans[1].astype(np.float64))
    for _ in range(2):
        assert same(register(source, target), found)
    assert same(register(pickle.loads(pickle.dumps(source)), target), found)


def same(one: Registration, other: Registration) -> bool:
    """Whether two registrations are equal to the bit but for their time."""
    parts = [pickle.dumps(replace(each, seconds=0.0)) for each in (one, other)]
    return parts[0] == parts[1]


REPEAT = """
import hashlib, sys
import numpy as np
from fusionslam.registration import register
source, target = np.load(sys.argv[1]), np.load(sys.argv[2])
for _ in range(2):
    found = register(source, target)
    pose, covariance = found.target_from_source, found.covariance
    print(hashlib.sha256(pose.tobytes() + covariance.tobytes()).hexdigest())
"""


@pytest.mark.slow
def test_every_run_and_number_of_threads_gives_equal_bits(scans: Scans, tmp_path: Any) -> None:
    paths = [str(tmp_path / f"{name}.npy") for name in ("source", "target")]
    for path, points in zip(paths, scans, strict=True):
        np.save(path, points)
    digests = []
    for threads in ("1", "8"):
        run = subprocess.run(
            [sys.executable, "-c", REPEAT, *paths],
            env=os.environ | {"OMP_NUM_THREADS": threads},
            capture_output=True,
            text=True,
            check=True,
        )
        digests += run.stdout.split()
        assert not run.stderr
    assert len(digests) == 4 and len(set(digests)) == 1


def test_an_upside_down_copy_is_refused_unless_there_is_no_gravity(scans: Scans) -> None:
    source = scans[1] * np.array([1, -1, -1], np.float32)
    over = np.diag([1.0, -1, -1, 1])
    refused = register(source, scans[1], over, search=False)
    assert refused.target_from_source is None is refused.covariance
    assert (refused.reason.code, round(refused.reason.number)) == ("tilted", 180)
    assert refused.estimate is not None
    free = register(source, scans[1], config=FREE)
    assert np.abs(error_between(free.target_from_source, over)).max() < 0.01


def test_another_place_is_refused_with_its_overlap(scans: Scans) -> None:
    elsewhere = scan_blocks(pose_of(-45, 40, 1.7, 0, 0, 0), 3)
    refused = register(elsewhere, scans[1], np.eye(4), search=False)
    assert refused.target_from_source is None and refused.reason.code == "low-overlap"
    assert refused.reason.number == refused.overlap == pytest.approx(0.085, abs=0.005)
    tolerant = register(
        elsewhere, scans[1], np.eye(4), search=False, config=RegistrationConfig(min_overlap=0)
    )
    assert tolerant.reason.code == "degenerate"
    np.testing.assert_array_equal(tolerant.estimate, refused.estimate)


def test_bare_ground_has_nothing_to_search_by(scans: Scans) -> None:
    floor = np.random.default_rng(4).uniform([-30, -30, -1.7], [30, 30, -1.7], (20000, 3))
    refused = register(floor.astype(np.float32), scans[1])
    assert (refused.reason.code, refused.reason.number) == ("no-match", 0)
    assert refused.estimate is None


def test_space_that_the_other_sensor_saw_to_be_free_counts_against_a_pose() -> None:
    front = np.mgrid[8:9, -10:10:0.2, 0:6:0.2].reshape(3, -1).T.astype(np.float32)
    back = front + np.float32([4, 0, 0])
    config = RegistrationConfig(gravity=False, min_overlap=0)

    def overlap(*points: Points) -> float:
        clouds = [np.concatenate(parts) for parts in (points, (front, SIDES))]
        return register(*clouds, np.eye(4), config=config).overlap

    assert overlap(front, SIDES) == 1
    hidden, missing = overlap(front, SIDES, back), overlap(back, SIDES)
    # What only one sees is behind the front for the other; without the front it is seen through.
    assert 1 > hidden > 0.8
    assert missing < 0.7


SIDES = np.mgrid[-10:10:0.2, 15:16, 0:6:0.2].reshape(3, -1).T.astype(np.float32)


def corridor(seed: int, length: float = 60) -> Points:
    """A floor and two bare walls along x, longer than the sensor reaches."""
    rng = np.random.default_rng(seed)
    half = length / 2
    walls = rng.uniform([-half, 0, -1], [half, 0, 2], (12000, 3))
    walls[:, 1] = np.where(rng.random(12000) < 0.5, -2, 2)
    floor = rng.uniform([-half, -2, -1], [half, 2, -1], (6000, 3))
    return (np.concatenate([walls, floor]) + rng.normal(0, 0.01, (18000, 3))).astype(np.float32)


def test_a_corridor_is_degenerate_along_itself() -> None:
    turn = pose_of(0, 0, 0, 0, 0, 90)  # the corridor lies along y in the source's frame
    source = (corridor(1).astype(np.float64) @ turn[:3, :3].T).astype(np.float32)
    found = register(source, corridor(2), np.linalg.inv(turn))
    assert found.accepted
    np.testing.assert_allclose(np.abs(found.degenerate), [[0, 1, 0]], atol=0.02)
    sds = np.sqrt(np.diag(found.covariance))
    assert sds[1] > 9 and max(sds[0], sds[2]) < 0.3
    error = error_between(found.target_from_source, np.linalg.inv(turn))
    assert np.abs(error[[0, 2, 3, 4, 5]]).max() < 0.02


def test_a_plane_is_refused_as_degenerate_along_both_of_its_axes() -> None:
    floors = []
    for seed in (1, 2):
        rng = np.random.default_rng(seed)
        floor = rng.uniform([-20, -20, -1], [20, 20, -1], (20000, 3))
        floors.append((floor + rng.normal(0, 0.01, floor.shape)).astype(np.float32))
    found = register(*floors, np.eye(4), config=RegistrationConfig(gravity=False))
    assert found.target_from_source is None
    assert (found.reason.code, found.reason.number) == ("degenerate", 2)
    assert len(found.degenerate) == 2
    np.testing.assert_allclose(found.degenerate[:, 2], 0, atol=0.02)


@rows("count", [0, 1, 5, 19])
def test_few_points_are_a_reason(count: int, scans: Scans) -> None:
    few = scans[0][:: len(scans[0]) // 20][:count]
    for clouds in ((few, scans[1]), (scans[1], few)):
        refused = register(*clouds)
        assert refused.reason is not None
        assert (refused.reason.code, refused.reason.number) == ("few-points", count)
        assert refused.estimate is None and refused.overlap == 0


NEAR = HERE @ pose_of(0.6, -0.4, 0.1, 1, -2, 4)
"""A pose from which a view looks like that from HERE."""


def test_views_from_nearly_one_pose_are_registered_though_no_features_match(
    scans: Scans, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pose_estimation, "search_pose", lambda *_: None)
    found = register(scan_blocks(NEAR, 3), scans[1], thorough=False, config=FREE)
    assert np.abs(error_between(found.target_from_source, np.linalg.inv(HERE) @ NEAR)).max() < 0.05
    assert not register(*scans, thorough=False, config=FREE).accepted


def test_a_thorough_search_matches_the_features_of_all_voxels(
    scans: Scans, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, target = (PreparedCloud(cloud, FREE) for cloud in scans)
    searched: list[tuple[int, int]] = []

    def search(one: Points, other: Points, voxel: float) -> Matrix | None:
        searched.append((len(one), len(other)))
        return search_pose(one, other, voxel) if len(searched) % 2 == 0 else None

    monkeypatch.setattr(pose_estimation, "search_pose", search)
    quick = register(source, target, thorough=False)
    searched.clear()
    found = register(source, target)
    assert not quick.accepted
    assert np.abs(error_between(found.target_from_source, TRUTH)).max() < 0.05
    few = len(source.search_points), len(target.search_points)
    assert searched == [few, (len(source), len(target))]
    assert len(source) > few[0] > 0


def test_the_pose_with_the_right_colours_wins_over_one_with_as_much_overlap(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng = np.random.default_rng(5)
    half = rng.uniform([-20, 8, -2], [20, 9, 6], (4000, 3))
    half[::4] = rng.uniform([10, -8, -2], [11, 8, 6], (1000, 3))
    turn = pose_of(0, 0, 0, 0, 0, 180)
    points = np.concatenate([half, half @ turn[:3, :3].T]).astype(np.float32)
    colors = rng.integers(0, 80, (40, 8, 3), dtype=np.uint8)  # of patches, 1 m wide
    shades = colors[(points[:, 0] + 20).astype(int) % 40, (points[:, 2] + 2).astype(int) % 8]
    shades[4000:] += np.uint8(150)
    cloud = Cloud(points, shades)
    monkeypatch.setattr(pose_estimation, "search_pose", lambda *_: turn)
    found = register(cloud, cloud, thorough=False, config=FREE)
    assert np.abs(error_between(found.target_from_source, np.eye(4))).max() < 0.01
    bare = register(points, points, thorough=False, config=FREE)
    assert np.abs(error_between(bare.target_from_source, turn)).max() < 0.01


def test_scattered_points_have_no_features() -> None:
    scattered = np.random.default_rng(3).uniform(-1e4, 1e4, (300, 3)).astype(np.float32)
    refused = register(scattered, scattered + np.float32(1), config=FREE)
    assert (refused.reason.code, refused.reason.number) == ("no-features", 0)


ONES = np.ones((30, 3), np.float32)
NO_CLOUDS = [None, [1, 2], np.ones((5, 2)), np.ones((5, 3), np.int32), "a"]
NO_POSES = [np.eye(3), np.diag([1.0, 1, -1, 1]), np.full((4, 4), np.nan), 2 * np.eye(4), "a"]
SEVENTH = (np.arange(30) == 7)[:, None]


@rows(
    "wrong, text, error",
    [
        *[([np.where(SEVENTH, x, ONES)], "point 7 is", DataError) for x in (np.nan, np.inf)],
        *[([cloud], "expected a Cloud", ShapeError) for cloud in NO_CLOUDS],
        *[([ONES, pose], "guess", (DataError, ShapeError)) for pose in NO_POSES],
    ],
)
def test_bad_input_is_refused_by_name(wrong: list[Any], text: str, error: Any) -> None:
    with pytest.raises(error, match=text):
        register(wrong[0], ONES, *wrong[1:])


def test_a_packed_cloud_registers_as_before(scans: Scans, found: Registration) -> None:
    config = RegistrationConfig()
    packed = [PreparedCloud(points).to_bytes() for points in scans]
    assert max(map(len, packed)) < 150_000
    assert same(register(*(PreparedCloud.from_bytes(each, config) for each in packed)), found)
    for damaged in (b"", packed[0][:-20], packed[0][:40] + b"x" + packed[0][41:]):
        with pytest.raises(DataError, match="damaged"):
            PreparedCloud.from_bytes(damaged, config)


def test_motion_while_clouds_were_taken_makes_their_pose_less_certain(
    scans: Scans, found: Registration
) -> None:
    source, target = (PreparedCloud(points) for points in scans)
    turn = np.zeros((2, 6))
    turn[1, 5] = np.radians(6)
    grown = []
    for one, other in ((turn, None), (None, turn), (turn, turn)):
        source.moved, target.moved = one, other
        packed = PreparedCloud.from_bytes(source.to_bytes(), source.config)
        moving = register(packed, pickle.loads(pickle.dumps(target)))
        np.testing.assert_array_equal(moving.target_from_source, found.target_from_source)
        grown.append(np.asarray(moving.covariance) - found.covariance)
    own, other_own, both = grown
    np.testing.assert_allclose(both, own + other_own, atol=1e-12)
    np.testing.assert_allclose(np.sqrt(own[5, 5]), np.radians(6) / np.sqrt(3))
    # The target turns about its own sensor, 6 m away.
    assert np.sqrt(np.trace(other_own[:2, :2])) > 5.5 * np.radians(6) / np.sqrt(3)
    assert np.linalg.eigvalsh(both).min() > -1e-12
    source.moved = turn * np.nan
    with pytest.raises(DataError, check=has_code("damaged")):
        PreparedCloud.from_bytes(source.to_bytes(), source.config)


def test_points_farther_than_16_bits_reach_are_packed_all_the_same() -> None:
    cloud = PreparedCloud(np.random.default_rng(3).uniform(-3e3, 3e3, (300, 3)).astype(np.float32))
    again = PreparedCloud.from_bytes(cloud.to_bytes(), cloud.config)
    np.testing.assert_array_equal(again.points, cloud.points)


def test_a_guess_or_a_search_is_needed(scans: Scans) -> None:
    with pytest.raises(ConfigError, match="neither a guess nor a search"):
        register(*scans, search=False)


def test_prepared_clouds_keep_their_configuration(scans: Scans) -> None:
    fine = RegistrationConfig(voxel=0.3)
    prepared = PreparedCloud(scans[0], fine)
    assert same(register(prepared, scans[1]), register(*scans, config=fine))
    with pytest.raises(ConfigError, match="different configurations"):
        register(prepared, PreparedCloud(scans[1]))


def test_a_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch, scans: Scans) -> None:
    monkeypatch.setitem(sys.modules, "kiss_matcher", None)
    with pytest.raises(FusionSlamError, match=r"\[map\]", check=has_code("missing-extra", "map")):
        register(*scans, config=FREE)


def test_without_a_package_of_kiss_matcher_for_this_python_a_guess_is_asked_for(
    monkeypatch: pytest.MonkeyPatch, scans: Scans
) -> None:
    monkeypatch.setitem(sys.modules, "kiss_matcher", None)
    later = SimpleNamespace(version_info=(3, 13))
    monkeypatch.setattr("fusionslam.registration.map_extra.sys", later)
    check = has_code("no-package", "kiss-matcher")
    with pytest.raises(FusionSlamError, match="give a guess", check=check):
        register(*scans, config=FREE)


def test_without_kiss_matcher_a_guess_is_judged_alone(
    monkeypatch: pytest.MonkeyPatch, scans: Scans
) -> None:
    monkeypatch.setitem(sys.modules, "kiss_matcher", None)
    assert register(*scans, TRUTH, config=FREE).accepted
    refused = register(*scans, pose_of(-20, 5, 0, 0, 0, 90), config=FREE)
    assert refused.reason.code in ("low-overlap", "degenerate")


@rows("is_built_from_source", [True, False])
def test_another_package_of_kiss_matcher_than_that_of_pypi_is_refused(
    is_built_from_source: bool,
    monkeypatch: pytest.MonkeyPatch,
    scans: Scans,
    tmp_path: Path,
) -> None:
    kiss_matcher = sys.modules["kiss_matcher"]
    (openmp,) = (Path(str(kiss_matcher.__file__)).parents[1]).glob("kiss_matcher.libs/libgomp-*")
    if not is_built_from_source:  # its TBB lacks the functions
        libraries = tmp_path / "kiss_matcher.libs"
        libraries.mkdir()
        for name in ("libtbb-1.so", "libgomp-1.so"):
            (libraries / name).symlink_to(openmp)
    monkeypatch.setattr(kiss_matcher, "__file__", str(tmp_path / "kiss_matcher" / "__init__.py"))
    found = "nothing" if is_built_from_source else r"libgomp-1\.so, libtbb-1\.so"
    check = has_code("other-package", "kiss-matcher")
    with pytest.raises(FusionSlamError, match=f"found there: {found}", check=check):
        register(*scans, config=FREE)
