# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Calibrates ``loop_closure.false_rate``, and checks its promise on drives that are left out.

python -m benchmarks.accuracy.false_loop_contract           # loops from the cache, or found
python -m benchmarks.accuracy.false_loop_contract --write   # and store the calibration, and tables

Each frame of a drive is judged by every rule: which loop would be accepted, and how far off it is.
Made drives are each through a world of its own, streets and rooms, by LiDARs that see all round or
a sector. A drive takes up to half a minute of processor time; what was found is kept in the cache.
FUSIONSLAM_TEST_DATA names the real recordings, which are not calibrated on.
"""

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from textwrap import fill
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.accuracy.data import find_folder
from benchmarks.accuracy.markdown import table, write_between
from benchmarks.accuracy.presets import ROOT
from benchmarks.accuracy.room_maps import DRIFT
from benchmarks.accuracy.rooms import CIRCLE_ROBOT, RoomDrive
from benchmarks.real.protocol import RIGHT
from benchmarks.real.recordings import CLOUDS, READERS, Recording, Rule, read_recording
from fusionslam import Cloud, LoopConfig, LoopDetector
from fusionslam.base.arrays import Floats, Mask
from fusionslam.base.cache import cache_folder
from fusionslam.config import merged
from fusionslam.loop_closure import Loop
from fusionslam.loop_closure.contract import CalibratedKind, Profile, choose_rule, profile_of
from fusionslam.loop_closure.contract import Rule as LoopRule
from fusionslam.loop_closure.verification import PairComparisons, verify_candidates
from fusionslam.sim.robot import RobotConfig, robot_named

PAGE = ROOT / "docs" / "stages" / "loop_closure.md"
CALIBRATION = ROOT / "python" / "fusionslam" / "loop_closure" / "false_loops.yaml"
LOOPS = LoopConfig()
RULES = (
    LoopRule(LOOPS.min_supported, LOOPS.min_probability),
    *(LoopRule(each, each) for each in (0.95, 0.97, 0.98, 0.99, 0.995, 0.998, 0.999, 0.9995)),
)
"""The defaults, then stricter ones without the support of neighbours."""
ANY = 0.5
"""Least probability of poses that registration does not refuse."""
FEWEST = 10
"""Poses of ``ANY`` that a drive needs to say anything of a kind of clouds."""
SECTOR_ROBOT = "turtlebot3_waffle_pi"
DRIVES = {
    "town": ("town", "car_lidar", 1.0),
    "house": ("house", CIRCLE_ROBOT, 0.5),
    "warehouse": ("warehouse", CIRCLE_ROBOT, 0.5),
    "sector-house": ("house", SECTOR_ROBOT, 0.5),
    "sector-warehouse": ("warehouse", SECTOR_ROBOT, 0.5),
}
"""World, robot and scans a second by kind of made drive."""
SEEDS = range(401, 421)
"""Of the worlds, to which nothing was fitted: houses of odd ones, warehouses of even ones."""
TILTED = (
    *("town-421+5", "town-422+15", "house-421+5", "warehouse-422+15"),
    *("sector-house-421+15", "sector-warehouse-422+15"),
)
"""Drives through further worlds, of level sensors that are pitched down by so many degrees."""
REAL = tuple(name for name in READERS if name != "euroc_v101")
"""Real recordings, but for one of no calibrated kind that takes a quarter of an hour."""
RATES = (0.01, 0.05)
ROOM_METRES = 0.5
"""Of right poses in rooms; outdoors, and of real recordings, as of benchmarks.real."""


@dataclass(frozen=True)
class MadeDrive(RoomDrive):
    """A drive through a made world, of towns, too."""

    @cached_property
    def _robot(self) -> RobotConfig:
        # A car's own radius is larger than the room that a town leaves beside parked cars.
        changes = {
            "radius_m": 0.2,
            "lidars": {"velodyne": {"rate_hz": self.rate_hz, "scan_motion": False}},
        }
        return merged(robot_named(self.robot_name), changes)


def made_names() -> list[str]:
    """Names of the drives that are calibrated on."""
    names = []
    for seed in SEEDS:
        room = "house" if seed % 2 else "warehouse"
        names += [f"{kind}-{seed}" for kind in ("town", room, f"sector-{room}")]
    return names


def make_recording(name: str) -> Recording:
    """Scan a made world as a recording; ``name`` is the kind of drive and the seed."""
    kind, _, seed = name.rpartition("-")
    world, robot, rate = DRIVES[kind]
    drive = MadeDrive(world, int(seed), robot, rate)
    frames = list(drive.frames())
    mount = frames[0].robot_from_points
    assert mount is not None
    return Recording(
        name=name,
        clouds=[Cloud(frame.points) for frame in frames if frame.points is not None],
        stamps_ns=np.array([frame.stamp_ns for frame in frames]),
        poses=drive.true @ mount,
        recorded_odometry=drive.odometry(DRIFT) @ mount,
        rule=Rule(10.0 if world == "town" else 2.0, seconds=30.0),
    )


class JudgingDetector(LoopDetector):
    """Finds the loop of each frame by every rule.

    Attributes:
        found: of the last frame, what registration alone accepts, then the loops by ``RULES``.
    """

    found: list[Loop | None]

    def _verify(self, pending: Any, stretches: Mapping[int, int] | None = None) -> Loop | None:
        number, candidates, seen, stored = pending
        self.found = [None] * (1 + len(RULES))
        if seen is None or seen.cloud is None:
            return None
        # Each pair is registered once, whatever the rule.
        pairs = PairComparisons(seen.cloud, stored.__getitem__)
        for column, least in enumerate((ANY, *(rule.alone for rule in RULES))):
            config = self.config.model_copy(update={"min_probability": least})
            found = verify_candidates(number, candidates, pairs, config)
            if column == 1:
                found = self._gate.decide(found, seen.odometry, stored.__getitem__, stretches)
            if found.best is not None and found.best.reason is None:
                self.found[column] = found.best
        return None


class Judged(NamedTuple):
    """What was found of N frames of a drive.

    Attributes:
        kinds: (N,), of ``profile_of``.
        profiles: float64 (N, 2), reach and voxels.
        errors: float64 (N, 1 + rules, 2), metres and degrees that loops are off, as
            ``JudgingDetector.found``; NaN where none is accepted.
    """

    kinds: NDArray[np.str_]
    profiles: Floats
    errors: Floats


def judge(recording: Recording) -> Judged:
    """Judge each frame of a recording."""
    loops, registration = recording.detector().config, recording.registration
    detector = JudgingDetector(
        recording.descriptor, config=loops, fusion=CLOUDS, registration=registration
    )
    kinds, profiles = [], []
    errors: Floats = np.full((len(recording.clouds), 1 + len(RULES), 2), np.nan)
    rows = zip(recording.clouds, recording.stamps_ns.tolist(), recording.odometry, strict=True)
    for row, (cloud, stamp, odometry) in enumerate(rows):
        seen = detector.observe(cloud, stamp_ns=stamp, odometry=odometry)
        detector.add_observation(seen)
        assert seen.cloud is not None  # loops are verified
        kind, *profile = profile_of(seen.cloud)
        kinds.append(kind)
        profiles.append(profile)
        for column, loop in enumerate(detector.found):
            if loop is not None and loop.match_from_query is not None:
                truth = np.linalg.inv(recording.poses[loop.match]) @ recording.poses[row]
                error = np.linalg.inv(truth) @ loop.match_from_query
                turn = np.degrees(Rotation.from_matrix(error[:3, :3]).magnitude())
                errors[row, column] = np.linalg.norm(error[:3, 3]), turn
    return Judged(np.array(kinds), np.array(profiles), errors)


def judged_drive(name: str, folder: Path) -> Judged | None:
    """Judge a drive, or read what was found; None of a recording that is not there.

    Args:
        name: of a real recording, or of a made drive and its seed ("house-401"), with "+15" for a
            sensor that is tilted by as many degrees.
        folder: that keeps what was found.
    """
    path = folder / f"{name}.npz"
    if not path.exists():
        whole, _, tilt = name.partition("+")
        is_real = whole in READERS
        recording = read_recording(find_folder(), whole) if is_real else make_recording(whole)
        if recording is None:
            return None
        found = judge(recording.tilted(float(tilt)) if tilt else recording)
        folder.mkdir(parents=True, exist_ok=True)
        np.savez(path, kinds=found.kinds, profiles=found.profiles, errors=found.errors)
    with np.load(path) as stored:
        return Judged(*(stored[each] for each in Judged._fields))


class Drive(NamedTuple):
    """N frames of a drive, by ``1 + RULES``: what registration alone accepts, then the rules.

    Attributes:
        kinds: (N,), of ``profile_of``.
        profiles: float64 (N, 2), reach and voxels.
        accepted, wrong: bool (N, 1 + rules), loops, and false ones.
    """

    kinds: NDArray[np.str_]
    profiles: Floats
    accepted: Mask
    wrong: Mask


def compare(name: str, judged: Judged) -> Drive:
    """Tell false loops of a drive from right ones."""
    is_room = any(place in name for place in ("house", "warehouse"))
    limits = (ROOM_METRES if is_room else RIGHT[0]), RIGHT[1]
    accepted = np.isfinite(judged.errors[..., 0])
    return Drive(
        judged.kinds, judged.profiles, accepted, accepted & ~(judged.errors <= limits).all(axis=2)
    )


def calibrate(drives: Mapping[str, Drive]) -> dict[str, tuple[CalibratedKind, list[str]]]:
    """Join the drives of each kind of clouds; return their names, too."""
    kinds = {}
    for kind in sorted({str(kind) for drive in drives.values() for kind in drive.kinds}):
        rows = {name: drive.kinds == kind for name, drive in drives.items()}
        names = [name for name in drives if drives[name].accepted[rows[name], 0].sum() >= FEWEST]
        if not names:
            continue
        shown = np.concatenate([drives[name].profiles[rows[name]] for name in names])
        own = [(drives[name], rows[name]) for name in names]
        accepted = np.array([drive.accepted[of_kind, 1:].sum(axis=0) for drive, of_kind in own])
        wrong = np.array([drive.wrong[of_kind, 1:].sum(axis=0) for drive, of_kind in own])
        reach, voxels = np.column_stack([shown.min(axis=0), shown.max(axis=0)]).tolist()
        kinds[kind] = CalibratedKind(reach, voxels, accepted, wrong), names
    return kinds


def calibration_yaml(drives: Mapping[str, Drive]) -> str:
    """Format the calibration as the package reads it."""
    lines = [
        "# SPDX-FileCopyrightText: 2026 The fusionslam authors",
        "# SPDX-License-Identifier: Apache-2.0",
        "# Of each drive: loops by each rule, and false ones of them. Written by",
        "# python -m benchmarks.accuracy.false_loop_contract --write",
        f"rules: {[[*rule] for rule in RULES]}",
        "kinds:",
    ]
    for kind, (found, names) in calibrate(drives).items():
        lines += [f"  {kind}:", f"    reach: {np.round(found.reach, 2).tolist()}"]
        lines += [f"    voxels: {np.round(found.voxels).astype(int).tolist()}", "    drives:"]
        counts = zip(names, found.accepted.tolist(), found.wrong.tolist(), strict=True)
        lines += [f"      {name}: [{loops}, {wrong}]" for name, loops, wrong in counts]
    return "\n".join(lines) + "\n"


class Kept(NamedTuple):
    """What a drive's loops are by rules that were chosen without it.

    Attributes:
        accepted, wrong: loops, and false ones of them.
        right_today: right ones by the defaults.
        promised: share of the frames that are promised anything.
    """

    accepted: int
    wrong: int
    right_today: int
    promised: float

    @property
    def right(self) -> int:
        return self.accepted - self.wrong

    def holds(self, rate: float) -> bool:
        return self.wrong <= rate * self.accepted


def keep(drive: Drive, others: Mapping[str, Drive], rate: float | None) -> Kept:
    """Judge a drive by the rules that other drives need; None are the defaults."""
    kinds = {kind: found for kind, (found, _) in calibrate(others).items()}
    columns, promised = np.ones(len(drive.kinds), np.int64), 0
    for row, (kind, (reach, voxels)) in enumerate(zip(drive.kinds, drive.profiles, strict=True)):
        if rate is not None:
            profile = Profile(str(kind), float(reach), int(voxels))
            is_alike = profile.kind in kinds and kinds[profile.kind].shows(profile)
            needed, is_promised = choose_rule(
                kinds, profile.kind if is_alike else None, rate, len(RULES)
            )
            columns[row] = 1 + needed
            promised += is_promised
    rows = np.flatnonzero(columns <= len(RULES))  # others make no loop
    taken = rows, columns[rows]
    accepted, wrong = int(drive.accepted[taken].sum()), int(drive.wrong[taken].sum())
    right_today = int((drive.accepted & ~drive.wrong)[:, 1].sum())
    return Kept(accepted, wrong, right_today, promised / max(len(drive.kinds), 1))


GROUPS = {
    "streets, circle": ("town-",),
    "rooms, circle": ("house-", "warehouse-"),
    "rooms, sector": ("sector-",),
    "tilted": TILTED,
    "real": REAL,
}
"""Beginnings of the names of drives."""


def without_world(drives: Mapping[str, Drive], name: str) -> dict[str, Drive]:
    """Leave out a drive, and that of another sensor through the same world."""
    seed = name.rpartition("-")[2]
    return {each: drive for each, drive in drives.items() if each.rpartition("-")[2] != seed}


def rows_of(drives: Mapping[str, Drive]) -> Iterator[list[str]]:
    """Yield a row for each group and rate, and one of each group for the defaults."""
    calibrated = {name: drives[name] for name in made_names()}
    for rate in (None, *RATES):
        kept = {
            name: keep(drive, without_world(calibrated, name), rate)
            for name, drive in drives.items()
        }
        groups: dict[str, list[Kept]] = {
            group: [
                each
                for name, each in kept.items()
                if name.startswith(begin) and (name in TILTED) == (group == "tilted")
            ]
            for group, begin in GROUPS.items()
        }
        groups["all"] = [*kept.values()]
        for group, found in groups.items():
            accepted, wrong = (
                sum(each.accepted for each in found),
                sum(each.wrong for each in found),
            )
            right, today = (
                sum(each.right for each in found),
                sum(each.right_today for each in found),
            )
            promised = np.mean([each.promised for each in found]) if found else 0.0
            held = [sum(each.holds(limit) for each in found) for limit in RATES]
            yield [
                "-" if rate is None else f"{rate:g}",
                group,
                str(len(found)),
                "-" if rate is None else f"{promised:.0%}",
                *map(str, held),
                f"{wrong} of {accepted}",
                f"{right / max(today, 1):.3f}",
            ]


HEADER = (
    *("false_rate", "drives", "number", "frames with a promise"),
    *(f"within {rate:g}" for rate in RATES),
    *("false loops", "right loops kept"),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--drives", type=Path, default=cache_folder() / "false-loops")
    arguments = parser.parse_args()
    drives = {}
    for name in (*made_names(), *TILTED, *REAL):
        judged = judged_drive(name, arguments.drives)
        if judged is not None:
            drives[name] = compare(name, judged)
    calibration = calibration_yaml({name: drives[name] for name in made_names()})
    about = fill(
        "`python -m benchmarks.accuracy.false_loop_contract`: each drive by the calibration of the "
        f"{len(made_names())} made drives, without those through its world. Within a rate: drives "
        "whose share of false loops is at most that. Right loops kept: of those of the defaults, "
        "which the rows without a rate are of. False loops are off by more than "
        f"{RIGHT[0]:g} m, in made rooms {ROOM_METRES:g} m, or {RIGHT[1]:g} degrees.",
        100,
    )
    shown = f"{about}\n\n{table(HEADER, list(rows_of(drives)))}"
    print(f"{calibration}\n{shown}")
    if arguments.write:
        CALIBRATION.write_text(calibration, encoding="utf-8")
        write_between(PAGE, "contract", shown)


if __name__ == "__main__":
    main()
