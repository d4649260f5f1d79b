# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command that drives a robot through a world and records what it publishes."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.guard import keep_partial, needs_extra
from fusionslam.cli.screen import progress

if TYPE_CHECKING:
    from fusionslam.sim.motion.trajectory import Trajectory
    from fusionslam.sim.recording import RecordingConfig
    from fusionslam.sim.world import World

FORMATS = {"bag": "rosbag1", "db3": "rosbag2", "mcap": "mcap", "folder": "folder"}
"""Names of --format, which are the outputs' suffixes, and what the writers call them."""


def sim(
    world: Annotated[
        str,
        typer.Argument(
            metavar="WORLD", help="warehouse, house, hospital, town, or a .glb, .world or .sdf."
        ),
    ],
    ctx: typer.Context,
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="X.bag, X.db3 (a folder), X.mcap, or a plain folder."),
    ],
    robot: Annotated[
        str | None,
        typer.Option("--robot", metavar="R", help="Name or YAML file; else the world's."),
    ] = None,
    trajectory: Annotated[
        Path | None,
        typer.Option("--trajectory", metavar="T", help="CSV t,x,y,yaw; else its own or planned."),
    ] = None,
    format: Annotated[
        str | None, typer.Option("--format", help="bag, db3, mcap or folder; else the suffix says.")
    ] = None,
    seconds: Annotated[
        float | None, typer.Option("--seconds", help="How long; else the whole drive.")
    ] = None,
    seed: Annotated[
        int | None, typer.Option("--seed", help="Decides noise, moving boxes and planned drives.")
    ] = None,
    obstacles: Annotated[
        int | None, typer.Option("--obstacles", metavar="N", help="Moving boxes on the way.")
    ] = None,
    lenient: Annotated[
        bool, typer.Option("--lenient", help="Go on without meshes and textures that are missing.")
    ] = False,
    settings: opt.Settings = None,
    config: opt.ConfigFile = None,
    jobs: opt.Jobs = None,
    verbose: opt.Verbose = False,
) -> None:
    """Drive a robot through WORLD and record what its sensors publish.

    --set takes robot.lidars.NAME.KEY, robot.odometry.errors.KEY, obstacles.KEY, plan.KEY and,
    for worlds that are made, world.KEY.
    """
    needs_extra("sim")
    kind = _kind(output, format)
    if kind != "folder":
        needs_extra("bags")
    from fusionslam.sim.recording import write_recording

    # --seed means all that is random on the drive; the world has a seed of its own.
    first: dict[str, Any] = {"seed": seed, "seconds": seconds}
    changes = {key: value for key, value in first.items() if value is not None}
    if seed is not None:
        changes["plan"] = {"seed": seed}
    if obstacles is not None:
        changes["obstacles"] = {"number": obstacles}
    with progress() as step:
        step("preparing world and drive", 0, 1)
        chosen, place = _chosen(world, robot, changes, config, settings, lenient)
        place, drive = _drive(place, chosen, trajectory)
        step("preparing world and drive", 1, 1)
        keep_partial(ctx, output)
        count = write_recording(
            place,
            drive,
            chosen,
            output,
            kind=kind,
            jobs=opt.cores(jobs),
            progress=lambda done, total: step("driving", done, total),
        )
    print(f"{output}: {_counted(count, kind)}")


def _counted(count: int, kind: str) -> str:
    noun = "frame" if kind == "folder" else "message"
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


def _kind(output: Path, format: str | None) -> str:
    if format is not None:
        opt.one_of("--format", format, tuple(FORMATS))
    return FORMATS.get(format or output.suffix.lower().lstrip("."), "folder")


def _chosen(
    name: str,
    robot: str | None,
    changes: dict[str, Any],
    file: Path | None,
    settings: list[str] | None,
    lenient: bool,
) -> "tuple[RecordingConfig, World]":
    """All settings, and the world they make or that was read."""
    from fusionslam.config import merged, with_file, with_settings
    from fusionslam.sim.catalogue import MADE, read_world
    from fusionslam.sim.recording import recording_config

    entry = MADE.get(name)
    config = merged(recording_config(entry, robot), changes)
    if file is not None:
        config = with_file(config, file)
    config = with_settings(config, settings or [])
    return config, entry.make(config.world) if entry else read_world(name, lenient=lenient)


def _drive(
    place: "World", config: "RecordingConfig", path: Path | None
) -> "tuple[World, Trajectory]":
    from dataclasses import replace

    from fusionslam.sim.catalogue import drive_through
    from fusionslam.sim.motion.trajectory import read_trajectory

    if path is not None:
        place = replace(place, trajectory=read_trajectory(path))
    return drive_through(place, config.robot, config.plan)
