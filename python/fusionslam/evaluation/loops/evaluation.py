# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Evaluation of a run of descriptors, or of verified loops, under several protocols."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Mask
from fusionslam.errors import ConfigError, DataError
from fusionslam.evaluation.loops.descriptor_run import DescriptorRun
from fusionslam.evaluation.loops.judge import evaluate_matches
from fusionslam.evaluation.loops.nearest_matches import Matches, find_matches, match_described
from fusionslam.evaluation.loops.pairs import evaluate_pairs
from fusionslam.evaluation.loops.precision_recall import RANKS, PrecisionRecall
from fusionslam.evaluation.loops.protocols import (
    DEFAULTS,
    USUAL_PROTOCOLS,
    EvaluationConfig,
    check_bound,
    find_protocol,
    validate_config,
)
from fusionslam.evaluation.loops.published import (
    PeerFigures,
    kitti_sequence,
    peer_figures,
    published_figures,
)
from fusionslam.evaluation.loops.revisits import DIRECTIONS, visits
from fusionslam.evaluation.loops.verified_run import LoopRun, VerifiedRun


@dataclass(frozen=True)
class StageCost:
    """Milliseconds per frame: the median and the 95th percentile over the frames."""

    median_ms: float
    p95_ms: float


@checked
@dataclass(frozen=True)
class Costs:
    """Cost of a run.

    Attributes:
        stages: cost of each stage, by its name.
        frame: cost of all stages of a frame together; None if no stage was timed.
        bytes_per_descriptor: size of one row; None of verified loops.
        peak_memory_bytes: memory needed to describe the largest cloud, beyond what was in use;
            None of verified loops.
        median_points: median number of points of a described cloud.
    """

    stages: dict[str, StageCost]
    frame: StageCost | None
    bytes_per_descriptor: int | None
    peak_memory_bytes: int | None
    median_points: float | None


@checked
def summarise_costs(run: LoopRun) -> Costs:
    """Summarise the costs of a run; figures of a run without frames are left out."""
    timed = {stage: seconds for stage, seconds in run.seconds.items() if len(seconds)}
    size = peak = None
    if isinstance(run, DescriptorRun):
        size = run.descriptors.shape[1] * run.descriptors.itemsize
        peak = run.peak_memory_bytes
    return Costs(
        stages={stage: _stage_cost(seconds) for stage, seconds in timed.items()},
        frame=_stage_cost(np.sum(list(timed.values()), axis=0)) if timed else None,
        bytes_per_descriptor=size,
        peak_memory_bytes=peak,
        median_points=float(np.median(run.points)) if len(run) else None,
    )


def _stage_cost(seconds: NDArray[np.float64]) -> StageCost:
    median, p95 = np.percentile(seconds, (50, 95)) * 1e3
    return StageCost(float(median), float(p95))


@dataclass(frozen=True)
class AcceptedLoops:
    """Loops that a detector accepted, judged: their number, the wrong ones among them, recall."""

    loops: int
    wrong: int
    recall: float | None


@dataclass(frozen=True)
class DirectionFigures:
    """Figures of the revisits in one direction.

    Attributes:
        revisits: their number.
        top1: share whose match is correct.
        recall_at_full_precision: share that is found at the threshold of 100 % precision of all
            directions together.
        accepted: share that is found by the accepted loops of a verified run; None of others.
    """

    revisits: int
    top1: float
    recall_at_full_precision: float
    accepted: float | None


