# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``PrecisionRecall``: precision and recall of loop closing over all thresholds.

Sources: Ferrarini et al. 2020 for the extended precision, Fawcett 2006 for the area under the ROC
curve.
"""

import math
import os
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.archive import check_types, load_json, save_json
from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Floats, Integers, Mask
from fusionslam.base.texts import counted
from fusionslam.evaluation.loops.protocols import PROTOCOLS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FORMAT = "fusionslam.precision_recall.1"
RANKS = (1, 5, 10)
"""Values of k for recall@k."""
_EXTRA = {"extended_precision": "extended precision", "roc_auc": "area under the ROC curve"}
"""Titles of figures that few papers print."""
_ARRAYS: dict[str, type[np.generic]] = {
    "thresholds": np.float64,
    "precision": np.float64,
    "recall": np.float64,
    "queries": np.int64,
    "matches": np.int64,
    "distances": np.float64,
    "correct": np.bool_,
    "revisit": np.bool_,
}

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


@checked
@dataclass(frozen=True, eq=False)
class PrecisionRecall:
    """Precision and recall of the nearest candidates, or of pairs of frames, at every threshold.

    Undefined figures are None (null in JSON): everything derived from recall if its denominator
    is 0 (``recall`` itself is then NaN), ``top1`` and ``recall_at_k`` without any revisit, and
    thresholds whose condition no threshold meets.

    Attributes:
        thresholds: float64 (T,), the distinct distances, ascending: of descriptors, or 1 -
            probability of verified loops.
        precision: float64 (T,), correct accepted matches / accepted matches.
        recall: float64 (T,), correct accepted matches / the protocol's denominator; a pose that is
            right where nothing is revisited does not count.
        recall_at_full_precision: largest recall without a false match; 0 if the nearest is false.
        threshold_at_full_precision: its threshold; None if the nearest match of all is false.
        max_f1: largest 2 P R / (P + R).
        max_f1_threshold: the lowest threshold that reaches it; None if no match is correct.
        average_precision: sum over thresholds of (R_t - R_(t-1)) P_t with R_0 = 0, no
            interpolation: the definition of scikit-learn's average_precision_score.
        top1: share of the revisits whose nearest candidate is correct.
        recall_at_k: k -> share of the revisits with a correct match among the k nearest
            candidates; None if fewer than k candidates per query were searched. Of verified loops
            as ``evaluate_verified`` says.
        n_queries: N, all frames. n_revisits: those with any candidate within the radius.
        n_correct: those whose nearest candidate is correct.
        protocol, radius, window: name, metres, frames that the figures hold for.
        queries: int64 (N,), rows of the queries; of pairs the later frame of each.
        matches: int64 (N,), row of the nearest candidate, -1 = no candidate; of pairs the earlier
            frame.
        distances: float64 (N,), its distance, inf = no candidate.
        correct: bool (N,), whether the match is correct under the protocol.
        revisit: bool (N,), whether some candidate lies within the radius.
        extended_precision: (1 + recall at 100 % precision) / 2: the mean of the precision where
            nothing is accepted yet and of that recall.
        roc_auc: area under the ROC curve: the probability that a correct match is nearer than a
            false one; None without either.

    Of pairs, N counts these, and all that are of one place are revisits and correct.
    """

    thresholds: Floats
    precision: Floats
    recall: Floats
    recall_at_full_precision: float | None
    threshold_at_full_precision: float | None
    max_f1: float | None
    max_f1_threshold: float | None
    average_precision: float | None
    top1: float | None
    recall_at_k: dict[int, float | None]
    n_queries: int
    n_revisits: int
    n_correct: int
    protocol: str
    radius: float
    window: int
    queries: NDArray[np.int64]
    matches: NDArray[np.int64]
    distances: Floats
    correct: NDArray[np.bool_]
    revisit: NDArray[np.bool_]
    extended_precision: float | None = None
    roc_auc: float | None = None

    def __repr__(self) -> str:
        title, counts, (name, value) = *self._headings(), self._rows()[0]
        return f"<PrecisionRecall, {title}: {counts}, {name} {_format(value)}>"

    def __str__(self) -> str:
        lines = [f"  {name:<28}{_format(value)}" for name, value in self._rows()]
        return "\n".join([*self._headings(), *lines])

    def _headings(self) -> tuple[str, str]:
        return (
            f"protocol {self.protocol}, radius {self.radius:g} m, window {self.window} frames",
            f"{self.counts}, {self.n_correct} nearest candidates correct"
            if not self.judges_pairs
            else self.counts,
        )

    def _prints(self, figure: str) -> bool:
        """Whether the protocol's paper prints a figure."""
        protocol = PROTOCOLS.get(self.protocol)
        return protocol is not None and figure in protocol.figures

    @property
    def judges_pairs(self) -> bool:
        """Whether pairs of frames were judged, and not the nearest candidate of each frame."""
        protocol = PROTOCOLS.get(self.protocol)
        return protocol is not None and protocol.pairs is not None

    @property
    def counts(self) -> str:
        """What was judged, in words: "1101 queries, 274 revisits"."""
        if self.judges_pairs:
            return f"{counted(self.n_queries, 'pair')}, {self.n_revisits} of one place"
        return f"{counted(self.n_queries, 'query')}, {counted(self.n_revisits, 'revisit')}"

    def metrics(self) -> dict[str, Any]:
        """All scalar figures with protocol, radius and window, ready for JSON."""
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in _ARRAYS}
        return values | {"recall_at_k": {str(k): v for k, v in self.recall_at_k.items()}}

    def accepted(self, threshold: float | None) -> NDArray[np.bool_]:
        """Bool (N,): queries whose match a threshold accepts; none for threshold None."""
        if threshold is None:
            return np.zeros(self.n_queries, dtype=np.bool_)
        return (self.matches >= 0) & (self.distances <= threshold)

    def threshold_at(self, precision: float) -> float | None:
        """Return the largest threshold whose precision is at least this; None if there is none."""
        rows = np.flatnonzero(self.precision >= precision)
        return float(self.thresholds[rows[-1]]) if len(rows) else None

    def explain(self, threshold: float | None) -> str:
        """Count in one line the queries without candidates, above the threshold and accepted."""
        alone = int((self.matches < 0).sum())
        kept = int(self.accepted(threshold).sum())
        parts = [f"{alone} without candidates"]
        if threshold is None:
            parts.append("no threshold accepts a correct match")
        else:
            parts.append(f"{self.n_queries - alone - kept} above threshold {threshold:.4g}")
            parts.append(f"{kept} accepted")
        if alone < self.n_queries:
            parts.append(f"best {self.distances.min():.4g}")
        return f"{counted(self.n_queries, 'query')}: {', '.join(parts)}"

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write JSON, whole or not at all; undefined figures are null. Raises DataError."""
        arrays = {
            name: [
                value if math.isfinite(value) else None for value in getattr(self, name).tolist()
            ]
            for name in _ARRAYS
        }
        save_json(path, FORMAT, {**self.metrics(), **arrays})

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "PrecisionRecall":
        """Read what ``save`` wrote.

        Raises:
            DataError: the file is missing, truncated or of another kind; the message names it.
        """
        with load_json(path, FORMAT, "a stored precision-recall result") as content:
            fill = {"distances": np.inf, "recall": np.nan}  # where JSON has null
            for name, dtype in _ARRAYS.items():
                values = [fill.get(name) if value is None else value for value in content[name]]
                content[name] = np.array(values, dtype=dtype)
            if np.isnan(content["distances"]).any():
                raise ValueError("distances: expected numbers")
            content["recall_at_k"] = {int(k): v for k, v in content["recall_at_k"].items()}
            return check_types(cls(**content))

    def plot(self, axis: "Axes | None" = None, **style: Any) -> "Axes":
        """Draw the curve, marking recall at 100 % precision and maximal F1.

        Args:
            axis: where to draw; None makes a new figure (``axis.figure.savefig(...)``).
            style: keyword arguments of matplotlib's ``Axes.plot`` for the curve.
        """
        if axis is None:
            from matplotlib.figure import Figure

            axis = Figure(figsize=(6, 4.5), layout="constrained").add_subplot()
            axis.grid(alpha=0.3)
        (line,) = axis.plot(self.recall, self.precision, **style)
        marks: dict[str, tuple[float, float]] = {}
        if full := self.recall_at_full_precision:
            marks["s"] = full, 1.0
        if self.max_f1_threshold is not None:
            row = int(np.searchsorted(self.thresholds, self.max_f1_threshold))
            marks["o"] = float(self.recall[row]), float(self.precision[row])
        for marker, point in marks.items():
            axis.plot(*point, marker, color=line.get_color(), markeredgecolor="white", ms=8)
        axis.set(xlabel=f"recall ({self.protocol}, {self.radius:g} m)", ylabel="precision")
        axis.set(xlim=(0, 1.02), ylim=(0, 1.04))
        return axis

    def _rows(self) -> list[tuple[str, float | None]]:
        rows = [
            ("recall at 100 % precision", self.recall_at_full_precision),
            ("maximal F1", self.max_f1),
            ("average precision", self.average_precision),
            *((title, getattr(self, name)) for name, title in _EXTRA.items() if self._prints(name)),
        ]
        if self.judges_pairs:
            return rows
        ranks = [(f"recall@{k} of the revisits", v) for k, v in self.recall_at_k.items() if k > 1]
        return [*rows, ("top-1 of the revisits", self.top1), *ranks]


def _format(value: float | None) -> str:
    return "undefined" if value is None else f"{value:.3f}"


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
