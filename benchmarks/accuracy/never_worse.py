# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Is any map worse than the odometry it was made from? Markdown tables.

    python -m benchmarks.accuracy.never_worse [hku_1 ...] [--write] [--fresh]

Real recordings are those of the test data, which FUSIONSLAM_TEST_DATA names; those that are not
there are left out. Maps are kept in the cache; ``--fresh`` makes them anew, as after a change of
``fusionslam.mapping``. Half an hour of processor time, of which EuRoC takes a third.
"""

import argparse
import json
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.accuracy.data import ROOT, find_folder
from benchmarks.accuracy.loop_peers import note
from benchmarks.accuracy.mapped_drives import Frames, difference, save
from benchmarks.accuracy.markdown import read_rows, table, write_between
from benchmarks.accuracy.place_maps import OPTIONS, add_drift, true_poses
from benchmarks.accuracy.pose_graphs import LOOP_SD, RUN, ate, invent_loops
from benchmarks.accuracy.presets import record_towns
from benchmarks.accuracy.room_maps import DRIFT, FLOOR
from benchmarks.accuracy.rooms import RoomDrive
from benchmarks.real.recordings import CLOUDS, read_recording
from fusionslam._core import OdometryTree
from fusionslam.base.arrays import Floats
from fusionslam.base.cache import cache_folder
from fusionslam.datasets import open_dataset
from fusionslam.geometry.se3 import exp, inverse
from fusionslam.mapping import Edge
from fusionslam.mapping.config import MapConfig
from fusionslam.mapping.place_map import PlaceMap
from fusionslam.registration import Refusal
from fusionslam.sensors.frame import Frame
from fusionslam.sim import SimConfig, TownConfig

PAGE = ROOT / "docs" / "results" / "robustness.md"
REAL = ("hku_1", "hku_2", "balm_realworld", "redkitchen", "kitti00_keyframes", "euroc_v101")
MADE = (("house", 7), ("house", 8), ("warehouse", 7), ("town", 1), ("town", 2))
RATIO, GOOD_M, MORE_M = 1.02, 0.1, 0.02
"""The error of a map, of that of its odometry; where this is below 0.1 m, 2 cm may be added."""
FALSE, FEWEST = 0.3, 10
"""False loops put in, of the loops there are; at least ten."""
GOOD_ODOMETRY = (0.002, 0.0002)
"""Standard deviations after one metre, in metres and radians, of odometry that is nearly right."""
WITHIN = {"within 2 sd": 2.0, "within 4 sd": 4.0}
KINDS = ("runs of ten", "one run", *WITHIN)
"""Of false loops: runs from a place to another, or so many deviations of odometry off."""
GAPS_S = (5.0, 60.0, 600.0)
"""Of real recordings, but for the one whose loops take three seconds a keyframe."""
SLOW = "euroc_v101"
PART = 0.3
"""Of a drive, at most, that is left out; for the rest of the time the robot stands."""
LOOKS = 5
"""Times while driving that another process compares what it reads."""


@dataclass(frozen=True)
class Drive:
    """A drive whose true poses are known.

    Attributes:
        name: of it.
        true: float64 (n, 4, 4), world_from_robot of the frames.
        odometry: float64 (n, 4, 4), odom_from_robot.
        frames: reads or makes them.
        right: metres and degrees beyond which a loop is false.
        options: of its map, as of ``PlaceMap.open``.
        is_made: whether it is simulated, so that the truth is exact.
    """

    name: str
    true: Floats
    odometry: Floats
    frames: Frames
    right: tuple[float, float]
    options: dict[str, Any]
    is_made: bool


@dataclass(frozen=True)
class Judged:
    """A map against the truth.

    Attributes:
        odometry, error: ATE of odometry and of the map, metres.
        parts: number of them.
        believed, false, refused: numbers of loops; the false ones are believed.
        reason: code of what the map says of itself; empty if nothing.
    """

    odometry: float
    error: float
    parts: int
    believed: int
    false: int
    refused: int
    reason: str

    @property
    def is_worse(self) -> bool:
        more = MORE_M if self.odometry < GOOD_M else 0.0
        return self.error > max(RATIO * self.odometry, self.odometry + more)

    def cells(self) -> list[str]:
        ratio = "-" if self.odometry < GOOD_M / 100 else f"{self.error / self.odometry:.2f}"
        mark = " **worse**" if self.is_worse else ""
        errors = [f"{self.odometry:.3f}", f"{self.error:.3f}{mark}", ratio]
        counts = (self.parts, self.believed, self.false, self.refused)
        return [*errors, *map(str, counts), self.reason or "-"]


HEAD = ["odometry, m", "map, m", "ratio", "parts", "believed", "false ones", "refused", "said"]


def real_drive(name: str) -> Drive | None:
    recording = read_recording(find_folder(), name)
    if recording is None:
        return None
    options = {"descriptor": recording.descriptor, **recording.options()}
    return Drive(
        name, recording.poses, recording.odometry, recording.frames, (1.0, 8.0), options, False
    )


def made_drive(world: str, seed: int) -> Drive:
    name = f"{world}_{seed}"
    if world == "town":
        true = true_poses(SimConfig(town=TownConfig(seed=seed), seed=seed))
        read: Frames = lambda: open_dataset(record_towns([seed])[0])  # noqa: E731
        return Drive(name, true, add_drift(true, seed), read, (1.0, 8.0), OPTIONS, True)
    drive = RoomDrive(world, seed)
    config = MapConfig.model_validate({"drift": FLOOR})
    options = {"descriptor": "m2dp", "fusion": CLOUDS, "config": config}
    return Drive(name, drive.true, drive.odometry(DRIFT), drive.frames, (0.3, 5.0), options, True)


def build(drive: Drive, path: Path, frames: Frames) -> float:
    """Map the frames; return by how many metres live poses were off those that others read."""
    stored = path.with_suffix(".json")
    if stored.exists():
        return float(json.loads(stored.read_text())[0])
    note(f"mapping {path.stem}")
    delete(path)  # what an interrupted run has left
    apart, looks = 0.0, np.linspace(0, len(drive.true) - 1, LOOKS + 1).astype(int)[1:]
    with PlaceMap.open(path, drive.name, **drive.options) as site:
        for frame in frames():
            site.add(frame, odometry=drive.odometry[frame.number])
            if frame.number in looks:
                apart = max(apart, compare(site, drive.name))
        site.solve()
        apart = max(apart, compare(site, drive.name))
    save(stored, [apart])
    return apart


def delete(path: Path) -> None:
    """Delete a map and its log."""
    for suffix in ("", "-wal", "-shm"):
        Path(f"{path}{suffix}").unlink(missing_ok=True)


def compare(site: PlaceMap, session: str) -> float:
    """Metres between a trajectory and that which another reader of the file gets."""
    live = site.trajectory(session)[1]
    with PlaceMap.open(site.path, read_only=True) as reader:
        read = reader.trajectory(session)[1]
    return float(np.linalg.norm((live - read)[:, :3, 3], axis=1).max())


def judge(drive: Drive, path: Path, odometry: Floats | None = None) -> Judged:
    """Judge a map as another process reads it; odometry of its keyframes if it was replaced."""
    with PlaceMap.open(path, read_only=True) as site:
        rows = site.frames(drive.name)
        true = drive.true[rows]
        believed = [edge for edge in site.loops if edge.state == "believed"]
        row = {int(number): k for k, number in enumerate(site.keyframes(drive.name))}
        false = 0
        mounts = [site.content.keyframes[k].robot_from_cloud for k in range(len(site))]
        for edge in believed:
            ends = [true[row[end]] @ mounts[row[end]] for end in (edge.a, edge.b)]
            off = difference(inverse(ends[0]) @ ends[1], edge.pose)
            false += off[0] > drive.right[0] or off[1] > drive.right[1]
        return Judged(
            ate(drive.odometry[rows] if odometry is None else odometry, true),
            ate(site.trajectory(drive.name)[1], true),
            sum(len(each.parts) for each in site.sessions),
            len(believed),
            false,
            len(site.loops) - len(believed),
            site.reason.code if site.reason is not None else "",
        )


def vary(drive: Drive, path: Path, change: Callable[[PlaceMap], Sequence[Edge]]) -> Path:
    """Solve a copy of a map with edges that replace its own, by their numbers, or are new."""
    copy = path.with_name("varied.fsmap")
    delete(copy)
    shutil.copy(path, copy)
    with PlaceMap.open(copy, drive.name) as site:
        site.content.take(change(site))
        site.solve()
    return copy


def unlink_all(site: PlaceMap) -> list[Edge]:
    """The loops of a map as if a person had taken them out."""
    reason = Refusal("unlinked", 0.0, "taken out")
    return [replace(edge, state="refused", reason=reason) for edge in site.loops]


def put_in(drive: Drive, kind: str, site: PlaceMap) -> list[Edge]:
    """False loops of a kind of ``KINDS``."""
    clouds = true_clouds(drive, site)
    count = max(FEWEST, round(FALSE * len(site.loops)))
    reach = float(np.linalg.norm(np.ptp(clouds[:, :3, 3], axis=0)))
    apart, between = min(20.0, reach / 4), min(100, len(clouds) // 4)
    rng = np.random.default_rng(len(clouds))
    run = min(count if kind == "one run" else RUN, len(clouds) // 4)
    if kind in WITHIN:
        invented = invent_within_drift(site, count, run, between, WITHIN[kind], rng)
    else:
        invented = invent_loops(clouds, count, rng, run=run, apart=apart, between=between)
    numbers, first = site.keyframes(drive.name), site.content.next_edge
    covariance = np.diag(LOOP_SD**2)
    return [
        Edge(first + k, "loop", int(numbers[a]), int(numbers[b]), pose, covariance, "pending")
        for k, (a, b, pose) in enumerate(invented)
    ]


def invent_within_drift(
    site: PlaceMap, count: int, run: int, between: int, sigmas: float, rng: np.random.Generator
) -> Iterator[tuple[int, int, Floats]]:
    """Runs of loops that agree, each so far from odometry as its stated drift makes likely."""
    tree = OdometryTree()
    tree.add_root(np.eye(4))
    for edge in site.edges:
        if edge.kind == "odometry":
            tree.add(site.content.row[edge.a], edge.pose, edge.covariance)
    poses, made = tree.poses, 0
    while made < count:
        a, b = sorted(rng.integers(0, len(poses) - run, 2).tolist())
        if b - a < between:
            continue
        way = rng.normal(size=6)
        off = exp(np.linalg.cholesky(tree.drift(a, b)) @ way * sigmas / np.linalg.norm(way))
        moved = inverse(poses[a]) @ poses[b] @ off @ inverse(poses[b])  # of the second stretch
        for k in range(min(run, count - made)):
            noise = exp(rng.normal(size=6) * LOOP_SD)
            yield a + k, b + k, inverse(poses[a + k]) @ poses[a] @ moved @ poses[b + k] @ noise
            made += 1


def true_clouds(drive: Drive, site: PlaceMap) -> Floats:
    mounts = np.array([each.robot_from_cloud for each in site.content.keyframes])
    clouds: Floats = drive.true[site.frames(drive.name)] @ mounts
    return clouds


def make_good(clouds: Floats, site: PlaceMap) -> list[Edge]:
    """Odometry along poses of clouds instead of the map's."""
    return [
        replace(edge, pose=inverse(clouds[edge.a]) @ clouds[edge.b])
        for edge in site.edges
        if edge.kind == "odometry"
    ]


