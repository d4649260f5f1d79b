# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The files beside the report: metrics.json, matches.csv, poses_tum.txt. All written whole."""

import csv
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.evaluation import CITATION, DescriptorRun, Evaluation, summarise_costs
from fusionslam.report.loops.outcomes import MATCH_COLUMNS, match_rows
from fusionslam.storage.files import atomic_path


def metrics_of(evaluation: Evaluation) -> dict[str, Any]:
    """All figures of one run, ready for JSON; each protocol's name its radius and window."""
    run = evaluation.run
    return {
        "dataset": run.dataset,
        "source": run.source,
        "descriptor": run.descriptor,
        "frames": len(run),
        "protocols": {name: curve.metrics() for name, curve in evaluation.curves.items()},
        "top1_by_direction": evaluation.top1_by_direction,
        "published": evaluation.published and {**evaluation.published, "citation": CITATION},
        "costs": asdict(summarise_costs(run)),
        "config": run.config,
    }


def write_metrics(path: Path, evaluations: Sequence[Evaluation], about: dict[str, Any]) -> None:
    """Write what is known about the report, and under "runs" the figures of each run."""
    content = about | {"runs": [metrics_of(evaluation) for evaluation in evaluations]}
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", "utf-8")


def write_matches(path: Path, evaluations: Sequence[Evaluation], protocol: str) -> None:
    """Write one line a matched query; accepted means at the threshold of maximal F1."""
    with atomic_path(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(MATCH_COLUMNS)
        for evaluation in evaluations:
            writer.writerows(match_rows(evaluation, protocol))


def write_tum(path: Path, run: DescriptorRun) -> None:
    """Write the true poses as TUM lines: seconds, x y z in metres, quaternion x y z w."""
    poses = run.poses
    if poses is None:
        return
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        for stamp, pose in zip(run.stamps_ns.tolist(), poses, strict=True):
            values = (*pose[:3, 3], *quaternion(pose[:3, :3]))
            numbers = " ".join(f"{value:.9g}" for value in values)
            # Whole nanoseconds do not fit a float.
            file.write(f"{stamp // 10**9}.{stamp % 10**9:09d} {numbers}\n")


def quaternion(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """(x, y, z, w), w >= 0, of a rotation matrix (3, 3).

    It is the eigenvector of the largest eigenvalue of Bar-Itzhack's symmetric matrix (2000),
    which is stable for every angle and for matrices that are not quite orthogonal.
    """
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation
    symmetric = np.array(
        [
            [xx - yy - zz, xy + yx, xz + zx, zy - yz],
            [xy + yx, yy - xx - zz, yz + zy, xz - zx],
            [xz + zx, yz + zy, zz - xx - yy, yx - xy],
            [zy - yz, xz - zx, yx - xy, xx + yy + zz],
        ]
    )
    found = np.linalg.eigh(symmetric)[1][:, -1]
    return np.asarray(found if found[3] >= 0 else -found, dtype=np.float64)
