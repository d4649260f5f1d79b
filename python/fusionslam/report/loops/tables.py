# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of report.html: accuracy, published figures, cost and time."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from fusionslam.evaluation import Costs, Evaluation, summarise_costs
from fusionslam.report.loops.labels import run_label, source_name
from fusionslam.report.page.tables import Column, Table, build_table

Value = Callable[[Evaluation], float | None]


PUBLISHED_PROTOCOL = "perdomo2019"


def summary_table(evaluations: Sequence[Evaluation], protocol: str) -> Table:
    """One row per source and descriptor: accuracy, time, memory."""
    accuracy = _accuracy_columns(protocol) if any(e.curves for e in evaluations) else []
    columns = accuracy + _published_columns(evaluations, protocol) + _cost_columns(evaluations)
    sources = {e.run.source for e in evaluations}
    return build_table(
        columns, evaluations, lambda e: f"{source_name(e.run.source, sources)}, {run_label(e.run)}"
    )


def accuracy_table(evaluations: Sequence[Evaluation], protocol: str) -> Table:
    """One row per run: the figures that decide between them, in few columns."""
    columns = [column for column in _accuracy_columns(protocol) if column.title != "recall@5"]
    return build_table(columns, evaluations, lambda e: run_label(e.run))


def published_table(evaluations: Sequence[Evaluation], protocol: str) -> Table:
    """One row per run: measured and published recall at 100 % precision."""
    return build_table(
        _published_columns(evaluations, protocol), evaluations, lambda e: run_label(e.run)
    )


def cost_table(evaluations: Sequence[Evaluation]) -> Table:
    """One row per run: median times and memory, in few columns."""
    columns = [column for column in _cost_columns(evaluations) if column.title != "p95"]
    columns[0] = replace(columns[0], title="frame")
    return build_table(columns, evaluations, lambda e: run_label(e.run))


def time_table(evaluations: Sequence[Evaluation]) -> Table:
    """One row per descriptor: median and 95th percentile of each stage, and published times."""
    columns = []
    for stage in _stages(evaluations):
        columns.append(_stage_column(stage, "median_ms", f"{stage} median"))
        columns.append(_stage_column(stage, "p95_ms", f"{stage} p95"))
    columns += [_frame_column("median_ms", "frame median"), _frame_column("p95_ms", "frame p95")]
    columns.append(_cost_column("points", "median of a cloud", lambda c: c.median_points, ",.0f"))
    if any("describe_seconds" in (e.published or {}) for e in evaluations):
        columns.append(_published("describe_seconds", "published: describe", "{:.1f}", 1e3))
    return build_table(columns, evaluations, lambda e: run_label(e.run))


def _accuracy_columns(protocol: str) -> list[Column[Evaluation]]:
    def of(name: str) -> Value:
        return lambda e: getattr(e.curves[protocol], name) if protocol in e.curves else None

    def ranked(e: Evaluation) -> float | None:
        return e.curves[protocol].recall_at_k.get(5) if protocol in e.curves else None

    def towards(kind: str) -> Value:
        return lambda e: e.top1_by_direction.get(kind)

    full = "largest recall at which every accepted match is correct"
    return [
        Column("R@100P", full, of("recall_at_full_precision"), "{:.3f}", max),
        Column(
            "threshold",
            "descriptor distance up to which every match is correct",
            of("threshold_at_full_precision"),
            "{:.3f}",
        ),
        Column("max F1", "largest 2PR / (P + R)", of("max_f1"), "{:.3f}", max),
        Column("AP", "average precision", of("average_precision"), "{:.3f}", max),
        Column("top-1", "revisits whose nearest is correct", of("top1"), "{:.3f}", max),
        Column(
            "same way", "top-1 of revisits in the same direction", towards("same"), "{:.3f}", max
        ),
        Column("opposite", "top-1 of revisits head-on", towards("opposite"), "{:.3f}", max),
        Column("recall@5", "revisits with a correct one among 5", ranked, "{:.3f}", max),
    ]


def _published_columns(
    evaluations: Sequence[Evaluation], protocol: str
) -> list[Column[Evaluation]]:
    if not any(e.published for e in evaluations):
        return []
    name = PUBLISHED_PROTOCOL
    found = _published("recall_at_full_precision", "R@100P, published", "{:.3f}")
    if protocol == name or not any(name in e.curves for e in evaluations):
        return [found]

    def ours(e: Evaluation) -> float | None:
        return e.curves[name].recall_at_full_precision if name in e.curves else None

    hint = f"recall at 100 % precision, protocol {name}: compare with the published figure"
    return [Column(f"R@100P, {name}", hint, ours, "{:.3f}", max), found]


def _published(figure: str, title: str, show: str, scale: float = 1.0) -> Column[Evaluation]:
    def value(e: Evaluation) -> float | None:
        found = (e.published or {}).get(figure)
        return None if found is None else found * scale

    return Column(title, f"as published, protocol {PUBLISHED_PROTOCOL}", value, show)


def _cost_columns(evaluations: Sequence[Evaluation]) -> list[Column[Evaluation]]:
    return [
        _frame_column("median_ms", "ms a frame"),
        _frame_column("p95_ms", "p95"),
        *(_stage_column(stage, "median_ms", stage) for stage in _stages(evaluations)),
        _cost_column("bytes", "of one descriptor", lambda c: c.bytes_per_descriptor, ",.0f", min),
        _cost_column(
            "peak MiB",
            "memory that describing the largest cloud took on top of what was in use",
            lambda c: c.peak_memory_bytes / 2**20,
            ",.0f",
            min,
        ),
    ]


def _stages(evaluations: Sequence[Evaluation]) -> list[str]:
    return list(dict.fromkeys(stage for e in evaluations for stage in e.run.seconds))


def _frame_column(figure: str, title: str) -> Column[Evaluation]:
    def value(costs: Costs) -> float | None:
        return getattr(costs.frame, figure, None)

    hint = {"median_ms": "median", "p95_ms": "95th percentile"}[figure]
    return _cost_column(title, f"{hint} of all stages of a frame together, ms", value, ".1f", min)


def _stage_column(stage: str, figure: str, title: str) -> Column[Evaluation]:
    def value(costs: Costs) -> float | None:
        return getattr(costs.stages.get(stage), figure, None)

    hint = {"median_ms": "median", "p95_ms": "95th percentile"}[figure]
    return _cost_column(title, f"{hint} of stage {stage}, ms", value, ".2f", min)


def _cost_column(
    title: str,
    hint: str,
    value: Callable[[Costs], float | None],
    show: str,
    best: Callable[[Sequence[float]], float] | None = None,
) -> Column[Evaluation]:
    return Column(title, hint, lambda e: value(summarise_costs(e.run)), f"{{:{show}}}", best)
