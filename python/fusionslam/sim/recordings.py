# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Record drives through worlds as bags or folders, including the embedded recordings."""

import os
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from fusionslam.base.cache import cache_folder, cached_path
from fusionslam.base.progress import Progress
from fusionslam.config import Section, explain_choice, merged, option
from fusionslam.datasets.bags import open_writer
from fusionslam.errors import ConfigError, DataError
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.sim.catalogue import (
    MADE,
    ROBOT,
    Entry,
    check_world,
    drive_through,
    limits_of,
    read_world,
)
from fusionslam.sim.folder_writer import FolderWriter, check_folder, first_lidar, folder_writer
from fusionslam.sim.motion.planner import PlanConfig
from fusionslam.sim.robot import RobotConfig, robot_named
from fusionslam.sim.simulator import (
    Select,
    SimulationConfig,
    event_count,
    odometry_errors,
    scan_count,
    simulate,
)
from fusionslam.sim.town.kitti_recorder import SimConfig, embedded_drive, record
from fusionslam.sim.world import World, hash_world

FOLDER = "folder"
"""The kind of output that is a folder instead of a bag."""
EMBEDDED = tuple(name for name, entry in MADE.items() if entry.robot == ROBOT)
"""Worlds whose embedded recording is kept in the user's cache."""
# Part of the cache key: increment when the same configuration gives different bytes.
_FORMAT = 1
# Default length: a full tour takes up to half an hour of driving, and hours to render.
_LENGTH_M = 100.0
# Changes for the embedded recordings: a short tour of the whole world, parts of it repeated and
# reversed, and one image per scan. The hospital is cut: all of it would take twice this.
_EMBEDDED: dict[str, Any] = {
    "plan": {"length_m": None, "spacing_m": 8.0, "again": 0.2, "back": 0.2},
    "robot": {"cameras": {"camera": {"rate_hz": 2.0}}},
}
_HOSPITAL_M = 350.0


class RecordingConfig(SimulationConfig):
    """A drive through a world and how it is recorded."""

    robot: RobotConfig = option(robot_named(ROBOT), "the robot")
    plan: PlanConfig = option(
        PlanConfig(length_m=_LENGTH_M), "the planned drive, if the world has none of its own"
    )
    world: Section = option(Section(), "the world, if it is procedural")


def recording_config(entry: Entry | None = None, robot: str | None = None) -> RecordingConfig:
    """The full configuration of a recording, with defaults.

    Args:
        entry: the world, if it is procedural; its settings become ``world``.
        robot: name or file of the robot; None for the one that suits the world.

    Raises:
        ConfigError: no such robot.
    """
    own = robot_named(robot or (entry.robot if entry else ROBOT))
    settings = entry.settings if entry else Section()
    kind: Any = type(settings)

    class WorldRecordingConfig(RecordingConfig):
        robot: RobotConfig = option(own, "the robot")
        world: kind = option(settings, "the world, if it is procedural")

    return WorldRecordingConfig()


def resolve_config(config: RecordingConfig) -> RecordingConfig:
    """The configuration with derived values (plan limits, odometry seed) filled in."""
    seed = odometry_errors(config.robot, config).seed
    own = limits_of(config.robot, config.plan)
    return merged(config, {"plan": own, "robot": {"odometry": {"errors": {"seed": seed}}}})


def check_output(output: Path, kind: str, robot: RobotConfig) -> None:
    """Check the output path before the costly building of a world.

    Raises:
        DataError: something else exists at this path.
        ConfigError: the robot's sensors cannot be written as a folder.
    """
    target = output.expanduser()
    check_parents(target)
    if kind == FOLDER:
        FolderWriter(target, robot)
        check_folder(target)
    elif kind == "rosbag2" and target.is_file():
        raise DataError(f"{target} is a file, expected a folder to write")
    elif kind != "rosbag2" and target.is_dir():
        raise DataError(f"{target} is a folder, expected a file to write")


def check_parents(path: Path) -> None:
    """Raise DataError if a parent of the path is a file."""
    for folder in path.parents:
        if folder.is_file():
            raise DataError(f"cannot write {path}: {folder} is a file, expected a folder")


