# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command demo: all descriptors on a simulated drive."""

from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fusionslam.base.progress import Step, label_progress
from fusionslam.cli import options as opt
from fusionslam.cli.bench import compare
from fusionslam.cli.console import progress
from fusionslam.cli.failures import keep, needs_extra
from fusionslam.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from fusionslam.pipelines.recording import Recording


@opt.command
def demo(
    ctx: typer.Context,
    output: opt.Folder = Path("out/demo"),
    world: Annotated[
        str,
        opt.one_of("--world", names=opt.WORLDS, help="Of a car (town) or a robot (the others)."),
    ] = "town",
    quick: Annotated[
        bool,
        typer.Option("--quick", help="Two rounds of one block of a town: does it all work?"),
    ] = False,
    settings: opt.Settings = None,
    config: opt.ConfigFile = None,
    jobs: opt.Jobs = None,
    no_report: opt.NoReport = False,
) -> None:
    """Compare all descriptors on a simulated drive, and map it; needs no data.

    --set sim.KEY changes the simulation: for the town with the keys that config sim prints, for
    the other worlds with those of the command sim.
    """
    from fusionslam.cli.map_building import map_drive
    from fusionslam.pipelines.compare_descriptors import (
        DEMO,
        DEMO_DESCRIPTORS,
        INDOOR,
        INDOOR_DESCRIPTORS,
        QUICK_TOWN,
    )

    if quick and world != "town":
        raise ConfigError(
            f"--quick is for the town, not for {world}", code="choice", fields=("--quick", world)
        )
    for extra in ("sim",) if world == "town" else ("sim", "bags"):
        needs_extra(extra)
    if not no_report:
        needs_extra("report", unless="--no-report")
    own = [setting for setting in settings or [] if setting.strip().startswith("sim.")]
    others = [setting for setting in settings or [] if setting not in own]
    if quick:
        own = [*QUICK_TOWN, *own]
    indoor = world != "town"
    descriptors = INDOOR_DESCRIPTORS if indoor else DEMO_DESCRIPTORS
    configs = {
        source: opt.pipeline_config(others, config, **(INDOOR if indoor else DEMO.get(source, {})))
        for source in descriptors
    }
    keep(ctx, output)
    with progress() as step:
        cores = opt.cores(jobs)
        if indoor:
            recording = _robot_drive(world, own, output, cores, step)
        else:
            recording = _car_drive(config, own, output, cores, step)
    # Closer to a wall than its LiDAR's minimum range, a robot has nothing to describe.
    compare(
        recording,
        output,
        descriptors,
        configs,
        jobs=jobs,
        no_report=no_report,
        demo=True,
        skip_bad_frames=indoor,
        before_report=partial(
            map_drive,
            recording,
            output,
            world,
            configs["lidar"],
            jobs=opt.cores(jobs),
            no_report=no_report,
        ),
    )


def _car_drive(
    file: Path | None, settings: list[str], output: Path, jobs: int, step: Step
) -> "Recording":
    """Return the drive through the town: the embedded one, or one as configured."""
    from fusionslam.pipelines.recording import Recording
    from fusionslam.pipelines.results import forget_demo
    from fusionslam.sim import SimConfig, embedded_folder, record

    simulation: SimConfig = opt.read_config(settings, file).sim
    folder = embedded_folder() if simulation == SimConfig() else output / "drive"
    recording = Recording.at(folder)
    forget_demo(output, recording)
    with _cache_can_move(folder == embedded_folder()):
        show = label_progress(step, "driving through the town")
        record(simulation, folder, jobs=jobs, progress=show)
    return recording


def _robot_drive(
    world: str, settings: list[str], output: Path, jobs: int, step: Step
) -> "Recording":
    """Return the drive of a robot through one of the other worlds, kept in the cache."""
    from fusionslam.config import with_settings
    from fusionslam.pipelines.recording import Recording
    from fusionslam.pipelines.results import forget_demo
    from fusionslam.sim.recordings import embedded_bag, embedded_config, embedded_path

    own = [setting.strip().removeprefix("sim.") for setting in settings]
    config = with_settings(embedded_config(world), own)
    recording = Recording.at(embedded_path(world, config))
    forget_demo(output, recording)
    with _cache_can_move(True):
        embedded_bag(world, config, jobs=jobs, progress=label_progress(step, f"driving: {world}"))
    return recording


@contextmanager
def _cache_can_move(cached: bool) -> "Iterator[None]":
    """Say how to move the user's cache if it cannot be written."""
    from fusionslam.errors import DataError

    try:
        yield
    except DataError as error:
        if not cached:
            raise
        hint = "the environment variable FUSIONSLAM_CACHE can name another folder"
        raise DataError(f"{error}; {hint}", code="cache") from error
