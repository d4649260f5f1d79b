# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How good a map is: how sure its keyframes are, what holds them, and where it is weak."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import groupby
from typing import NamedTuple

import numpy as np

from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Floats, Integers, Points
from fusionslam.base.texts import counted
from fusionslam.errors import DataError
from fusionslam.geometry.se3 import inverse
from fusionslam.mapping.edge import Edge, chi_squares, deviations_of
from fusionslam.mapping.gtsam_extra import Uncertainty
from fusionslam.mapping.map_content import MapContent
from fusionslam.mapping.marginals import measure_uncertainty
from fusionslam.mapping.place_map import PlaceMap
from fusionslam.mapping.surfaces import doubling
from fusionslam.mapping.sweeps import SolvedSweeps

_SEGMENT_M = 25.0
"""Length of a segment of the way, at most."""
_REACH_M = 50.0
"""Of loops along the way, on and back: a keyframe without one in it is held by odometry alone."""
_PASS_M = 5.0
"""Between keyframes of two passes, at most, whose surfaces are compared."""
_MOST_PASSES = 200
_LISTED, _ASKED = 10, 30
"""Loops that change most, and those that are tried for them."""
_LEVER_M = 100.0
"""By which a turn of the ends of a loop counts, as what is this far away moves with them."""
_LEAST_CHECKED = 0.1
"""Redundancy of all loops below which their residuals say nothing."""


class Influence(NamedTuple):
    """A believed loop, and what the map would be without it.

    Attributes:
        edge: the loop.
        chi_square: of its error, six degrees of freedom.
        redundancy: of these six, those that other edges check (Baarda 1968).
        shift_m: how far the keyframe that moves most would move; infinite if the loop alone joins
            two parts of the map.
        keyframe: number of that one; None if parts come apart.
    """

    edge: Edge
    chi_square: float
    redundancy: float
    shift_m: float
    keyframe: int | None


@dataclass(frozen=True)
class Segment:
    """A piece of the way of a session.

    Attributes:
        session: its name.
        first, last: numbers of its keyframes.
        metres: its length.
        loops, refused: believed and refused loops that end in it.
        deviation_m: of the keyframe that is least sure.
        thickness_m, apart_m: how thick surfaces are that another pass shows, too (median), and half
            the distance between both passes' surfaces (90 % of them), in the place where they lie
            farthest apart; None where no other pass was compared.
        weak: why it is weak: "no-loops" (a keyframe of a longer way has none within 50 m), "unsure"
            (the deviation exceeds the distance between keyframes), "thick-walls" (surfaces of two
            passes are farther apart than loops' deviations say) or "refused" (more loops are
            refused than believed); nothing if it is not.
    """

    session: str
    first: int
    last: int
    metres: float
    loops: int
    refused: int
    deviation_m: float
    thickness_m: float | None
    apart_m: float | None
    weak: tuple[str, ...]

    @property
    def loops_a_metre(self) -> float:
        """Believed loops that end in it, by its length."""
        return self.loops / self.metres if self.metres else 0.0

    @property
    def weak_text(self) -> str:
        """The reasons, separated by commas."""
        return ", ".join(self.weak)


@dataclass(frozen=True, eq=False)
class MapQuality:
    """How good a map is, as far as its graph and its clouds tell.

    Attributes:
        numbers: int64 (n), of the keyframes.
        deviations: float64 (n, 2), root mean squares of the errors of their positions and angles,
            metres and degrees, that are to be expected against the first keyframe of their part.
        near_loops: int64 (n), ends of believed loops within 50 m of way.
        metres: of the way.
        loops: number of believed loops.
        fit: mean square of their residuals, by what their covariances and redundancies say: 1 if
            these are right, less if they are cautious; None without loops that others check.
        segments: of all sessions.
        influences: of believed loops, those that change most, the largest shift first.
    """

    numbers: Integers
    deviations: Floats
    near_loops: Integers
    metres: float
    loops: int
    fit: float | None
    segments: tuple[Segment, ...]
    influences: tuple[Influence, ...]

    @property
    def weak_places(self) -> list[Segment]:
        """Weak segments; those that follow each other for the same reason are one."""
        groups = groupby(self.segments, lambda each: (each.session, each.weak))
        return [_join([*each]) for (_, weak), each in groups if weak]

    def describe(self) -> str:
        """Say it in three lines."""
        median, worst = np.median(self.deviations[:, 0]), int(np.argmax(self.deviations[:, 0]))
        weak = self.weak_places
        lines = [
            f"positions: deviation {median:.3g} m in the median, at most "
            f"{self.deviations[worst, 0]:.3g} m (keyframe {self.numbers[worst]})",
            f"{1000 * self.loops / max(self.metres, 1e-9):,.0f} loops a km of way"
            + (f"; squared residuals {self.fit:.2g} times as stated" if self.fit else ""),
            counted(len(weak), "weak place")
            + "".join(
                f"{', ' if k else ': '}{each.first} to {each.last} ({each.weak_text})"
                for k, each in enumerate(weak[:3])
            )
            + (", ..." if len(weak) > 3 else ""),
        ]
        return "\n".join(lines)