def write_recording(
    world: World,
    drive: Trajectory,
    config: RecordingConfig,
    output: Path,
    *,
    kind: str = "rosbag1",
    jobs: int = 1,
    progress: Progress | None = None,
) -> int:
    """Record a drive; return the number of messages written, or of frames in a folder.

    Args:
        world: the world, with its map.
        drive: the robot's drive through it.
        config: robot and sensors; its ``plan`` and ``world`` are not used here.
        output: bag or folder.
        kind: "rosbag1", "rosbag2", "mcap" or ``FOLDER``.
        jobs: threads that render ahead. The bytes do not depend on it.
        progress: called with (messages or frames written, total).

    Raises:
        DataError: the drive meets an obstacle, or the output cannot be written; complete parts
            are kept as described in ``open_writer`` and ``folder_writer``.
    """
    total, robot = recording_size(drive, config, kind), config.robot
    images = {camera.picture_topic(): camera.stored for camera in robot.cameras.values()}
    writing: AbstractContextManager[Any] = (
        folder_writer(output, robot) if kind == FOLDER else open_writer(output, kind, images=images)
    )
    with writing as writer:
        select: Select = writer.select_tasks if isinstance(writer, FolderWriter) else iter
        for event in simulate(world, robot, drive, config, jobs=jobs, select=select):
            writer.write(event)
            if progress is not None:
                progress(writer.count, total)
    return int(writer.count)


def recording_size(drive: Trajectory, config: RecordingConfig, kind: str) -> int:
    """Number of messages, or of frames in a folder, that ``write_recording`` writes."""
    robot = config.robot
    if kind != FOLDER:
        return event_count(robot, drive, config)
    return scan_count(first_lidar(robot), drive, config)


def embedded_config(name: str) -> RecordingConfig:
    """Configuration of the embedded recording of a world, one of ``EMBEDDED``."""
    config = merged(recording_config(MADE[name]), _EMBEDDED)
    return merged(config, {"plan": {"length_m": _HOSPITAL_M}}) if name == "hospital" else config


def embedded_bag(
    name: str,
    config: RecordingConfig | None = None,
    *,
    jobs: int = 1,
    progress: Progress | None = None,
) -> Path:
    """Path of a procedural world's recording: a bag in the user's cache, made on first use.

    Args:
        name: one of ``EMBEDDED``.
        config: replaces ``embedded_config``; each configuration has its own bag.
        jobs: threads.
        progress: called with (messages written, total).

    Raises:
        DataError: the cache cannot be written.
    """
    chosen = config or embedded_config(name)
    path = embedded_path(name, chosen)
    if not path.exists():
        world, drive = drive_through(MADE[name].make(chosen.world), chosen.robot, chosen.plan)
        write_recording(world, drive, chosen, path, jobs=jobs, progress=progress)
    return path


def record_world(
    world: str | os.PathLike[str], *, jobs: int = 1, progress: Progress | None = None
) -> Path:
    """Path of a recorded drive through a world, kept in the user's cache and made on first use.

    A world file's own drive is followed; if it has none, one of 100 m is planned.

    Args:
        world: name of a simulated world, or a path that ``load_world`` reads.
        jobs: threads.
        progress: called with (messages or frames written, total).

    Returns:
        A bag; for the town, a folder in KITTI odometry layout.

    Raises:
        DataError: no such world, it cannot be read, or the cache cannot be written.
    """
    name = str(world)
    check_world(name)
    if name in EMBEDDED:
        return embedded_bag(name, jobs=jobs, progress=progress)
    if name in MADE:
        return embedded_drive(jobs=jobs, progress=progress)
    config = merged(recording_config(), {"robot": _EMBEDDED["robot"]})
    place = read_world(name)
    path = _bag_path(place.name, {"world": hash_world(place), "config": _values(config)})
    if not path.exists():
        place, drive = drive_through(place, config.robot, config.plan)
        write_recording(place, drive, config, path, jobs=jobs, progress=progress)
    return path


def record_seed(name: str, seed: int, *, jobs: int = 1, progress: Progress | None = None) -> Path:
    """Path of a recorded drive through another world of a kind, kept in the user's cache.

    Args:
        name: of a procedural world.
        seed: of the world, its drive and the noise.
        jobs: threads.
        progress: called with (messages or frames written, total).

    Raises:
        ConfigError: no such kind of world, or a seed out of range.
        DataError: the cache cannot be written.
    """
    if name in EMBEDDED:
        seeds = {"seed": seed, "world": {"seed": seed}, "plan": {"seed": seed}}
        config = merged(embedded_config(name), seeds)
        return embedded_bag(name, config, jobs=jobs, progress=progress)
    if name not in MADE:
        problem = f"{name!r} has no seed, {explain_choice(name, tuple(MADE))}"
        raise ConfigError(problem, code="choice", fields=(name, str(seed)))
    town = merged(SimConfig(), {"seed": seed, "town": {"seed": seed}})
    return record(town, cache_folder() / f"{name}-{seed}", jobs=jobs, progress=progress)


def embedded_path(name: str, config: RecordingConfig) -> Path:
    """Path of the bag of ``embedded_bag``, whether it exists or not."""
    return _bag_path(name, {"config": _values(config)})


def _values(config: RecordingConfig) -> dict[str, Any]:
    return config.model_dump(mode="json", serialize_as_any=True)


def _bag_path(name: str, identity: dict[str, Any]) -> Path:
    return cached_path(name, {"format": _FORMAT, **identity}, ".bag")
