# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What does motion within scans cost, and what is left of it once it is undone? Markdown tables.

python -m benchmarks.accuracy.moving_scans [--write] [--parts PART ...] [SEED ...]

A VLP-16 on a small robot in made houses, which nothing was fitted to. Its scans are taken in one
instant, on the move, and on the move with the motion undone by odometry; the last with people who
walk around the robot, too. Some twenty minutes of processor time a house, and ten with people.
"""

import argparse
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import pairwise, product
from pathlib import Path
from textwrap import fill
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.accuracy.data import ROOT
from benchmarks.accuracy.mapped_drives import RIGHT, Fix, MappedDrive, Shares
from benchmarks.accuracy.markdown import table, write_between
from benchmarks.accuracy.pose_graphs import ate, fit_motion
from benchmarks.accuracy.room_maps import FLOOR
from benchmarks.accuracy.rooms import CIRCLE_ROBOT, turn_back
from fusionslam import Cloud, Frame, FrameBuilder, FusionConfig, LoopDetector, OnlineConfig, deskew
from fusionslam.base.arrays import Floats, Integers, Mask, Points
from fusionslam.config import merged
from fusionslam.geometry.odometry_noise import OdometryConfig
from fusionslam.geometry.se3 import exp, inverse, motion_size
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.mapping.clouds import pack_cloud, unpack_cloud
from fusionslam.mapping.config import MapConfig
from fusionslam.mapping.grids import GridConfig
from fusionslam.mapping.place_map import PlaceMap
from fusionslam.mapping.surfaces import patches_of
from fusionslam.mapping.sweeps import SolvedSweeps
from fusionslam.sensors.messages import NANOSECONDS, Imu, Odometry, Scan
from fusionslam.sim.catalogue import MADE, drive_through
from fusionslam.sim.imu import simulate_imu
from fusionslam.sim.lidar import scan
from fusionslam.sim.motion.planner import PlanConfig
from fusionslam.sim.robot import ImuMount, RobotConfig, base_from, robot_named
from fusionslam.sim.scene import RayCaster
from fusionslam.sim.simulator import SimulationConfig, Task, simulate
from fusionslam.sim.world import World

PAGE = ROOT / "docs" / "stages" / "sensors.md"
SEEDS = (11, 12, 13, 14, 15)
RATES_HZ = (10.0, 5.0)
MODES = ("one instant", "as measured", "undone")
LOOPS_EVERY_S, MAP_EVERY_S = 1.0, 0.5
FOUND_EVERY_S = 3.0
AGE_S = 20.0
FALSE_DEG = 3.0
NEAR_M = 0.1
"""From a true surface, within which an occupied cell is right."""
DRIFT = OdometryConfig(scale=1.02, rotation_scale=1.01)
SWEEP_S = 0.1
WAYS = {
    "odometry at 30 Hz": (30.0, False),
    "at 5 Hz": (5.0, False),
    "at 5 Hz, and IMU": (5.0, True),
}
"""How often odometry comes, and whether an IMU helps it."""
SWEEPS = ["m/s", "rad/s"]
for _way in ("as measured", *WAYS):
    SWEEPS += [f"{_way}: median, m", "most"]
LOOPS = ["scans a second", "scans", "loops", "more than 3 degrees off", "degrees off: median"]
LOOPS += ["95 %", "most", "metres off: median", "95 %", "most"]
MAPS = ["scans a second", "scans", "ATE, m", "occupied cells", "wrong ones", "share"]
PEOPLE = (0, 40)
FOUND_PEOPLE, FOUND_M = (0, 20), 40.0
"""People, and metres of the way, of drives that are mapped and localised."""
CLOSE = {"near_m": 1.5, "path_m": 4.0}
"""How people walk near the robot's path."""
BINS = (0.0, 0.05, 0.1, 0.2, 1.0)
"""Shares of a scan's points on people, by which scans are counted."""
REVISIT_M = 1.0
FALSE_M = 0.3
BACK_SEED = 100
"""Added to the seed, for the noise and the people of a second drive."""
PEOPLE_LOOPS = ["points on people", "scans that revisit", "recall without people", "with them"]
PEOPLE_LOOPS += ["false without", "with", "right poses refused with them"]
PEOPLE_FOUND = ["map", "drive", "points on people", "scans near a keyframe"]
PEOPLE_FOUND += ["found", "good", "wrong", "ATE of the map, m"]
BACKWARDS = ["scans a second", "patches of", "patches", "thinner", "thicker by 5 mm", "most, m"]
BACKWARDS += ["thickness: mean of the truth, m", "before", "after", "95 % of the truth", "before"]
BACKWARDS += ["after"]
PATCH_M, PATCH_POINTS = 0.5, 20
FLAT_M = 0.08
"""A patch of the truth is flat if its points reach no farther across it."""
LEVEL = 0.7
"""z of the normal of a floor, at least; a bend leaves it thin."""
THICKER_M = 0.005
PARTS = ("sweeps", "loops", "maps", "backwards", "people", "found")
SPEEDS_M_S = (0.0, 5.0, 15.0)
TURNS_RAD_S = (0.0, 0.5, 1.0, 2.0, 3.0)


