# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of report.html: accuracy, published figures, cost and time."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fusionslam.evaluation import Evaluation, VerifiedRun, find_protocol
from fusionslam.report.loops.labels import short_labels, source_name
from fusionslam.report.page.tables import Column, Table, build_table, columns_of

PUBLISHED_PROTOCOL = "perdomo2019"
_FIGURES = {
    "max_f1": ("max F1", "largest 2PR / (P + R)"),
    "extended_precision": ("EP", "extended precision: (1 + R@100P) / 2"),
    "top1": ("top-1", "revisits whose nearest is correct"),
    "roc_auc": ("AUC", "area under the ROC curve: how often a correct match is nearer"),
}
"""Title and explanation of the figures that other papers print."""
_PERCENTILES = {"median_ms": "median", "p95_ms": "95th percentile"}

_NUMBERS = {
    "less-alike": "correlation from above",
    "few-points": "voxels",
    "no-features": "points with neighbours",
    "tilted": "degrees",
    "low-overlap": "overlap",
    "degenerate": "directions",
    "improbable": "probability",
    "alone": "probability",
    "not-promised": "probability",
    "far": "metres apart",
}
"""What the number of a rejected candidate is, by its code; others have none."""

Best = Callable[[Sequence[Any]], Any]
Columns = list[Column[Evaluation]]


def summary_table(evaluations: Sequence[Evaluation], protocol: str) -> Table:
    """One row per source and descriptor: accuracy, time of a frame, memory."""
    accuracy = _accuracy_columns(protocol) if any(e.curves for e in evaluations) else []
    if any(e.accepted for e in evaluations):
        accuracy += columns_of("loops.accepted", protocol=protocol)
    columns = accuracy + _published_columns(evaluations, protocol) + _cost_columns()
    runs = [e.run for e in evaluations]
    sources = {run.source for run in runs}
    labels = zip(runs, short_labels(runs), strict=True)
    named = [f"{source_name(run.source, sources)}, {label}" for run, label in labels]
    return build_table(columns, evaluations, named)


def accuracy_table(evaluations: Sequence[Evaluation], protocol: str) -> Table:
    """One row per run: the figures that decide between them, in few columns."""
    left_out = {"recall@5", "AP"} if find_protocol(protocol).peer else {"recall@5"}
    columns = [each for each in _accuracy_columns(protocol) if each.title not in left_out]
    return _table_of_runs(columns, evaluations)


def published_table(evaluations: Sequence[Evaluation], protocol: str) -> Table:
    """One row per run: measured and published recall at 100 % precision."""
    return _table_of_runs(_published_columns(evaluations, protocol), evaluations)


def peers_table(evaluations: Sequence[Evaluation], protocol: str) -> Table | None:
    """One row per run and per published method: what the protocol's paper prints; None without.

    Figures are published of whole sequences of KITTI.
    """
    judged = [e for e in evaluations if protocol in e.curves]
    peers = list(dict.fromkeys(p for e in judged for p in e.peers if p.protocol == protocol))
    if not peers:
        return None

    names = find_protocol(protocol).figures
    rows: list[Mapping[str, float | None]] = [
        {name: getattr(each.curves[protocol], name) for name in names} for each in judged
    ]
    columns: list[Column[Mapping[str, float | None]]] = [
        Column(*_FIGURES[name], name, "{:.3f}", max) for name in names
    ]
    runs = [each.run for each in judged]
    sources = {run.source for run in runs}
    ours = zip(short_labels(runs), runs, strict=True)
    labels = [f"{label}, {source_name(run.source, sources)}" for label, run in ours]
    labels += [f"{peer.method}, published" for peer in peers]
    return build_table(columns, [*rows, *(peer.figures for peer in peers)], labels)


def cost_table(evaluations: Sequence[Evaluation]) -> Table:
    """One row per run: median times and memory, in few columns: registration is a match, too."""

    def matching_ms(evaluation: Evaluation) -> float | None:
        stages = evaluation.costs.stages
        spread = stages.get("register") or stages.get("match")
        return None if spread is None else spread.median_ms

    columns = [column for column in _cost_columns(_stages(evaluations)) if column.title != "p95"]
    titles = [column.title for column in columns]
    if "match" in titles and "register" in titles:
        del columns[titles.index("register")]
        at = titles.index("match")
        columns[at] = replace(columns[at], value=matching_ms)
    columns[0] = replace(columns[0], title="frame")
    return _table_of_runs(columns, evaluations)


def time_table(evaluations: Sequence[Evaluation]) -> Table:
    """One row per descriptor: median and 95th percentile of each stage, and published times."""
    columns = []
    for stage in _stages(evaluations):
        columns.append(_stage_column(stage, "median_ms", f"{stage} median"))
        columns.append(_stage_column(stage, "p95_ms", f"{stage} p95"))
    columns += [_frame_column("median_ms", "frame median"), _frame_column("p95_ms", "frame p95")]
    columns.append(Column("points", "median of a cloud", "costs.median_points", "{:,.0f}"))
    if any("describe_seconds" in (e.published or {}) for e in evaluations):
        columns.append(
            _published_column("describe_seconds", "published: describe", "{:.1f}", scale=1e3)
        )
    return _table_of_runs(columns, evaluations)


