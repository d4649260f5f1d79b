# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds of rooms are registered with smaller lengths than those of streets."""

import numpy as np
import pytest

from clouds import scan_blocks
from fusionslam import Cloud
from fusionslam.base.arrays import Points
from fusionslam.errors import DataError, ShapeError
from fusionslam.registration import RegistrationConfig, fit_lengths, measure_reach, register
from rows import rows
from streets import at

EMPTY = np.empty((0, 3), np.float32)


def walls(size: float, count: int = 20000) -> Points:
    """The four walls of a square room about the sensor."""
    rng = np.random.default_rng(0)
    along, height = rng.uniform(-size / 2, size / 2, count), rng.uniform(-1, 2, count)
    across = np.full(count, size / 2)
    side = np.c_[across, along, height]
    turned = np.c_[along, across, height]
    return np.concatenate([side, -side, turned, -turned]).astype(np.float32)


def test_the_reach_is_the_median_distance_of_surfaces_however_dense_they_are() -> None:
    far = np.array([[30, 0, 0], [32, 0, 0], [34, 0, 0]], np.float32)
    near = np.random.default_rng(1).uniform(1.0, 1.4, (1000, 3)).astype(np.float32)  # one voxel
    assert measure_reach(Cloud(np.concatenate([far, near]))) == pytest.approx(31)
    assert measure_reach(EMPTY) == 0


def test_clouds_of_streets_leave_the_configuration_as_it_is() -> None:
    config = RegistrationConfig(voxel=0.3)
    cloud = scan_blocks(np.eye(4), 1)
    assert measure_reach(cloud) > 15
    assert fit_lengths([cloud], config) is config


def test_lengths_are_in_proportion_to_rooms_and_the_rest_stays() -> None:
    config = RegistrationConfig(min_overlap=0.5, gravity=False)
    room = walls(6)
    fitted = fit_lengths([room], config)
    factor = measure_reach(room) / 20
    assert 0.15 < factor < 0.25
    lengths = {
        "voxel": 0.5,
        "search_cell": 2.0,
        "search_voxel": 1.0,
        "guess_distance": 3.0,
        "distance": 1.0,
        "ground_height": 0.5,
        "overlap_distance": 0.5,
    }
    for name, length in lengths.items():
        assert getattr(fitted, name) == pytest.approx(factor * length)
    rest = set(RegistrationConfig.model_fields) - set(lengths)
    assert all(getattr(fitted, name) == getattr(config, name) for name in rest)


def test_the_median_of_the_clouds_counts_and_empty_ones_do_not() -> None:
    street = scan_blocks(np.eye(4), 1)
    assert fit_lengths([walls(6), street, EMPTY, walls(6)]) == fit_lengths([walls(6)])
    assert fit_lengths([walls(6), street, street]) == RegistrationConfig()


def test_tiny_clouds_have_lengths_that_are_not_zero() -> None:
    assert fit_lengths([walls(0.2)]).voxel == pytest.approx(0.05)


@rows("clouds", [[], [EMPTY]])
def test_clouds_without_points_are_refused(clouds: list[Points]) -> None:
    with pytest.raises(DataError, match="points"):
        fit_lengths(clouds)


def test_what_is_no_cloud_is_refused() -> None:
    with pytest.raises(ShapeError):
        fit_lengths([np.zeros((5, 2), np.float32)])


def test_a_room_is_registered_more_finely_than_by_the_defaults() -> None:
    # A model of a street at a tenth of its size.
    truth = at(0.15, -0.1, 25, 0)
    poses = at(1.5, -1, 25, 0), np.eye(4)
    small = [0.1 * scan_blocks(pose, seed) for seed, pose in enumerate(poses, 1)]
    fitted = fit_lengths(small)
    assert fitted != RegistrationConfig()
    error = {}
    for name, config in (("fitted", fitted), ("default", RegistrationConfig())):
        found = register(*(each.astype(np.float32) for each in small), config=config)
        assert found.estimate is not None or name == "default"
        off = np.eye(4) * 9 if found.estimate is None else np.linalg.inv(truth) @ found.estimate
        error[name] = float(np.linalg.norm(off[:3, 3]))
    assert error["fitted"] < 0.01 and error["default"] > 2 * error["fitted"]
