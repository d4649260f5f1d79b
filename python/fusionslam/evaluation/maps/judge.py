# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Judge the map of a RatSLAM run, its metric errors and the places that it links, and paths."""

from typing import Any

import numpy as np

from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Floats, Integers, Mask, read_numbers
from fusionslam.base.texts import counted
from fusionslam.errors import DataError, ShapeError
from fusionslam.evaluation.maps.report import MapReport, PoseErrors
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.evaluation.views.rules import (
    VIEW_RULES,
    ViewRule,
    explain_no_revisit,
    view_rule,
)
from fusionslam.geometry.rigid import fit_motion, fit_rigid
from fusionslam.geometry.se2 import wrapped

_PAIRS = 1 << 19
"""Pairs of looks compared at a time: some tens of megabytes."""
_CAR_SPEED = 2.0
"""Mean speed in m/s above which a run is taken to be a car's."""
_CAR_PLACE_M = 4.0
"""Value of ``ratslam.map.place_m`` that suits a car."""
_FEW = 0.1
"""Share of the looks that are a loop below which loops are few."""


@checked
def judge_map(run: RatSlamRun, *, rule: str | ViewRule = "paper") -> MapReport:
    """Judge the map of a run, and dead reckoning for comparison, against the true poses.

    Without ground truth the report says so and holds only counts. Single steps may lack ground
    truth too: their true pose is three times NaN.

    Args:
        run: the run to judge.
        rule: "paper", "author", "car", or a ``ViewRule``, of which the loop limits (the view
            radius), the loop age and the revisit limits are used.

    Raises:
        DataError: a true pose that is partly NaN or infinite, a pose of the run that is not
            finite, stamps that go back, or an unknown node.
        ConfigError: unknown rule.
    """
    if not isinstance(run, RatSlamRun):
        raise ShapeError(f"run: expected a RatSlamRun, got {type(run).__name__}")
    rule_name, values = view_rule(rule)
    judge = _Judge(run, values)
    counts: dict[str, Any] = {
        "name": run.name,
        "views": run.views,
        "odometry": run.odometry,
        "preset": run.preset,
        "steps": int(judge.judged.sum()),
        "looks": int((run.is_view & judge.judged).sum()),
        "seconds": judge.seconds,
        "node_count": len(run.nodes),
        "link_count": len(run.links),
        "loops": int(judge.loop.sum()),
        "refused": len(run.refused),
        "rule_name": rule_name,
        "rule": values,
    }
    if not judge.known.any():
        remarks = ("not judged: the run has no true poses", *_explain_few_loops(judge))
        return MapReport(**counts, unjudged=remarks)
    if not len(run.nodes):
        return MapReport(**counts, unjudged=("not judged: the map has no node",))
    found: dict[str, Any] = {**judge.metric(), **judge.links(), **judge.loops()}
    found |= {**judge.refusals(), **judge.revisits()}
    remarks = judge.list_unjudged()
    if not found["revisits"]:
        by_car = _Judge(run, VIEW_RULES["car"]).revisits()["revisits"]
        remarks = (*remarks, explain_no_revisit(values, by_car))
    remarks = (*remarks, *_explain_few_loops(judge))
    return MapReport(**counts, **found, unjudged=remarks)


def _explain_few_loops(judge: "_Judge") -> tuple[str, ...]:
    """Say why the map of a car has few loops, and what gives more; nothing of other runs.

    The defaults are those of a small robot, whose scans of one place are decimetres apart.
    """
    run, looks, loops = judge.run, int(judge.run.is_view.sum()), int(judge.loop.sum())
    path_m = float(np.hypot(*np.diff(run.dead_reckoning[:, :2], axis=0).T).sum())
    lasts_s = float(run.seconds[-1]) if len(run) else 0.0
    place_m = float(run.config.get("map", {}).get("place_m", 0.0))
    if path_m <= _CAR_SPEED * lasts_s or place_m >= _CAR_PLACE_M or loops >= _FEW * looks:
        return ()
    if judge.known.any() and not _Judge(run, VIEW_RULES["car"]).revisits()["revisits"]:
        return ()
    known = run.view_ids[run.is_view]
    views = len(np.unique(known[known >= 0]))
    return (
        f"{counted(loops, 'loop')} in {counted(looks, 'look')}: {counted(views, 'look')} showed a "
        f"new view, {counted(len(run.refused), 'loop')} did not fit odometry and "
        f"{'was' if len(run.refused) == 1 else 'were'} refused; a car passes a place metres apart, "
        f"which --views m2dp --set ratslam.map.place_m={_CAR_PLACE_M:g} allows for",
    )