def with_good_odometry(drive: Drive, path: Path) -> tuple[Path, Floats]:
    """The map as if odometry were nearly right; and odometry of its keyframes."""
    with PlaceMap.open(path, read_only=True) as site:
        clouds = true_clouds(drive, site)
        mounts = np.array([each.robot_from_cloud for each in site.content.keyframes])
    steps = inverse(clouds[:-1]) @ clouds[1:]
    metres = np.linalg.norm(steps[:, :3, 3], axis=1)
    sds = np.repeat(GOOD_ODOMETRY, 3) * np.sqrt(metres)[:, None]
    noise = exp(np.random.default_rng(len(clouds)).normal(size=sds.shape) * sds)
    poses = [clouds[0]]
    for step in steps @ noise:
        poses.append(poses[-1] @ step)
    driven = np.array(poses)
    return vary(drive, path, partial(make_good, driven)), driven @ inverse(mounts)


def leave_out(drive: Drive, seconds: float) -> Iterator[Frame]:
    """Frames but those of some seconds in the middle; later ones come so much later at least."""
    frames = list(drive.frames())
    stamps = np.array([frame.stamp_ns for frame in frames])
    begin = stamps[0] + int(0.4 * np.ptp(stamps))
    end = begin + int(min(seconds * 1e9, PART * np.ptp(stamps)))
    stood = max(int(seconds * 1e9) - (end - begin), 0)
    for frame in frames:
        if frame.stamp_ns <= begin:
            yield frame
        elif frame.stamp_ns >= end:
            frame.stamp_ns += stood
            yield frame


