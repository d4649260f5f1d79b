# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What loops must show so that no more of them are false than was asked for.

Split conformal prediction whose units are whole drives (Vovk et al. 2005; Angelopoulos et al.,
"Conformal Risk Control", 2024; for units with many samples each, Dunn et al. 2023): frames of a
drive depend on each other, drives do not. Of each drive of a calibration set, the truth tells from
which rule on its share of false loops is at most the rate; the rule asked for is the one that
suffices for all but 5 % of the drives, and of one more.
"""

import logging
import math
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fusionslam.base.argument_types import checked
from fusionslam.errors import ConfigError, DataError
from fusionslam.registration import PreparedCloud

logger = logging.getLogger(__name__)

CONFIDENCE = 0.95
"""Share of the drives in which the rate holds."""
_CALIBRATED = Path(__file__).with_name("false_loops.yaml")
_LIKE = 1.25
"""Factor on the lengths and counts of the calibrated clouds within which others are alike."""


class Rule(NamedTuple):
    """What makes a loop of a pose, as ``LoopConfig`` has it.

    Attributes:
        supported: least probability of ``min_supported``.
        alone: least probability of ``min_probability``.
    """

    supported: float
    alone: float


NOTHING = Rule(math.inf, math.inf)
"""No pose is a loop."""


class Profile(NamedTuple):
    """What a cloud is told apart by: those that are alike are judged by the same drives.

    Attributes:
        kind: view and place: "circle, room" or "narrow, street"; local maps are narrow, too.
        reach: median range of its voxels, metres.
        voxels: number of them.
    """

    kind: str
    reach: float
    voxels: int


def profile_of(cloud: PreparedCloud) -> Profile:
    """Return the profile of a cloud."""
    view = "narrow" if cloud.further or cloud.is_sector else "circle"
    words = [view, "room" if cloud.shows_room else "street"]
    if cloud.colors is not None:
        words.append("colours")
    if cloud.scene is not None or not cloud.config.gravity:
        words.append("planar" if cloud.scene is not None else "any way up")
    reach = float(np.median(np.linalg.norm(cloud.points, axis=1))) if len(cloud) else 0.0
    return Profile(", ".join(words), reach, len(cloud))


class CalibratedKind(NamedTuple):
    """Drives of one kind of clouds.

    Attributes:
        reach, voxels: lowest and highest of their clouds.
        accepted, wrong: int (drives, rules), loops by each rule, and false ones of them; rules
            from the loosest to the strictest.
    """

    reach: Sequence[float]
    voxels: Sequence[float]
    accepted: Any
    wrong: Any

    def shows(self, profile: Profile) -> bool:
        """Whether a cloud of the kind is as large as those of the drives."""
        pairs = (self.reach, profile.reach), (self.voxels, profile.voxels)
        return all(low / _LIKE <= value <= high * _LIKE for (low, high), value in pairs)


@checked
def rule_needed(accepted: Any, wrong: Any, false_rate: float) -> int | None:
    """Return the loosest rule by which the share of false loops holds in all drives but 5 %.

    A drive exchangeable with the given ones has a larger share with a probability of at most 5 %,
    over the choice of all of them, however its frames depend on each other.

    Args:
        accepted, wrong: integers (drives, rules), as of ``CalibratedKind``.
        false_rate: largest share of false loops.

    Returns:
        Number of the rule, that of rules if even the strictest one fails; None if there are too
        few drives to say: less than 19.

    Raises:
        DataError: counts of other shapes, or more false loops than loops.
        ConfigError: a rate that is not above 0 and below 1.
    """
    if not 0 < false_rate < 1:
        raise ConfigError(
            f"false_rate is {false_rate}, expected more than 0 and less than 1",
            code="choice",
            fields=("false_rate", str(false_rate)),
        )
    counts, false = np.asarray(accepted), np.asarray(wrong)
    if (
        counts.ndim != 2
        or counts.shape != false.shape
        or counts.dtype.kind not in "iu"
        or false.dtype.kind not in "iu"
        or (false < 0).any()
        or (false > counts).any()
    ):
        raise DataError(
            f"loops {counts.dtype} {counts.shape} and false ones {false.dtype} {false.shape}: "
            "expected integers (drives, rules), and no more false loops than loops"
        )
    drives, rules = counts.shape
    rank = math.ceil(round((drives + 1) * CONFIDENCE, 9))
    if rank > drives:
        return None
    fails = false > false_rate * counts
    # A drive needs the first rule after the last one that fails.
    needed = np.where(fails.any(axis=1), rules - fails[:, ::-1].argmax(axis=1), 0)
    return int(np.sort(needed)[rank - 1])


def rule_of(cloud: PreparedCloud, false_rate: float) -> Rule:
    """Return what loops of a cloud must show; the log says once where nothing can be promised.

    Clouds unlike all calibrated ones, or of too few drives, are asked for what the strictest kind
    needs, without a promise.
    """
    profile = profile_of(cloud)
    _, kinds = calibration()
    known = kinds.get(profile.kind)
    return _rule(profile.kind, known is not None and known.shows(profile), false_rate)


@cache
def _rule(kind: str, is_alike: bool, false_rate: float) -> Rule:
    rules, kinds = calibration()
    needed, is_promised = choose_rule(kinds, kind if is_alike else None, false_rate, len(rules))
    rule = [*rules, NOTHING][needed]
    if not is_promised:
        logger.warning(
            "false_rate %g is no promise for clouds of the kind %r: %s; loops must be %g probable, "
            "as the strictest kind needs",
            *(false_rate, kind),
            "too few drives like these are known" if is_alike else "unlike all that are known",
            rule.alone,
        )
    elif rule == NOTHING:
        logger.warning(
            "false_rate %g: clouds of the kind %r make no loop: no probability keeps that rate",
            *(false_rate, kind),
        )
    return rule


def choose_rule(
    kinds: Mapping[str, CalibratedKind], kind: str | None, false_rate: float, rules: int
) -> tuple[int, bool]:
    """Return the number of the rule that a kind needs, and whether the rate is promised by it.

    Else it is the strictest rule that any kind needs, but for kinds of which all rules fail.

    Args:
        kinds: calibrated ones, by name.
        kind: one of them; None of clouds that are unlike all.
        false_rate: largest share of false loops.
        rules: number of them.
    """
    found = {
        name: rule_needed(each.accepted, each.wrong, false_rate) for name, each in kinds.items()
    }
    own = None if kind is None else found[kind]
    if own is not None:
        return own, True
    return max(
        (each for each in found.values() if each is not None and each < rules), default=0
    ), False


@cache
def calibration() -> tuple[Sequence[Rule], Mapping[str, CalibratedKind]]:
    """Return the rules, from the loosest on, and the drives of each kind of clouds."""
    import yaml

    stored = yaml.safe_load(_CALIBRATED.read_text(encoding="utf-8"))
    kinds = {
        name: CalibratedKind(
            kind["reach"],
            kind["voxels"],
            np.array([accepted for accepted, _ in kind["drives"].values()]),
            np.array([wrong for _, wrong in kind["drives"].values()]),
        )
        for name, kind in stored["kinds"].items()
    }
    return [Rule(*each) for each in stored["rules"]], kinds
