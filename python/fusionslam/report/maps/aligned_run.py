# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A RatSLAM run ready to draw: map, dead reckoning and truth in one frame, loops judged, time."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fusionslam._core import ActionKind
from fusionslam.base.arrays import Floats, Integers, Mask
from fusionslam.evaluation import MapReport, PoseErrors
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.geometry.se2 import wrapped
from fusionslam.report.page.figures import PATH

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_PAUSE_S = 60.0


@dataclass(frozen=True)
class Scene:
    """A run in the frame of the ground truth, or in the map frame without ground truth.

    Map and dead reckoning are each aligned with the truth by the motion in the report.

    Attributes:
        run, report: the run and its report.
        nodes: float64 (k, 3), metres and radians.
        path: float64 (n, 3), every step on the final map.
        reckoned: float64 (n, 3), dead reckoning.
        made: int64 (l), the loop behind each link: the step in which the robot arrived at a known
            node, or was first refused there; -1 for links created with a node.
        false: bool (l), loops that join poses not near each other; all False without truth.
    """

    run: RatSlamRun
    report: MapReport
    nodes: Floats
    path: Floats
    reckoned: Floats
    made: Integers
    false: Mask

    @property
    def truth(self) -> Floats | None:
        """float64 (n, 3), or None."""
        return self.run.truth

    @property
    def loops(self) -> Mask:
        """Bool (l), links that are loops."""
        return np.asarray(self.made >= 0)

    @property
    def right(self) -> Mask:
        """Bool (l), links that are loops and not false."""
        return self.loops & ~self.false

    @property
    def loop_count(self) -> int:
        """Number of links that are loops."""
        return int(self.loops.sum())

    @property
    def misfit(self) -> float | None:
        """Root mean square of ``measure_misfits``; None without links."""
        apart = measure_misfits(self.run)
        return float(np.sqrt((apart**2).mean())) if apart.size else None


def scene_of(run: RatSlamRun, report: MapReport) -> Scene:
    """Align a run with its ground truth, and judge its loops."""
    made = _find_arrivals(run)
    false = made >= 0
    false[false] = near(run, report, made[false], run.links["target"][false]) == 0
    return Scene(
        run=run,
        report=report,
        nodes=align_poses(run.nodes, report.nodes),
        path=align_poses(run.final_poses, report.nodes),
        reckoned=align_poses(run.dead_reckoning, report.dead_reckoning),
        made=made,
        false=false,
    )


def find_denied(run: RatSlamRun) -> Mask:
    """Bool (r), refused loops without a final link: later loops may confirm a refused one."""
    pairs = zip(run.links["source"].tolist(), run.links["target"].tolist(), strict=True)
    linked = {frozenset(pair) for pair in pairs}
    ends = zip(run.refused["source"].tolist(), run.refused["target"].tolist(), strict=True)
    return np.array([frozenset(pair) not in linked for pair in ends], np.bool_)


def measure_misfits(run: RatSlamRun) -> Floats:
    """float64 (l): metres between the target's place by the link and its place on the map."""
    links, nodes = run.links, run.nodes
    source, target = nodes[links["source"]], nodes[links["target"]]
    way = source[:, 2] + links["heading"]
    said = source[:, :2] + (links["distance"] * np.stack([np.cos(way), np.sin(way)])).T
    return np.asarray(np.hypot(*(target[:, :2] - said).T))


def near(run: RatSlamRun, report: MapReport, steps: Integers, nodes: Integers) -> Floats:
    """float64 (m): 1 where the robot truly was within the view radius of these nodes, else 0.

    NaN where the truth is unknown. Arguments as for ``measure_offsets``.
    """
    metres, degrees = measure_offsets(run, steps, nodes)
    within = (metres <= report.rule.loop_distance) & (degrees <= report.rule.loop_angle)
    return np.where(np.isnan(metres), np.nan, within)


def align_poses(poses: Floats, errors: PoseErrors | None) -> Floats:
    """Poses aligned with the ground truth; unchanged if it is unknown."""
    return poses if errors is None else errors.motion.apply(poses)


def measure_offsets(run: RatSlamRun, steps: Integers, nodes: Integers) -> tuple[Floats, Floats]:
    """Compute the true distance of the robot from where nodes were made: metres and degrees.

    Args:
        run: the run.
        steps, nodes: int64 (m), steps of the robot and ids of the nodes.

    Returns:
        float64 (m) each; NaN where the truth is not known.
    """
    at = run.steps_at(run.node_stamps_ns)[nodes]
    if run.truth is None or not len(steps):
        return np.full(len(steps), np.nan), np.full(len(steps), np.nan)
    difference = run.truth[steps] - run.truth[at]
    difference[(steps < 0) | (at < 0)] = np.nan
    return np.hypot(*difference[:, :2].T), np.degrees(np.abs(wrapped(difference[:, 2])))


def _find_arrivals(run: RatSlamRun) -> Integers:
    """The step of the loop that caused each link; -1 where it was created with a node."""
    changes = np.flatnonzero(run.actions[:, 0] != ActionKind.NONE)[::-1].tolist()
    first = {(int(run.actions[row, 1]), int(run.actions[row, 2])): row for row in changes}
    for row, one in zip(run.steps_at(run.refused["stamp_ns"]), run.refused, strict=True):
        # A loop refused at first is linked once others agree with it.
        first.setdefault((int(one["source"]), int(one["target"])), int(row))
    pairs = zip(run.links["source"].tolist(), run.links["target"].tolist(), strict=True)
    steps = np.array([first.get(pair, -1) for pair in pairs], np.int64)
    with_node = run.actions[steps, 0] == ActionKind.CREATE_NODE
    with_node &= run.actions[steps, 2] == run.links["target"]
    return np.where((steps >= 0) & ~with_node, steps, -1)


def new_views(ids: Integers) -> Mask:
    """Mask of the ids that occur for the first time; -1 is none."""
    new = np.zeros(len(ids), bool)
    new[np.unique(ids, return_index=True)[1]] = True
    return new & (ids >= 0)


@dataclass(frozen=True)
class DrawnTime:
    """Times of a run for the axis of a plot, in which the pauses between recordings are short.

    A pause is longer than a minute and than half of the time without pauses.

    Attributes:
        seconds: float64 (n), time of each step on the axis.
        pauses: float64 (p), the middles of the pauses on the axis.
        left_out: seconds that the axis is shorter than the run.
    """

    seconds: Floats
    pauses: Floats
    left_out: float

    @classmethod
    def of(cls, run: RatSlamRun) -> "DrawnTime":
        gaps = np.diff(run.seconds, prepend=run.seconds[:1])
        driven = float(gaps[gaps <= _PAUSE_S].sum())
        is_pause = (gaps > max(_PAUSE_S, driven / 2)) & (driven > 0)
        short = np.where(is_pause, 0.03 * driven, gaps)
        seconds = np.cumsum(short)
        return cls(seconds, (seconds - short / 2)[is_pause], float((gaps - short).sum()))

    def at(self, run: RatSlamRun, stamps_ns: Integers) -> Floats:
        """Place stamps of a run on the axis."""
        return np.asarray(
            np.interp((stamps_ns - run.stamps_ns[0]) / 1e9, run.seconds, self.seconds)
        )

    def label(self, axis: "Axes", *others: "Axes") -> None:
        """Label the axis, and draw a line at each pause, also into other axes above it."""
        left_out = f", {self.left_out:,.0f} s of pauses left out" if self.pauses.size else ""
        axis.set_xlabel(f"time (s{left_out})")
        for each in (axis, *others):
            for pause in self.pauses:
                each.axvline(pause, color=PATH, lw=1, ls=":")