@dataclass(frozen=True)
class Drive:
    """A tour of a made house.

    Attributes:
        seed: of the house, the way and the noise.
        rate_hz: of the scanner.
        mode: one of ``MODES``.
        people: who walk around.
        back: the same way in the opposite direction, with other noise and people.
        length_m: of the way; None for the whole tour.
        moving: of each scan of ``frames``, the share of points on people.
    """

    seed: int
    rate_hz: float
    mode: str
    people: int = 0
    back: bool = False
    length_m: float | None = None
    moving: list[float] = field(default_factory=list)

    @cached_property
    def robot(self) -> RobotConfig:
        lidar = {
            "rate_hz": self.rate_hz,
            "scan_motion": self.mode != MODES[0],
            "fields": ("intensity", "ring", "time", "moving"),
        }
        errors = {"errors": DRIFT.model_dump(include={"scale", "rotation_scale"})}
        robot = merged(
            robot_named(CIRCLE_ROBOT), {"lidars": {"velodyne": lidar}, "odometry": errors}
        )
        return robot.model_copy(update={"cameras": {}})

    @cached_property
    def driven(self) -> tuple[World, Trajectory]:
        made = MADE["house"]
        world = made.make(merged(made.settings, {"seed": self.seed}))
        plan = PlanConfig(
            seed=self.seed, spacing_m=8.0, again=0.2, back=0.2, length_m=self.length_m
        )
        world, way = drive_through(world, self.robot, plan)
        return world, turn_back(way) if self.back else way

    @property
    def mount(self) -> Floats:
        """float64 (4, 4), base_from_lidar."""
        return base_from(self.robot, self.robot.lidars["velodyne"].frame_id)

    def true(self, frame: Frame) -> Floats:
        """float64 (4, 4), world_from_robot of a frame."""
        pose: Floats = self.true_at(frame.stamp_ns, np.zeros(1))[0]
        return pose

    def true_at(self, stamp_ns: int, after: Floats) -> Floats:
        """float64 (N, 4, 4), world_from_robot so many seconds, (N,), after a stamp."""
        way, start_ns = self.driven[1], SimulationConfig().start_s * NANOSECONDS
        seconds = way.seconds[0] + (stamp_ns - start_ns) / NANOSECONDS + after
        return way.at(np.minimum(seconds, way.seconds[-1]))

    def frames(self, every_s: float) -> Iterator[Frame]:
        """Simulate the scans of each so many seconds, and odometry, as a robot gets them."""
        topic, every = self.robot.lidars["velodyne"].topic, round(every_s * self.rate_hz)
        dropped = {"/tf", "/ground_truth"}

        def chosen(tasks: Iterable[Task]) -> Iterator[Task]:
            seen = 0
            for task in tasks:
                if task.topic in dropped:
                    continue
                if task.topic == topic:
                    seen += 1
                    if (seen - 1) % every:
                        continue
                yield task

        builder = FrameBuilder(OnlineConfig(deskew=self.mode == MODES[2]), cameras=())
        seed = self.seed + BACK_SEED * self.back
        movers = {"people": self.people, **CLOSE}
        config = merged(SimulationConfig(), {"seed": seed, "movers": movers})
        for event in simulate(*self._in_world, config, select=chosen):
            if isinstance(event.message, Scan):
                self.moving.append(float(event.message.fields["moving"].mean()))
            yield from builder.process(event.message)
        yield from builder.flush()

    @property
    def _in_world(self) -> tuple[World, RobotConfig, Trajectory]:
        world, way = self.driven
        return world, self.robot, way


