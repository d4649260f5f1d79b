# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The tables that bench and eval print: accuracy and cost of runs of loops."""

import textwrap
from collections.abc import Iterator, Sequence

from fusionslam.base.texts import counted
from fusionslam.cli.console import left_out, print_figures
from fusionslam.evaluation import Evaluation, VerifiedRun
from fusionslam.report.loops import comparison
from fusionslam.report.loops.comparison import Compared, pair_up
from fusionslam.report.loops.labels import by_rank, winner
from fusionslam.report.loops.tables import (
    accuracy_table,
    cost_table,
    peers_table,
    published_table,
)

_COSTS = (
    "times: medians in ms per frame; peak MiB: additional memory to describe the\n"
    "largest cloud, 0 if less than half a MiB"
)


def print_summary(evaluations: Sequence[Evaluation], protocol: str) -> None:
    """Print accuracy and cost of every run, in 80 columns; the report has more."""
    groups = by_rank(evaluations, protocol)
    every = [evaluation for group in groups.values() for evaluation in group]
    compared = [each for each in pair_up(every) if each.verified is not None]
    alone = [each.verified for each in compared]  # in a table of their own
    groups = {name: [e for e in group if e not in alone] for name, group in groups.items()}
    ranked = [evaluation for group in groups.values() for evaluation in group]
    curves = [e.curves[protocol] for e in ranked if protocol in e.curves]
    judged = any(curve.n_revisits for curve in curves)
    tables = [accuracy_table(ranked, protocol)] if judged else []
    published = published_table(ranked, protocol)
    if published.heads:
        tables.append(published)
    sizes = [(name, len(group)) for name, group in groups.items()]
    for table in [*tables, cost_table(ranked)]:
        print_figures("", table, sizes)
    peers = peers_table(ranked, protocol)
    if peers is not None:
        print_figures(f"as published under protocol {protocol}", peers)
        for source in dict.fromkeys(peer.source for each in ranked for peer in each.peers):
            print(textwrap.fill(f"published: {source}", 80))
    lines = [_conditions(ranked, protocol), _COSTS, *_accepted(ranked, protocol)]
    for line in (*lines, winner(every, protocol)):
        if line:
            print(line)
    if judged and compared:
        print_comparison(compared, protocol)
    for line in dict.fromkeys(left_out(evaluation.run) for evaluation in ranked):
        if line:
            print(line.removeprefix(", "))


def print_comparison(compared: Sequence[Compared], protocol: str) -> None:
    """Print accuracy with and without verification, and cost, of each descriptor by itself."""
    accuracy = comparison.accuracy_columns(protocol)
    kept = [column for column in accuracy if column.title in ("top-1", "opposite", "R@100P")]
    columns = [*kept, *comparison.verified_columns(protocol), *comparison.cost_columns()]
    table = comparison.comparison_table(compared, protocol, columns)
    print_figures("each descriptor by itself, and its candidates verified (ver.)", table)


def _accepted(evaluations: Sequence[Evaluation], protocol: str) -> Iterator[str]:
    """Yield lines for each run of verified loops: what was accepted and what proposed them."""
    for evaluation in evaluations:
        run = evaluation.run
        if isinstance(run, VerifiedRun):
            found = evaluation.accepted.get(protocol)
            wrong = "" if found is None else f", {found.wrong} of them wrong"
            loops = counted(int(run.accepted.sum()), "loop")
            yield f"verified, {run.source}: {loops} accepted{wrong}"
            yield f"  candidates of {run.descriptor}"
    if any(isinstance(evaluation.run, VerifiedRun) for evaluation in evaluations):
        yield "match, of verified loops: the registration of their candidates"


def _conditions(evaluations: Sequence[Evaluation], protocol: str) -> str:
    curve = next((e.curves[protocol] for e in evaluations if protocol in e.curves), None)
    if curve is None:
        return "no true poses: cost only (--gt names a file of poses)"
    conditions = f"protocol {protocol}, radius {curve.radius:g} m, window {curve.window}: "
    if curve.judges_pairs:
        return f"{conditions}{curve.counts}"
    if curve.n_revisits:
        revisits, frames = counted(curve.n_revisits, "revisit"), counted(curve.n_queries, "frame")
        return f"{conditions}{revisits} in {frames}"
    return (
        f"{conditions}no frame is a revisit, so there is no\n"
        "accuracy to judge; --set evaluation.window or evaluation.radius may change that"
    )
