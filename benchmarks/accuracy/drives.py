# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What do planned drives cover, and how often do they come back? A Markdown table.

    python -m benchmarks.accuracy.drives [--write]

Every drive is checked to keep its clearance; the house needs no data. Worlds of the test data are
left out where FUSIONSLAM_TEST_DATA does not name them. Times are processor time of one planning.
"""

import argparse
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.accuracy.data import ROOT, world_files
from benchmarks.accuracy.markdown import table, write_between
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.sim.indoor import HouseConfig, make_indoor
from fusionslam.sim.motion.clearance import check_trajectory
from fusionslam.sim.motion.occupancy import OccupancyMap
from fusionslam.sim.motion.path_following import DriveLimits
from fusionslam.sim.motion.planner import PlanConfig, plan_trajectory
from fusionslam.sim.world import World
from fusionslam.sim.worlds import load_world

PAGE = ROOT / "docs" / "guides" / "motion.md"
SEEDS = range(3)
LENGTHS = (150.0, None)
DRIVES = ["world", "`length_m`", "driven", "within 1 m", "within 1.5 m", "same way"]
DRIVES += ["opposite way", "planned in"]
UNITS = {"speed": "m/s", "turn rate": "rad/s", "acceleration": "m/s²"}
UNITS |= {"turn acceleration": "rad/s²"}


@dataclass(frozen=True)
class Drive:
    """A drive, the map where a robot can be, and the processor time of planning if planned."""

    trajectory: Trajectory
    room: OccupancyMap
    seconds: float | None = None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="put the table into the docs")
    arguments = parser.parse_args()
    text = drives_table()
    print(text)
    if arguments.write:
        write_between(PAGE, "drives", text)


def drives_table() -> str:
    """Drives of each world and length, and how near they come to the limits."""
    rows, all_planned = [], []
    for name, world in worlds():
        assert world.map is not None
        for length_m in LENGTHS:
            found = list(plan_drives(world.map, length_m))
            all_planned += found
            rows.append([name, f"{length_m:.0f}" if length_m else "none", *driven(found)])
        if world.trajectory is not None:
            own = Drive(world.trajectory, world.map.inflate(PlanConfig().clearance_m))
            rows.append([name, "its own trajectory", *driven([own])])
    return f"{table(DRIVES, rows)}\n\n{nearest_to_limits(all_planned)}"


def worlds() -> Iterator[tuple[str, World]]:
    yield "house (made)", make_indoor(HouseConfig())
    for name, path in world_files().items():
        yield name, load_world(path)


def plan_drives(grid: OccupancyMap, length_m: float | None) -> Iterator[Drive]:
    """A drive for each seed; DataError where one does not keep its clearance."""
    for seed in SEEDS:
        config = PlanConfig(seed=seed, length_m=length_m)
        start = time.process_time()
        found = plan_trajectory(grid, config)
        seconds = time.process_time() - start
        check_trajectory(found, grid, config.clearance_m)
        yield Drive(found, grid.inflate(config.clearance_m), seconds)


def driven(drives: list[Drive]) -> list[str]:
    """Cells of the table: from the least of these drives to the most."""
    paths = [drive.trajectory for drive in drives]
    metres = spread(path.length_m for path in paths)
    seconds = spread(path.duration_s for path in paths)
    near = [
        [100 * measure_coverage(d.trajectory, d.room, within) for d in drives]
        for within in (1, 1.5)
    ]
    back = zip(*(revisits(path) for path in paths), strict=True)
    shares = [*near, *([100 * share for share in shares] for shares in back)]
    times = [drive.seconds for drive in drives if drive.seconds is not None]
    planned_in = f"{spread(times, 1)} s" if times else ""
    return [f"{metres} m, {seconds} s", *(f"{spread(s)} %" for s in shares), planned_in]


def spread(values: Iterable[float], digits: int = 0) -> str:
    found = list(values)
    ends = [f"{value:.{digits}f}" for value in (min(found), max(found))]
    return " to ".join(dict.fromkeys(ends))


def measure_coverage(path: Trajectory, room: OccupancyMap, within_m: float) -> float:
    """Share of the room's reachable cells that are so near to a place of the path."""
    cells = np.column_stack(room.centres(*np.nonzero(room.reachable)))
    apart, _ = cKDTree(np.column_stack([path.x, path.y])).query(cells)
    return float((apart < within_m).mean())


def revisits(path: Trajectory) -> tuple[float, float]:
    """Shares of places within 0.5 m of one more than 20 s before: same heading, opposite."""
    places = np.column_stack([path.x, path.y])
    tree = cKDTree(places)
    same, opposite = [], []
    for k in range(0, len(places), 10):
        near = np.array(tree.query_ball_point(places[k], 0.5))
        near = near[path.seconds[near] < path.seconds[k] - 20]
        alike = np.cos(path.yaw[near] - path.yaw[k])
        same.append((alike > np.cos(np.pi / 4)).any())
        opposite.append((alike < -np.cos(np.pi / 4)).any())
    return float(np.mean(same)), float(np.mean(opposite))


def nearest_to_limits(drives: list[Drive]) -> str:
    limits = PlanConfig().limits
    found = [exceeds(drive.trajectory, limits) for drive in drives]
    most = {kind: max(shares[kind] for shares in found) for kind in UNITS}
    parts = [
        f"{kind} {most[kind] * limit:.4f} of {limit:g} {UNITS[kind]}"
        for kind, limit in bounds_of(limits).items()
    ]
    return f"Largest finite differences of all {len(drives)} planned drives: {', '.join(parts)}."


def bounds_of(limits: DriveLimits) -> dict[str, float]:
    """The limits by the names of UNITS."""
    values = [limits.max_speed_m_s, limits.max_turn_rad_s]
    values += [limits.max_acceleration_m_s2, limits.max_turn_acceleration_rad_s2]
    return dict(zip(UNITS, values, strict=True))


def exceeds(path: Trajectory, limits: DriveLimits) -> dict[str, float]:
    """Finite differences as shares of the limits: beyond 1 is too much."""
    gap = np.diff(path.seconds)
    speed = np.hypot(np.diff(path.x), np.diff(path.y)) / gap
    turn = np.diff(path.yaw) / gap
    between = (gap[1:] + gap[:-1]) / 2
    series = [speed, np.abs(turn)]
    series += [np.abs(np.diff(change) / between) for change in (speed, turn)]
    bounds = bounds_of(limits).items()
    return {kind: float(s.max()) / limit for (kind, limit), s in zip(bounds, series, strict=True)}


if __name__ == "__main__":
    main()
