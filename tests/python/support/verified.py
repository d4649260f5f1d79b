# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Verified loops of nine frames, small enough to be judged by hand.

The body is a camera (z ahead, y down), the clouds are those of a scanner (x ahead, z up) 0.5 m
ahead of it and 0.2 m above. Two of the first four frames are passed again head-on, one in the same
direction and one crosswise; the last one is 10.5 m beyond the fourth.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.evaluation import REJECTED, VerifiedRun

Floats = NDArray[np.float64]

CAMERA_FROM_SCANNER = np.array([[0.0, -1, 0, 0], [0, 0, -1, -0.2], [1, 0, 0, 0.5], [0, 0, 0, 1]])
PLACES = [
    *((0, 0, 0), (20, 0, 0), (40, 0, 0), (60, 0, 0)),  # x, y in metres, heading in degrees
    *((41, 0, 180), (20, 2, 180), (1, 0, 0), (20.5, 0, 90), (70.5, 0, 0)),
]
LOOPS = {
    # query: match, probability, scanner in that of the match (x, y, degrees), error of the estimate
    4: (2, 0.9, (0, 0, 180), (0.99, 0, 0)),
    5: (1, 0.8, (-1, 2, 180), (1.5, 0, 0)),
    6: (0, 0.7, (1, 0, 0), (0, 0, 5.2)),
    7: (1, 0.6, (0, 0.5, 90), (0, 0, 4.8)),
    8: (3, 0.95, (10.5, 0, 0), (0, 0, 0)),
}


def planar(x: float, y: float, degrees: float) -> Floats:
    """A pose on the ground with x ahead and z up."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, 0], [0, 0, 0, 1]])


def verified_run(**change: Any) -> VerifiedRun:
    """The run; its detector accepted the queries 4, 5 and 8."""
    count = len(PLACES)
    axes = CAMERA_FROM_SCANNER.copy()
    axes[:3, 3] = 0
    match, distance = np.full(count, -1), np.full(count, np.inf)
    poses, covariance = np.full((count, 4, 4), np.nan), np.full((count, 6, 6), np.nan)
    probability, overlap = np.full((2, count), np.nan)
    for query, (other, likely, place, error) in LOOPS.items():
        match[query], probability[query] = other, likely
        distance[query] = np.inf if query == 5 else 0.1
        poses[query] = planar(*np.add(place, error))
        covariance[query], overlap[query] = np.eye(6), 0.75
    fields: dict[str, Any] = {
        "source": "lidar",
        "descriptors": ("m2dp", "scan_context"),
        "dataset": "nine frames",
        "frames": np.arange(count),
        "numbers": 10 * np.arange(count),
        "stamps_ns": np.arange(count) * 10**8,
        "poses": np.array([planar(*place) @ np.linalg.inv(axes) for place in PLACES]),
        "body_from_cloud": np.tile(CAMERA_FROM_SCANNER, (count, 1, 1)),
        "points": np.full(count, 1000),
        "match": match,
        "match_from_query": poses,
        "covariance": covariance,
        "overlap": overlap,
        "probability": probability,
        "distance": distance,
        "accepted": np.isin(np.arange(count), (4, 5, 8)),
        "candidates": np.array(
            [[-1] * 3] * 4 + [[2, 0, -1], [0, 1, -1], [3, 4, 0], [3, 2, 1], [3, -1, -1]]
        ),
        "rejected": np.array([(4, 0, "low-overlap", 0.1), (6, 3, "tilted", 170.0)], REJECTED),
        "seconds": {"describe": np.full(count, 0.02), "register": np.full(count, 0.1)},
        "config": {"fusion": {}},
        "skipped": {95: "empty"},
    }
    return VerifiedRun(**(fields | change))