class _Judge:
    """A run, the true poses of its nodes, and the view radius."""

    def __init__(self, run: RatSlamRun, rule: ViewRule) -> None:
        # Imported here: ratslam imports fusionslam.views, which imports this package.
        from fusionslam._core import ActionKind

        self.run, self.rule = run, rule
        if (back := np.flatnonzero(np.diff(run.stamps_ns) < 0)).size:
            raise DataError(
                f"stamps_ns: row {back[0] + 1} is earlier than the one before",
                code="stamps-decrease",
                fields=(str(back[0] + 1),),
            )
        _check_ids("actions", run.actions[:, 1:], len(run.nodes))
        _check_ids("refused", run.refused["target"], len(run.nodes))
        for name in ("nodes", "poses", "offsets", "dead_reckoning"):
            _check_finite(name, getattr(run, name))
        self.truth = np.full((len(run), 3), np.nan) if run.truth is None else run.truth
        self.known: Mask = ~np.all(np.isnan(self.truth), axis=1)
        _check_finite("truth", self.truth, self.known)
        self.judged = (run.node_ids >= 0) & (self.known | (run.truth is None))
        self.loop = run.actions[:, 0] == ActionKind.CREATE_EDGE
        self.made = run.actions[:, 0] != ActionKind.NONE
        stamps = run.stamps_ns[self.judged]
        self.seconds = float((stamps[-1] - stamps[0]) / 1e9) if stamps.size else 0.0
        self.node_steps = self._drop_unknown(run.steps_at(run.node_stamps_ns))

    def _drop_unknown(self, steps: Integers) -> Integers:
        """The steps, -1 where the ground truth is unknown."""
        return np.where((steps >= 0) & self.known[steps], steps, -1) if len(self.run) else steps

    def metric(self) -> dict[str, PoseErrors | None]:
        """Errors of all sets of poses that are compared with the ground truth."""
        run, known, rows = self.run, self.node_steps >= 0, np.flatnonzero(self.judged)
        when = self.node_steps[known]
        return {
            "nodes": self._errors(run.nodes[known], when),
            "nodes_by_odometry": self._errors(run.dead_reckoning[when], when),
            "trajectory": self._errors(run.final_poses[rows], rows),
            "live": self._errors(run.poses[rows], rows),
            "dead_reckoning": self._errors(run.dead_reckoning[rows], rows),
        }

    def _errors(self, poses: Floats, steps: Integers) -> PoseErrors | None:
        return pose_errors(poses, self.truth[steps]) if steps.size else None

    def links(self) -> dict[str, int]:
        """Count the links, and those that join places near each other."""
        run = self.run
        pairs = [tuple(pair) for pair in run.actions[self.made, 1:].tolist()]
        first = dict(zip(reversed(pairs), np.flatnonzero(self.made)[::-1].tolist(), strict=True))
        ends = zip(run.links["source"].tolist(), run.links["target"].tolist(), strict=True)
        steps = self._drop_unknown(np.array([first.get(pair, -1) for pair in ends], np.int64))
        known = (steps >= 0) & (self.node_steps[run.links["target"]] >= 0)
        near = self._near(steps[known], run.links["target"][known])
        of_loop = self.loop[steps[known]]
        return {
            "judged_links": int(known.sum()),
            "near_links": int(near.sum()),
            "loop_links": int(of_loop.sum()),
            "near_loop_links": int((near & of_loop).sum()),
        }

    def loops(self) -> dict[str, int]:
        """Count the loops, and those that arrived at the wrong node."""
        steps = np.flatnonzero(self.loop & self.known)
        targets = self.run.actions[steps, 2]
        known = self.node_steps[targets] >= 0
        near = self._near(steps[known], targets[known])
        return {"judged_loops": int(known.sum()), "false_loops": int((~near).sum())}

    def refusals(self) -> dict[str, int]:
        """Count the refused loops, and those that were right."""
        refused = self.run.refused
        steps = self._drop_unknown(self.run.steps_at(refused["stamp_ns"]))
        known = (steps >= 0) & (self.node_steps[refused["target"]] >= 0)
        near = self._near(steps[known], refused["target"][known])
        linked = self._are_linked(refused["source"][known], refused["target"][known])
        return {
            "judged_refused": int(known.sum()),
            "refused_true": int(near.sum()),
            "refused_linked": int((near & linked).sum()),
        }

    def _near(self, steps: Integers, nodes: Integers) -> Mask:
        """Bool (n,): the robot was truly within the view radius of these nodes."""
        there = self.truth[self.node_steps[nodes]]
        return _within(self.truth[steps], there, self.rule.loop_distance, self.rule.loop_angle)

    def revisits(self) -> dict[str, int]:
        """Count the revisits, and those that the map links."""
        rule, looks = self.rule, np.flatnonzero(self.run.is_view & self.known)
        poses, times = self.truth[looks], self.run.stamps_ns[looks]
        older = np.searchsorted(times, times - round(rule.loop_age * 1e9), side="left")
        back, linked = np.zeros((2, len(looks)), np.bool_)
        block = max(1, _PAIRS // max(1, len(looks)))
        for start in range(0, len(looks), block):
            rows = np.arange(start, min(start + block, len(looks)))
            here, there = np.nonzero(np.arange(older[rows[-1]]) < older[rows, None])
            here = rows[here]
            near = _within(poses[here], poses[there], rule.revisit_distance, rule.revisit_angle)
            here, there = here[near], there[near]
            back[here] = True
            one, other = self.run.node_ids[looks[here]], self.run.node_ids[looks[there]]
            joined = (one == other) | self._are_linked(one, other)
            linked[here[joined & (one >= 0) & (other >= 0)]] = True
        return {"revisits": int(back.sum()), "linked_revisits": int(linked.sum())}

    def _are_linked(self, nodes: Integers, others: Integers) -> Mask:
        """Bool (n,): the map has a link between these nodes."""
        links, count = self.run.links, len(self.run.nodes)
        source, target = links["source"], links["target"]
        codes = np.concatenate([source * count + target, target * count + source])
        return np.isin(nodes * count + others, codes)

    def list_unjudged(self) -> tuple[str, ...]:
        """List what has no ground truth: a resumed run has nodes that are older than itself."""
        unknown = {"steps": ~self.known, "nodes": self.node_steps < 0}
        return tuple(
            f"not judged: {rows.sum()} of {len(rows)} {name}, whose true poses are not known"
            for name, rows in unknown.items()
            if rows.any()
        )


@checked
def pose_errors(poses: Floats, truth: Floats) -> PoseErrors:
    """Compute the errors of poses after rigid alignment with the truth (``fit_rigid``).

    Args:
        poses, truth: float64 (n, 3), n > 0, x, y in metres and heading in radians.

    Raises:
        ShapeError, DataError: as ``fit_rigid``.
    """
    motion = fit_rigid(poses, truth)
    moved = motion.apply(poses)
    apart = np.hypot(*(moved - truth)[:, :2].T)
    turned = np.degrees(wrapped(moved[:, 2] - truth[:, 2]))
    return PoseErrors(
        n=len(poses),
        rmse_m=float(np.sqrt((apart**2).mean())),
        mean_m=float(apart.mean()),
        max_m=float(apart.max()),
        heading_rmse_deg=float(np.sqrt((turned**2).mean())),
        motion=motion,
    )


@checked
def trajectory_error(poses: Floats, truth: Floats, parts: Integers | None = None) -> float:
    """Absolute trajectory error (ATE): root mean square of the distances to the true positions.

    Args:
        poses: float64 (n, 4, 4), n > 0.
        truth: float64 (n, 4, 4), at the same times; rows with NaN are left out.
        parts: int64 (n): poses of one number are aligned by one rigid motion; None for all.

    Returns:
        Metres, after the alignment; NaN if no true pose is known.

    Raises:
        ShapeError: other shapes, or no poses.
        DataError: a pose is not finite (code "not-finite").
    """
    poses = read_numbers("poses", poses, "(n, 4, 4)")
    truth = read_numbers("truth", truth, "(n, 4, 4)")
    shape = (len(poses) if poses.ndim else 0, 4, 4)
    if not shape[0] or not poses.shape == truth.shape == shape:
        raise ShapeError(
            f"poses and truth have shapes {poses.shape} and {truth.shape}, "
            "expected (n, 4, 4), n > 0"
        )
    if parts is not None and np.shape(parts) != shape[:1]:
        raise ShapeError(f"parts has shape {np.shape(parts)}, expected {shape[:1]}")
    if not np.isfinite(poses).all():
        raise DataError("poses holds NaN or infinity, expected numbers", code="not-finite")
    known = np.isfinite(truth).all(axis=(1, 2))
    numbers = np.zeros(len(poses), np.int64) if parts is None else parts
    squares = []
    for part in np.unique(numbers[known]):
        rows = known & (numbers == part)
        aligned = fit_motion(poses[rows], truth[rows]) @ poses[rows]
        squares.append(((aligned - truth[rows])[:, :3, 3] ** 2).sum(axis=1))
    return float(np.sqrt(np.concatenate(squares).mean())) if squares else float("nan")


def _within(poses: Floats, others: Floats, distance: float, angle: float) -> Mask:
    """Bool (n,): poses (n, 3) within these metres and degrees of each other."""
    apart = np.hypot(poses[:, 0] - others[:, 0], poses[:, 1] - others[:, 1])
    turned = np.degrees(np.abs(wrapped(poses[:, 2] - others[:, 2])))
    return np.asarray((apart <= distance) & (turned <= angle))


def _check_ids(name: str, ids: Integers, count: int) -> None:
    """Raise DataError for unknown nodes; if there are no nodes, 0 stands for none."""
    if (wrong := ids[(ids < 0) | (ids >= max(count, 1))]).size:
        raise DataError(
            f"{name}: node {wrong[0]}, and there are {count}",
            code="unknown-node",
            fields=(name, str(wrong[0])),
        )


def _check_finite(name: str, poses: Floats, wanted: Mask | None = None) -> None:
    """Raise DataError that names the first row, of those wanted, that is not finite."""
    broken = ~np.isfinite(poses).all(axis=1) & (True if wanted is None else wanted)
    if (bad := np.flatnonzero(broken)).size:
        raise DataError(
            f"{name}: row {bad[0]} is {poses[bad[0]].tolist()}, expected numbers",
            code="not-finite",
            fields=(name, str(bad[0])),
        )
