# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Limits of distance, angle and age by which views are judged (Stastny 2022, 5.2)."""

from typing import Any

from fusionslam.config import Section, explain_choice, option
from fusionslam.errors import ConfigError


def _limit(default: float, unit: str, help: str) -> Any:
    return option(default, help, unit=unit, ge=0, allow_inf_nan=False)


class ViewRule(Section):
    """Limits that define the same place. All are inclusive; angles are differences of yaw.

    The first four come from the thesis, the others define loop recall and loop precision.
    """

    false_positive_distance: float = _limit(
        0.8, "m", "a known view is wrong if its first scene lies farther than this"
    )
    false_positive_angle: float = _limit(
        22.9183, "deg", "a known view is wrong if its first scene is turned by more than this"
    )
    false_negative_distance: float = _limit(
        0.2, "m", "a new view is wrong if a stored scene lies within this"
    )
    false_negative_angle: float = _limit(
        12.0, "deg", "a new view is wrong if that stored scene is turned by at most this"
    )
    loop_age: float = _limit(
        20.0, "s", "a match is a loop, and a scan comes back, after more than this"
    )
    revisit_distance: float = _limit(
        0.5, "m", "a scan comes back if an older true pose lies within this"
    )
    revisit_angle: float = _limit(
        30.0, "deg", "a scan comes back if that older pose is turned by at most this"
    )
    loop_distance: float = _limit(
        0.8, "m", "a loop is right if the first scene of its view lies within this"
    )
    loop_angle: float = _limit(
        22.9183, "deg", "a loop is right if that first scene is turned by at most this"
    )


VIEW_RULES = {
    "paper": ViewRule(),
    # The author's program compares yaw / pi: its 0.4 and 0.04 are these angles.
    "author": ViewRule(false_positive_angle=72.0, false_negative_angle=7.2),
    # The paper's distances times 12.5: a view is right within 10 m, as in the evaluation of loops.
    "car": ViewRule(
        false_positive_distance=10.0,
        false_negative_distance=2.5,
        revisit_distance=6.25,
        loop_distance=10.0,
        loop_age=5.0,
    ),
}
"""Rules by name: the thesis's text, its author's program, which judges loops alike, and limits for
a car, whose scans are metres apart and which hardly drives in its own tracks."""


def explain_no_revisit(rule: ViewRule, by_car: int) -> str:
    """Say that no scan of a drive comes back under a rule.

    Args:
        rule: the limits that judged it.
        by_car: number of scans that come back under the rule "car".
    """
    said = (
        f"no scan comes back within {rule.revisit_distance:g} m and {rule.revisit_angle:g} deg of "
        f"where it was more than {rule.loop_age:g} s before"
    )
    cure = ": a car's loops are judged by the rule 'car' (--rule car), by which"
    return f"{said}{cure} {by_car} do" if by_car else said


def view_rule(rule: str | ViewRule) -> tuple[str, ViewRule]:
    """Return name ("custom" for a rule passed by value) and values of a rule.

    Raises:
        ConfigError: unknown name.
    """
    if isinstance(rule, ViewRule):
        known = (name for name, preset in VIEW_RULES.items() if preset == rule)
        return next(known, "custom"), rule
    if rule in VIEW_RULES:
        return rule, VIEW_RULES[rule]
    problem = f"unknown view rule {rule!r}: {explain_choice(str(rule), VIEW_RULES)}"
    raise ConfigError(problem, code="unknown-rule", fields=(str(rule),))
