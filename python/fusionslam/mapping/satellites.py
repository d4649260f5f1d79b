# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Puts a solved pose graph on the globe, and improves it, by fixes of a satellite receiver."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from fusionslam.base.arrays import Floats, Integers, Mask, Matrix
from fusionslam.errors import DataError, ShapeError
from fusionslam.geometry.globe import MapOrigin, from_geographic, geographic
from fusionslam.geometry.rigid import rotation
from fusionslam.geometry.se3 import inverse
from fusionslam.mapping.edge import Edge
from fusionslam.mapping.gtsam_extra import Anchor, Solver
from fusionslam.registration.result import Refusal

FEWEST = 10
"""Positions that place a map."""
_MOST_HEADING_SD = 0.05  # rad: beyond it, the way is too short for its positions
_FEWEST_BELIEVED = 0.5  # part of the positions
_MOST_AS_ONE = 100.0  # positions whose errors are alike
_MOST_ROUNDS = 4  # of solving with the positions that fit
_CHI2_999, _CHI2_MEDIAN = 16.26623619623813, 2.3659738843753377
"""scipy.stats.chi2.ppf([.999, .5], 3), without its import."""


@dataclass(frozen=True, eq=False)
class Position:
    """A measured position of a point that is fixed to a node.

    Attributes:
        node: its number.
        arm: float64 (3), the point in the node's frame, metres.
        place: float64 (3), latitude, longitude, degrees, and metres above the ellipsoid of WGS 84.
        covariance: float64 (3, 3), m^2, east, north, up.

    Raises:
        ShapeError: an array has another shape.
        DataError: a value is not finite (code "not-finite"), or the covariance not positive
            definite ("not-positive-definite"); the field is its name.
    """

    node: int
    arm: Matrix
    place: Matrix
    covariance: Floats

    def __post_init__(self) -> None:
        for name, shape in (("arm", (3,)), ("place", (3,)), ("covariance", (3, 3))):
            values = np.asarray(getattr(self, name), np.float64)
            if values.shape != shape:
                raise ShapeError(f"{name} has shape {values.shape}, expected {shape}")
            if not np.isfinite(values).all():
                raise DataError(f"{name} is not finite", code="not-finite", fields=(name,))
        if np.linalg.eigvalsh(self.covariance)[0] <= 0:
            raise DataError(
                f"covariance is {self.covariance.tolist()}: expected a positive definite one",
                code="not-positive-definite",
                fields=("covariance",),
            )


class Placement(NamedTuple):
    """Where a part of a graph is on the globe.

    Attributes:
        poses: float64 (n, 4, 4), map_from_node. The map's z axis points up; x, y, z and heading of
            its first node are as before.
        origin: of the map.
        believed: bool (m), the positions that fit.
        factor: by which stated deviations are too small for how positions differ from one to the
            next; 1 if they are not.
    """

    poses: Floats
    origin: MapOrigin
    believed: Mask
    factor: float


