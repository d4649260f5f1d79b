# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of the report of views: runs, baselines and published figures."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusionslam.evaluation import (
    ViewCurve,
    ViewReport,
    ViewRule,
    ViewRun,
    baselines,
    judge_views,
    published_views,
    rerun_views,
)
from fusionslam.report.page.tables import Cell, Column, Table, build_table

_SHARES = ("accuracy", "loop_recall", "loop_precision", "precision", "recall")
_FAULTS = ("false_positives", "false_negatives", "mean_error")
_ACCURACY = (*_SHARES, *_FAULTS, "max_error", "views", "unplaced")
_SWEPT = (*_SHARES, *_FAULTS, "views")
_COSTS = ("views", "view_bytes", "all_bytes", "build_ms", "match_ms", "pair_ms")
_RERUN = ("accuracy", "loop_recall", "best_loop_recall")

Judged = Sequence[tuple[ViewRun, ViewReport]]
Best = Callable[[Sequence[float]], float]


@dataclass(frozen=True)
class ViewRow:
    """A row of figures, each None if unknown. Shares; metres; milliseconds; bytes."""

    label: str
    accuracy: float | None = None
    loop_recall: float | None = None
    loop_precision: float | None = None
    precision: float | None = None
    recall: float | None = None
    false_positives: float | None = None
    false_negatives: float | None = None
    mean_error: float | None = None
    max_error: float | None = None
    views: float | None = None
    unplaced: float | None = None
    best_loop_recall: float | None = None
    view_bytes: float | None = None
    build_ms: float | None = None
    match_ms: float | None = None
    pair_ms: float | None = None

    @property
    def all_bytes(self) -> float | None:
        """Bytes of all views together."""
        known = self.view_bytes is not None and self.views is not None
        return self.view_bytes * self.views if known else None  # type: ignore[operator]


def accuracy_table(judged: Judged) -> Table:
    """Build the table of the runs over one drive, its baselines and its published figures."""
    return _beside(_columns(_ACCURACY), own_rows(judged), _published(judged[0][0].world))


def cost_table(judged: Judged) -> Table:
    """Build the table of storage and time for the same rows."""
    return _beside(_columns(_COSTS), own_rows(judged), _published(judged[0][0].world))


def rerun_table(judged: Judged) -> Table | None:
    """Build the table with figures measured again; None if there are none for this world."""
    again = [
        ViewRow(
            label=f"run again: {figures.input}",
            accuracy=figures.accuracy,
            loop_recall=figures.loop_recall,
            best_loop_recall=figures.best_loop_recall,
        )
        for figures in rerun_views(judged[0][0].world)
    ]
    return _beside(_columns(_RERUN), own_rows(judged), again) if again else None


def own_rows(judged: Judged) -> list[ViewRow]:
    """Return the runs, then the baselines: the first rows of every table."""
    run, report = judged[0]
    return [
        *(view_row(each.method, own, each) for each, own in judged),
        *_baselines(run, report.rule),
    ]


def _beside(
    columns: list[Column[ViewRow]], own: Sequence[ViewRow], others: Sequence[ViewRow]
) -> Table:
    """Add rows measured elsewhere, which do not compete for the best of a column."""
    table = build_table(columns, own, lambda row: row.label)
    beside = build_table(columns, others, lambda row: row.label)
    plain = [(label, [Cell(cell.text) for cell in cells]) for label, cells in beside.rows]
    return Table(table.heads, table.rows + plain)


def _baselines(run: ViewRun, rule: ViewRule) -> list[ViewRow]:
    """Return the scores of programs without a sensor on the drive of a run."""
    return [
        view_row(f"no sensor: {name}", judge_views(ids, run.poses, run.stamps, rule=rule))
        for name, ids in baselines(len(run)).items()
    ]


def sweep_table(run: ViewRun, curve: ViewCurve, rule: ViewRule) -> Table:
    """Build the table of a run at some thresholds, with the baselines."""
    rows = [_curve_row(curve, index, run.threshold) for index in _telling_rows(curve, run)]
    return build_table(_columns(_SWEPT), [*rows, *_baselines(run, rule)], lambda row: row.label)