Passes = Mapping[int, tuple[float, float]]
"""By number of the keyframe, how thick surfaces are that another pass shows, too, and half the
distance between both, in metres."""


@checked
def judge_map(site: PlaceMap, *, surfaces: bool = True) -> MapQuality:
    """Say how good a map is, which does not change. What satellites tell does not count.

    Args:
        site: the map.
        surfaces: whether clouds of different passes are compared, too, which takes some hundredths
            of a second each, of at most 200.

    Raises:
        DataError: the map has no keyframes (code "empty"), or a stored cloud is damaged.
        FusionSlamError: the graph cannot be solved (code "not-solvable").
    """
    if not len(site):
        raise DataError(f"{site.path}: the map has no keyframes", code="empty")
    content, settings = site.content, site.settings
    passes: Passes = {}
    if surfaces:
        sweeps = SolvedSweeps(content, lru_cache(4)(site.file.cloud), site.file.frames_after)
        passes = compare_passes(content, lambda number: sweeps.cloud(number).points)
    return judge_graph(
        content,
        passes,
        unsure_m=settings.keyframe_distance,
        apart_m=settings.registration.position_sd,
    )


def judge_graph(
    content: MapContent, passes: Passes, *, unsure_m: float, apart_m: float
) -> MapQuality:
    """Say how good the graph of a map with keyframes is; errors as of ``judge_map``.

    Args:
        content: of the map.
        passes: what ``compare_passes`` found.
        unsure_m: deviation beyond which a keyframe is unsure.
        apart_m: half the distance between surfaces of two passes beyond which walls are thick.
    """
    used, errors = measure_uncertainty(content)
    poses = content.poses
    deviations = deviations_of(np.array([errors.covariance(k) for k in range(len(poses))]))
    fit, influences = _measure_influences(content, used, errors)
    believed, refused = (
        [edge for edge in content.loops if edge.state == state] for state in ("believed", "refused")
    )
    names = {number: name for name, number in content.sessions.items()}
    near_loops, segments = np.zeros(len(poses), np.int64), []
    for rows, metres in _stretches(content):
        ends = [_find_ends(content, each, rows) for each in (believed, refused)]
        held = np.sort(metres[ends[0][0]])
        until = np.searchsorted(held, metres + _REACH_M, "right")
        near_loops[rows] = until - np.searchsorted(held, metres - _REACH_M, "left")
        count = max(int(np.ceil(metres[-1] / _SEGMENT_M)), 1)
        pieces = np.minimum(metres * count / max(metres[-1], 1e-9), count - 1).astype(int)
        for piece in np.unique(pieces):
            inside = pieces == piece
            own = rows[inside]
            keyframes = [content.keyframes[k] for k in own.tolist()]
            seen = [passes[each.id] for each in keyframes if each.id in passes]
            thickness, apart = max(seen, key=lambda each: each[1], default=(None, None))
            loops, not_loops = (len(np.unique(numbers[inside[at]])) for at, numbers in ends)
            deviation = float(deviations[own, 0].max())
            is_held = metres[-1] <= _REACH_M or bool(near_loops[own].all())
            reasons = {
                "no-loops": not is_held,
                "unsure": deviation > unsure_m,
                "thick-walls": apart is not None and apart > apart_m,
                "refused": not_loops > loops,
            }
            segments.append(
                Segment(
                    session=names[keyframes[0].session],
                    first=keyframes[0].id,
                    last=keyframes[-1].id,
                    metres=float(metres[-1] / count),
                    loops=loops,
                    refused=not_loops,
                    deviation_m=deviation,
                    thickness_m=thickness,
                    apart_m=apart,
                    weak=tuple(reason for reason, holds in reasons.items() if holds),
                )
            )
    return MapQuality(
        content.numbers,
        deviations,
        near_loops,
        sum(each.metres for each in segments),
        len(believed),
        fit,
        tuple(segments),
        tuple(influences),
    )


