# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Drives through worlds as bags or folders, and the embedded ones that need no data."""

import hashlib
import json
import os
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from fusionslam.config import Section, merged, option
from fusionslam.datasets.bags import open_writer
from fusionslam.errors import DataError
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
from fusionslam.sim.town.kitti_recorder import embedded_drive
from fusionslam.sim.world import World
from fusionslam.sim.worlds import world_file
from fusionslam.storage.cache import cache_folder
from fusionslam.storage.progress import Progress

FOLDER = "folder"
"""The kind of output that is no bag."""
EMBEDDED = tuple(name for name, entry in MADE.items() if entry.robot == ROBOT)
"""Worlds of which a recording is kept in the user's cache."""
# Part of the cache's key: raise it when the same configuration gives other bytes.
_FORMAT = 1
# A whole tour takes up to half an hour of driving, and hours to render.
_LENGTH_M = 100.0
# What the embedded recordings change: a short way through all of the world, parts of it again and
# back, and one image a scan. All of the hospital would take twice this.
_EMBEDDED: dict[str, Any] = {
    "plan": {"length_m": None, "spacing_m": 8.0, "again": 0.2, "back": 0.2},
    "robot": {"cameras": {"camera": {"rate_hz": 2.0}}},
}
_HOSPITAL_M = 350.0


class RecordingConfig(SimulationConfig):
    """A drive through a world and what is recorded of it."""

    robot: RobotConfig = option(robot_named(ROBOT), "the robot")
    plan: PlanConfig = option(PlanConfig(length_m=_LENGTH_M), "the drive, where it is planned")
    world: Section = option(Section(), "the world, if it is made")


def recording_config(entry: Entry | None = None, robot: str | None = None) -> RecordingConfig:
    """All there is to configure of a recording, with its defaults.

    Args:
        entry: the world, if it is one that is made; its settings are ``world``.
        robot: name or file of the robot; None for the one that suits the world.

    Raises:
        ConfigError: no such robot.
    """
    own = robot_named(robot or (entry.robot if entry else ROBOT))
    settings = entry.settings if entry else Section()
    kind: Any = type(settings)

    class WorldRecordingConfig(RecordingConfig):
        robot: RobotConfig = option(own, "the robot")
        world: kind = option(settings, "the world, if it is made")

    return WorldRecordingConfig()


def resolved(config: RecordingConfig) -> RecordingConfig:
    """The configuration with what would follow from other values written out."""
    seed = odometry_errors(config.robot, config).seed
    own = limits_of(config.robot, config.plan)
    return merged(config, {"plan": own, "robot": {"odometry": {"errors": {"seed": seed}}}})


def check_output(output: Path, kind: str, robot: RobotConfig) -> None:
    """Find out before a world is made what can be known of the output.

    Raises:
        DataError: something else is in its place.
        ConfigError: the robot does not fit a folder.
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
    """Raise DataError if a file is where a folder above the path should be."""
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
    """Write what the robot publishes, and return the number of messages, or of frames in a folder.

    Args:
        world: with its map.
        drive: of the robot through it.
        config: robot and sensors; its plan and world have been followed already.
        output: bag or folder.
        kind: "rosbag1", "rosbag2", "mcap" or ``FOLDER``.
        jobs: threads that render ahead. The bytes do not depend on it.
        progress: called with (messages or frames written, those in all).

    Raises:
        DataError: the drive meets an obstacle, or the output cannot be written; what is whole is
            kept as ``open_writer`` or ``folder_writer`` say.
    """
    total = recording_size(drive, config, kind)
    with _writer(output, kind, config.robot) as writer:
        select: Select = writer.needed if isinstance(writer, FolderWriter) else iter
        for event in simulate(world, config.robot, drive, config, jobs=jobs, select=select):
            writer.write(event)
            if progress is not None:
                progress(writer.count, total)
    return int(writer.count)


def recording_size(drive: Trajectory, config: RecordingConfig, kind: str) -> int:
    """How many messages, or frames in a folder, ``write_recording`` writes."""
    robot = config.robot
    if kind != FOLDER:
        return event_count(robot, drive, config)
    return scan_count(first_lidar(robot), drive, config)


def embedded_config(name: str) -> RecordingConfig:
    """How the embedded recording of a world is made: one of ``EMBEDDED``."""
    config = merged(recording_config(MADE[name]), _EMBEDDED)
    return merged(config, {"plan": {"length_m": _HOSPITAL_M}}) if name == "hospital" else config


def embedded_bag(
    name: str,
    config: RecordingConfig | None = None,
    *,
    jobs: int = 1,
    progress: Progress | None = None,
) -> Path:
    """The recording of a world that is made: a bag in the user's cache, made when first asked for.

    Args:
        name: one of ``EMBEDDED``.
        config: another one than ``embedded_config``, which has a bag of its own.
        jobs: threads.
        progress: called with (messages written, messages in all).

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
    """A recorded drive through a world, kept in the user's cache and made when first asked for.

    A world's own drive is followed, or one of 100 m is planned.

    Args:
        world: name of a simulated world, or what ``load_world`` reads.
        jobs: threads.
        progress: called with (messages or frames written, those in all).

    Returns:
        A bag; of the town a folder like KITTI's.

    Raises:
        DataError: no such world, one that cannot be read, or a cache that cannot be written.
    """
    name = str(world)
    check_world(name)
    if name in EMBEDDED:
        return embedded_bag(name, jobs=jobs, progress=progress)
    if name in MADE:
        return embedded_drive(jobs=jobs, progress=progress)
    config = merged(recording_config(), {"robot": _EMBEDDED["robot"]})
    file = world_file(world)
    path = _cached_bag(file.stem, {"files": _digest(file), "config": _values(config)})
    if not path.exists():
        place, drive = drive_through(read_world(name), config.robot, config.plan)
        write_recording(place, drive, config, path, jobs=jobs, progress=progress)
    return path


def _digest(world: Path) -> str:
    """What differs between worlds of other files; meshes and textures elsewhere do not count."""
    found = hashlib.sha256()
    for suffix in (world.suffix, ".collision.glb", ".map.yaml", ".trajectory.csv"):
        file = world.with_suffix(suffix)
        found.update(file.read_bytes() if file.is_file() else b"-")
    return found.hexdigest()


def embedded_path(name: str, config: RecordingConfig) -> Path:
    """Where ``embedded_bag`` keeps its bag, whether it has been made or not."""
    return _cached_bag(name, {"config": _values(config)})


def _values(config: RecordingConfig) -> dict[str, Any]:
    return config.model_dump(mode="json", serialize_as_any=True)


def _cached_bag(name: str, identity: dict[str, Any]) -> Path:
    text = json.dumps({"format": _FORMAT, **identity}, sort_keys=True)
    return cache_folder() / f"{name}-{hashlib.sha256(text.encode()).hexdigest()[:12]}.bag"


def _writer(output: Path, kind: str, robot: RobotConfig) -> AbstractContextManager[Any]:
    if kind == FOLDER:
        return folder_writer(output, robot)
    images = {camera.picture_topic(): camera.stored for camera in robot.cameras.values()}
    return open_writer(output, kind, images=images)
