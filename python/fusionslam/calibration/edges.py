# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Scores the alignment of a scan's depth edges with image edges, for many calibrations at once.

Levinson and Thrun 2013, "Automatic Online Calibration of Cameras and Lasers": points before a jump
in depth should project onto strong image gradients; a map that decays slowly around each gradient
rewards near misses. Castorena, Kamilov and Boufounos 2016 align edges in a similar way.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from fusionslam.base.arrays import Floats, Image
from fusionslam.sensors.frame import Camera

# Larger jumps count as this one: else open doors would outweigh all other edges.
_LARGEST_JUMP = 3.0
_NEAREST = 0.5
# Rings of some scanners are ten times as far apart as the points on them.
_NEIGHBOURS = 24
_OPPOSITE, _ABOVE, _BELOW = [1, 0, 3, 2], 2, 3  # sides are left, right, above, below
_STRAIGHT = -0.9  # cosine between the directions of opposite neighbours
_FAR = 3  # neighbours this many times further away than is usual are none
_BEYOND = 1000.0  # metres; a plane seen beyond its horizon is nowhere
# Weight of a pixel's own gradient against that of its surroundings: Levinson and Thrun's alpha.
_OWN_SHARE = 1 / 3
# Number of parts of a frame whose scores are compared to estimate standard errors.
STRIPS = 12
# Side of the square that a pixel is compared with, in multiples of the reach.
_SURROUNDINGS = 4