def _measure_influences(
    content: MapContent, used: Sequence[Edge], errors: Uncertainty
) -> tuple[float | None, list[Influence]]:
    """The ``fit`` of a map, and its ``influences``."""
    known = {edge.number for edge in content.loops}
    rows = [k for k, edge in enumerate(used) if edge.number in known]
    if not rows:
        return None, []
    squares = chi_squares(content.poses, [used[k] for k in rows])
    redundancies, motions = map(np.array, zip(*map(errors.leverage, rows), strict=True))
    apart = np.linalg.norm(motions.reshape(-1, 2, 3), axis=2) @ [1.0, _LEVER_M]
    influences = []
    for k in np.argsort(-apart, kind="stable")[:_ASKED].tolist():
        shift_m, moved = np.inf, None
        if np.isfinite(apart[k]):
            shifts = np.linalg.norm(errors.shift_without(rows[k])[:, :3], axis=1)
            shift_m, moved = float(shifts.max()), content.keyframes[int(shifts.argmax())].id
        loop, of_six = content.edges[used[rows[k]].number], float(redundancies[k])
        influences.append(Influence(loop, float(squares[k]), of_six, shift_m, moved))
    influences.sort(key=lambda each: -each.shift_m)
    checked_by_others = float(redundancies.sum())
    fit = float(squares.sum() / checked_by_others) if checked_by_others > _LEAST_CHECKED else None
    return fit, influences[:_LISTED]


def _stretches(content: MapContent) -> Iterator[tuple[Integers, Floats]]:
    """Rows of the keyframes of each stretch of odometry, and metres of way to each."""
    firsts = np.array([content.stretches[each.id] for each in content.keyframes], np.int64)
    for first in np.unique(firsts):
        rows = np.flatnonzero(firsts == first)
        steps = np.diff(content.poses[rows, :3, 3], axis=0)
        yield rows, np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps, axis=1))])


def _find_ends(
    content: MapContent, edges: Sequence[Edge], rows: Integers
) -> tuple[Integers, Integers]:
    """Ends of edges within a stretch: their places in ``rows``, and the numbers of the edges."""
    ends = np.array([[content.row[edge.a], content.row[edge.b]] for edge in edges], np.int64)
    numbers = np.repeat([edge.number for edge in edges], 2).astype(np.int64)
    inside = np.isin(ends.reshape(-1), rows)
    return np.searchsorted(rows, ends.reshape(-1)[inside]), numbers[inside]


def _join(segments: Sequence[Segment]) -> Segment:
    """One segment of several that follow each other."""
    worst = max(segments, key=lambda each: each.apart_m or 0.0)
    return replace(
        segments[0],
        last=segments[-1].last,
        metres=sum(each.metres for each in segments),
        loops=sum(each.loops for each in segments),
        refused=sum(each.refused for each in segments),
        deviation_m=max(each.deviation_m for each in segments),
        thickness_m=worst.thickness_m,
        apart_m=worst.apart_m,
    )


def compare_passes(content: MapContent, points: Callable[[int], Points]) -> Passes:
    """Compare the surfaces that keyframes show with those of another pass of the same place.

    Args:
        content: of the map.
        points: float32 (N, 3), of a keyframe's cloud, by its number.

    Returns:
        Of at most 200 keyframes, spread over the map, those that have another pass within 5 m.
    """
    from scipy.spatial import cKDTree  # slow to import

    poses, numbers, parts = content.poses, content.numbers, np.array(content.parts)
    stretch, metres = np.empty(len(numbers), np.int64), np.empty(len(numbers))
    for first, (rows, way) in enumerate(_stretches(content)):
        stretch[rows], metres[rows] = first, way
    tree = cKDTree(poses[:, :3, 3])
    found = {}
    for k in np.unique(np.linspace(0, len(numbers) - 1, _MOST_PASSES).astype(int)).tolist():
        near = np.array(tree.query_ball_point(poses[k, :3, 3], _PASS_M), np.int64)
        later = (stretch[near] != stretch[k]) | (np.abs(metres[near] - metres[k]) > _SEGMENT_M)
        near = near[later & (parts[near] == parts[k])]
        if not len(near):
            continue
        apart = np.linalg.norm(poses[near, :3, 3] - poses[k, :3, 3], axis=1)
        other = int(near[apart.argmin()])
        step = inverse(poses[k]) @ poses[other]
        there = points(int(numbers[other])) @ step[:3, :3].T + step[:3, 3]
        measured = doubling(points(int(numbers[k])), there)
        if measured is not None:
            found[int(numbers[k])] = measured
    return found
