# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Does the filter of places find a lost robot by driving? A Markdown table.

python -m benchmarks.accuracy.lost_robots            # recordings, and made worlds
python -m benchmarks.accuracy.lost_robots --write    # and put the table into the docs

A drive is cut at three quarters. The robot is put back to where it was at three tenths, and drives
on from there with odometry of its own; it sees every second scan of then again.
"""

import argparse
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from benchmarks.accuracy.data import WORLDS, data_folder
from benchmarks.accuracy.markdown import table, write_between
from benchmarks.accuracy.place_filter import PAGE, SEEDS, open_made
from fusionslam.evaluation import ViewJudge
from fusionslam.geometry.odometry_noise import DRIFT, add_odometry_errors
from fusionslam.geometry.trajectory import ground_poses
from fusionslam.pipelines.drives import Drive, open_drive
from fusionslam.views import ViewMatcher

HEAD = ["drive", "seed", "scans", "held back", "found after, m", "wrong", "revised"]
_CUT, _BACK, _SCANS = 0.75, 0.3, 150


class Found(NamedTuple):
    """What became of a robot that was put back.

    Attributes:
        scans: that it made there.
        held_back: scans without an answer.
        way_m: driven until the first match; None without any.
        wrong: scans matched wrongly.
        revised: answers given later.
    """

    scans: int
    held_back: int
    way_m: float | None
    wrong: int
    revised: int


def put_back(drive: Drive) -> Found:
    scenes = drive.scenes
    assert scenes.clouds is not None
    cut, back = int(_CUT * len(scenes)), int(_BACK * len(scenes))
    again = np.arange(back, min(back + _SCANS, cut), 2)
    rows = np.concatenate([np.arange(cut), again])
    poses, seconds = scenes.true_poses(), scenes.seconds
    first = add_odometry_errors(poses[:cut], seconds[:cut], DRIFT)
    second = add_odometry_errors(poses[again], seconds[again], DRIFT) - [1000.0, 50.0, 0.0]
    odometry = ground_poses(*np.concatenate([first, second]).T)
    matcher = ViewMatcher()
    matches = [
        matcher.process(matcher.view(scenes.clouds[row]), odometry=pose)
        for row, pose in zip(rows.tolist(), odometry, strict=True)
    ]
    stamps = np.concatenate([seconds[:cut], seconds[cut - 1] + 60 + seconds[again] - seconds[back]])
    report = ViewJudge(poses[rows], stamps).judge(np.array([match.id for match in matches]))
    later = matches[cut:]
    matched = [k for k, match in enumerate(later) if match.matched is not None]
    ways = np.hypot(*np.diff(poses[again][:, :2], axis=0).T)
    return Found(
        len(again),
        sum(match.is_ambiguous for match in later),
        float(ways[: matched[0]].sum()) if matched else None,
        int(report.false_positive[cut:].sum()),
        sum(len(match.revised) for match in later),
    )


def drives() -> Iterator[tuple[str, str, Drive]]:
    for name in WORLDS:
        yield f"recorded {name}", "", open_drive(data_folder() / "recordings" / f"{name}.npz")
    for world, seeds in SEEDS.items():
        for seed in seeds:
            yield world, str(seed), open_made(world, seed)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="put the table into the docs")
    arguments = parser.parse_args()
    rows = []
    for name, seed, drive in drives():
        found = put_back(drive)
        way = "never" if found.way_m is None else f"{found.way_m:.1f}"
        rows.append([name, seed, found.scans, found.held_back, way, found.wrong, found.revised])
        print(*rows[-1], flush=True)
    text = table(HEAD, rows)
    print(text)
    if arguments.write:
        write_between(PAGE, "lost robots", text)


if __name__ == "__main__":
    main()
