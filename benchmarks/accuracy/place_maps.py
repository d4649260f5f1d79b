# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How good are maps of simulated towns, and is a robot found on them? Markdown tables.

python -m benchmarks.accuracy.place_maps            # towns that nothing was fitted to
python -m benchmarks.accuracy.place_maps 1 2        # these towns
python -m benchmarks.accuracy.place_maps --write    # and put the tables into the docs

Towns are taken from the cache and recorded if missing. A town takes about two minutes of
processor time. Maps and what was localised on them are kept in the cache; ``--fresh`` makes them
anew, as after a change of ``fusionslam.mapping``.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np

from benchmarks.accuracy.mapped_drives import (
    GOOD,
    NEAR,
    RIGHT,
    SHARES,
    STRIDE,
    Fix,
    MappedDrive,
    Shares,
)
from benchmarks.accuracy.markdown import table, write_between
from benchmarks.accuracy.pose_graphs import LOOP_SD, ate, invent_loops
from benchmarks.accuracy.presets import (
    RETURN,
    RETURN_DRIVE,
    ROOT,
    mean_and_range,
    record_returns,
    record_towns,
)
from fusionslam import FusionConfig
from fusionslam.base.arrays import Floats
from fusionslam.base.cache import cache_folder
from fusionslam.datasets import open_dataset
from fusionslam.geometry.se3 import exp, inverse
from fusionslam.mapping import PoseGraph
from fusionslam.mapping.config import MapConfig
from fusionslam.sim import SimConfig, TownConfig
from fusionslam.sim.town.route import make_drive

PAGE = ROOT / "docs" / "stages" / "mapping.md"
SEEDS = (1, 2, 3, 5, 7)
DRIFT = (0.03, 0.005)
"""Standard deviations of odometry after one metre, in metres and radians, of each axis."""
SCALE = 1.01
"""Metres of odometry for each true one."""
KEYFRAME_DISTANCE = 1.5
FALSE = 0.3
"""Invented loops for each loop."""
OPTIONS: dict[str, Any] = {
    "descriptor": "m2dp",
    "fusion": FusionConfig(source="cloud"),
    "config": MapConfig(keyframe_distance=KEYFRAME_DISTANCE),
}
"""Of the maps, as of ``PlaceMap.open``."""


class Town(MappedDrive):
    """A town, the map of the first drive through it, and the truth."""

    def __init__(self, seed: int, folder: Path) -> None:
        self.seed = seed
        true = true_poses(SimConfig(town=TownConfig(seed=seed), seed=seed))
        super().__init__(
            folder / f"town-{seed}",
            true,
            add_drift(true, seed),
            lambda: open_dataset(record_towns([seed])[0]),
            **OPTIONS,
        )

    def localize_all(self, seed: int) -> list[Fix]:
        """Localise the frames of the second drive through a town, each without any guess."""
        return self.localize(
            str(seed), lambda: open_dataset(record_returns([seed])[0]), true_returns(seed)
        )