class Loops(NamedTuple):
    """Loops that a detector proves on a drive.

    Attributes:
        poses: float64 (S, 4, 4), world_from_lidar of each scan.
        queries: int64 (n,), scans that have a loop.
        off: float64 (n, 2), errors: metres and degrees.
        refused: int64 (m,), scans without one whose best pose is right all the same.
    """

    poses: Floats
    queries: Integers
    off: Floats
    refused: Integers


def find_loops(drive: Drive) -> Loops:
    detector = LoopDetector(
        "m2dp", window=0, window_seconds=AGE_S, fusion=FusionConfig(source="cloud")
    )
    poses, queries, off, refused = [], [], [], []
    for number, frame in enumerate(drive.frames(LOOPS_EVERY_S)):
        poses.append(drive.true(frame) @ drive.mount)
        loop = detector.add(frame)
        best = loop or detector.nearest
        if best is None or best.match_from_query is None:
            continue
        true = inverse(poses[best.match]) @ poses[number]
        errors = motion_size(inverse(true) @ best.match_from_query)
        if loop is not None:
            queries.append(number)
            off.append(errors)
        elif is_right(np.array(errors)):
            refused.append(number)
    return Loops(
        np.stack(poses),
        np.array(queries, np.int64),
        np.array(off).reshape(-1, 2),
        np.array(refused, np.int64),
    )


def is_right(errors: Floats) -> Mask:
    """Whether a pose is, of its errors (..., 2) in metres and degrees."""
    return np.asarray((errors[..., 0] <= FALSE_M) & (errors[..., 1] <= FALSE_DEG))


def map_drive(drive: Drive, folder: Path, every_s: float) -> MappedDrive:
    frames = list(drive.frames(every_s))
    odometry = np.stack([frame.odometry for frame in frames if frame.odometry is not None])
    mode = drive.mode.replace(" ", "-")
    return MappedDrive(
        folder / f"{drive.seed}-{drive.rate_hz:g}-{mode}-{drive.people}",
        np.stack([drive.true(frame) for frame in frames]),
        odometry,
        lambda: iter(frames),
        descriptor="m2dp",
        fusion=FusionConfig(source="cloud"),
        config=MapConfig.model_validate({"drift": FLOOR}),
    )


def build_map(drive: Drive, folder: Path, surfaces: cKDTree) -> tuple[float, int, int]:
    """Map a drive; ATE in metres, occupied cells, and those that no true surface is near."""
    mapped = map_drive(drive, folder, MAP_EVERY_S)
    with PlaceMap.open(mapped.path, read_only=True) as site:
        grid = site.grid(0.05, GridConfig())
    rows, columns = np.nonzero(grid.cells == 100)
    places = np.zeros((len(rows), 4))
    places[:, :2] = (np.stack([columns, rows], axis=1) + 0.5) * grid.resolution + grid.origin
    places[:, 3] = 1
    in_world = (places @ mapped.true_from_map.T)[:, :2]
    far = surfaces.query(in_world)[0] > NEAR_M
    return ate(mapped.poses, mapped.true_keyframes), len(rows), int(far.sum())


