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

from fusionslam.sensors.frame import Camera
from fusionslam.storage.arrays import Floats, Image

# Larger jumps count as this one: else open doors would outweigh all other edges.
_LARGEST_JUMP = 3.0
_NEIGHBOURS = 4
_NEAREST = 0.5
# Weight of a pixel's own gradient against that of its surroundings: Levinson and Thrun's alpha.
_OWN_SHARE = 1 / 3
# Number of parts of a frame whose scores are compared to estimate standard errors.
STRIPS = 12
# Side of the square that a pixel is compared with, in multiples of the reach.
_SURROUNDINGS = 4


def depth_edges(points: NDArray[np.float32], jump: float) -> tuple[Floats, Floats]:
    """Find the points of a scan beside which the depth jumps to something further away.

    Neighbours are points in nearly the same direction from the scanner, such as the next ones on
    a ring; the scan need not have rings.

    Args:
        points: float32 (N, 3), metres, with the scanner at the origin.
        jump: smallest jump, metres; it is at least a twentieth of the distance.

    Returns:
        float64 (M, 3) points and float64 (M) weights, the square root of the jump up to 3 m.
    """
    distance = np.linalg.norm(points, axis=1).astype(np.float64)
    seen = np.isfinite(distance) & (distance > _NEAREST)
    points, distance = points[seen].astype(np.float64), distance[seen]
    if len(points) <= _NEIGHBOURS:
        return np.zeros((0, 3)), np.zeros(0)
    angles, near = cKDTree(points / distance[:, None]).query(
        points / distance[:, None], k=_NEIGHBOURS + 1
    )
    close = angles[:, 1:] < 3 * np.median(angles[:, 1:], axis=0)
    behind = np.where(close, distance[near[:, 1:]] - distance[:, None], 0).max(axis=1)
    edge = behind > np.maximum(jump, distance / 20)
    return points[edge], np.sqrt(np.minimum(behind[edge], _LARGEST_JUMP))


def edge_map(image: Image, reach: float) -> NDArray[np.float32]:
    """Edge strength of each pixel relative to its surroundings: float32 (H, W), -1 to 1.

    Strong gradients count 1 and decay around them by 1/e in ``reach`` pixels. Unlike in Levinson
    and Thrun, the mean over a square is then subtracted.
    """
    grey = image.mean(axis=2) if image.ndim == 3 else image.astype(np.float64)
    smooth = ndimage.gaussian_filter(grey, 1.0)
    gradient = np.hypot(ndimage.sobel(smooth, 0), ndimage.sobel(smooth, 1))
    strong = np.percentile(gradient, 98)
    own = np.minimum(gradient / strong, 1) if strong > 0 else gradient
    around, fall = own.copy(), np.exp(-1 / reach)
    for lines in (around, around[::-1], around.T, around.T[::-1]):
        for before, line in pairwise(lines):
            np.maximum(line, fall * before, out=line)
    felt = _OWN_SHARE * own + (1 - _OWN_SHARE) * around
    # Else a rotation towards busier texture, such as trees, would raise the score by itself.
    side = 2 * round(_SURROUNDINGS * reach / 2) + 1  # odd: the pixel is in the middle
    return np.asarray(felt - ndimage.uniform_filter(felt, side), np.float32)


@dataclass(frozen=True, eq=False)
class EdgeView:
    """Depth edges of one scan and the edge map of one image.

    Attributes:
        points: float64 (M, 3), in the scan's frame.
        weights: float64 (M).
        strips: int64 (M), vertical strip of the image that each point lies in at present.
        edges: float32 (H, W), from ``edge_map``.
        camera: with the present calibration.
    """

    points: Floats
    weights: Floats
    strips: NDArray[np.int64]
    edges: NDArray[np.float32]
    camera: Camera

    @classmethod
    def of(
        cls, points: Floats, weights: Floats, edges: NDArray[np.float32], camera: Camera, most: int
    ) -> "EdgeView":
        """Keep the points that are in the image at present, evenly thinned to at most ``most``."""
        columns, _, inside = _pixels(
            points, camera, camera.rectified_from_points[None], edges.shape
        )
        kept = np.flatnonzero(inside[0])
        kept = kept[:: max(-(-len(kept) // most), 1)]
        strips = columns[0, kept] * STRIPS // edges.shape[1]
        return cls(points[kept], weights[kept], strips, edges, camera)

    def scores(self, rectified_from_points: Floats) -> Floats:
        """Sum of the points' scores in each strip: float64 (K, STRIPS).

        A point outside the image scores the image's mean, so that leaving the image neither
        raises nor lowers the score.

        Args:
            rectified_from_points: float64 (K, 4, 4), the calibrations to judge.
        """
        member = np.eye(STRIPS)[self.strips] * self.weights[:, None]
        chunks = np.array_split(rectified_from_points, -(-len(rectified_from_points) // 128))
        return np.concatenate([self._values(chunk) @ member for chunk in chunks])

    def _values(self, rectified_from_points: Floats) -> Floats:
        columns, rows, inside = _pixels(
            self.points, self.camera, rectified_from_points, self.edges.shape
        )
        return np.where(inside, self.edges[rows, columns], self.edges.mean())


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