@checked
@dataclass(frozen=True, eq=False)
class Evaluation:
    """A run evaluated under several protocols.

    Attributes:
        run: the run that was evaluated.
        curves: results by protocol name; empty without ground truth.
        published: published figures for the same sequence, source and descriptor, if any
            (``published_figures``; their protocol is perdomo2019).
        matches: the nearest candidates, which need no ground truth.
        window: number of frames before the query that are not candidates.
    """

    run: LoopRun
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

    @property
    def peers(self) -> tuple[PeerFigures, ...]:
        """What other papers print for the same sequence under the protocols of the curves."""
        sequence = kitti_sequence(self.run.dataset)
        return tuple(
            peer
            for protocol in self.curves
            for peer in peer_figures(protocol, sequence, len(self.run))
        )

    @property
    def query_curves(self) -> dict[str, PrecisionRecall]:
        """The curves that judge the match of each frame, without those of pairs."""
        return {name: curve for name, curve in self.curves.items() if not curve.judges_pairs}

    @cached_property
    def accepted(self) -> dict[str, AcceptedLoops]:
        """The loops that the detector of a verified run accepted, by protocol; none of others."""
        if not isinstance(self.run, VerifiedRun):
            return {}
        found = {}
        for name, curve in self.curves.items():
            relevant = find_protocol(name).relevant(curve.correct, curve.revisit)
            right = self.run.accepted & curve.correct
            loops = int(self.run.accepted.sum())
            recall = float(right[relevant].mean()) if relevant.any() else None
            found[name] = AcceptedLoops(loops, loops - int(right.sum()), recall)
        return found

    @cached_property
    def by_direction(self) -> dict[str, dict[str, DirectionFigures]]:
        """Protocol -> direction of revisits ("same", "opposite", "crossing"), if any -> figures."""
        curves = self.query_curves
        if self.run.poses is None or not curves:
            return {}
        first = next(iter(curves.values()))
        found = visits(self.run.poses, radius=first.radius, window=first.window)
        kinds = np.array([visit.kind for visit in found])
        return {
            protocol: {
                kind: self._direction_figures(curve, kinds == kind)
                for kind in DIRECTIONS
                if (kinds == kind).any()
            }
            for protocol, curve in curves.items()
        }

    def _direction_figures(self, curve: PrecisionRecall, among: Mask) -> DirectionFigures:
        """Figures of the queries ``among`` all, bool (N,)."""
        full = curve.correct & curve.accepted(curve.threshold_at_full_precision)
        run = self.run
        accepted = run.accepted & curve.correct if isinstance(run, VerifiedRun) else None
        return DirectionFigures(
            revisits=int(among.sum()),
            top1=float(curve.correct[among].mean()),
            recall_at_full_precision=float(full[among].mean()),
            accepted=None if accepted is None else float(accepted[among].mean()),
        )


@checked
def evaluate(
    run: DescriptorRun,
    *,
    protocols: Sequence[str] = USUAL_PROTOCOLS,
    radius: float | None = None,
    window: int | None = None,
    threads: int = 0,
) -> Evaluation:
    """Find the nearest candidates and judge them, or pairs of frames, under each protocol.

    A frame with a descriptor of zeros, which describes nothing, has no candidates.

    Without ground truth there are matches but no curves. Protocols by pose are left out, as
    descriptors give none. Arguments as for precision_recall; without a radius or a window each
    protocol has its own. ``Evaluation.matches`` are those of the first protocol's window.

    Raises:
        DataError: a position that is not finite; of a protocol that judges pairs, also as
            ``evaluate_pairs``.
        ConfigError: unknown protocol, radius <= 0 or window < 0.
    """
    configs = _configs(protocols, radius, window)
    own = configs[0].window if configs else DEFAULTS.window if window is None else window
    matches = _search(run, own, threads)
    curves: dict[str, PrecisionRecall] = {}
    if (places := run.positions) is not None:
        for config in configs:
            rule, values = find_protocol(config.protocol), config.model_dump()
            if rule.pairs is not None:
                curves[rule.name] = evaluate_pairs(
                    run.descriptors, places, **values, threads=threads, metric=run.metric
                )
            elif rule.bound is None:
                same = config.window == own
                found = matches if same else _search(run, config.window, threads)
                curves[rule.name] = evaluate_matches(found, places, **values)
    known = published_figures(kitti_sequence(run.dataset), run.source, run.descriptor, len(run))
    return Evaluation(run, curves, known, matches, own)


