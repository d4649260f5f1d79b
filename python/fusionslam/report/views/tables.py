# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of views.html: methods, baselines and published figures side by side."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

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
from fusionslam.report.page.tables import Cell, Table, build_table, columns_of

Judged = Sequence[tuple[ViewRun, ViewReport]]
Row = Mapping[str, Any]
"""A row: its "label", and figures by the names in columns.yaml; None or absent if unknown.

Shares are between 0 and 1; errors in metres, times in milliseconds, sizes in bytes.
"""

_SHARES = ("accuracy", "loop_recall", "loop_precision", "precision", "recall")
_FAULTS = ("false_positives", "false_negatives", "mean_error")
_ACCURACY = (*_SHARES, *_FAULTS, "max_error", "views", "unplaced")
_SWEPT = (*_SHARES, *_FAULTS, "views")
_COSTS = ("views", "view_bytes", "all_bytes", "build_ms", "match_ms", "pair_ms")
_RERUN = ("accuracy", "loop_recall", "best_loop_recall")


def accuracy_table(judged: Judged) -> Table:
    """Build the table of the runs over one drive, its baselines and its published figures."""
    return _table_beside(_ACCURACY, judged, _published_rows(judged[0][0].world))


def cost_table(judged: Judged) -> Table:
    """Build the table of storage and time for the same rows."""
    return _table_beside(_COSTS, judged, _published_rows(judged[0][0].world))


def rerun_table(judged: Judged) -> Table | None:
    """Build the table with figures measured again; None if there are none for this world."""
    again = [
        {"label": f"run again: {figures.input}", **vars(figures)}
        for figures in rerun_views(judged[0][0].world)
    ]
    return _table_beside(_RERUN, judged, again) if again else None


def sweep_table(run: ViewRun, curve: ViewCurve, rule: ViewRule) -> Table:
    """Build the table of a run at some thresholds, with the baselines."""
    rows = [_curve_row(curve, index, run.threshold) for index in _select_thresholds(curve, run)]
    return _table_of(_SWEPT, [*rows, *_baseline_rows(run, rule)])


def view_row(label: str, report: ViewReport, run: ViewRun | None = None) -> dict[str, Any]:
    """Return the figures and the cost of a run as a row."""
    plain = (*_SHARES, "false_positives", "false_negatives", "views", "unplaced")
    size = run.bytes_per_view if run else None
    return {
        "label": label,
        **{name: getattr(report, name) for name in plain},
        "mean_error": report.mean_false_positive_distance,
        "max_error": report.max_false_positive_distance,
        "view_bytes": size,
        "all_bytes": None if size is None else size * report.views,
        "build_ms": run.build_ms if run else None,
        "match_ms": run.match_ms if run else None,
        "pair_ms": run.pair_ms if run else None,
    }


def _table_of(names: Sequence[str], rows: Sequence[Row]) -> Table:
    columns = {column.value: column for column in columns_of("views.figures")}
    return build_table([columns[name] for name in names], rows, [row["label"] for row in rows])


def _table_beside(names: Sequence[str], judged: Judged, others: Sequence[Row]) -> Table:
    """Build a table of the runs, the baselines, and rows measured elsewhere.

    The latter do not compete for the best of a column.
    """
    run, report = judged[0]
    own = [view_row(each.method, judgement, each) for each, judgement in judged]
    table = _table_of(
        names, [*own, *_baseline_rows(run, report.rule, [each for each, _ in judged])]
    )
    beside = _table_of(names, others)
    plain = [(label, [Cell(cell.text) for cell in cells]) for label, cells in beside.rows]
    return Table(table.heads, table.rows + plain)


def _baseline_rows(run: ViewRun, rule: ViewRule, runs: Sequence[ViewRun] = ()) -> list[Row]:
    """Return the scores of programs without a sensor on the drive of a run.

    Those that are among ``runs`` have a row already: they alone store nothing.
    """
    there = [each.ids for each in runs if each.bytes_per_view is None]
    return [
        view_row(f"no sensor: {name}", judge_views(ids, run.poses, run.stamps, rule=rule))
        for name, ids in baselines(len(run)).items()
        if not any(np.array_equal(ids, known) for known in there)
    ]


def _published_rows(world: str) -> list[Row]:
    return [
        {
            **vars(figures),
            "label": f"published: {figures.method}",
            "all_bytes": figures.view_bytes * figures.views,
            # The thesis gives the time to compare two views.
            "match_ms": None,
            "pair_ms": figures.match_ms,
        }
        for figures in published_views(world)
    ]


def _select_thresholds(curve: ViewCurve, run: ViewRun) -> list[int]:
    """Select about twenty thresholds, plus the one in use and those a reader would pick."""
    picked = (curve.best_threshold(), curve.most_accurate_threshold(), run.threshold)
    known = [threshold for threshold in picked if threshold is not None]
    steps = range(0, len(curve), max(1, len(curve) // 20))
    return sorted({*steps, *np.flatnonzero(np.isin(curve.thresholds, known)).tolist()})


def _curve_row(curve: ViewCurve, index: int, used: float | None) -> Row:
    threshold, figures = float(curve.thresholds[index]), curve.row(index)
    remarks = {
        "used": used,
        "most accurate": curve.most_accurate_threshold(),
        "best at loop precision 97 %": curve.best_threshold(),
    }
    remark = ", ".join(name for name, value in remarks.items() if value == threshold)
    label = f"{threshold:.4g} ({remark})" if remark else f"{threshold:.4g}"
    return {**figures, "label": label, "mean_error": figures["mean_false_positive_distance"]}