@dataclass(frozen=True)
class Surfaces:
    """A map's surfaces before its clouds are undone along the solved path, and after.

    Attributes:
        thickness: float64 (n, 3), of each patch, 5 to 95 % across its plane, metres: of the points
            at their true places, before and after.
        level: float64 (n,), z of the normal of each patch, 0 to 1.
        ate: metres.
        keyframes: number of them.
        bytes: of the times of points, and of all clouds.
    """

    thickness: Floats
    level: Floats
    ate: tuple[float, float]
    keyframes: int
    bytes: tuple[int, int]


def compare_surfaces(drive: Drive, folder: Path) -> Surfaces:
    """Map a drive; patches are points that a plane of the house has, from the true poses."""
    path = folder / "site.fsmap"
    path.unlink(missing_ok=True)
    config, fusion = MapConfig.model_validate({"drift": FLOOR}), FusionConfig(source="cloud")
    with PlaceMap.open(path, "drive", descriptor="m2dp", fusion=fusion, config=config) as site:
        true = []
        for frame in drive.frames(1 / drive.rate_hz):
            if site.add(frame).keyframe is not None:
                true.append(drive.true(frame))
        ates, placed = [], []
        for part in ("before", "after"):
            if part == "after":
                site.solve()
            robot = site.trajectory("drive")[1]
            off = (fit_motion(robot, np.array(true)) @ robot)[:, :3, 3] - np.array(true)[:, :3, 3]
            ates.append(float(np.sqrt((off**2).sum(axis=1).mean())))
            sweeps = SolvedSweeps(site.content, site.file.cloud, site.file.frames_after)
            find = sweeps.stored if part == "before" else sweeps.cloud
            poses = site.content.poses[:, None]
            clouds = [find(number) for number in range(len(true))]
            placed.append(
                np.concatenate([move(p, c.points) for p, c in zip(poses, clouds, strict=True)])
            )
        stored = [site.file.cloud(number).points for number in range(len(true))]
        stamps_ns = site.trajectory("drive")[0].tolist()
    plain, world = 0, []
    for data, stamp_ns in zip(stored, stamps_ns, strict=True):
        cloud = unpack_cloud(data)
        plain += len(pack_cloud(Cloud(cloud.points), 1e-3))
        seconds = np.zeros(len(cloud)) if cloud.seconds is None else cloud.seconds
        world.append(move(drive.true_at(stamp_ns, seconds) @ drive.mount, cloud.points))
    true_points = np.concatenate(world)
    numbers, _ = patches_of(true_points, PATCH_M)
    thickness, level = [], []
    for rows in np.split(np.argsort(numbers), np.cumsum(np.bincount(numbers))[:-1]):
        if len(rows) < PATCH_POINTS:
            continue
        thick, normal = across(true_points[rows])
        if thick < FLAT_M:
            thickness.append([thick, *(across(points[rows])[0] for points in placed)])
            level.append(abs(normal[2]))
    size = sum(map(len, stored))
    return Surfaces(
        np.array(thickness),
        np.array(level),
        (ates[0], ates[1]),
        len(true),
        (size - plain, size),
    )


def move(poses: Floats, points: Points) -> Floats:
    """Points, (N, 3), by a pose each, (N, 4, 4), or by one, (1, 4, 4)."""
    moved: Floats = (poses[:, :3, :3] @ points[:, :, None].astype(np.float64))[..., 0]
    return moved + poses[:, :3, 3]


def across(points: Floats) -> tuple[float, Floats]:
    """How far points, (N, 3), reach across their plane, 5 to 95 %, and its normal."""
    normal: Floats = np.linalg.eigh(np.cov(points.T))[1][:, 0]
    return float(np.diff(np.percentile(points @ normal, [5, 95]))[0]), normal


