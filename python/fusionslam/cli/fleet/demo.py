# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command fleet demo: a small fleet in made towns, from recordings to the page."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import progress
from fusionslam.cli.failures import keep, needs_extra
from fusionslam.cli.fleet.describe import describe_root, print_described
from fusionslam.cli.fleet.options import Engine
from fusionslam.cli.fleet.report import write_page
from fusionslam.help_texts import counted
from fusionslam.storage.progress import Step, label_progress

if TYPE_CHECKING:
    from fusionslam.fleet.site_maps import SiteMerge
    from fusionslam.sim import SimConfig

_BLOCK = [[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]
_SITES = {"north": 1, "south": 2}
"""Seeds of the towns."""
_ROBOTS = {"r1": (0.0, _BLOCK), "r2": (-1.2, _BLOCK)}
"""How far to the side of the lane's middle each drives, and by which crossings."""


@opt.options_of()
def demo(
    ctx: typer.Context,
    output: opt.Folder = Path("out/fleet"),
    engine: Engine = "local",
    *,
    jobs: opt.Jobs = None,
) -> None:
    """Two robots drive in each of two made towns: describe, index, join and show their drives."""
    for extra in ("sim", "map", "report", "fleet"):
        needs_extra(extra)
    from fusionslam.fleet.recordings import Labels

    cores, places = opt.cores(jobs), output / "places"
    keep(ctx, output)
    with progress() as step:
        root = _record(output / "recordings", cores, step)
        described = describe_root(
            root,
            places,
            opt.read_config(),
            names=["cm2dp"],
            labels=Labels(("site", "robot")),
            engine=engine,
            jobs=cores,
            step=step,
        )
        with described.folder.database(read_only=False) as database:
            database.build_index(progress=lambda text: step(text, 0, 1))
        merges = {site: _merge(places, site, cores, step) for site in _SITES}
        page = write_page(places, 10, step)
    print_described(described)
    for site, merge in merges.items():
        joined = len(merge.known) + len(merge.added)
        print(f"{site}: {counted(joined, 'drive')} on one map, {len(merge.left_out)} left out")
    print(page)


def _record(root: Path, jobs: int, step: Step) -> Path:
    """Drive through the towns; drives that are there already stay."""
    from fusionslam.sim import record

    for site in _SITES:
        for robot in _ROBOTS:
            show = label_progress(step, f"driving: {robot} in {site}")
            record(_simulation(site, robot), root / site / robot, jobs=jobs, progress=show)
    return root


def _simulation(site: str, robot: str) -> "SimConfig":
    from fusionslam.config import with_settings
    from fusionslam.pipelines.compare_descriptors import QUICK_TOWN

    aside, crossings = _ROBOTS[robot]
    own = [
        f"sim.town.seed={_SITES[site]}",
        f"sim.seed={list(_ROBOTS).index(robot)}",
        f"sim.drive.laps=[{crossings}]",
        f"sim.drive.lap_shift_m=[{aside}]",
    ]
    simulation: SimConfig = with_settings(opt.read_config(), [*QUICK_TOWN, *own]).sim
    return simulation


def _merge(places: Path, site: str, jobs: int, step: Step) -> "SiteMerge":
    """Join the drives of a site; the odometry of cars is their true motion with errors."""
    from fusionslam.fleet.config import FleetSettings
    from fusionslam.fleet.site_maps import merge_site
    from fusionslam.fleet.work import Plan

    recordings, settings = Plan.load(places).recordings, FleetSettings.load(places)
    return merge_site(
        places, site, recordings, settings, odometry="truth+noise", jobs=jobs, step=step
    )
