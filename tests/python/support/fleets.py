# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A small fleet of made recordings, and what describes it."""

import hashlib
import os
import signal
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fusionslam import FusionConfig
from fusionslam.datasets.pose_files import write_poses_kitti
from fusionslam.errors import DataError
from fusionslam.fleet.chunk import Chunk, describe_chunk
from fusionslam.fleet.config import FleetConfig, FleetSettings
from fusionslam.fleet.engines import Engine, Work
from fusionslam.fleet.folder import FleetFolder
from fusionslam.fleet.recordings import Found, Labels, find_recordings
from fusionslam.fleet.settings import settle_settings
from fusionslam.fleet.work import Failure, Plan, describe_recordings
from fusionslam.pipelines.describe import PipelineConfig
from streets import RETURN, WAY, Floats, write_street

MONDAY, TUESDAY, WEDNESDAY = "north/r1/monday", "north/r2/tuesday", "south/r3/wednesday"
LABELS = Labels(("site", "robot"))
FRAMES = 27
"""Of ``write_fleet``: 9 of monday, 9 of tuesday, 9 of wednesday."""


def write_fleet(root: Path) -> Path:
    """Two robots in the north, one in the south: root/SITE/ROBOT/DAY."""
    write_drive(root / MONDAY, WAY[:9], 0)
    write_drive(root / TUESDAY, RETURN, 100)
    write_drive(root / WEDNESDAY, WAY[:9], 200, place=7)
    return root


def write_drive(folder: Path, way: list[Floats], seed: int, *, place: int = 12) -> Path:
    """A street with its true poses."""
    write_street(folder, way, seed, place=place)
    write_poses_kitti(folder / "poses.txt", np.asarray(way))
    return folder


class InProcess:
    """Does the work here: what the other engines are compared with."""

    def __init__(self) -> None:
        self.begun: list[Chunk] = []

    def run(
        self, chunks: Iterable[Chunk], work: Work
    ) -> Iterator[tuple[Chunk, BaseException | None]]:
        for chunk in chunks:
            self.begun.append(chunk)
            error: BaseException | None = None
            try:
                work(chunk)
            except Exception as problem:
                error = problem
            yield chunk, error

    def close(self) -> None:
        pass


def settings_for(found: Found, folder: Path, **fleet: Any) -> FleetSettings:
    """Settings with M2DP and chunks of four frames, stored in a folder."""
    config = PipelineConfig(fusion=FusionConfig(source="cloud"))
    asked = FleetConfig(**({"chunk": 4} | fleet))
    return settle_settings(found, ["m2dp"], config, asked, folder)


def describe_fleet(
    root: Path, folder: Path, engine: Engine | None = None, **fleet: Any
) -> list[Failure]:
    """Describe all below a root without a database; return what failed."""
    found = find_recordings(root, LABELS)
    settings = settings_for(found, folder, **fleet)
    plan = Plan.make(root, found, settings)
    plan.save(folder)
    return describe_recordings(plan, settings, folder, engine or InProcess())


def describe_with_database(root: Path, path: Path) -> tuple[list[Failure], InProcess]:
    """Describe all below a root, and add it to the folder's database."""
    settings, engine = settings_for(find_recordings(root, LABELS), path), InProcess()
    plan = Plan.make(root, find_recordings(root, LABELS), settings)
    return FleetFolder(path, settings).describe(plan, engine), engine


def chunk_files(folder: Path) -> list[Path]:
    """All files of chunks, by name."""
    return sorted(path for path in (folder / "chunks").rglob("*") if path.is_file())


def digests(folder: Path) -> dict[str, str]:
    """Digest of every file of a chunk, by its name."""
    return {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in chunk_files(folder)
    }


def plan_of(root: Path, folder: Path, **fleet: Any) -> tuple[Plan, FleetSettings]:
    found = find_recordings(root, LABELS)
    settings = settings_for(found, folder, **fleet)
    return Plan.make(root, found, settings), settings


def keys_of(root: Path, settings: FleetSettings) -> dict[str, tuple[str, ...]]:
    """Keys of the chunks of each recording."""
    plan = Plan.make(root, find_recordings(root, LABELS), settings)
    return {each.recording.session: each.keys for each in plan.recordings}


def with_fleet(settings: FleetSettings, **changes: Any) -> FleetSettings:
    return replace(settings, fleet=settings.fleet.model_copy(update=changes))


# Work that goes wrong; other processes import it from here.


def poisonous_chunk(chunk: Chunk, settings: FleetSettings, folder: Path) -> None:
    """Describe a chunk; the process does not survive the second of tuesday."""
    if chunk.recording.session.endswith("tuesday") and chunk.first == 4:
        os.kill(os.getpid(), signal.SIGKILL)
    describe_chunk(chunk, settings, folder)


def deadly_chunk(chunk: Chunk, settings: FleetSettings, folder: Path) -> None:
    """Describe a chunk; the first two processes of those that do so are killed, before or after."""
    for number in range(2):
        with suppress(FileExistsError):
            (folder / f"killed-{number}").touch(exist_ok=False)
            if number:
                describe_chunk(chunk, settings, folder)
            os.kill(os.getpid(), signal.SIGKILL)
    describe_chunk(chunk, settings, folder)


def chunk_of_faults(chunk: Chunk, folder: Path) -> None:
    """Raise what a fault of the program would, and what cannot be pickled; exit hard."""
    name = chunk.recording.session
    (folder / f"{name}-{chunk.first}-{os.getpid()}").touch()
    if name == "fault":
        raise ZeroDivisionError("a fault")
    if name == "refused":
        raise DataError("it is refused", code="some-code", fields=("a", "b"))
    if name == "strange":

        class StrangeError(Exception):
            pass

        raise StrangeError("of a class that no other process knows")
    if name == "exit":
        os._exit(3)
