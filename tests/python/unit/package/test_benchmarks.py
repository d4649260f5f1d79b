# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The benchmark's own arithmetic, with made-up clocks: nothing here measures time."""

from collections.abc import Callable

import numpy as np
import pytest

from benchmarks.speed import timing
from benchmarks.speed.cases import Bound, Case, Result, WrongAnswer, agree, measured, times_faster
from benchmarks.speed.inputs import random_descriptors, resized
from benchmarks.speed.timing import Comparison, Limits, Ratio, Times, alternate, compare, exponent
from rows import rows


@pytest.fixture(autouse=True)
def collects_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A collection of all garbage takes the longer, the more other tests have loaded."""
    monkeypatch.setattr(timing.gc, "collect", lambda: 0)


FIVE = Limits(seconds=0, least=5, most=5)


def clock(seconds: list[float]) -> Callable[[], float]:
    """A timer that says these times one after the other, after a first one that does not count."""
    remaining = iter([99.0, *seconds])
    return lambda: next(remaining)


def test_ours_and_the_peer_take_turns_after_one_pair_that_does_not_count() -> None:
    calls: list[str] = []

    def called(name: str) -> float:
        calls.append(name)
        return float(len(calls))

    samples = alternate(lambda: called("ours"), lambda: called("peer"), Limits(0, 3, 9))
    assert calls == ["ours", "peer"] * 4
    assert samples == ([3.0, 5.0, 7.0], [4.0, 6.0, 8.0])


def test_repetitions_end_at_the_most_however_much_time_there_is() -> None:
    ours, peer = alternate(lambda: 1.0, lambda: 1.0, Limits(seconds=60, least=1, most=4))
    assert len(ours) == len(peer) == 4


def test_times_are_minimum_median_and_95th_percentile() -> None:
    times = Times.of([float(i) for i in range(100, -1, -1)])
    assert (times.minimum, times.median, times.p95, times.repetitions) == (0, 50, 95, 101)


def test_the_ratio_is_that_of_the_medians_and_its_spread_that_of_the_pairs() -> None:
    comparison = compare(clock([1, 2, 4, 2, 2]), clock([10, 20, 20, 30, 40]), FIVE)
    assert comparison.ratio is not None
    assert comparison.ratio.value == pytest.approx(10)
    low, high = np.percentile([10, 10, 5, 15, 20], [10, 90])
    assert (comparison.ratio.low, comparison.ratio.high) == pytest.approx((low, high))


def test_the_ratio_is_by_the_work_done_where_that_differs() -> None:
    ratio = Ratio.of([1.0, 1.0], [10.0, 10.0], work=(1, 2))
    assert (ratio.value, ratio.low, ratio.high) == (5, 5, 5)


def test_without_a_peer_there_is_no_ratio() -> None:
    comparison = compare(clock([3, 1, 2, 5, 4]), None, FIVE)
    assert comparison == Comparison(Times(1, 3, pytest.approx(4.8), 5))


@rows("power", [0.5, 1.0, 2.0])
def test_the_exponent_of_a_power_law_is_found(power: float) -> None:
    sizes = [1000, 3000, 10000, 25000]
    assert exponent(sizes, [1e-6 * n**power for n in sizes]) == pytest.approx(power)


def test_what_every_call_costs_does_not_pass_for_good_scaling() -> None:
    sizes = [10, 100, 10_000, 100_000, 250_000]
    seconds = [1.0, 1.0, 0.01, 0.1, 0.25]  # the two smallest are left out of the fit
    assert exponent(sizes, seconds) == pytest.approx(1)


def test_one_size_has_no_exponent() -> None:
    assert np.isnan(exponent([100], [1.0]))


@rows(
    "bound, met",
    [
        (times_faster(10), True),
        (times_faster(10.1), False),
        (Bound("ratio", "<=", 1.9), False),
        (Bound("median", "<=", 2000), True),
        (Bound("median", "<=", 1999), False),
    ],
)
def test_bounds_are_judged_by_the_medians(bound: Bound, met: bool) -> None:
    comparison = compare(clock([2] * 5), clock([20] * 5), FIVE)
    assert bound.judge(comparison).met is met


@rows("error", [0.2, float("nan"), float("inf")])
def test_an_error_beyond_the_tolerance_is_a_wrong_answer(error: float) -> None:
    with pytest.raises(WrongAnswer, match=r"votes.*\b0\.1"):
        agree("votes", error, 0.1)


def row(error: float, reasons: dict[str, str] | None = None) -> Result:
    """A row that is to be three times faster and is twice."""
    case = Case(
        "work",
        "peer",
        clock([1] * 5),
        clock([2] * 5),
        lambda: agree("entries", error, 0.5),
        times_faster(3),
    )
    return measured("group", case, FIVE, reasons or {}, judged=True)


def test_a_wrong_answer_is_told_and_its_time_is_not() -> None:
    result = row(error=1)
    assert "entries: 1" in result.wrong
    assert result.comparison is None


def test_a_bound_that_is_not_met_carries_its_reason() -> None:
    result = row(error=0, reasons={"work / peer": "memory bandwidth"})
    assert result.verdict is not None
    assert not result.verdict.met
    assert result.reason == "memory bandwidth"
    assert result.agreement == "entries: 0 <= 0.5"


def test_clouds_of_any_size_are_the_same_each_time() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-9, 9, (100, 3)).astype(np.float32)
    colors = rng.integers(0, 256, (100, 3), dtype=np.uint8)
    for size in (40, 100, 250):
        first, second = resized(points, colors, size), resized(points, colors, size)
        assert first[0].shape == first[1].shape == (size, 3)
        assert np.array_equal(first[0], second[0])
        assert np.array_equal(first[1], second[1])
    assert np.array_equal(resized(points, colors, 100)[0], points)
    nearest = np.linalg.norm(resized(points, colors, 250)[0][:, None] - points, axis=2).min(axis=1)
    assert nearest.max() < 0.2


def test_descriptors_to_search_are_unit_vectors() -> None:
    table = random_descriptors(20, 192)
    assert table.dtype == np.float32
    assert np.linalg.norm(table, axis=1) == pytest.approx(np.ones(20))