def _configs(
    protocols: Sequence[str], radius: float | None, window: int | None
) -> list[EvaluationConfig]:
    """Return the configuration of each protocol. Raises ConfigError."""
    return [validate_config(protocol=name, radius=radius, window=window) for name in protocols]


def _search(run: DescriptorRun, window: int, threads: int) -> Matches:
    rows, count = run.descriptors, max(RANKS)
    if not rows.any(axis=1).all():
        return match_described(rows, window, count, run.metric)
    return find_matches(rows, window=window, k=count, threads=threads, metric=run.metric)


@checked
def evaluate_verified(
    run: VerifiedRun,
    *,
    protocols: Sequence[str] = USUAL_PROTOCOLS,
    radius: float | None = None,
    window: int | None = None,
) -> Evaluation:
    """Judge the matches of verified loops under each protocol, with 1 - probability as distance.

    ``recall_at_k`` of the curves is the share of the revisits with a candidate within the radius
    among the first k, the most promising, for k = 1, 5, 10 and all of them: what the descriptors
    left to be verified, under every protocol. Without ground truth there are no curves, without
    ``body_from_cloud`` none by pose, and never one of pairs. Other arguments as for evaluate.

    Raises:
        DataError: a pose that is not finite, or a candidate that the window excludes (code
            "window").
        ConfigError: unknown protocol, radius <= 0 or window < 0.
    """
    configs = _configs(protocols, radius, window)
    own = configs[0].window if configs else DEFAULTS.window if window is None else window
    for least in {own, *(config.window for config in configs)}:
        _check_window(run, least)
    matches = run.matches
    curves: dict[str, PrecisionRecall] = {}
    if run.poses is not None:
        for config in configs:
            rule = find_protocol(config.protocol)
            judged = rule.bound is None or matches.match_from_query is not None
            if judged and rule.pairs is None:
                recalls = _candidate_recalls(run, config.radius, config.window)
                curve = evaluate_matches(matches, run.poses, **config.model_dump())
                curves[rule.name] = replace(curve, recall_at_k=recalls)
    return Evaluation(run, curves, None, matches, own)


def _check_window(run: VerifiedRun, window: int) -> None:
    rows = np.column_stack([run.match, run.candidates])
    lags = np.where(rows >= 0, np.arange(len(run))[:, None] - rows, window + 1)
    if lags.min(initial=window + 1) <= window:
        raise DataError(
            f"verified loops of {run.source} clouds: some candidates are {lags.min()} frames "
            f"before their query, but evaluation.window is {window}: verify them with a "
            f"loop_closure.window of {window}",
            code="window",
            fields=(run.source, str(lags.min()), str(window)),
        )


def check_judged(evaluations: Sequence[Evaluation], protocol: str) -> None:
    """Check that runs with ground truth were judged under a protocol.

    Raises:
        ConfigError: the protocol is unknown, or nothing was judged under it but under others (code
            "not-judged"; "needs-poses" of a protocol by pose).
    """
    find_protocol(protocol)
    known = {name for evaluation in evaluations for name in evaluation.curves}
    if known and protocol not in known:
        check_bound(protocol, has_poses=False)
        names = ", ".join(sorted(known))
        problem = f"nothing was judged under protocol {protocol}, only under {names}"
        raise ConfigError(problem, code="not-judged", fields=(protocol,))


def _candidate_recalls(run: VerifiedRun, radius: float, window: int) -> dict[int, float | None]:
    count = run.candidates.shape[1]
    if not count:
        return dict.fromkeys(RANKS)
    present = run.candidates >= 0
    apart = np.where(present, 0, np.inf).astype(np.float32)
    assert run.positions is not None
    ranks = tuple(sorted({*RANKS, count}))
    return evaluate_matches(
        Matches(run.candidates, apart), run.positions, radius=radius, window=window, ranks=ranks
    ).recall_at_k
