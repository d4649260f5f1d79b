# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Drives with view ids, and a judge of them that does everything by plain loops."""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fusionslam.evaluation import ViewRule

Drive = tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]


def random_drive(seed: int, count: int, views: int) -> Drive:
    """Ids (some negative), poses on a coarse grid of a small room, and stamps with pauses."""
    rng = np.random.default_rng(seed)
    ids = rng.integers(-1, max(views, 1), count)
    grid = rng.integers(0, 6, (count, 2)) * 0.2
    yaw = np.radians(rng.integers(-40, 40, (count, 1)) * 6.0)
    stamps = np.cumsum(rng.choice([0.0, 0.5, 5.0, 20.0], count))
    return ids, np.hstack([grid, yaw]), stamps


def apart(one: NDArray[np.float64], other: NDArray[np.float64]) -> tuple[float, float]:
    """Metres and degrees between two poses."""
    turn = math.atan2(math.sin(one[2] - other[2]), math.cos(one[2] - other[2]))
    return math.dist(one[:2], other[:2]), abs(math.degrees(turn))


def judged_by_loops(drive: Drive, rule: ViewRule) -> dict[str, int]:
    """The counts that define a report."""
    ids, poses, stamps = drive
    first: dict[int, int] = {}
    names = ("false_positives", "false_negatives", "positives", "revisits", "found_revisits")
    counts = dict.fromkeys((*names, "loops", "correct_loops", "unplaced"), 0)
    for scan, view in enumerate(ids.tolist()):
        right = False
        counts["unplaced"] += view < 0
        if view in first:
            metres, degrees = apart(poses[scan], poses[first[view]])
            counts["positives"] += 1
            counts["false_positives"] += (
                metres > rule.false_positive_distance or degrees > rule.false_positive_angle
            )
            if stamps[scan] - stamps[first[view]] > rule.loop_age:
                right = metres <= rule.loop_distance and degrees <= rule.loop_angle
                counts["loops"] += 1
                counts["correct_loops"] += right
        else:
            near = [apart(poses[scan], poses[stored]) for stored in first.values()]
            counts["false_negatives"] += any(
                metres <= rule.false_negative_distance and degrees <= rule.false_negative_angle
                for metres, degrees in near
            )
            if view >= 0:
                first[view] = scan
        older = [
            apart(poses[scan], poses[j])
            for j in range(scan)
            if stamps[scan] - stamps[j] > rule.loop_age
        ]
        back = any(
            metres <= rule.revisit_distance and degrees <= rule.revisit_angle
            for metres, degrees in older
        )
        counts["revisits"] += back
        counts["found_revisits"] += back and right
    return counts | {"views": len(first)}


def scans_above_floor(
    test_data: Path, world: str
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Poses and stamps of a recording's scans that hold more than floor (z > 0.1 m)."""
    with np.load(test_data / "recordings" / f"{world}.npz") as data:
        heights = data["rays"][data["collision_ray"], 2] * (data["collision_range_mm"] / 1000)
        above = np.append(0, np.cumsum(heights + data["lidar_xyz"][2] > 0.1))
        kept = np.diff(above[data["collision_offsets"]]) > 0
        return data["poses"][kept], data["stamps"][kept]
