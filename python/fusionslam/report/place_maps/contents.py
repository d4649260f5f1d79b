# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A map ready to draw: its drives by odometry and after correction, and its loops against drift."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fusionslam._core import OdometryTree
from fusionslam.base.arrays import Floats, Integers
from fusionslam.evaluation import trajectory_error
from fusionslam.geometry.rigid import fit_motion
from fusionslam.geometry.se3 import inverse, log
from fusionslam.mapping import Edge, PlaceMap

_MEDIAN = 5.348
"""Of chi square with six degrees of freedom."""


class LoopFit(NamedTuple):
    """How far a loop is from where odometry has its end, and how far the drift model allows it.

    Attributes:
        metres: driven between both keyframes.
        error_m, error_deg: between loop and odometry.
        promised_m, promised_deg: standard deviations of drift and loop, in the error's direction.
        chi_square: of the error, with six degrees of freedom.
    """

    edge: Edge
    metres: float
    error_m: float
    error_deg: float
    promised_m: float
    promised_deg: float
    chi_square: float


@dataclass(frozen=True, eq=False)
class Drive:
    """A session.

    Attributes:
        name: of the session.
        numbers: int64 (n), its keyframes.
        parts: int64 (n), the part of the map that each belongs to: its first keyframe.
        poses: float64 (n, 4, 4), map_from_robot.
        odometry: float64 (n, 4, 4), moved to where it fits the map best.
        truth: float64 (n, 4, 4), NaN where it is unknown; None without any.
        metres: driven, by odometry.
        odometry_error, error: ATE in metres of odometry and of the map, each part of it aligned by
            itself; None without truth.
    """

    name: str
    numbers: Integers
    parts: Integers
    poses: Floats
    odometry: Floats
    truth: Floats | None
    metres: float
    odometry_error: float | None
    error: float | None

    @property
    def part_count(self) -> int:
        """Number of parts of the map that the session is in."""
        return len(np.unique(self.parts))


def read_drives(site: PlaceMap, truth: Mapping[str, Floats] | None = None) -> list[Drive]:
    """Return the sessions of a map.

    Args:
        site: the map.
        truth: float64 (n, 4, 4), of each session whose keyframes' true poses are known.
    """
    content = site.content
    parts = {each.id: part for each, part in zip(content.keyframes, content.parts, strict=True)}
    return [
        _read_drive(site, session.name, parts, (truth or {}).get(session.name))
        for session in site.sessions
        if session.keyframes
    ]


def _read_drive(site: PlaceMap, name: str, parts: dict[int, int], truth: Floats | None) -> Drive:
    numbers = site.keyframes(name)
    own = np.array([parts[number] for number in numbers.tolist()], np.int64)
    poses, odometry = site.trajectory(name)[1], site.odometry(name)
    known = truth is not None and bool(np.isfinite(truth).all(axis=(1, 2)).any())
    steps = np.diff(odometry[:, :3, 3], axis=0)
    return Drive(
        name=name,
        numbers=numbers,
        parts=own,
        poses=poses,
        odometry=poses[0] @ inverse(odometry[:1]) @ odometry,
        truth=_move_to(poses, own, truth) if known and truth is not None else None,
        metres=float(np.linalg.norm(steps, axis=1).sum()),
        odometry_error=trajectory_error(odometry, truth) if known and truth is not None else None,
        error=trajectory_error(poses, truth, own) if known and truth is not None else None,
    )


def _move_to(poses: Floats, parts: Integers, truth: Floats) -> Floats:
    """True poses in the frame of each part of the map."""
    moved = truth.copy()
    for part in np.unique(parts):
        rows = (parts == part) & np.isfinite(truth).all(axis=(1, 2))
        if rows.any():
            moved[rows] = fit_motion(truth[rows], poses[rows]) @ truth[rows]
    return moved


def fit_loops(edges: Sequence[Edge], loops: Sequence[Edge]) -> list[LoopFit]:
    """Compare loops with odometry, where odometry connects their keyframes.

    Args:
        edges: of a map, with its odometry.
        loops: some of them.
    """
    tree, node, driven = OdometryTree(), {}, {}
    steps = sorted((edge for edge in edges if edge.kind == "odometry"), key=lambda edge: edge.b)
    for step in steps:
        if step.a not in node:
            node[step.a], driven[step.a] = tree.add_root(np.eye(4)), 0.0
        node[step.b] = tree.add(node[step.a], step.pose, step.covariance)
        driven[step.b] = driven[step.a] + float(np.linalg.norm(step.pose[:3, 3]))
    return [
        _fit_loop(tree, node[loop.a], node[loop.b], loop, abs(driven[loop.b] - driven[loop.a]))
        for loop in loops
        if loop.a in node and loop.b in node and tree.root(node[loop.a]) == tree.root(node[loop.b])
    ]


def _fit_loop(tree: OdometryTree, a: int, b: int, loop: Edge, metres: float) -> LoopFit:
    error = log(inverse(loop.pose) @ inverse(tree.pose(a)) @ tree.pose(b))
    fit = tree.fit(a, b, error.tolist(), loop.covariance, 1.0)
    covariance = tree.drift(a, b) + loop.covariance
    return LoopFit(
        loop,
        metres,
        fit[0],
        float(np.degrees(fit[1])),
        fit[2],
        float(np.degrees(fit[3])),
        float(error @ np.linalg.solve(covariance, error)),
    )


def drift_factor(fits: Sequence[LoopFit]) -> float | None:
    """By how many times odometry's errors along believed loops exceed the model's, in the median.

    None without such a loop.
    """
    believed = [fit.chi_square for fit in fits if fit.edge.state == "believed"]
    return float(np.sqrt(np.median(believed) / _MEDIAN)) if believed else None