def true_surfaces(seed: int) -> cKDTree:
    """Places on the ground below what a scanner without noise hits, from the true poses."""
    drive = Drive(seed, RATES_HZ[0], MODES[0])
    clear = {"noise_m": 0.0, "dropout": 0.0, "grazing_dropout": 0.0, "far_dropout": 0.0}
    world, way = drive.driven
    lidar = merged(drive.robot.lidars["velodyne"], clear)
    caster = RayCaster(world.visual)
    places = []
    for seconds in np.arange(way.seconds[0], way.seconds[-1], MAP_EVERY_S):
        pose = way.at(seconds)[0] @ drive.mount
        points = scan(caster, lidar, pose, np.random.default_rng(0)).points
        high = points @ pose[:3, :3].T + pose[:3, 3]
        places.append(np.unique(np.round(high[high[:, 2] > 0.05, :2] / 0.02), axis=0))
    return cKDTree(np.unique(np.concatenate(places), axis=0) * 0.02)


def sweep_errors(speed: float, turn: float) -> list[str]:
    """How far points at 20 m are from the truth when the robot turns fastest: median and most.

    The robot sways: its turn rate goes up and down once in two seconds.
    """
    times = np.arange(0, 2, 1e-4)
    yaw = turn / np.pi * np.sin(np.pi * (times - 1))
    steps = speed * 1e-4 * np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
    x, y = (np.cumsum(steps, axis=0) - steps).T
    way = Trajectory(times, x, y, yaw)
    azimuths = np.linspace(0, 2 * np.pi, 1800)
    seconds = azimuths / (2 * np.pi) * SWEEP_S
    here = way.at(1.0)[0]
    ring = 20 * np.stack([np.cos(azimuths), np.sin(azimuths), 0.1 * np.sin(9 * azimuths)], axis=1)
    places = ring @ here[:3, :3].T + here[:3, 3]
    then = inverse(way.at(1.0 + seconds))
    points = np.einsum("nij,nj->ni", then[:, :3, :3], places) + then[:, :3, 3]
    taken = Scan(
        stamp_ns=2 * NANOSECONDS,
        frame_id="base",
        points=points.astype(np.float32),
        fields={"time": seconds.astype(np.float32)},
    )
    found = [points, *(undo(taken, way, rate, helped) for rate, helped in WAYS.values())]
    cells = [f"{speed:g}", f"{turn:g}"]
    for each in found:
        off = np.linalg.norm(each - ring, axis=1)
        cells += [f"{np.median(off):.3f}", f"{off.max():.3f}"]
    return cells


def undo(taken: Scan, way: Trajectory, rate_hz: float, has_imu: bool) -> Floats:
    """Points of a scan as of its stamp, one second after the robot's way begins."""
    builder = FrameBuilder(OnlineConfig(robot_frame="base"), cameras=())
    for at in np.arange(0, 1.99, 1 / rate_hz):
        stamp = NANOSECONDS + round(at * NANOSECONDS)
        moved = way.at((stamp - NANOSECONDS) / NANOSECONDS)[0]
        builder.process(
            Odometry(stamp_ns=stamp, frame_id="odom", child_frame_id="base", pose=moved)
        )
    if has_imu:
        times = np.arange(0.02, 1.97, 0.005)
        track = simulate_imu(way.at, ImuMount(), times, np.random.default_rng(3))
        for at, angular, linear in zip(times, *track, strict=True):
            stamp = NANOSECONDS + round(at * NANOSECONDS)
            builder.process(Imu(stamp_ns=stamp, frame_id="base", angular=angular, linear=linear))
    (frame,) = builder.process(taken) + builder.flush()
    assert frame.deskew is not None and frame.points is not None
    return np.asarray(frame.points, np.float64)


def sweeps_table() -> str:
    rows = [sweep_errors(speed, turn) for speed in SPEEDS_M_S for turn in TURNS_RAD_S]
    spent = fill(f"Undoing the motion of 120,000 points takes {kernel_time():.2f} ms.", 99)
    return f"{table(SWEEPS, rows)}\n\n{spent}"