def measure(drive: Drive, folder: Path, scratch: Path) -> dict[str, list[list[str]]]:
    """Rows of the tables; maps of earlier runs are solved anew."""
    path = folder / f"{drive.name}.fsmap"
    apart = build(drive, path, drive.frames)
    shutil.copy(path, copy := scratch / path.name)
    made = judge(drive, vary(drive, copy, lambda _: []))
    maps, gaps = [[drive.name, *made.cells(), f"{1e3 * apart:.3f}"]], []
    if made.believed:
        judged = judge(drive, vary(drive, copy, unlink_all))
        maps.append([f"{drive.name}, without its loops", *judged.cells(), "-"])
    false = list(judge_with_false(drive, copy, "as it is"))
    if drive.is_made:  # others are not known that well
        good, odometry = with_good_odometry(drive, copy)
        maps.append([f"{drive.name}, good odometry", *judge(drive, good, odometry).cells(), "-"])
        shutil.move(good, good := scratch / "good.fsmap")
        false += judge_with_false(drive, good, "good", odometry)
    for seconds in () if drive.is_made or drive.name == SLOW else GAPS_S:
        path = folder / f"{drive.name}-without-{seconds:g}.fsmap"
        build(drive, path, partial(leave_out, drive, seconds))
        shutil.copy(path, copy := scratch / path.name)
        judged = judge(drive, vary(drive, copy, lambda _: []))
        gaps.append([drive.name, f"{seconds:g} s", *judged.cells()])
    return {"never worse": maps, "false loops": false, "gaps": gaps}


