# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command demo: all descriptors on a simulated drive."""

from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.bench import compare
from fusionslam.cli.console import progress
from fusionslam.cli.failures import keep, needs_extra
from fusionslam.storage.progress import Step, label_progress

if TYPE_CHECKING:
    from collections.abc import Iterator

    from fusionslam.pipelines.recording import Recording


def demo(
    ctx: typer.Context,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")] = Path(
        "out/demo"
    ),
    world: Annotated[
        str, typer.Option("--world", help="town (a car), or warehouse, house, hospital (a robot).")
    ] = "town",
    settings: opt.Settings = None,
    config: opt.ConfigFile = None,
    jobs: opt.Jobs = None,
    verbose: opt.Verbose = False,
) -> None:
    """Compare all descriptors on a simulated drive; needs no data.

    --set sim.KEY changes the simulation: what config sim prints for the town, what the command
    sim takes for the other worlds.
    """
    from fusionslam.pipelines.compare_descriptors import (
        DEMO,
        DEMO_DESCRIPTORS,
        INDOOR,
        INDOOR_DESCRIPTORS,
    )
    from fusionslam.sim.recordings import EMBEDDED

    opt.one_of("--world", world, ("town", *EMBEDDED))
    for extra in ("sim", "report") if world == "town" else ("sim", "bags", "report"):
        needs_extra(extra)
    own, others = _split_settings(settings)
    indoor = world != "town"
    descriptors = INDOOR_DESCRIPTORS if indoor else DEMO_DESCRIPTORS
    configs = {
        source: opt.pipeline_config(config, others, **(INDOOR if indoor else DEMO.get(source, {})))
        for source in descriptors
    }
    keep(ctx, output)
    with progress() as step:
        make = _robot_drive if indoor else _car_drive
        recording = make(world, config, own, output, opt.cores(jobs), step)
        # Closer to a wall than its LiDAR's minimum range, a robot has nothing to describe.
        bad = opt.bad_frames(indoor)
        compare(
            recording,
            output,
            descriptors,
            configs,
            opt.cores(jobs),
            step,
            demo=True,
            bad_frames=bad,
        )


def _split_settings(settings: list[str] | None) -> tuple[list[str], list[str]]:
    """Split settings into those of the simulator and the others."""
    own = [setting for setting in settings or [] if setting.strip().startswith("sim.")]
    return own, [setting for setting in settings or [] if setting not in own]


def _car_drive(
    world: str, file: Path | None, settings: list[str], output: Path, jobs: int, step: Step
) -> "Recording":
    """Return the drive through the town: the embedded one, or one as configured."""
    from fusionslam.config import with_file, with_settings
    from fusionslam.pipelines.recording import Recording
    from fusionslam.pipelines.results import forget_demo
    from fusionslam.sim import SimConfig, embedded_folder, record

    whole = opt.everything()
    whole = with_settings(whole if file is None else with_file(whole, file), settings)
    simulation: SimConfig = whole.sim  # type: ignore[attr-defined]
    folder = embedded_folder() if simulation == SimConfig() else output / "drive"
    recording = Recording.at(folder)
    forget_demo(output, recording)
    with _cache_can_move(folder == embedded_folder()):
        record(
            simulation, folder, jobs=jobs, progress=label_progress(step, "driving through the town")
        )
    return recording


def _robot_drive(
    world: str, file: Path | None, settings: list[str], output: Path, jobs: int, step: Step
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
        raise DataError(f"{error}; {hint}") from error