def loops_table(seeds: Sequence[int]) -> str:
    """Loops by rate and mode, all houses together."""
    rows = []
    for rate in RATES_HZ:
        for mode in MODES:
            found = [find_loops(Drive(seed, rate, mode)) for seed in seeds]
            off = np.concatenate([loops.off for loops in found])
            metres, degrees = (np.percentile(off[:, k], [50, 95, 100]) for k in (0, 1))
            false = int((off[:, 1] > FALSE_DEG).sum())
            cells = [f"{rate:g}", mode, str(len(off)), str(false)]
            cells += [f"{value:.2f}" for value in degrees] + [f"{value:.3f}" for value in metres]
            rows.append(cells)
    return table(LOOPS, rows)


def maps_table(seed: int) -> str:
    """Maps of one house by rate and mode."""
    surfaces, rows = true_surfaces(seed), []
    with tempfile.TemporaryDirectory() as folder:
        for rate in RATES_HZ:
            for mode in MODES:
                error, cells, wrong = build_map(Drive(seed, rate, mode), Path(folder), surfaces)
                share = f"{wrong / max(1, cells):.4f}"
                rows.append([f"{rate:g}", mode, f"{error:.3f}", str(cells), str(wrong), share])
    return table(MAPS, rows)


def backwards_table(seeds: Sequence[int]) -> str:
    """Surfaces of maps of scans as measured, all houses together."""
    rows, said = [], []
    with tempfile.TemporaryDirectory() as folder:
        for rate in RATES_HZ:
            found = [compare_surfaces(Drive(n, rate, MODES[1]), Path(folder)) for n in seeds]
            is_level = np.concatenate([each.level for each in found]) > LEVEL
            for name, chosen in (("walls", ~is_level), ("floors", is_level)):
                thick = np.concatenate([each.thickness for each in found])[chosen]
                grown = thick[:, 2] - thick[:, 1]
                cells = [f"{rate:g}", name, str(len(thick)), f"{(grown < 0).mean():.3f}"]
                cells += [str((grown > THICKER_M).sum()), f"{grown.max():.3f}"]
                cells += [f"{value:.3f}" for value in thick.mean(axis=0)]
                rows.append([*cells, *(f"{v:.3f}" for v in np.percentile(thick, 95, axis=0))])
            before, after = np.mean([each.ate for each in found], axis=0)
            times, size = np.sum([each.bytes for each in found], axis=0)
            keyframes = sum(each.keyframes for each in found)
            said.append(
                f"At {rate:g} scans a second: {keyframes} keyframes, ATE {before:.3f} m before and "
                f"{after:.3f} m after; times take {times / keyframes:.0f} bytes a keyframe, "
                f"{100 * times / size:.0f} % of the clouds that exports show.\n"
            )
    return "\n".join([table(BACKWARDS, rows), *said])


def revisits(loops: Loops) -> Mask:
    """Scans near an earlier one that is old enough, bool (S,)."""
    places = loops.poses[:, :3, 3]
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)
    age = round(AGE_S / LOOPS_EVERY_S)
    return np.asarray(np.tril(apart < REVISIT_M, -age).any(axis=1))


def people_table(seeds: Sequence[int]) -> str:
    """Loops of the same drives without and with people, by the points that are on them."""
    scans = []
    for seed in seeds:
        drives = [Drive(seed, RATES_HZ[0], MODES[2], people) for people in PEOPLE]
        found = [find_loops(drive) for drive in drives]
        again = revisits(found[0])
        marks = np.zeros((5, len(again)))
        for number, loops in enumerate(found):
            fine = is_right(loops.off)
            marks[number, loops.queries[fine]] = again[loops.queries[fine]]
            marks[2 + number, loops.queries[~fine]] = 1
        refused = found[1].refused
        marks[4, refused] = again[refused]
        scans.append(np.stack([drives[1].moving, again, *marks]))
    share, again, *counted = np.concatenate(scans, axis=1)
    rows = []
    for low, high in [*pairwise(BINS), (0.0, 1.0)]:
        within = (share >= low) & (share < high)
        count, *sums = (int(each[within].sum()) for each in (again, *counted))
        name = f"{100 * low:g} to {100 * high:g} %"
        if within.all():
            name += f", {100 * share.mean():.1f} % in the mean"
        recalls = [f"{right / count:.3f}" if count else "" for right in sums[:2]]
        rows.append([name, str(count), *recalls, *map(str, sums[2:])])
    return table(PEOPLE_LOOPS, rows)