def reasons_table(run: VerifiedRun) -> Table:
    """One row per reason for which candidates were rejected, the most frequent one first."""
    codes, counts = np.unique(run.rejected["code"], return_counts=True)
    ranked = sorted(
        zip(codes.tolist(), counts.tolist(), strict=True), key=lambda counted: -counted[1]
    )
    rows: list[Mapping[str, Any]] = []
    for code, count in ranked:
        numbers = run.rejected["number"][run.rejected["code"] == code]
        median = float(np.median(numbers)) if code in _NUMBERS else None
        rows.append({"rejected": count, "median": median, "of": _NUMBERS.get(code)})
    return build_table(columns_of("loops.reasons"), rows, [code for code, _ in ranked])


def _table_of_runs(columns: Columns, evaluations: Sequence[Evaluation]) -> Table:
    return build_table(columns, evaluations, short_labels([e.run for e in evaluations]))


def _accuracy_columns(protocol: str) -> Columns:
    def column(title: str, hint: str, figure: str, best: Best | None = max) -> Column[Evaluation]:
        return Column(title, hint, f"curves.{protocol}.{figure}", "{:.3f}", best)

    def ranked(e: Evaluation) -> float | None:
        return e.curves[protocol].recall_at_k.get(5) if protocol in e.curves else None

    full = "largest recall at which every accepted match is correct"
    limit = "distance up to which every match is correct; of verified loops 1 - probability"
    same, opposite = (f"by_direction.{protocol}.{kind}.top1" for kind in ("same", "opposite"))
    rule = find_protocol(protocol)
    columns = [
        column("R@100P", full, "recall_at_full_precision"),
        column("threshold", limit, "threshold_at_full_precision", None),
        column(*_FIGURES["max_f1"], "max_f1"),
        column("AP", "average precision", "average_precision"),
    ]
    columns += [
        column(*_FIGURES[figure], figure)
        for figure in rule.figures
        if figure not in ("max_f1", "top1")
    ]
    if rule.pairs is not None:
        return columns
    return [
        *columns,
        column(*_FIGURES["top1"], "top1"),
        Column("same way", "top-1 of revisits in the same direction", same, "{:.3f}", max),
        Column("opposite", "top-1 of revisits head-on", opposite, "{:.3f}", max),
        Column("recall@5", "revisits with a correct one among 5", ranked, "{:.3f}", max),
    ]


def _published_columns(evaluations: Sequence[Evaluation], protocol: str) -> Columns:
    if find_protocol(protocol).peer:
        return _peer_columns(evaluations, protocol)
    if not any(e.published for e in evaluations):
        return []
    name = PUBLISHED_PROTOCOL
    found = _published_column("recall_at_full_precision", "R@100P, published", "{:.3f}")
    if protocol == name or not any(name in e.curves for e in evaluations):
        return [found]
    hint = f"recall at 100 % precision, protocol {name}: compare with the published figure"
    ours = f"curves.{name}.recall_at_full_precision"
    return [Column(f"R@100P, {name}", hint, ours, "{:.3f}", max), found]


def _peer_columns(evaluations: Sequence[Evaluation], protocol: str) -> Columns:
    """Columns of what the protocol's paper prints of the same descriptors; none without."""

    def read(figure: str) -> Callable[[Evaluation], float | None]:
        return lambda evaluation: next(
            (
                peer.figures.get(figure)
                for peer in evaluation.peers
                if (peer.protocol, peer.descriptor) == (protocol, evaluation.run.descriptor)
            ),
            None,
        )

    found = {figure: read(figure) for figure in find_protocol(protocol).figures}
    return [
        Column(f"{_FIGURES[figure][0]}, published", _FIGURES[figure][1], value, "{:.3f}")
        for figure, value in found.items()
        if any(value(evaluation) is not None for evaluation in evaluations)
    ]


def _published_column(figure: str, title: str, show: str, scale: float = 1) -> Column[Evaluation]:
    hint = f"as published, protocol {PUBLISHED_PROTOCOL}"
    return Column(title, hint, f"published.{figure}", show, scale=scale)


def _cost_columns(stages: Sequence[str] = ()) -> Columns:
    peak = "memory that describing the largest cloud took on top of what was in use"
    return [
        _frame_column("median_ms", "ms a frame"),
        _frame_column("p95_ms", "p95"),
        *(_stage_column(stage, "median_ms", stage) for stage in stages),
        Column("bytes", "of one descriptor", "costs.bytes_per_descriptor", "{:,.0f}", min),
        Column("peak MiB", peak, "costs.peak_memory_bytes", "{:,.0f}", min, scale=2**-20),
    ]


def _stages(evaluations: Sequence[Evaluation]) -> list[str]:
    return list(dict.fromkeys(stage for e in evaluations for stage in e.run.seconds))


def _frame_column(figure: str, title: str) -> Column[Evaluation]:
    hint = f"{_PERCENTILES[figure]} of all stages of a frame together, ms"
    return Column(title, hint, f"costs.frame.{figure}", "{:.1f}", min)


def _stage_column(stage: str, figure: str, title: str) -> Column[Evaluation]:
    hint = f"{_PERCENTILES[figure]} of stage {stage}, ms"
    return Column(title, hint, f"costs.stages.{stage}.{figure}", "{:.2f}", min)