def _telling_rows(curve: ViewCurve, run: ViewRun) -> list[int]:
    """Select about twenty thresholds, plus the one in use and those a reader would pick."""
    rows = set(range(0, len(curve), max(1, len(curve) // 20)))
    picked = (curve.best_threshold(), curve.most_accurate_threshold(), run.threshold)
    rows |= {
        int(row)
        for threshold in picked
        if threshold is not None
        for row in np.flatnonzero(curve.thresholds == threshold)
    }
    return sorted(rows)


def _curve_row(curve: ViewCurve, index: int, used: float | None) -> ViewRow:
    threshold, figures = float(curve.thresholds[index]), curve.row(index)
    remarks = {
        "used": used,
        "most accurate": curve.most_accurate_threshold(),
        "best at loop precision 97 %": curve.best_threshold(),
    }
    remark = ", ".join(name for name, value in remarks.items() if value == threshold)
    figures["mean_error"] = figures.pop("mean_false_positive_distance")
    figures.pop("loops")
    label = f"{threshold:.4g} ({remark})" if remark else f"{threshold:.4g}"
    return ViewRow(label=label, **figures)


def view_row(label: str, report: ViewReport, run: ViewRun | None = None) -> ViewRow:
    """Return the figures and the cost of a run."""
    return ViewRow(
        label=label,
        accuracy=report.accuracy,
        loop_recall=report.loop_recall,
        loop_precision=report.loop_precision,
        precision=report.precision,
        recall=report.recall,
        false_positives=report.false_positives,
        false_negatives=report.false_negatives,
        mean_error=report.mean_false_positive_distance,
        max_error=report.max_false_positive_distance,
        views=report.views,
        unplaced=report.unplaced,
        view_bytes=run.bytes_per_view if run else None,
        build_ms=_mean_ms(run.build_seconds) if run else None,
        match_ms=_mean_ms(run.match_seconds) if run else None,
        pair_ms=_mean_ms(run.pair_seconds) if run else None,
    )


def _mean_ms(seconds: NDArray[np.float64] | None) -> float | None:
    """Mean in milliseconds, as in the thesis; None if nothing was timed."""
    known = np.empty(0) if seconds is None else seconds[np.isfinite(seconds)]
    return float(known.mean() * 1e3) if known.size else None


def _published(world: str) -> list[ViewRow]:
    return [
        ViewRow(
            label=f"published: {figures.method}",
            accuracy=figures.accuracy,
            mean_error=figures.mean_error,
            max_error=figures.max_error,
            views=figures.views,
            view_bytes=figures.view_bytes,
            build_ms=figures.build_ms,
            pair_ms=figures.match_ms,
        )
        for figures in published_views(world)
    ]


def _columns(names: Sequence[str]) -> list[Column[ViewRow]]:
    known = _named_columns()
    return [known[name] for name in names]


def _named_columns() -> dict[str, Column[ViewRow]]:
    share = "{:.1%}"
    return {
        "accuracy": _column(
            "accuracy", "accuracy", "1 - (false positives + false negatives) / scans", share, max
        ),
        "loop_recall": _column(
            "loop_recall",
            "loop recall",
            "share of the scans that come back after more than 20 s that were recognised",
            share,
            max,
        ),
        "loop_precision": _column(
            "loop_precision",
            "loop precision",
            "share of the matches with views older than 20 s that are right",
            share,
            max,
        ),
        "precision": _column("precision", "precision", "right positives / positives", share),
        "recall": _column(
            "recall", "recall", "right positives / (right positives + false negatives)", share
        ),
        "false_positives": _column("false_positives", "FP", "false positives", "{:.0f}"),
        "false_negatives": _column("false_negatives", "FN", "false negatives", "{:.0f}"),
        "mean_error": _column(
            "mean_error", "FP mean m", "mean distance of false positives from their view", "{:.2f}"
        ),
        "max_error": _column("max_error", "FP max m", "the largest of them", "{:.2f}"),
        "views": _column("views", "views", "stored scenes: ids given", "{:.0f}"),
        "unplaced": _column(
            "unplaced", "no view", "scans that held nothing to recognise", "{:.0f}"
        ),
        "best_loop_recall": _column(
            "best_loop_recall",
            "loop recall, best threshold",
            "at the best threshold of this very world, which no robot knows",
            share,
        ),
        "view_bytes": _column("view_bytes", "bytes", "of one view as stored, mean", "{:,.0f}"),
        "all_bytes": _column("all_bytes", "all bytes", "of all views together", "{:,.0f}"),
        "build_ms": _column("build_ms", "build ms", "to make a view, mean", "{:.2f}"),
        "match_ms": _column(
            "match_ms", "match ms", "to compare a scan with all stored views, mean", "{:.3f}"
        ),
        "pair_ms": _column("pair_ms", "ms a pair", "match ms for each stored view, mean", "{:.4f}"),
    }


def _column(
    name: str, title: str, hint: str, show: str, best: Best | None = None
) -> Column[ViewRow]:
    return Column(title, hint, lambda row: getattr(row, name), show, best)
