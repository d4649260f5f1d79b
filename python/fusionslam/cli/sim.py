# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command sim: a robot driven through a world, and a recording of what it publishes."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fusionslam.base.progress import label_progress
from fusionslam.base.texts import counted
from fusionslam.cli import options as opt
from fusionslam.cli.console import during, progress
from fusionslam.cli.failures import PARTIAL, keep, needs_extra
from fusionslam.errors import ConfigError

if TYPE_CHECKING:
    from fusionslam.geometry.trajectory import Trajectory
    from fusionslam.sim.recordings import RecordingConfig

FORMATS = {"bag": "rosbag1", "db3": "rosbag2", "mcap": "mcap", "folder": "folder"}
"""Values of --format, which are also the suffixes of outputs, and the writers' names for them."""


@opt.command
def sim(
    world: Annotated[
        str,
        typer.Argument(
            metavar="WORLD",
            autocompletion=opt.completed_from(lambda: opt.WORLDS),
            help="warehouse, house, hospital, town, or a .glb, .world or .sdf.",
        ),
    ],
    ctx: typer.Context,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="X.bag, X.db3 (a folder), X.mcap, or a plain folder."),
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option("--robot", metavar="R", help="Name or YAML file; by default the world's."),
    ] = None,
    trajectory: Annotated[
        Path | None,
        typer.Option(
            "--trajectory", metavar="T", help="CSV t,x,y,yaw; by default the world's, or planned."
        ),
    ] = None,
    format: Annotated[
        str | None,
        opt.one_of("--format", names=tuple(FORMATS), help="Of the output; by default by suffix."),
    ] = None,
    seconds: Annotated[
        float | None, typer.Option("--seconds", help="Duration; by default the whole drive.")
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option("--seed", min=0, help="Seed of noise, moving boxes and planned drives."),
    ] = None,
    obstacles: Annotated[
        int | None,
        typer.Option("--obstacles", metavar="N", min=0, help="Number of moving boxes on the way."),
    ] = None,
    lenient: Annotated[
        bool, typer.Option("--lenient", help="Leave out meshes and textures that are missing.")
    ] = False,
    save_trajectory: Annotated[
        Path | None,
        typer.Option("--save-trajectory", metavar="FILE", help="Also write the drive as CSV."),
    ] = None,
    save_map: Annotated[
        Path | None,
        typer.Option(
            "--save-map", metavar="FILE.yaml", help="Also write the map as for ROS map_server."
        ),
    ] = None,
    print_config: Annotated[
        bool, typer.Option("--print-config", help="Print all values as YAML, without a drive.")
    ] = False,
    settings: opt.Settings = None,
    config: Annotated[
        Path | None,
        typer.Option("--config", metavar="FILE", help="YAML, as --print-config prints."),
    ] = None,
    jobs: opt.Jobs = None,
) -> None:
    """Drive a robot through WORLD and record what its sensors publish.

    --set takes robot.lidars.NAME.KEY, robot.odometry.errors.KEY, obstacles.KEY, movers.KEY,
    plan.KEY and, for built-in worlds, world.KEY.
    """
    needs_extra("sim")
    from fusionslam.config import as_yaml
    from fusionslam.geometry.trajectory import read_trajectory, write_trajectory
    from fusionslam.sim.catalogue import MADE, check_world, drive_through, read_world
    from fusionslam.sim.motion.map_files import write_map
    from fusionslam.sim.recordings import (
        check_output,
        check_parents,
        resolve_config,
        write_recording,
    )

    check_world(world)
    changes = _changes(seed, seconds, obstacles)
    chosen = _chosen(world, robot, config, changes, settings)
    if print_config:
        print(as_yaml(resolve_config(chosen)), end="")
        return
    output, kind = _output(output, format)
    check_output(output, kind, chosen.robot)
    for file in filter(None, (save_trajectory, save_map)):
        check_parents(file)
        opt.check_output(file, Path(world), trajectory, config, output)
    way = None if trajectory is None else read_trajectory(trajectory)
    with progress() as step:
        with during(step, "preparing world and drive"):
            entry = MADE.get(world)
            place = entry.make(chosen.world) if entry else read_world(world, lenient=lenient)
            if way is not None:
                place = replace(place, trajectory=way)
            place, drive = drive_through(place, chosen.robot, chosen.plan)
            if save_map is not None and place.map is not None:
                write_map(save_map, place.map)
            if save_trajectory is not None:
                write_trajectory(save_trajectory, drive)
        _announce(output, kind, drive, chosen)
        keep(ctx, output, PARTIAL)
        count = write_recording(
            place,
            drive,
            chosen,
            output,
            kind=kind,
            jobs=opt.cores(jobs),
            progress=label_progress(step, "driving"),
        )
    print(f"{output}: {_count_noun(count, kind)}")


def _output(path: Path | None, format: str | None) -> tuple[Path, str]:
    """Return the output path and its kind, from format or suffix; checks for a needed extra."""
    if path is None:
        raise ConfigError("--output is missing: expected a bag or a folder to write")
    kind = FORMATS.get(format or path.suffix.lower().lstrip("."), "folder")
    if kind == "folder" and format is None:
        known = [f".{name}" for name in FORMATS if name != "folder"]
        opt.check_folder_name(path, known, "--format folder")
    if kind != "folder":
        needs_extra("bags")
    return path, kind


def _announce(output: Path, kind: str, drive: "Trajectory", config: "RecordingConfig") -> None:
    """Say what will be written, if no progress bar shows it."""
    from fusionslam.sim.recordings import recording_size
    from fusionslam.sim.simulator import recorded_seconds

    if not sys.stderr.isatty():
        size = _count_noun(recording_size(drive, config, kind), kind)
        seconds = recorded_seconds(drive, config)
        print(f"{output}: {size} of {seconds:.1f} s of driving to write", file=sys.stderr)


def _count_noun(count: int, kind: str) -> str:
    return counted(count, "frame" if kind == "folder" else "message", ",")


def _changes(seed: int | None, seconds: float | None, obstacles: int | None) -> dict[str, Any]:
    """Return the changes made by options; --seed sets every seed except the world's."""
    options: dict[str, Any] = {"seed": seed, "seconds": seconds}
    changes = {key: value for key, value in options.items() if value is not None}
    if seed is not None:
        changes["plan"] = {"seed": seed}
    if obstacles is not None:
        changes["obstacles"] = {"number": obstacles}
    return changes


def _chosen(
    name: str,
    robot: str | None,
    file: Path | None,
    changes: dict[str, Any],
    settings: list[str] | None,
) -> "RecordingConfig":
    """Return the defaults, changed by the file, then by options, then by settings."""
    from fusionslam.config import merged, with_file, with_settings
    from fusionslam.sim.catalogue import MADE
    from fusionslam.sim.recordings import recording_config

    entry = MADE.get(name)
    own = [text for text in settings or [] if text.strip().startswith("world.")]
    if own and entry is None:
        raise ConfigError(f"--set {own[0]}: worlds from files have no settings")
    config = recording_config(entry, robot)
    if file is not None:
        config = with_file(config, file)
    return with_settings(merged(config, changes), settings or [])
