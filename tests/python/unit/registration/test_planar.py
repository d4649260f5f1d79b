# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Views of a robot on a floor are registered by their range images."""

import pickle
from itertools import product

import numpy as np
import pytest

from error_codes import has_code
from fusionslam import Cloud
from fusionslam.base.arrays import Floats
from fusionslam.errors import DataError
from fusionslam.registration import PreparedCloud, Registration, RegistrationConfig, register
from fusionslam.views import align_scenes, build_scene
from rows import rows
from streets import at
from worlds import AHEAD, AROUND, Pose, room, scan, seen_from

PLANAR = RegistrationConfig(method="planar", position_sd=0.02, angle_sd=0.2)
STORED: Pose = (0.4, -0.3, 1.2)
CURRENT: Pose = (0.6, -0.2, 1.3)


def check_pose(found: Registration, stored: Pose, current: Pose) -> None:
    x, y, yaw = seen_from(stored, current)
    truth = at(x, y, np.degrees(yaw), 0)
    np.testing.assert_allclose(found.target_from_source, truth, atol=0.03)


@rows("sector, seed", product([AHEAD, AROUND], range(3)))
def test_the_pose_of_a_nearby_view_is_found(sector: Floats, seed: int) -> None:
    source = scan(room(seed), CURRENT, sector, seed=2)
    target = scan(room(seed), STORED, sector, seed=1)
    found = register(source, target, config=PLANAR)
    check_pose(found, STORED, CURRENT)
    assert found.reason is None and found.probability >= 0.96
    assert found.overlap > 0.8 and found.tilt == 0


def test_z_roll_and_pitch_have_the_deviations_of_the_configuration() -> None:
    clouds = [scan(room(1), pose, AROUND) for pose in (CURRENT, STORED)]
    config = RegistrationConfig(method="planar", floor_height_sd=0.2, floor_tilt_sd=3)
    covariance = register(*clouds, config=config).covariance
    sds = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(sds[2:5], [0.2, *np.radians([3, 3])])
    assert ((sds[:2] >= 0.05) & (sds[:2] < 0.06)).all()
    assert 0.3 <= np.degrees(sds[5]) < 0.4


@rows("turn_deg", [-170, 90, 183])
def test_the_turn_of_a_guess_finds_views_in_other_directions(turn_deg: float) -> None:
    current: Pose = (0.5, -0.2, STORED[2] + np.radians(turn_deg))
    source, target = scan(room(2), current, AROUND), scan(room(2), STORED, AROUND, seed=1)
    assert not register(source, target, config=PLANAR).accepted
    guess = at(0, 0, turn_deg + 4, 0)
    check_pose(register(source, target, guess, config=PLANAR), STORED, current)


def test_another_room_is_improbable() -> None:
    source, target = scan(room(2), CURRENT, AHEAD), scan(room(5), STORED, AHEAD)
    found = register(source, target, config=PLANAR)
    assert found.target_from_source is None is found.covariance
    assert found.reason.code in ("improbable", "no-match")
    assert found.reason.number < 0.96


def corridor(pose: Pose, seed: int) -> Cloud:
    """Two bare walls along x, 3 m apart and 100 m long."""
    bare = room(0, half=(50.0, 1.5), boxes=0)
    return scan(bare, pose, AROUND, seed=seed)


def test_a_corridor_is_degenerate_along_itself() -> None:
    config = RegistrationConfig(method="planar", min_probability=0)
    sideways = np.pi / 2
    found = register(corridor((0, 0, sideways), 1), corridor((0, 0.1, sideways), 2), config=config)
    # The robots look across it.
    np.testing.assert_allclose(np.abs(found.degenerate), [[0, 1, 0]], atol=0.02)
    sds = np.sqrt(np.diag(found.covariance))
    assert sds[1] > 9 and sds[0] < 0.3


def test_the_information_of_an_alignment_follows_its_walls() -> None:
    clouds = [corridor((0, y, 0), seed) for y, seed in ((0, 1), (0.1, 2))]
    scenes = [build_scene(each.points, each.colors) for each in clouds]
    information = align_scenes(*scenes).information
    np.testing.assert_array_equal(information, information.T)
    assert np.linalg.eigvalsh(information)[0] > -1e-9 * information.max()
    assert information[1, 1] > 10 * information[0, 0]
    nothing = build_scene(np.empty((0, 3), np.float32), np.empty((0, 3), np.uint8))
    assert not align_scenes(nothing, scenes[0]).information.any()


def test_few_cells_are_a_reason() -> None:
    target = scan(room(1), STORED, AHEAD)
    tiny, empty = (Cloud(target.points[:n], target.colors[:n]) for n in (3, 0))
    for clouds in ((tiny, target), (target, tiny), (empty, target)):
        found = register(*clouds, config=PLANAR)
        assert found.reason.code == "few-points" and found.estimate is None


def test_clouds_without_colours_are_refused() -> None:
    target = scan(room(1), STORED, AHEAD)
    for colourless in (Cloud(target.points), target.points):
        with pytest.raises(DataError, check=has_code("no-colors")):
            register(colourless, target, config=PLANAR)


def test_prepared_clouds_and_clouds_give_equal_bits() -> None:
    clouds = [scan(room(1), pose, AHEAD) for pose in (CURRENT, STORED)]
    prepared = [pickle.loads(pickle.dumps(PreparedCloud(each, PLANAR))) for each in clouds]
    expected, found = register(*clouds, config=PLANAR), register(*prepared)
    np.testing.assert_array_equal(found.target_from_source, expected.target_from_source)
    np.testing.assert_array_equal(found.covariance, expected.covariance)