def judge_with_false(
    drive: Drive, path: Path, name: str, odometry: Floats | None = None
) -> Iterator[list[str]]:
    """A row for each kind of false loops that are put into a map."""
    for kind in KINDS:
        judged = judge(drive, vary(drive, path, partial(put_in, drive, kind)), odometry)
        yield [drive.name, name, kind, *judged.cells()]


HEADS = {
    "never worse": ["drive", *HEAD, "live, mm"],
    "false loops": ["drive", "odometry", "put in", *HEAD],
    "gaps": ["drive", "left out", *HEAD],
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="of drives")
    parser.add_argument("--write", action="store_true", help="put the tables into the docs")
    parser.add_argument("--fresh", action="store_true", help="use nothing of earlier runs")
    arguments = parser.parse_args()
    folder = cache_folder() / "never-worse"
    folder.mkdir(parents=True, exist_ok=True)
    if arguments.fresh:
        for path in folder.iterdir():
            path.unlink()
    readers: dict[str, Callable[[], Drive | None]] = {
        name: partial(real_drive, name) for name in REAL
    }
    readers |= {f"{world}_{seed}": partial(made_drive, world, seed) for world, seed in MADE}
    names = arguments.names or [*readers]
    found: dict[str, list[list[str]]] = {name: [] for name in HEADS}
    with tempfile.TemporaryDirectory() as scratch:
        for name in names:
            drive = readers[name]()
            if drive is None:
                note(f"without {name}, which is not in {find_folder()}")
                continue
            for title, rows in measure(drive, folder, Path(scratch)).items():
                found[title] += rows
                print(f"{table(HEADS[title], rows)}\n", flush=True)
    if arguments.write:
        for title, rows in found.items():
            kept = [row for row in read_rows(PAGE, title) if row[0].split(",")[0] not in names]
            write_between(PAGE, title, table(HEADS[title], kept + rows))


if __name__ == "__main__":
    main()
