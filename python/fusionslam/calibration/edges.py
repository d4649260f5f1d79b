# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How well the depth edges of a scan lie on the edges of an image, for many calibrations at once.

Levinson and Thrun 2013, "Automatic Online Calibration of Cameras and Lasers": points before a jump
in depth should fall onto strong gradients of the image; a map that falls off slowly around each
gradient rewards those that come near. Castorena, Kamilov and Boufounos 2016 align edges alike.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from fusionslam.sensors.frame import Camera
from fusionslam.storage.arrays import Floats, Image

# Beyond this, a jump is no more an edge than another: open doors would outweigh all else.
_LARGEST_JUMP = 3.0
_NEIGHBOURS = 4
_NEAREST = 0.5
# Share of a pixel's own gradient against that of its surroundings: Levinson and Thrun's alpha.
_OWN_SHARE = 1 / 3
# The parts of a frame whose scores are compared, to tell chance from gain.
STRIPS = 12
# Side of the square that a pixel is compared with, in times the reach.
_SURROUNDINGS = 4


def depth_edges(points: NDArray[np.float32], jump: float) -> tuple[Floats, Floats]:
    """The points of a scan right before something that is further away.

    Neighbours are those in nearly the same direction from the scanner, which along a ring are its
    neighbours in it; a hundred rings or none make no difference.

    Args:
        points: float32 (N, 3), metres, seen from the origin.
        jump: metres, and at least a twentieth of the distance.

    Returns:
        float64 (M, 3) points and float64 (M) weights, the root of the jump up to 3 m.
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
    """How much more edge there is at a pixel than around it: float32 (H, W), -1 to 1.

    Strong gradients count 1 and fall off around them by 1/e in ``reach`` pixels; of that the mean
    over a square is taken away, as Levinson and Thrun do not.
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
    # Else a turn towards busier texture, such as trees, would pay wherever the edges fall in it.
    side = 2 * round(_SURROUNDINGS * reach / 2) + 1  # odd: the pixel is in the middle
    return np.asarray(felt - ndimage.uniform_filter(felt, side), np.float32)


@dataclass(frozen=True, eq=False)
class EdgeView:
    """Depth edges of one scan and the edge map of one image.

    Attributes:
        points: float64 (M, 3), in the scan's frame.
        weights: float64 (M).
        strips: int64 (M), in which vertical strip of the image each point lies at present.
        edges: float32 (H, W), of ``edge_map``.
        camera: as the present calibration has it.
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
        """Keep the points that are in the image now, evenly thinned to at most ``most``."""
        columns, _, inside = _pixels(
            points, camera, camera.rectified_from_points[None], edges.shape
        )
        kept = np.flatnonzero(inside[0])
        kept = kept[:: max(-(-len(kept) // most), 1)]
        strips = columns[0, kept] * STRIPS // edges.shape[1]
        return cls(points[kept], weights[kept], strips, edges, camera)

    def scores(self, rectified_from_points: Floats) -> Floats:
        """Summed score of the points of each strip: float64 (K, STRIPS).

        A point that falls outside of the image counts as the image's mean: leaving it neither
        pays nor costs.

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
    """The points of a scan that fall into an image of this shape."""
    _, _, inside = _pixels(points, camera, camera.rectified_from_points[None], shape)
    return np.asarray(points[inside[0]])


def _pixels(
    points: Floats | NDArray[np.float32],
    camera: Camera,
    rectified_from_points: Floats,
    shape: tuple[int, ...],
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
    """Column, row, and whether in the image, (K, M) each; those outside have pixel 0, 0."""
    projection = camera.projection @ rectified_from_points
    seen = projection[:, :, :3] @ points.T + projection[:, :, 3:]
    depth = seen[:, 2]
    ahead = depth > _NEAREST
    pixels = np.round(seen[:, :2] / np.where(ahead, depth, 1)[:, None])
    limits = np.array([shape[1], shape[0]])[None, :, None]
    inside = ahead & ((pixels >= 0) & (pixels < limits)).all(axis=1)
    columns, rows = np.where(inside[:, None], pixels, 0).astype(np.int64).transpose(1, 0, 2)
    return columns, rows, inside
