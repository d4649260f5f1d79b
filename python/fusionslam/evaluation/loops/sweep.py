# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Sweep of the threshold over all distances, and the figures read off the curve.

Sources: Ferrarini et al. 2020 for the extended precision, Fawcett 2006 for the area under the ROC
curve.
"""

from typing import Any

import numpy as np

from fusionslam.storage.arrays import Floats, Integers, Mask

_UNDEFINED = dict.fromkeys(
    (
        "recall_at_full_precision",
        "threshold_at_full_precision",
        "max_f1",
        "max_f1_threshold",
        "average_precision",
        "extended_precision",
    )
)


def sweep_thresholds(distances: Floats, correct: Mask, relevant: Mask) -> dict[str, Any]:
    """Compute the curve over all distinct distances, and the figures read off it.

    A pose may be right where the places are farther apart than the radius: such a match is
    correct, but the recall of revisits does not count it.

    Args:
        distances: float64 (N,), inf where there is nothing to accept.
        correct: bool (N,), those that are right to accept.
        relevant: bool (N,), those that recall counts.
    """
    denominator = int(relevant.sum())
    present = np.isfinite(distances)
    thresholds, row = np.unique(distances[present], return_inverse=True)

    def count(mask: Mask) -> Integers:
        return np.bincount(row[mask[present]], minlength=len(thresholds)).astype(np.int64)

    right, wrong = count(correct), count(~correct)
    accepted = np.cumsum(right + wrong)
    precision = np.cumsum(right) / accepted
    found = np.cumsum(count(correct & relevant))
    recall = found / denominator if denominator else np.full(len(found), np.nan)
    curve = {"thresholds": thresholds, "precision": precision, "recall": recall}
    figures = _figures(thresholds, precision, recall) if denominator else _UNDEFINED
    # The area under the ROC curve is the probability that a right one is nearer than a wrong one,
    # equally near ones counting half; there is none if nothing is right or nothing is wrong.
    pairs, farther = int(right.sum()) * int(wrong.sum()), wrong.sum() - np.cumsum(wrong)
    area = float((right * (farther + wrong / 2)).sum() / pairs) if pairs else None
    return curve | figures | {"roc_auc": area}


def _figures(thresholds: Floats, precision: Floats, recall: Floats) -> dict[str, Any]:
    """Read the figures off a curve; thresholds that do not exist are None."""
    total = precision + recall
    f1 = 2 * precision * recall / np.where(total > 0, total, 1)  # 0 where both are 0
    best = float(f1.max(initial=0))
    # A false match stays accepted at all larger thresholds: rows without one are a prefix.
    flawless = int((precision == 1).sum())
    full = float(recall[flawless - 1]) if flawless else 0.0
    return {
        "recall_at_full_precision": full,
        "threshold_at_full_precision": float(thresholds[flawless - 1]) if flawless else None,
        "max_f1": best,
        "max_f1_threshold": float(thresholds[np.argmax(f1)]) if best > 0 else None,
        "average_precision": float((np.diff(recall, prepend=0) * precision).sum()),
        # The curve begins at recall 0 with precision 1, where nothing is accepted yet.
        "extended_precision": (1 + full) / 2,
    }
