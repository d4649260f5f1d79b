# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Evaluation of a descriptor run under several protocols."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from fusionslam.evaluation.loops.costs import Costs, summarise_costs
from fusionslam.evaluation.loops.descriptor_run import DescriptorRun
from fusionslam.evaluation.loops.judge import RANKS, evaluate_matches
from fusionslam.evaluation.loops.nearest_matches import Matches, find_matches
from fusionslam.evaluation.loops.precision_recall import PrecisionRecall
from fusionslam.evaluation.loops.protocols import DEFAULTS, PROTOCOLS, validate_config
from fusionslam.evaluation.loops.published import kitti_sequence, published_figures
from fusionslam.evaluation.loops.revisits import DIRECTIONS, visits


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A descriptor run evaluated under several protocols.

    Attributes:
        run: the run that was evaluated.
        curves: results by protocol name; empty without ground truth.
        published: published figures for the same sequence, source and descriptor, if any
            (``published_figures``; their protocol is perdomo2019).
        matches: the nearest candidates, which need no ground truth.
        window: number of frames before the query that are not candidates.
    """

    run: DescriptorRun
    curves: dict[str, PrecisionRecall] = field(default_factory=dict)
    published: dict[str, float] | None = None
    matches: Matches | None = None
    window: int = DEFAULTS.window

    def __repr__(self) -> str:
        protocols = ", ".join(self.curves) or "nothing to judge by"
        return f"<Evaluation of {self.run!r}: {protocols}>"

    @cached_property
    def costs(self) -> Costs:
        """Time and memory of the run."""
        return summarise_costs(self.run)

    @cached_property
    def top1_by_direction(self) -> dict[str, float]:
        """Top-1 of the revisits in the same, opposite or crossing direction, if there are any."""
        if self.run.poses is None or not self.curves:
            return {}
        curve = next(iter(self.curves.values()))
        kinds = np.array(
            [v.kind for v in visits(self.run.poses, radius=curve.radius, window=curve.window)]
        )
        return {
            kind: float(curve.correct[kinds == kind].mean())
            for kind in DIRECTIONS
            if (kinds == kind).any()
        }


def evaluate(
    run: DescriptorRun,
    *,
    protocols: Sequence[str] = tuple(PROTOCOLS),
    radius: float = DEFAULTS.radius,
    window: int = DEFAULTS.window,
    threads: int = 0,
) -> Evaluation:
    """Find the nearest candidates once and judge them under each protocol.

    A frame with a descriptor of zeros, which describes nothing, has no candidates.

    Without ground truth there are matches but no curves. Arguments as for precision_recall.

    Raises:
        DataError: a position that is not finite.
        ConfigError: unknown protocol, radius <= 0 or window < 0.
    """
    for protocol in protocols:
        validate_config(protocol=protocol, radius=radius, window=window)
    matches = find_matches(
        run.descriptors, window=window, k=max(RANKS), threads=threads, metric=run.metric
    )
    blank = ~run.descriptors.any(axis=1)
    matches.indices[blank], matches.distances[blank] = -1, np.inf
    curves: dict[str, PrecisionRecall] = {}
    if (places := run.positions) is not None:
        for name in protocols:
            curves[name] = evaluate_matches(
                matches, places, protocol=name, radius=radius, window=window
            )
    known = published_figures(kitti_sequence(run.dataset), run.source, run.descriptor, len(run))
    return Evaluation(run, curves, known, matches, window)
