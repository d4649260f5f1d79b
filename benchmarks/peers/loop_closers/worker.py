# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Finds loops by MapClosures and by the loop closer of KISS-SLAM; runs in their environment.

worker.py INPUT.npz OUTPUT.npz

INPUT: points float32 (P, 3) of all clouds and where each ends, ends int64 (N,); poses float64
(N, 4, 4), world_from_cloud, by which ``scans`` clouds are joined to a local map of the middle one;
older int64 (N,), the number of the first clouds, which are the candidates of each.
OUTPUT: of each cloud the candidate with the most inliers, its pose, score and whether it was
accepted. Arrays (1, N, ...) of what MapClosures says; (2, N, ...) where there are local maps, of
which KISS-SLAM's closer judges those that MapClosures accepts. The score is the number of inliers;
loops that the closer accepts come before all others.
"""

import sys
import time
from typing import Any

import numpy as np
from kiss_slam.config import LoopCloserConfig
from kiss_slam.loop_closer import LoopCloser
from kiss_slam.voxel_map import VoxelMap
from map_closures.config import MapClosuresConfig
from map_closures.map_closures import MapClosures

CANDIDATES = 100
"""Asked of MapClosures, whose own candidates include frames that are too young."""


def local_map(clouds: list[Any], poses: Any, row: int, scans: int, size: float) -> VoxelMap:
    """Join the clouds around that in a row, in its frame, one point a voxel."""
    joined = VoxelMap(size)
    first = max(row - scans // 2, 0)
    for other in range(first, min(first + scans, len(clouds))):
        joined.integrate_frame(clouds[other], np.linalg.inv(poses[row]) @ poses[other])
    return joined


def find_loops(given: Any) -> dict[str, Any]:
    """Return match, match_from_query, score, accepted and seconds of each cloud."""
    clouds = np.split(given["points"], given["ends"][:-1])
    count, limits, scans = len(clouds), given["older"], int(given["scans"])
    config, closer = MapClosuresConfig(), LoopCloser(LoopCloserConfig())
    detector, maps = MapClosures(config), []
    judges = 2 if scans > 1 else 1
    match, score = np.full((judges, count), -1), np.zeros((judges, count))
    accepted, seconds = np.zeros((judges, count), np.bool_), np.zeros((judges, count))
    poses = np.full((judges, count, 4, 4), np.nan)
    for row, cloud in enumerate(clouds):
        points = cloud.astype(np.float64)
        if scans > 1:
            joined = local_map(clouds, given["poses"], row, scans, config.density_map_resolution)
            points = joined.point_cloud()
            maps.append(joined.open3d_pcd_with_normals())
        start = time.process_time()
        found = detector.get_top_k_closures(row, points, CANDIDATES)
        older = [each for each in found if each.source_id < limits[row]]
        if older:
            best = max(older, key=lambda each: each.number_of_inliers)
            match[:, row], score[:, row] = best.source_id, best.number_of_inliers
            accepted[:, row] = best.number_of_inliers >= config.inliers_threshold
            poses[:, row] = np.linalg.inv(best.pose)
        seconds[:, row] = time.process_time() - start
        if maps and accepted[1, row]:
            start = time.process_time()
            accepted[1, row], query_from_match = closer.validate_closure(
                maps[best.source_id], maps[row], best.pose
            )
            poses[1, row] = np.linalg.inv(query_from_match)
            seconds[1, row] += time.process_time() - start
    if maps:
        score[1, accepted[1]] += score.max()
    return {
        "match": match,
        "match_from_query": poses,
        "score": score,
        "accepted": accepted,
        "seconds": seconds,
    }


if __name__ == "__main__":
    with np.load(sys.argv[1]) as stored:
        result = find_loops(dict(stored))
    np.savez(sys.argv[2], **result)