def depth_edges(
    points: NDArray[np.float32], up: Floats, jump: float
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Find where a surface ends and the depth jumps to something further away.

    Each point is compared with its nearest neighbours to the left, to the right and above. A
    neighbour is behind an edge if it is further away than the surface would be there, continued
    as a plane from the neighbour opposite. So a floor has no edges, however flat the angle and
    far apart the rings that hit it. Nor has the pavement behind a kerb: the neighbour must also be
    behind the edge as its own surface continues towards it. The scan need not have rings.

    The edge is somewhere between the point and its neighbour, so the middle is taken, at the
    point's distance: edges of objects that stand on the ground are mostly upper edges, and taking
    the points themselves would shift all of them down by half the distance between two rings.
    Lower edges are left out, because images show the edge of the shadow below them instead.

    Args:
        points: float32 (N, 3), metres, with the scanner at the origin.
        up: float64 (3), roughly the upward direction of the image.
        jump: smallest jump, metres; it is at least a twentieth of the distance.

    Returns:
        float64 (M, 3) points; float64 (M) weights: the square root of the jump up to 3 m, less
        where the angle between the two points is larger than in most of the scan; bool (M) whether
        the neighbour is above, not at a side.
    """
    distance = np.linalg.norm(points, axis=1).astype(np.float64)
    seen = np.isfinite(distance) & (distance > _NEAREST)
    distance = distance[seen]
    if len(distance) < 2:
        return np.zeros((0, 3)), np.zeros(0), np.zeros(0, bool)
    rays = points[seen].astype(np.float64) / distance[:, None]
    near, gaps, opposed = _neighbours(rays, up)
    small = np.percentile(gaps[opposed], 25) if opposed.any() else 1.0
    opposed[:, _BELOW] = False
    # On a plane the inverse of the distance is a linear function of the ray.
    inverse = 1 / distance[:, None]
    slope = (inverse - inverse[near[:, _OPPOSITE], 0]) / gaps[:, _OPPOSITE]
    expected = 1 / np.clip(inverse + slope * gaps, 1 / _BEYOND, inverse)
    behind = np.where(opposed, distance[near] - expected, 0)
    least = np.maximum(jump, distance / 20)[:, None]
    sure = behind > least
    # The point on a kerb and the one on the road make a ramp, which the pavement is behind.
    sides = np.arange(len(_OPPOSITE))
    slope = (inverse[near, 0] - inverse[near[near, sides], 0]) / gaps[near, sides]
    before = 1 / np.clip(inverse[near, 0] + slope * gaps, 1 / _BEYOND, 1 / _NEAREST)
    sure &= (before - distance[:, None] > least) | ~opposed[near, sides]
    edge = np.flatnonzero(sure.any(axis=1))
    nearest = np.where(sure, gaps, np.inf)[edge].argmin(axis=1)
    middle = rays[edge] + rays[near[edge, nearest]]
    middle *= (distance[edge] / np.linalg.norm(middle, axis=1))[:, None]
    jumps = np.minimum(behind[edge].max(axis=1), _LARGEST_JUMP)
    weights = np.sqrt(jumps) * small / np.maximum(gaps[edge, nearest], small)
    return middle, weights, nearest == _ABOVE


def _neighbours(rays: Floats, up: Floats) -> tuple[NDArray[np.int64], Floats, NDArray[np.bool_]]:
    """Nearest rays to the left, right, above and below.

    Returns:
        (N, 4) indices, (N, 4) angles to them in radians, and (N, 4) whether there is one that is
        not unusually far, with another straight opposite.
    """
    count = min(_NEIGHBOURS, len(rays) - 1)
    gaps, near = (each[:, 1:] for each in cKDTree(rays).query(rays, k=count + 1))
    right = np.cross(rays, up)
    above = np.cross(right, rays)
    steps = rays[near] - rays[:, None]
    across, along = (np.einsum("nki,ni->nk", steps, axis) for axis in (right, above))
    sides = np.stack([-across, across, along, -along], axis=1)  # (N, 4, count)
    own = sides >= np.maximum(np.abs(across), np.abs(along))[:, None]
    own &= (gaps > 0)[:, None]
    # Columns are in the order of the angle: the first on a side is the nearest.
    first = own.argmax(axis=2)
    found = own.any(axis=2)
    index, angle = np.take_along_axis(near, first, 1), np.take_along_axis(gaps, first, 1)
    towards = np.take_along_axis(steps, first[..., None], 1) / np.where(found, angle, 1)[..., None]
    straight = (towards * towards[:, _OPPOSITE]).sum(axis=2) < _STRAIGHT
    for pair in ([0, 1], [2, 3]):
        usual = np.median(angle[:, pair][found[:, pair]]) if found[:, pair].any() else 0
        found[:, pair] &= angle[:, pair] <= _FAR * usual
    return index, np.where(found, angle, 1), found & found[:, _OPPOSITE] & straight


def edge_map(image: Image, reach: float) -> NDArray[np.float32]:
    """Strength of upright and of level edges at each pixel: float32 (2, H, W), -1 to 1.

    Strong gradients count 1 and decay around them by 1/e in ``reach`` pixels. Unlike in Levinson
    and Thrun, the mean over a square is then subtracted.
    """
    grey = image.mean(axis=2) if image.ndim == 3 else image.astype(np.float64)
    smooth = ndimage.gaussian_filter(grey, 1.0)
    gradients = np.abs([ndimage.sobel(smooth, axis) for axis in (1, 0)])
    strong = np.percentile(np.hypot(*gradients), 98)
    own = np.minimum(gradients / strong, 1) if strong > 0 else gradients
    around, fall = own.copy(), np.exp(-1 / reach)
    for kind in around:
        for lines in (kind, kind[::-1], kind.T, kind.T[::-1]):
            for before, line in pairwise(lines):
                np.maximum(line, fall * before, out=line)
    felt = _OWN_SHARE * own + (1 - _OWN_SHARE) * around
    # Else a rotation towards busier texture, such as trees, would raise the score by itself.
    side = 2 * round(_SURROUNDINGS * reach / 2) + 1  # odd: the pixel is in the middle
    return np.asarray(felt - ndimage.uniform_filter(felt, (0, side, side)), np.float32)


@dataclass(frozen=True, eq=False)
class EdgeView:
    """Depth edges of one scan and the edge map of one image.

    Attributes:
        points: float64 (M, 3), in the scan's frame.
        weights: float64 (M).
        level: bool (M), whether each is compared with level edges of the image, else with upright
            ones, which a turn up or down moves it along.
        strips: int64 (M), vertical strip of the image that each point lies in at present.
        edges: float32 (2, H, W), from ``edge_map``.
        camera: with the present calibration.
    """

    points: Floats
    weights: Floats
    level: NDArray[np.bool_]
    strips: NDArray[np.int64]
    edges: NDArray[np.float32]
    camera: Camera

    @classmethod
    def of(
        cls,
        points: Floats,
        weights: Floats,
        level: NDArray[np.bool_],
        edges: NDArray[np.float32],
        camera: Camera,
        most: int,
    ) -> "EdgeView":
        """Keep the points that are in the image at present, evenly thinned to at most ``most``."""
        columns, _, inside = _pixels(
            points, camera, camera.rectified_from_points[None], edges.shape[1:]
        )
        kept = np.flatnonzero(inside[0])
        kept = kept[:: max(-(-len(kept) // most), 1)]
        strips = columns[0, kept] * STRIPS // edges.shape[2]
        return cls(points[kept], weights[kept], level[kept], strips, edges, camera)

    def scores(self, rectified_from_points: Floats) -> Floats:
        """Sum of the points' scores in each strip: float64 (K, STRIPS).

        A point outside the image scores the image's mean, so that leaving the image neither
        raises nor lowers the score.

        Args:
            rectified_from_points: float64 (K, 4, 4), the calibrations to judge.
        """
        member = np.eye(STRIPS)[self.strips] * self.weights[:, None]
        level, scores = self.level.astype(np.int64), []
        outside = self.edges.mean(axis=(1, 2))[level]
        for chunk in np.array_split(rectified_from_points, -(-len(rectified_from_points) // 128)):
            columns, rows, inside = _pixels(self.points, self.camera, chunk, self.edges.shape[1:])
            values = np.where(inside, self.edges[level, rows, columns], outside)
            scores.append(values @ member)
        return np.concatenate(scores)


def in_view(
    points: NDArray[np.float32], camera: Camera, shape: tuple[int, ...]
) -> NDArray[np.float32]:
    """Select the points of a scan that project into an image of this shape."""
    _, _, inside = _pixels(points, camera, camera.rectified_from_points[None], shape)
    return np.asarray(points[inside[0]])


def _pixels(
    points: Floats | NDArray[np.float32],
    camera: Camera,
    rectified_from_points: Floats,
    shape: tuple[int, ...],
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
    """Column, row and whether inside the image, (K, M) each; points outside have pixel 0, 0."""
    projection = camera.projection @ rectified_from_points
    seen = projection[:, :, :3] @ points.T + projection[:, :, 3:]
    depth = seen[:, 2]
    ahead = depth > _NEAREST
    pixels = np.round(seen[:, :2] / np.where(ahead, depth, 1)[:, None])
    limits = np.array([shape[1], shape[0]])[None, :, None]
    inside = ahead & ((pixels >= 0) & (pixels < limits)).all(axis=1)
    columns, rows = np.where(inside[:, None], pixels, 0).astype(np.int64).transpose(1, 0, 2)
    return columns, rows, inside
