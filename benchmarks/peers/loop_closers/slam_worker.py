# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Maps a drive by KISS-SLAM; runs in its environment.

slam_worker.py INPUT.npz OUTPUT.npz

INPUT: points float32 (P, 3) of all clouds and where each ends, ends int64 (N,); poses float64
(N, 4, 4), odom_from_cloud, which take the place of its own odometry if there are any.
OUTPUT: poses float64 (N, 4, 4), map_from_cloud; closures int64 (L, 2), the scans at which the local
maps begin that are the same place; constraints float64 (L, 4, 4), later_from_earlier of them;
seconds, of processor time.
"""

import sys
import time
from typing import Any

import numpy as np
from kiss_icp.kiss_icp import KissICP
from kiss_slam.config import load_config
from kiss_slam.slam import KissSLAM


def follow(odometry: KissICP, poses: Any) -> None:
    """Let an odometry take the steps of given poses instead of registering scans."""
    steps = iter([np.eye(4), *(np.linalg.inv(poses[:-1]) @ poses[1:])])

    def register_frame(frame: Any, timestamps: Any) -> tuple[Any, Any]:
        source, points = odometry.voxelize(frame)
        odometry.last_pose = odometry.last_pose @ next(steps)
        odometry.local_map.update(points, odometry.last_pose)
        return frame, source

    odometry.register_frame = register_frame


def map_drive(given: Any) -> dict[str, Any]:
    """Return poses, closures, constraints and seconds."""
    clouds = np.split(given["points"], given["ends"][:-1])
    config = load_config(None)
    config.odometry.preprocessing.deskew = False  # each cloud is of one moment
    slam = KissSLAM(config)
    if len(given["poses"]):
        follow(slam.odometry, given["poses"])
    starts, found, compute = [0], [], slam.closer.compute

    def remember(*arguments: Any) -> Any:
        result = compute(*arguments)
        if result[0]:
            found.append(result[1:])
        return result

    slam.closer.compute = remember
    started = time.process_time()
    for row, cloud in enumerate(clouds):
        slam.process_scan(cloud.astype(np.float64), np.zeros(len(cloud)))
        if len(starts) <= slam.local_map_graph.last_id:
            starts.append(row)
    # As its own pipeline ends a drive.
    slam.generate_new_node()
    slam.local_map_graph.erase_last_local_map()
    poses, _ = slam.fine_grained_optimization()
    return {
        "poses": np.array(poses),
        "closures": np.array([[starts[a], starts[b]] for a, b, _ in found]).reshape(-1, 2),
        "constraints": np.array([pose for *_, pose in found]).reshape(-1, 4, 4),
        "seconds": time.process_time() - started,
    }


if __name__ == "__main__":
    with np.load(sys.argv[1]) as stored:
        result = map_drive(dict(stored))
    np.savez(sys.argv[2], **result)