def place_on_globe(
    poses: Floats, rows: Integers, edges: Sequence[Edge], positions: Sequence[Position]
) -> Placement | Refusal:
    """Move a part of a graph to where its edges and measured positions fit best.

    Positions that are far off weigh less from the start (first by Huber's kernel, whose
    minimum is one, then by Cauchy's); at last those count that fit (chi square .999). Where steps
    from one to the next err less than stated, errors of neighbours correlate, by multipath or a
    filter in the receiver: as in a Gauss-Markov process, several count as one then.

    Args:
        poses: float64 (n, 4, 4), of all nodes.
        rows: int64 (k), nodes of the part, ascending.
        edges: believed ones, which connect all of the part's nodes; others are left out.
        positions: of the part's nodes in the order of time.

    Returns:
        The placement, or why there is none: codes "few-fixes" (number of positions), "no-heading"
        (standard deviation of the heading, rad), "fixes-disagree" (part of them that is believed).

    Raises:
        FusionSlamError: GTSAM or pyproj is not installed (code "missing-extra").
    """
    if len(positions) < FEWEST:
        text = f"{len(positions)} fixes lie on the map's way: expected {FEWEST} or more"
        return Refusal("few-fixes", len(positions), text)
    row = {node: k for k, node in enumerate(rows.tolist())}
    start = poses[rows]
    nodes = np.array([row[each.node] for each in positions])
    arms = np.array([each.arm for each in positions])
    places = np.array([each.place for each in positions])[:, [1, 0, 2]]
    covariances = np.array([each.covariance for each in positions])
    # Latitude and longitude near the way, by which it is turned; then those of the map itself.
    near = np.median(places, axis=0)
    middle = MapOrigin(latitude=near[1], longitude=near[0], altitude=near[2])
    points = _points(start, nodes, arms)
    turned = _align(points, from_geographic(places, middle))
    origin = _move(middle, turned)
    targets = from_geographic(places, origin)
    covariances = _turned(covariances, origin)
    ratio = _step_ratio(points, targets, covariances)
    factor = max(np.sqrt(ratio), 1.0)
    covariances = covariances * factor**2
    spread = np.linalg.norm(points[:, :2] - points[:, :2].mean(axis=0))
    heading_sd = float(np.sqrt(np.median(covariances[:, 0, 0] + covariances[:, 1, 1]) / 2) / spread)
    if not heading_sd < _MOST_HEADING_SD:
        text = (
            f"the way is too short for its fixes: they tell its heading to {heading_sd:.2g} rad, "
            f"expected {_MOST_HEADING_SD:g}"
        )
        return Refusal("no-heading", heading_sd, text)
    inner = [replace(e, a=row[e.a], b=row[e.b]) for e in edges if e.a in row and e.b in row]
    measured = zip(nodes.tolist(), arms, targets, covariances, strict=True)
    anchors = [Anchor(*each) for each in measured]
    solver = Solver(start, inner, rows[:0], level=0)
    moved = solver.solve([], anchors=anchors, kernel="huber")
    moved = solver.solve([], anchors=anchors, kernel="cauchy")
    for _ in range(_MOST_ROUNDS):
        fits = _squares(_points(moved, nodes, arms) - targets, covariances) <= _CHI2_999
        if fits.mean() < _FEWEST_BELIEVED:
            text = (
                f"{fits.mean():.0%} of {len(fits)} fixes agree with odometry and loops, expected "
                f"{_FEWEST_BELIEVED:.0%}: they are left out"
            )
            return Refusal("fixes-disagree", float(fits.mean()), text)
        moved = solver.solve([], anchors=[anchors[k] for k in np.flatnonzero(fits).tolist()])
        if np.array_equal(
            fits, _squares(_points(moved, nodes, arms) - targets, covariances) <= _CHI2_999
        ):
            break
    if ratio < 1:  # neighbours correlate by 1 - ratio: so many count as one
        several = min((2 - ratio) / max(ratio, 1e-9), _MOST_AS_ONE)
        kept = [anchors[k] for k in np.flatnonzero(fits).tolist()]
        moved = solver.solve(
            [], anchors=[each._replace(covariance=several * each.covariance) for each in kept]
        )
    back = _upright(start[0]) @ inverse(_upright(moved[0]))
    return Placement(back @ moved, _move(origin, inverse(back)), fits, factor)


def _points(poses: Floats, nodes: Integers, arms: Floats) -> Floats:
    """Where nodes' points are, float64 (m, 3)."""
    here = poses[nodes]
    return np.asarray(here[:, :3, 3] + np.einsum("nij,nj->ni", here[:, :3, :3], arms))


def _align(points: Floats, targets: Floats) -> Matrix:
    """float64 (4, 4): turn about z and shift that bring points to targets, by least distances.

    Weights are inverse distances, so that a few that are far off count little.
    """
    weights, moved = np.ones(len(points)), np.eye(4)
    for _ in range(30):
        share = weights / weights.sum()
        centre, aim = share @ points, share @ targets
        p, t = (points - centre)[:, :2], (targets - aim)[:, :2]
        angle = np.arctan2(
            share @ (p[:, 0] * t[:, 1] - p[:, 1] * t[:, 0]), share @ (p * t).sum(axis=1)
        )
        moved[:3, :3] = rotation([0, 0, angle])
        moved[:3, 3] = aim - moved[:3, :3] @ centre
        off = points @ moved[:3, :3].T + moved[:3, 3] - targets
        weights = 1 / np.maximum(np.linalg.norm(off, axis=1), 0.1)
    return moved


def _step_ratio(points: Floats, targets: Floats, covariances: Floats) -> float:
    """Squared errors of steps between positions, of those stated; odometry knows steps well."""
    errors = np.diff(targets - points, axis=0)
    squares = _squares(errors, covariances[:-1] + covariances[1:])
    return float(np.median(squares) / _CHI2_MEDIAN)


def _squares(errors: Floats, covariances: Floats) -> Floats:
    weighted = np.linalg.solve(covariances, errors[..., None])[..., 0]
    return np.asarray((errors * weighted).sum(axis=1))


def _turned(covariances: Floats, origin: MapOrigin) -> Floats:
    """Covariances of east, north, up as those of a map's axes."""
    turn = rotation([0, 0, np.radians(origin.heading)])
    return np.asarray(turn.T @ covariances @ turn)


def _move(origin: MapOrigin, moved: Matrix) -> MapOrigin:
    """The origin of a map whose pose in the map of another origin is given; both are level."""
    longitude, latitude, altitude = geographic(moved[None, :3, 3], origin)[0].tolist()
    heading = origin.heading + float(np.degrees(np.arctan2(moved[1, 0], moved[0, 0])))
    return MapOrigin(
        latitude=latitude,
        longitude=longitude,
        altitude=altitude,
        heading=(heading + 180) % 360 - 180,
    )


def _upright(pose: Matrix) -> Matrix:
    """A pose without its tilt."""
    level = pose.copy()
    level[:3, :3] = rotation([0, 0, np.arctan2(pose[1, 0], pose[0, 0])])
    return level