def found_table(seeds: Sequence[int]) -> str:
    """Scans of a second drive on maps of the first, each without and with people."""
    pairs = list(product(FOUND_PEOPLE, FOUND_PEOPLE))
    fixes: dict[tuple[int, int], list[Fix]] = {pair: [] for pair in pairs}
    errors: dict[int, list[float]] = {people: [] for people in FOUND_PEOPLE}
    moving: dict[int, list[float]] = {people: [] for people in FOUND_PEOPLE}
    with tempfile.TemporaryDirectory() as folder:
        for seed, walked in product(seeds, FOUND_PEOPLE):
            first = Drive(seed, RATES_HZ[0], MODES[2], walked, length_m=FOUND_M)
            mapped = map_drive(first, Path(folder), LOOPS_EVERY_S)
            errors[walked].append(ate(mapped.poses, mapped.true_keyframes))
            for people in FOUND_PEOPLE:
                drive = replace(first, people=people, back=True, moving=[])
                frames = list(drive.frames(FOUND_EVERY_S))
                moving[people] += drive.moving
                true = np.stack([drive.true(frame) for frame in frames])
                fixes[walked, people] += mapped.localize(
                    str(people), partial(iter, frames), true, stride=1
                )
    rows = []
    for (walked, people), each in fixes.items():
        shares = Shares(each)
        wrong = sum((fix.error or 0) > RIGHT[0] or (fix.turn or 0) > RIGHT[1] for fix in each)
        cells = ["with people" if count else "without" for count in (walked, people)]
        cells += [
            f"{100 * np.mean(moving[people]):.1f} %",
            str(shares.near),
            f"{shares.found:.3f}",
            f"{shares.good:.3f}",
            str(wrong),
        ]
        rows.append([*cells, f"{np.mean(errors[walked]):.3f}"])
    return table(PEOPLE_FOUND, rows)


def kernel_time() -> float:
    """Milliseconds of undoing the motion of 120,000 points, the least of twenty runs."""
    random = np.random.default_rng(1)
    points = random.uniform(-50, 50, (120_000, 3)).astype(np.float32)
    seconds = np.sort(random.uniform(0, SWEEP_S, len(points)))
    poses = exp(np.outer(np.linspace(0, SWEEP_S, 33), [10.0, 0, 0, 0, 0, 1.0]))
    spent = []
    for _ in range(20):
        started = time.perf_counter()
        deskew(points, seconds, poses, (0.0, SWEEP_S))
        spent.append(time.perf_counter() - started)
    return 1e3 * min(spent)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seeds", nargs="*", type=int, default=[])
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS)
    parser.add_argument("--write", action="store_true", help="put the tables into the docs")
    arguments = parser.parse_args()
    seeds = arguments.seeds or SEEDS
    makes: dict[str, Callable[[], str]] = {
        "sweeps": sweeps_table,
        "loops": lambda: loops_table(seeds),
        "maps": lambda: maps_table(seeds[0]),
        "backwards": lambda: backwards_table(seeds[:1]),
        "people": lambda: people_table(seeds),
        "found": lambda: found_table(seeds),
    }
    tables = {name: makes[name]() for name in arguments.parts}
    for name, text in tables.items():
        print(f"\n{text}")
        if arguments.write:
            write_between(PAGE, name, text)


if __name__ == "__main__":
    main()
