# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command that drives a robot through a world and records what it publishes."""

from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.guard import keep_partial, needs_extra
from fusionslam.cli.screen import progress

if TYPE_CHECKING:
    from fusionslam.cli.screen import Step
    from fusionslam.sim.motion.trajectory import Trajectory
    from fusionslam.sim.robot import RobotConfig
    from fusionslam.sim.simulator import SimulationConfig
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
        count = _record(place, drive, chosen, output, kind, opt.cores(jobs), step)
    print(f"{output}: {count} messages")


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
) -> "tuple[Any, World]":
    """All settings, and the world they make or that was read."""
    from fusionslam.config import Section, merged, option, with_file, with_settings
    from fusionslam.sim.catalogue import MADE, ROBOT, read_world
    from fusionslam.sim.motion.planner import PlanConfig
    from fusionslam.sim.robot import RobotConfig, robot_named
    from fusionslam.sim.simulator import SimulationConfig

    entry = MADE.get(name)
    own = robot_named(robot or (entry.robot if entry else ROBOT))
    kind: Any = type(entry.settings) if entry else Section

    class RecordingConfig(SimulationConfig):
        """All there is to configure."""

        robot: RobotConfig = option(own, "the robot")
        plan: PlanConfig = option(PlanConfig(), "the drive, where it is planned")
        world: kind = option(entry.settings if entry else Section(), "the world, if it is made")

    config = merged(RecordingConfig(), changes)
    if file is not None:
        config = with_file(config, file)
    config = with_settings(config, settings or [])
    return config, entry.make(config.world) if entry else read_world(name, lenient=lenient)


def _drive(place: "World", config: Any, path: Path | None) -> "tuple[World, Trajectory]":
    from dataclasses import replace

    from fusionslam.sim.catalogue import drive_through
    from fusionslam.sim.motion.trajectory import read_trajectory

    if path is not None:
        place = replace(place, trajectory=read_trajectory(path))
    return drive_through(place, config.robot, config.plan)


def _record(
    place: "World",
    drive: "Trajectory",
    config: "SimulationConfig",
    output: Path,
    kind: str,
    jobs: int,
    step: "Step",
) -> int:
    """Write every message; the number of them."""
    from fusionslam.sim.simulator import event_count, simulate

    robot: RobotConfig = config.robot  # type: ignore[attr-defined]
    total = event_count(robot, drive, config)
    events = simulate(place, robot, drive, config, jobs=jobs)
    with _writer(output, kind, robot) as writer:
        for done, event in enumerate(events, start=1):
            writer.write(event)
            step("driving", done, total)
    return total


def _writer(output: Path, kind: str, robot: "RobotConfig") -> AbstractContextManager[Any]:
    from fusionslam.datasets.bags import open_writer
    from fusionslam.sim.folder import folder_writer

    if kind == "folder":
        return folder_writer(output, robot)
    images = {camera.picture_topic(): camera.stored for camera in robot.cameras.values()}
    return open_writer(output, kind, images=images)
