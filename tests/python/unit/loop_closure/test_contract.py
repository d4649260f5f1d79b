# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The rule that a rate of false loops needs: against crepes, by its promise, and of bad input."""

import logging
import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from fusionslam.errors import ConfigError, DataError
from fusionslam.loop_closure import LoopConfig, contract
from fusionslam.loop_closure.contract import (
    NOTHING,
    CalibratedKind,
    Profile,
    Rule,
    calibration,
    choose_rule,
    profile_of,
    rule_needed,
    rule_of,
)
from fusionslam.registration import PreparedCloud, RegistrationConfig
from rows import rows
from worlds import room, scan

RULES = 9
POSE = (0.0, 0.0, 0.0)


def drives_that_need(needed: Any) -> tuple[Any, Any]:
    """A hundred loops by each rule, of which ten are false by all that are too loose."""
    wrong = np.where(np.arange(RULES) < np.asarray(needed)[:, None], 10, 0)
    return np.full(wrong.shape, 100), wrong


# crepes 0.9.1, ConformalRegressor at 95 % of residuals 0 to n - 1.
@rows("drives, rank", [(19, 18), (20, 19), (38, 37), (39, 37), (40, 38), (60, 57), (100, 95)])
def test_the_rule_is_that_of_the_drive_which_crepes_takes(drives: int, rank: int) -> None:
    needed = np.random.default_rng(drives).permutation(np.arange(drives) * RULES // drives)
    assert rule_needed(*drives_that_need(needed), 0.05) == np.sort(needed)[rank]


def test_less_than_19_drives_promise_nothing() -> None:
    assert rule_needed(*drives_that_need(np.zeros(18, int)), 0.05) is None
    assert rule_needed(*drives_that_need(np.zeros(19, int)), 0.05) == 0


@rows(
    "wrong, rate, rule",
    [
        ([5, 2, 0, 0], 0.05, 0),  # 100, 50, 20 and 10 loops
        ([5, 2, 0, 0], 0.01, 2),
        ([0, 0, 2, 0], 0.05, 3),  # a stricter rule that fails rules out looser ones
        ([0, 0, 0, 1], 0.05, 4),
    ],
)
def test_a_drive_needs_the_rule_from_which_on_all_keep_the_rate(
    wrong: list[int], rate: float, rule: int
) -> None:
    accepted = np.tile([100, 50, 20, 10], (19, 1))
    assert rule_needed(accepted, np.tile(wrong, (19, 1)), rate) == rule


def made_drives(rng: np.random.Generator, count: int) -> tuple[Any, Any]:
    """Drives that differ in how often loops of a probability are false, in runs of equal frames."""
    limits = np.linspace(0.9, 0.9999, RULES)
    accepted, wrong = np.zeros((2, count, RULES), np.int64)
    for drive in range(count):
        scores = np.repeat(1 - 10 ** -rng.uniform(0, 5, 40), 5)
        hardness = rng.exponential(2.0)
        false = np.repeat(rng.random(40) < np.clip(hardness * (1 - scores[::5]), 0, 1), 5)
        above = scores[:, None] >= limits
        accepted[drive], wrong[drive] = above.sum(axis=0), (above & false[:, None]).sum(axis=0)
    return accepted, wrong


@rows("rate", [0.01, 0.05])
def test_the_rate_holds_in_95_percent_of_new_drives(rate: float) -> None:
    rng = np.random.default_rng(7)
    held, without = [], []
    for _ in range(200):
        needed = rule_needed(*made_drives(rng, 20), rate)
        accepted, wrong = made_drives(rng, 10)
        within = np.column_stack([wrong <= rate * accepted, np.full(10, True)])
        assert needed is not None
        held += [*within[:, needed]]
        without += [*within[:, 0]]
    assert np.mean(without) < 0.9 and np.mean(held) >= 0.95


def test_a_lower_rate_never_needs_a_looser_rule() -> None:
    drives = made_drives(np.random.default_rng(1), 40)
    needed = [rule_needed(*drives, rate) for rate in np.linspace(0.001, 0.999, 50)]
    assert needed == sorted(needed, reverse=True) and needed[0] != needed[-1]


def kind_that_needs(rule: int, drives: int = 19) -> CalibratedKind:
    return CalibratedKind((2, 8), (100, 900), *drives_that_need(np.full(drives, rule)))


@rows(
    "kind, rule",
    [
        *(("easy", (0, True)), ("hard", (4, True)), ("impossible", (RULES, True))),
        *(("few", (4, False)), (None, (4, False))),
    ],
)
def test_clouds_without_a_promise_need_the_strictest_rule(
    kind: str | None, rule: tuple[int, bool]
) -> None:
    kinds = {"easy": kind_that_needs(0), "hard": kind_that_needs(4), "few": kind_that_needs(0, 9)}
    assert choose_rule(kinds | {"impossible": kind_that_needs(RULES)}, kind, 0.05, RULES) == rule


def test_clouds_of_another_size_are_unlike() -> None:
    kind = kind_that_needs(0)
    assert kind.shows(Profile("", 5, 500)) and kind.shows(Profile("", 1.7, 1100))
    assert not kind.shows(Profile("", 1.5, 500)) and not kind.shows(Profile("", 5, 1200))


def test_a_cloud_is_judged_by_its_kind_and_the_log_says_once_what_is_not_promised(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    cloud = PreparedCloud(scan(room(1), POSE))
    upright = profile_of(cloud)
    free = PreparedCloud(scan(room(1), POSE), RegistrationConfig(gravity=False))
    rules = [Rule(0.9, 0.95), *(Rule(each, each) for each in (0.95, 0.97, 0.99))]
    near, many = (upright.reach, upright.reach), (upright.voxels, upright.voxels)
    counts = drives_that_need(np.full(19, 2))
    kinds = {upright.kind: CalibratedKind(near, many, *(each[:, :4] for each in counts))}
    monkeypatch.setattr(contract, "calibration", lambda: (rules, kinds))
    contract._rule.cache_clear()
    caplog.set_level(logging.WARNING)
    assert rule_of(cloud, 0.05) == rules[2] and rule_of(cloud, 0.2) == rules[0]
    assert not caplog.records
    assert rule_of(free, 0.05) == rule_of(free, 0.05) == rules[2]
    (said,) = caplog.records
    assert said.args is not None and said.args[:2] == (0.05, profile_of(free).kind)
    kinds[upright.kind].wrong[:] = 100
    contract._rule.cache_clear()
    assert rule_of(cloud, 0.05) == NOTHING == Rule(math.inf, math.inf)
    contract._rule.cache_clear()


def test_the_stored_calibration_can_promise_both_rates_of_the_issue() -> None:
    rules, kinds = calibration()
    assert rules[0] == Rule(LoopConfig().min_supported, LoopConfig().min_probability)
    assert all(a.alone <= b.alone and a.supported < b.supported for a, b in pairwise(rules))
    for kind in kinds.values():
        assert kind.accepted.shape[1] == len(rules) and (kind.wrong <= kind.accepted).all()
        assert (np.diff(kind.accepted, axis=1) <= 0).all()
    for name in ("circle, room", "circle, street", "narrow, room"):
        for rate in (0.01, 0.05):
            assert rule_needed(kinds[name].accepted, kinds[name].wrong, rate) is not None, name


@rows("rate", [0.0, 1.0, -0.1, math.nan, math.inf])
def test_a_rate_that_is_none_is_refused(rate: Any) -> None:
    with pytest.raises(ConfigError, match="false_rate"):
        LoopConfig(false_rate=rate)
    with pytest.raises(ConfigError):
        rule_needed(*drives_that_need(np.zeros(19, int)), rate)


@rows("accepted, wrong", [([[1]], [[2]]), ([[1.5]], [[0.5]]), ([1], [1]), ([[1]], [[-1]])])
def test_counts_that_contradict_each_other_are_refused(accepted: Any, wrong: Any) -> None:
    with pytest.raises(DataError, match="false ones"):
        rule_needed(accepted, wrong, 0.05)
