# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What the commands ``fusionslam fleet ...`` do and print."""

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fusionslam.base.progress import Step, label_progress
from fusionslam.base.texts import counted
from fusionslam.cli import options as opt
from fusionslam.cli.console import print_table
from fusionslam.cli.failures import needs_extra
from fusionslam.config import with_settings
from fusionslam.errors import FusionSlamError
from fusionslam.fleet.config import FleetSettings
from fusionslam.fleet.encounters import find_encounters
from fusionslam.fleet.engines import check_engine, open_engine
from fusionslam.fleet.folder import FleetFolder
from fusionslam.fleet.localization import FleetLocalization
from fusionslam.fleet.places import Candidate
from fusionslam.fleet.recordings import Labels, find_recordings
from fusionslam.fleet.scans import Scan
from fusionslam.fleet.settings import settle_settings
from fusionslam.fleet.site_maps import SiteMerge, merge_site
from fusionslam.fleet.work import Failure, Plan, list_status
from fusionslam.pipelines.compare_descriptors import QUICK_TOWN
from fusionslam.report.fleet import write_fleet_page
from fusionslam.sim import SimConfig, record

_SHOWN = 10
"""Failures that are printed."""
_HEADS = ("distance", "site", "robot", "recording", "frame", "seen (UTC)")
_BLOCK = [[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]
_SITES = {"north": 1, "south": 2}
"""Seeds of the demo's towns."""
_ROBOTS = {"r1": (0.0, _BLOCK), "r2": (-1.2, _BLOCK)}
"""How far to the side of the lane's middle each drives, and by which crossings."""


class Described(NamedTuple):
    """What became of the recordings below a root."""

    folder: FleetFolder
    plan: Plan
    failures: list[Failure]
    places: int


def describe_root(
    root: Path,
    output: Path,
    config: Any,
    *,
    names: list[str],
    labels: Labels,
    engine: str,
    jobs: int,
    step: Step,
    source: str | None = None,
) -> Described:
    """Describe all recordings below a root; arguments as the command's options."""
    needs_extra("fleet", module="lancedb")
    if engine != "local":
        needs_extra("fleet", module="ray")
    check_engine(engine)
    found = find_recordings(root, labels, excluded=output)
    settings = settle_settings(found, names, config, config.fleet, output, source=source)
    folder = FleetFolder(output, settings)
    plan = Plan.make(root, found, settings, label_progress(step, "opening recordings"))
    workers = open_engine(engine, jobs)
    try:
        show = label_progress(step, "describing frames")
        failures = folder.describe(plan, workers, progress=show)
    finally:
        workers.close()
    with folder.database() as database:
        return Described(folder, Plan.load(output), failures, len(database))


def print_described(described: Described) -> None:
    """Say how much there is, and what failed."""
    plan = described.plan
    recordings, frames = len(plan.recordings), plan.frames
    counts = [(recordings, "recording"), (frames, "frame"), (described.places, "place")]
    print(", ".join(counted(*count) for count in counts))
    # The exit status stays 0, as the rest is done.
    for each in described.failures[:_SHOWN]:
        part = "" if each.first is None else f", from frame {each.first}"
        print(f"failed: {each.session}{part}: {each.reason}")
    if described.failures:
        file = described.folder.path / "failed.jsonl"
        print(f"{counted(len(described.failures), 'failure')}, all in {file}")


def write_page(places: Path, most: int, step: Step) -> Path:
    """Write the page of a folder of places; return its path."""
    needs_extra("report")
    needs_extra("map")
    folder = FleetFolder.open(places)
    status = list_status(places)
    with folder.database() as database:
        encounters = find_encounters(
            folder,
            database,
            Plan.load(places),
            most=most,
            progress=label_progress(step, "looking for drives in each other"),
        )
        return write_fleet_page(
            places / "fleet.html",
            folder,
            database,
            status,
            encounters,
            command=opt.command_line(),
        )


def print_candidates(candidates: Sequence[Candidate]) -> None:
    print_table(_HEADS, [_row(each) for each in candidates])


def _row(each: Candidate) -> list[str]:
    seen = datetime.fromtimestamp(each.stamp_ns / 1e9, UTC)
    return [
        f"{each.distance:.4f}",
        each.site,
        each.robot,
        each.session,
        str(each.frame),
        f"{seen:%Y-%m-%d %H:%M:%S}",
    ]


def print_all(scans: Sequence[Scan], found: Sequence[FleetLocalization | FusionSlamError]) -> None:
    """Print a line for each scan, and then why some failed."""
    failed = [
        f"failed: {scan}: {each}"
        for scan, each in zip(scans, found, strict=True)
        if isinstance(each, FusionSlamError)
    ]
    unknown = [""] * len(_HEADS)
    rows = [
        [
            scan.short_name,
            *([*unknown, each.code] if isinstance(each, FusionSlamError) else _best(each)),
        ]
        for scan, each in zip(scans, found, strict=True)
    ]
    print_table(["scan", *_HEADS, "x, y, z (m), yaw (deg)"], rows)
    for line in failed:
        print(line)


def _best(found: FleetLocalization) -> list[str]:
    """Return the place that proves a pose, else the nearest, and the pose, or why there is none."""
    best = found.place or next(iter(found.candidates), None)
    place = [""] * len(_HEADS) if best is None else _row(best)
    where, pose = "", found.site_from_robot
    if pose is None:
        where, pose = "from there ", found.place_from_robot
    if pose is None:
        return [*place, "" if found.reason is None else found.reason.code]
    x, y, z, yaw = _numbers(pose)
    return [*place, f"{where}({x:.2f}, {y:.2f}, {z:.2f}) {yaw:.1f}"]


def print_pose(found: FleetLocalization) -> None:
    """Print the proven pose, or why there is none; nothing if none was asked for."""
    place = found.place
    if found.reason is not None:
        print(f"not proven: {found.reason}")
    if place is None or found.place_from_robot is None:
        return
    print(
        f"seen by {place.robot or 'a robot'} in {place.session}, frame {place.frame}, "
        f"probability {found.probability:.2f}"
    )
    print(f"from there: {_describe(found.place_from_robot)}")
    if found.site_from_robot is not None:
        print(f"in the frame of {place.session}: {_describe(found.site_from_robot)}")


def _describe(pose: Any) -> str:
    """Say where a pose is."""
    x, y, z, yaw = _numbers(pose)
    return f"x {x:.2f} m, y {y:.2f} m, z {z:.2f} m, yaw {yaw:.1f} deg"


def _numbers(pose: Any) -> tuple[float, float, float, float]:
    """Return x, y, z (metres), and yaw (degrees) of a pose (4, 4)."""
    x, y, z = pose[:3, 3].tolist()
    return x, y, z, float(np.degrees(np.arctan2(pose[1, 0], pose[0, 0])))


def run_demo(
    output: Path, engine: str, jobs: int, step: Step
) -> tuple[Described, dict[str, SiteMerge], Path]:
    """Record, describe, index, join and show a small fleet in a folder.

    Returns:
        What was described, the joint map of each site, and the page.
    """
    places, recordings = output / "places", output / "recordings"
    for site, seed in _SITES.items():
        for number, (robot, (aside, crossings)) in enumerate(_ROBOTS.items()):
            own = [
                f"sim.town.seed={seed}",
                f"sim.seed={number}",
                f"sim.drive.laps=[{crossings}]",
                f"sim.drive.lap_shift_m=[{aside}]",
            ]
            simulation: SimConfig = with_settings(opt.read_config(), [*QUICK_TOWN, *own]).sim
            show = label_progress(step, f"driving: {robot} in {site}")
            record(simulation, recordings / site / robot, jobs=jobs, progress=show)
    described = describe_root(
        recordings,
        places,
        opt.read_config(),
        names=["cm2dp"],
        labels=Labels(("site", "robot")),
        engine=engine,
        jobs=jobs,
        step=step,
    )
    with described.folder.database(read_only=False) as database:
        database.build_index(progress=lambda text: step(text, 0, 1))
    found, settings = Plan.load(places).recordings, FleetSettings.load(places)
    # The odometry of cars is their true motion with errors.
    merges = {
        site: merge_site(
            places, site, found, settings, odometry="truth+noise", jobs=jobs, step=step
        )
        for site in _SITES
    }
    return described, merges, write_page(places, 10, step)
