# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``ViewCurve``: views judged at every threshold (Stastny 2022, 5.4: steps of 0.01)."""

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fusionslam.base.archive import load_json, save_json
from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Floats, Integers, read_numbers
from fusionslam.errors import DataError, ShapeError
from fusionslam.evaluation.views.judge import ViewJudge, validate_ids
from fusionslam.evaluation.views.report import percent

FORMAT = "fusionslam.view_curve.1"
THRESHOLDS: tuple[float, ...] = tuple(step / 100 for step in range(101))
"""Thresholds of the thesis, for similarities in [0, 1]."""
COLUMNS = (
    "accuracy",
    "loop_recall",
    "loop_precision",
    "precision",
    "recall",
    "false_positives",
    "false_negatives",
    "views",
    "loops",
    "mean_false_positive_distance",
)
"""The figures of ``ViewReport`` that a curve keeps for each threshold."""


@checked
@dataclass(frozen=True, eq=False)
class ViewCurve:
    """Figures of a drive at every threshold.

    Attributes:
        thresholds: float64 (T,), ascending.
        figures: name (``COLUMNS``) -> float64 (T,); NaN where a figure is undefined.
        rule_name: the rule that was applied.
    """

    thresholds: Floats
    figures: dict[str, Floats]
    rule_name: str

    def __len__(self) -> int:
        return len(self.thresholds)

    def best_threshold(self, loop_precision: float = 0.97) -> float | None:
        """Threshold with the largest loop recall among those with at least this loop precision.

        Ties go to the largest accuracy, then to the strictest (largest) threshold. None if no
        threshold reaches this precision.
        """
        allowed = self.figures["loop_precision"] >= loop_precision
        return self._largest(allowed, ("loop_recall", "accuracy"))

    def most_accurate_threshold(self) -> float | None:
        """Threshold with the largest accuracy, as the thesis picks it; None without scans."""
        known = np.isfinite(self.figures["accuracy"])
        return self._largest(known, ("accuracy", "loop_recall"))

    def at(self, threshold: float) -> dict[str, float | None]:
        """Return the figures at one of the thresholds, by name; None where one is undefined.

        Raises:
            DataError: the curve does not have this threshold.
        """
        rows = np.flatnonzero(self.thresholds == threshold)
        if not rows.size:
            raise DataError(f"threshold {threshold} is none of the {len(self)} of the curve")
        return self.row(int(rows[0]))

    def row(self, index: int) -> dict[str, float | None]:
        """Return the figures of one row, by name; None where one is undefined."""
        values = {name: float(column[index]) for name, column in self.figures.items()}
        return {name: value if np.isfinite(value) else None for name, value in values.items()}

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write JSON, whole or not at all; undefined figures are null. Raises DataError."""
        save_json(path, None, self.as_json())

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "ViewCurve":
        """Read what ``save`` wrote. Raises DataError that names the file."""
        with load_json(path, None, "a stored view curve") as content:
            return cls.from_json(content)

    def as_json(self) -> dict[str, Any]:
        """Return all values in types that JSON can hold."""
        rows = [self.row(index) for index in range(len(self))]
        return {
            "format": FORMAT,
            "rule": self.rule_name,
            "thresholds": self.thresholds.tolist(),
            "figures": {name: [row[name] for row in rows] for name in self.figures},
        }

    @classmethod
    def from_json(cls, content: dict[str, Any]) -> "ViewCurve":
        """Inverse of ``as_json``. Raises ValueError, KeyError or TypeError for anything else."""
        if content.get("format") != FORMAT:
            raise ValueError(f"expected format {FORMAT}")
        if unknown := content.keys() - {"format", "rule", "thresholds", "figures"}:
            raise ValueError(f"unknown value {min(unknown)}")
        figures = {name: content["figures"][name] for name in COLUMNS}
        curve = cls(
            np.array(content["thresholds"], dtype=np.float64),
            {name: np.array(column, dtype=np.float64) for name, column in figures.items()},
            str(content["rule"]),
        )
        if any(column.shape != curve.thresholds.shape for column in curve.figures.values()):
            raise ValueError("columns of different lengths")
        return curve

    def __str__(self) -> str:
        names = ("accuracy", "loop_recall", "loop_precision", "views")
        lines = ["threshold  " + "  ".join(f"{name:>14}" for name in names)]
        for index, threshold in enumerate(self.thresholds):
            row = self.row(index)
            cells = [percent(row[name]) for name in names[:-1]]
            cells.append("none" if row["views"] is None else f"{row['views']:.0f}")
            lines.append(f"{threshold:9.4g}  " + "  ".join(f"{cell:>14}" for cell in cells))
        return "\n".join(lines)

    def _largest(self, allowed: NDArray[np.bool_], names: tuple[str, str]) -> float | None:
        rows = np.flatnonzero(allowed)
        if not rows.size:
            return None
        keys = [np.nan_to_num(self.figures[name][rows], nan=-1.0) for name in names]
        best = np.lexsort((self.thresholds[rows], keys[1], keys[0]))[-1]
        return float(self.thresholds[rows[best]])


@checked
def sweep_views(
    judge: ViewJudge,
    matcher: Callable[[float], ArrayLike],
    thresholds: Iterable[float] = THRESHOLDS,
) -> ViewCurve:
    """Run a matcher once per threshold and judge its ids.

    The stored scenes depend on the threshold, so this is the exact curve of a matcher that compares
    with stored scenes only.

    Args:
        judge: the drive.
        matcher: threshold -> ids, integers (n,), from a fresh run over the whole drive.
        thresholds: in any order; duplicates share a row.

    Raises:
        DataError: no thresholds, or one that is not finite.
        ShapeError: the matcher does not return n ids.
    """
    steps = np.unique(np.array(list(thresholds), dtype=np.float64))
    if not steps.size or not np.isfinite(steps).all():
        raise DataError("thresholds: expected one or more finite numbers")
    reports = [judge.judge(matcher(float(step))) for step in steps]
    figures = {  # NumPy turns None into NaN
        name: np.array([getattr(report, name) for report in reports], dtype=np.float64)
        for name in COLUMNS
    }
    return ViewCurve(steps, figures, judge.rule_name)


@checked
def sweep_pairs(
    judge: ViewJudge,
    similarities: ArrayLike,
    candidates: ArrayLike,
    thresholds: Iterable[float] | None = None,
) -> ViewCurve:
    """Compute the curve of a search whose candidates do not depend on the threshold.

    That is a nearest-neighbour search among all earlier scans, stored or not.

    Args:
        judge: the drive.
        similarities, candidates: as for ``ids_from_pairs``.
        thresholds: None for every distinct similarity, plus one that accepts nothing.

    Raises:
        ShapeError, DataError: as for ``ids_from_pairs`` and ``sweep_views``.
    """
    likeness, found = _validate_pairs(similarities, candidates, len(judge))
    if thresholds is None:
        distinct = np.unique(likeness[found >= 0])
        above = np.nextafter(distinct[-1], np.inf) if distinct.size else 1.0
        thresholds = [*distinct.tolist(), float(above)]
    return sweep_views(judge, lambda limit: _ids(likeness, found, limit), thresholds)


@checked
def ids_from_pairs(similarities: ArrayLike, candidates: ArrayLike, threshold: float) -> Integers:
    """Ids int64 (n,) of scans whose most similar earlier scans are known.

    A scan whose similarity reaches the threshold takes its candidate's id, else a new one.

    Args:
        similarities: (n,), larger is more alike (negate a distance); ignored where there is no
            candidate.
        candidates: integers (n,), row of the most similar earlier scan, -1 for none.
        threshold: the smallest similarity that counts as a match.

    Raises:
        ShapeError: wrong shape, length or dtype.
        DataError: a candidate that is not earlier, or a candidate's similarity that is NaN.
    """
    count = len(np.atleast_1d(np.asarray(candidates)))
    return _ids(*_validate_pairs(similarities, candidates, count), threshold)


def _ids(likeness: Floats, candidates: Integers, threshold: float) -> Integers:
    accepted = (candidates >= 0) & (likeness >= threshold)
    ids = np.cumsum(~accepted) - 1
    for scan in np.flatnonzero(accepted).tolist():
        ids[scan] = ids[candidates[scan]]
    return ids.astype(np.int64)


def _validate_pairs(similarities: Any, candidates: Any, count: int) -> tuple[Floats, Integers]:
    found = validate_ids(candidates, count)
    likeness = read_numbers("similarities", similarities, f"({count},)")
    if likeness.shape != (count,):
        raise ShapeError(f"similarities: {likeness.shape}, expected ({count},), as candidates")
    late = np.flatnonzero(found >= np.arange(count))
    if late.size:
        raise DataError(
            f"candidates: row {late[0]} has {found[late[0]]}, expected an earlier scan or -1"
        )
    unknown = np.flatnonzero((found >= 0) & np.isnan(likeness))
    if unknown.size:
        raise DataError(f"similarities: row {unknown[0]} is NaN but has a candidate")
    return likeness, found
