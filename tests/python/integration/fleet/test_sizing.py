# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The simulation of arriving drives against queueing theory."""

import numpy as np
import pytest

from benchmarks.fleet.sizing import Costs, arrivals_of_day, simulate_arrivals


def test_waits_are_those_of_pollaczek_and_khinchine() -> None:
    # Arrivals at random and equal work: the mean wait in the queue is load / (2 (1 - load)) works.
    rng, load = np.random.default_rng(4), 0.7
    arrivals = np.cumsum(rng.exponential(1 / load, 400_000))
    waits = simulate_arrivals(arrivals, np.full(len(arrivals), 3.0), workers=3)
    assert np.mean(waits) - 1 == pytest.approx(load / (2 * (1 - load)), rel=0.03)


def test_drives_without_a_queue_wait_for_their_own_work() -> None:
    waits = simulate_arrivals(np.array([0.0, 100.0]), np.array([40.0, 20.0]), workers=4)
    np.testing.assert_allclose(waits, [10, 5])


def test_a_share_of_the_drives_arrives_in_the_last_hour() -> None:
    times = arrivals_of_day(500, 4, 3, 0.5, np.random.default_rng(0))
    assert len(times) == 6000 and (np.diff(times) >= 0).all()
    late = (times % 86_400 >= 17 * 3600).mean()
    assert late == pytest.approx(0.5 + 0.5 / 10, abs=0.02)


def test_costs_grow_by_their_exponents() -> None:
    costs = Costs(0.036, 1000, 2000, 360, 2.0, 0.01, 0.5)
    assert costs.describe_core_hours(1e6) == pytest.approx(10)
    assert costs.database_gb(1e8) == pytest.approx(100)
    assert costs.clouds_gb(1e6) == pytest.approx(2)
    assert costs.build_hours(1e7) == pytest.approx(10)
    assert costs.query_ms(1e8) == pytest.approx(100)
