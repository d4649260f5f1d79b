# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How good the poses of all frames of a map are, those between keyframes included.

``python -m benchmarks.accuracy.frame_poses --write`` puts the table into docs/stages/mapping.md.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.accuracy.markdown import table, write_between
from benchmarks.accuracy.pose_graphs import ate
from benchmarks.accuracy.recorded_loops import CONFIG
from benchmarks.accuracy.room_maps import FLOOR, NOISE, PAGE
from benchmarks.accuracy.rooms import RecordedDrive
from fusionslam.base.arrays import Floats, Mask
from fusionslam.config import merged
from fusionslam.geometry.se3 import inverse, log
from fusionslam.mapping.config import MapConfig
from fusionslam.mapping.frame_poses import FramePoses, frame_poses
from fusionslam.mapping.place_map import PlaceMap

APART = 0.6
"""Metres between keyframes."""
WORLDS = ("small_house", "warehouse")
HEAD = ["recording", "frames", "keyframes", "poses between", "ATE, m"]
HEAD += ["steps off odometry: 95 %, cm", "largest, cm", "95 %, degrees", "largest, degrees"]
HEAD += ["within 95 %"]
CHI2_95 = 12.591587243743977
"""scipy.stats.chi2.ppf(.95, 6)"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="put the table into the docs")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        rows = [row for name in WORLDS for row in measure(name, Path(folder))]
    text = table(HEAD, rows)
    print(text)
    if arguments.write:
        write_between(PAGE, "frame poses", text)


def measure(name: str, folder: Path) -> list[list[str]]:
    """Rows of a recording: frames led on from the last keyframe, and from both neighbours."""
    drive = RecordedDrive(name)
    odometry, path = drive.odometry(NOISE), folder / f"{name}.fsmap"
    config = merged(MapConfig(), {"keyframe_distance": APART, "drift": FLOOR})
    with PlaceMap.open(
        path,
        "drive",
        descriptor="cm2dp",
        loops=CONFIG.loop_closure,
        fusion=CONFIG.fusion,
        registration=CONFIG.registration,
        config=config,
    ) as site:
        for frame in drive.frames():
            site.add(frame, odometry=odometry[frame.number])
        site.solve()
        found = frame_poses(site, "drive", covariance=True)
        known = site.frames("drive")
        rows = np.searchsorted(known, found.numbers, side="right") - 1
        led = (site.trajectory("drive")[1] @ inverse(site.odometry("drive")))[rows]
    odometry, true = odometry[found.numbers], drive.true[found.numbers]
    is_between = ~np.isin(found.numbers, known)
    beside = is_between[1:] | is_between[:-1]
    cells = [name, str(len(odometry)), str(len(known))]
    inside = f"{share_inside(found, true):.2f}"
    return [
        [*cells, "from the keyframe before", *judge(led @ odometry, odometry, true, beside), ""],
        [*cells, "from both", *judge(found.poses, odometry, true, beside), inside],
    ]


def judge(poses: Floats, odometry: Floats, true: Floats, beside: Mask) -> list[str]:
    """ATE, and by how much steps to or from frames between keyframes differ from odometry's."""
    steps = [inverse(each[:-1]) @ each[1:] for each in (odometry, poses)]
    off = log(inverse(steps[0]) @ steps[1])
    jumps = np.linalg.norm(off.reshape(-1, 2, 3), axis=2)[beside] * [100, np.degrees(1)]
    sizes = np.percentile(jumps, [95, 100], axis=0)
    return [f"{ate(poses, true):.3f}", *(f"{size:.2f}" for size in sizes.T.ravel())]


def share_inside(found: FramePoses, true: Floats) -> float:
    """Share of poses, relative to the first one, within their ellipsoids of 95 %."""
    assert found.covariances is not None
    error = log(inverse(found.poses[1:]) @ found.poses[0] @ inverse(true[0]) @ true[1:])
    weighed = np.linalg.solve(found.covariances[1:], error[..., None])[..., 0]
    return float(((error * weighed).sum(axis=1) <= CHI2_95).mean())


if __name__ == "__main__":
    main()
