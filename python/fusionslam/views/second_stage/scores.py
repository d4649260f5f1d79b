# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Area under the curve of pair scores, and calibration of distances to probabilities."""

import numpy as np
from numpy.typing import ArrayLike

from fusionslam.base.arrays import Floats, Mask
from fusionslam.errors import DataError


def area_under_curve(scores: ArrayLike, same: ArrayLike) -> float:
    """Probability that a same-place pair scores higher than another pair; ties count half.

    Args:
        scores: (n,), higher means the same place.
        same: bool (n,).

    Raises:
        DataError: there are not both kinds of pair.
    """
    from scipy.stats import rankdata

    truth, alike, unlike = _count_kinds(same)
    ranks = rankdata(np.asarray(scores, np.float64))
    return float((ranks[truth].sum() - alike * (alike + 1) / 2) / (alike * unlike))


def _count_kinds(same: ArrayLike) -> tuple[Mask, int, int]:
    """Pairs as a mask, the number of same-place pairs, and that of others."""
    truth = np.asarray(same, bool)
    alike, unlike = int(truth.sum()), int((~truth).sum())
    if not alike or not unlike:
        raise DataError(
            f"{alike} pairs of the same place, {unlike} of others: expected some of both",
            code="no-pairs",
        )
    return truth, alike, unlike


def calibrate(distances: ArrayLike, same: ArrayLike) -> tuple[float, float]:
    """Fit offset a and slope b of P(same place) = 1 / (1 + exp(b d - a)).

    Logistic regression in which both kinds of pair have the same total weight (Platt 1999).

    Args:
        distances: (n,), each between two feature vectors.
        same: bool (n,).

    Raises:
        DataError: there are not both kinds of pair.
    """
    from scipy.optimize import minimize

    truth, alike, unlike = _count_kinds(same)
    d = np.asarray(distances, np.float64)
    weight = np.where(truth, 0.5 / alike, 0.5 / unlike)
    sign = np.where(truth, 1.0, -1.0)

    def loss(value: Floats) -> tuple[float, Floats]:
        margin = sign * (value[0] - value[1] * d)
        pull = -weight * sign / (1 + np.exp(margin.clip(-500, 500)))
        # Weak regularisation: the slope would diverge if the kinds do not overlap.
        return (
            float(weight @ np.logaddexp(0, -margin)) + 1e-8 * float(value @ value),
            np.array([pull.sum(), -(pull * d).sum()]) + 2e-8 * value,
        )

    offset, slope = minimize(loss, np.zeros(2), jac=True, method="BFGS").x
    return float(offset), float(slope)


def probability_of(distances: ArrayLike, offset: float, slope: float) -> Floats:
    """Probability of the same place for calibrated distances."""
    margin = offset - slope * np.asarray(distances, np.float64)
    chance: Floats = 1 / (1 + np.exp(-margin.clip(-500, 500)))
    return chance
