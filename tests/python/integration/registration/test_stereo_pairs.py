# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Stereo pairs of EuRoC V1_01, a flight without an upright axis, get the poses of Vicon."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.accuracy.euroc_loops import Flight, differences
from fusionslam.registration import PreparedCloud, RegistrationConfig, fit_lengths, register

pytest.importorskip("small_gicp", reason="the libraries of registration are an extra")
pytest.importorskip("kiss_matcher", reason="the libraries of registration are an extra")


@pytest.mark.parametrize(
    ("query", "match", "thorough"),
    [(30, 12, False), (56, 23, False), (48, 2, True)],
    ids=["by features", "by one pose", "by more features"],
)
def test_views_of_one_place_get_the_true_pose(
    query: int, match: int, thorough: bool, test_data: Path
) -> None:
    flight = Flight(test_data / "euroc_v101")
    config = fit_lengths([flight.cloud(0)], RegistrationConfig(gravity=False))
    source, target = (PreparedCloud(flight.cloud(each), config) for each in (query, match))
    found = register(source, target, thorough=thorough)
    assert found.target_from_source is not None
    assert found.probability is not None and found.probability > 0.9
    truth = np.linalg.inv(flight.poses[match]) @ flight.poses[query]
    metres, degrees = differences(truth, found.target_from_source)
    assert metres < 0.1
    assert degrees < 3
    assert thorough <= (not register(source, target, thorough=False).accepted)