class SecondDrive(MappedDrive):
    """The map of the second drive through a town, the other way around, and the truth."""

    def __init__(self, seed: int, folder: Path) -> None:
        true = true_returns(seed)
        super().__init__(
            folder / f"town-{seed}-second",
            true,
            add_drift(true, seed + RETURN),
            lambda: open_dataset(record_returns([seed])[0]),
            "second",
            **OPTIONS,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seeds", nargs="*", type=int, default=SEEDS)
    parser.add_argument("--write", action="store_true", help="put the tables into the docs")
    parser.add_argument("--fresh", action="store_true", help="use nothing of earlier runs")
    arguments = parser.parse_args()
    seeds = arguments.seeds or SEEDS
    folder = cache_folder() / "place-maps"
    folder.mkdir(parents=True, exist_ok=True)
    if arguments.fresh:
        for path in folder.iterdir():
            path.unlink()
    towns = [Town(seed, folder) for seed in seeds]
    for name, about, draw in (
        ("place maps", maps_text(), maps_table),
        ("localization", fixes_text(), fixes_table),
    ):
        text = f"{about}\n\n{draw(towns)}"
        print(f"{text}\n", flush=True)
        if arguments.write:
            write_between(PAGE, name, text)


def maps_text() -> str:
    drift_m, drift_rad = DRIFT
    return fill(
        f"Towns, full circle of the LiDAR, a keyframe each {KEYFRAME_DISTANCE:g} m. Odometry is "
        f"the truth with noise of {drift_m:g} m and {drift_rad:g} rad after one metre, about each "
        f"axis, and {100 * (SCALE - 1):.0f} % too long. A loop is false if it is more than "
        f"{RIGHT[0]:g} m or {RIGHT[1]:g} degrees off. Invented loops: {100 * FALSE:.0f} % as many "
        "as there are loops, in runs of ten that agree with each other. Seconds are of processor "
        "time.",
        100,
    )


def maps_table(towns: Sequence[Town]) -> str:
    """Errors of the maps, what they believe, and what they cost."""
    head = ["town", "keyframes", "ATE of odometry, m", "ATE, m", "believed", "false ones of them"]
    head += ["refused", "invented", "believed of them", "ATE with them, m", "kB a keyframe"]
    head += ["s a keyframe, median", "95 %"]
    rows, errors = [], []
    for town in towns:
        odometry = town.odometry[town.frames]
        invented, believed, false_error = solve_with_false(town)
        ates = [ate(odometry, town.true_keyframes), ate(town.poses, town.true_keyframes)]
        errors.append([*ates, false_error])
        mine = [edge for edge in town.loops if edge.state == "believed"]
        median, late = np.percentile(town.seconds, [50, 95])
        rows.append(
            [
                *(str(town.seed), str(len(town.frames))),
                *(f"{value:.2f}" for value in ates),
                *(str(len(mine)), str(sum(town.is_false(edge) for edge in mine))),
                *(str(len(town.loops) - len(mine)), str(invented), str(believed)),
                *(f"{false_error:.2f}", f"{town.path.stat().st_size / 1e3 / len(town.frames):.0f}"),
                *(f"{median:.2f}", f"{late:.2f}"),
            ]
        )
    means = [f"{value:.2f}" for value in np.mean(errors, axis=0)]
    rows.append(["mean", "", *means[:2], *[""] * 5, means[2], "", "", ""])
    return table(head, rows)


def fixes_text() -> str:
    return fill(
        "A second drive through the same towns: other noise, another start, and the first lap the "
        f"other way around. Each {STRIDE}th frame is localised, without any guess and without "
        f"odometry. Found: of the frames at most {NEAR:g} m from a keyframe. Good: within "
        f"{GOOD[0]:g} m and {GOOD[1]:g} degrees of the truth, after the map is aligned with it by "
        "one rigid motion, so that the error of the map counts, too; against the map, the pose "
        "relative to its keyframe counts alone. Frames of another town should not be found.",
        100,
    )


def fixes_table(towns: Sequence[Town]) -> str:
    """What is found on the maps."""
    head = ["map", *SHARES, "frames of another town", "found of them"]
    rows, shares = [], []
    for town in towns:
        own = Shares(town.localize_all(town.seed))
        foreign = town.localize_all(another_seed(town.seed))
        found = sum(fix.error is not None for fix in foreign)
        shares.append([own.found, own.good])
        rows.append([str(town.seed), *own.cells(), str(len(foreign)), str(found)])
    ranges = [mean_and_range(values) for values in np.array(shares).T]
    rows.append(["mean (range)", "", *ranges, *[""] * 7])
    return table(head, rows)


def another_seed(seed: int) -> int:
    return SEEDS[(SEEDS.index(seed) + 1) % len(SEEDS)] if seed in SEEDS else SEEDS[0]


def true_returns(seed: int) -> Floats:
    """world_from_robot of the second drive, float64 (n, 4, 4)."""
    config = SimConfig(town=TownConfig(seed=seed), seed=seed + RETURN, drive=RETURN_DRIVE)
    return true_poses(config)


def true_poses(config: SimConfig) -> Floats:
    """world_from_robot, float64 (n, 4, 4)."""
    return make_drive(config.drive, config.town.block_m, config.seed).poses


def add_drift(true: Floats, seed: int) -> Floats:
    """Odometry of a drive, from its first true pose."""
    rng = np.random.default_rng(seed)
    poses = [true[0]]
    for step in inverse(true[:-1]) @ true[1:]:
        metres = np.linalg.norm(step[:3, 3])
        sds = np.repeat(DRIFT, 3) * np.sqrt(metres)
        moved = step.copy()
        moved[:3, 3] *= SCALE
        poses.append(poses[-1] @ moved @ exp(rng.normal(size=6) * sds))
    return np.array(poses)


def solve_with_false(town: Town) -> tuple[int, int, float]:
    """Add false loops to the map's graph; return how many, how many are believed, and the ATE."""
    graph = PoseGraph()
    for pose in town.poses:
        graph.add_node(pose)
    for edge in town.edges:
        graph.add_edge(edge.a, edge.b, edge.pose, edge.covariance, edge.kind)
    known = len(graph.edges)
    rng = np.random.default_rng(town.seed)
    false = list(invent_loops(town.true_keyframes, round(FALSE * len(town.loops)), rng))
    for a, b, pose in false:
        graph.add_edge(a, b, pose, np.diag(LOOP_SD**2), "loop")
    solution = graph.solve()
    believed = sum(edge.number >= known for edge in solution.believed)
    return len(false), believed, ate(solution.poses, town.true_keyframes)


if __name__ == "__main__":
    main()
