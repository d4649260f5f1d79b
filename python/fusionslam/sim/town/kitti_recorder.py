# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Drive the car through the town and write a folder in the layout of KITTI odometry.

With four cameras (``car.cameras``) it is a plain folder instead.

``sim.json`` is written last, so a folder with it is complete. An interrupted recording leaves
``sim.partial.json`` and is resumed with the missing frames.
"""

import hashlib
import json
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from pydantic import model_validator

from fusionslam.config import Section, option
from fusionslam.errors import DataError
from fusionslam.evaluation.loops.revisits import visits
from fusionslam.sim.camera import photograph
from fusionslam.sim.lidar import scan
from fusionslam.sim.scene import RayCaster
from fusionslam.sim.town.car import CarConfig, car_from_lidar
from fusionslam.sim.town.layout import TownConfig, make_town
from fusionslam.sim.town.recording_layout import Layout, layout_of
from fusionslam.sim.town.route import Drive, DriveConfig, make_drive
from fusionslam.storage.cache import cache_folder
from fusionslam.storage.files import atomic_path, reading
from fusionslam.storage.parallel import available_cores
from fusionslam.storage.progress import Progress

# Part of the cache key: increment when the same configuration gives different bytes.
FORMAT = 1
_DONE, _STARTED = "sim.json", "sim.partial.json"
# What other recordings may have; nothing is written beside it.
_FOREIGN = ("sequences", "poses", "clouds")


class SimConfig(Section):
    """Settings of the town's recording; on one machine the same settings give the same bytes."""

    seed: int = option(0, "decides noise, drop-outs, drift and wobble (not the town)", ge=0)
    town: TownConfig = option(TownConfig(), "the world")
    drive: DriveConfig = option(DriveConfig(), "the route")
    car: CarConfig = option(CarConfig(), "the sensors")

    @model_validator(mode="after")
    def _route_is_in_town(self) -> "SimConfig":
        columns, rows = self.town.blocks
        for crossing in self.drive.crossings():
            if not (0 <= crossing[0] <= columns and 0 <= crossing[1] <= rows):
                raise ValueError(
                    f"drive.laps: crossing {crossing} is outside the town, whose last crossing "
                    f"is {self.town.blocks}"
                )
        return self


@dataclass(frozen=True)
class _Recorder:
    """Writes single frames; shared by all threads."""

    config: SimConfig
    drive: Drive
    layout: Layout
    root: Path

    def missing(self, lap: int) -> list[int]:
        """Frames of one lap that have yet to be written."""
        frames = np.flatnonzero(self.drive.lap == lap).tolist()
        return [k for k in frames if not all(path.exists() for path in self._paths(k))]

    def write(self, caster: RayCaster, frame: int) -> None:
        """Simulate and write one frame: LiDAR sweep and images."""
        (scans, *images), car = self._paths(frame), self.config.car
        world_from_car = self.drive.poses[frame]
        swept = world_from_car @ car_from_lidar(car)
        sweep = scan(caster, car.lidar, swept, self._rng(frame, 0))
        points = np.column_stack([sweep.points, sweep.intensity])
        _write_bytes(scans, points.tobytes())
        for sensor, (path, shots) in enumerate(
            zip(images, self.layout.shots, strict=True), start=1
        ):
            gain = shots.gains[min(self.drive.lap[frame], len(shots.gains) - 1)]
            seen = world_from_car @ shots.car_from_camera
            rng = self._rng(frame, sensor)
            _write_png(path, photograph(caster, shots.lens, seen, gain, rng))

    def _paths(self, frame: int) -> list[Path]:
        """The scan's, then those of the images."""
        scans, shots = self.root / self.layout.scans, self.layout.shots
        images = [self.root / shot.folder / f"{frame:06d}.png" for shot in shots]
        return [scans / f"{frame:06d}.bin", *images]

    def _rng(self, frame: int, sensor: int) -> np.random.Generator:
        return np.random.default_rng([self.config.seed, frame, sensor])


def record(
    config: SimConfig,
    folder: str | os.PathLike[str],
    *,
    jobs: int = 1,
    progress: Progress | None = None,
) -> Path:
    """Write a recording; an interrupted one is resumed, a complete one is kept.

    Args:
        config: town, route and sensors.
        folder: output folder; created if it does not exist.
        jobs: threads. The bytes do not depend on it.
        progress: called with (frames written, total) after each frame.

    Returns:
        The folder, in KITTI odometry layout (sequence 00); with four cameras a plain folder.

    Raises:
        DataError: the folder cannot be written, or already contains something else.
    """
    root = Path(folder)
    drive = make_drive(config.drive, config.town.block_m, config.seed)
    if _claim(root, config):
        return root
    layout = layout_of(config.car, drive)
    for name, text in layout.texts.items():
        _write_bytes(root / name, text.encode())
    recorder = _Recorder(config, drive, layout, root)
    for done in _write_frames(recorder, max(jobs, 1)):
        if progress is not None:
            progress(done, len(drive.poses))
    _write_json(root / _DONE, _summary(config, drive))
    (root / _STARTED).unlink(missing_ok=True)
    return root


def embedded_drive(*, jobs: int | None = None, progress: Progress | None = None) -> Path:
    """Folder of the default recording, made on first use and kept in the user's cache.

    The environment variable FUSIONSLAM_CACHE sets another cache folder.

    Raises:
        DataError: the cache cannot be written.
    """
    threads = available_cores() if jobs is None else jobs
    return record(SimConfig(), embedded_folder(), jobs=threads, progress=progress)


def embedded_folder() -> Path:
    """Folder of the embedded drive, whether it has been made or not."""
    text = json.dumps(_identity(SimConfig()), sort_keys=True)
    return cache_folder() / f"drive-{hashlib.sha256(text.encode()).hexdigest()[:12]}"


def _write_frames(recorder: _Recorder, jobs: int) -> Iterator[int]:
    """Write the missing frames lap by lap; yield the number of frames that exist."""
    done = len(recorder.drive.poses)
    todo = {lap: recorder.missing(lap) for lap in np.unique(recorder.drive.lap).tolist()}
    done -= sum(len(frames) for frames in todo.values())
    with ThreadPoolExecutor(jobs) as pool:
        try:
            for lap, frames in todo.items():
                if not frames:
                    continue
                caster = RayCaster(make_town(recorder.config.town, lap))
                for _ in pool.map(lambda k, c=caster: recorder.write(c, k), frames):
                    done += 1
                    yield done
        except BaseException:
            pool.shutdown(wait=True, cancel_futures=True)
            raise


def _identity(config: SimConfig) -> dict[str, object]:
    values = config.model_dump(mode="json")
    if values["car"]["cameras"] == "stereo":
        # Recordings of the pair keep the identity that they had before there was a ring.
        del values["car"]["cameras"], values["car"]["ring"]
    return {"format": FORMAT, "config": values}


def _claim(root: Path, config: SimConfig) -> bool:
    """Return True if the folder holds this complete recording; otherwise mark it as started."""
    for name in (_DONE, _STARTED):
        if (root / name).exists():
            if _read_identity(root / name) != _identity(config):
                raise DataError(
                    f"{root} holds another recording: choose another folder", code="other-recording"
                )
            return name == _DONE
    for name in _FOREIGN:
        if (root / name).exists():
            raise DataError(
                f"{root / name} was not written by the simulator: choose another folder",
                code="other-data",
            )
    _write_json(root / _STARTED, _identity(config))
    return False


def _read_identity(path: Path) -> dict[str, object]:
    with reading(path, "the identity of a recording"):
        read = json.loads(path.read_text())
        return {key: read[key] for key in ("format", "config")}


def _summary(config: SimConfig, drive: Drive) -> dict[str, object]:
    frames = [
        {"lap": int(lap), "visit": visit.kind, "earlier": visit.earlier}
        for lap, visit in zip(drive.lap, visits(drive.poses), strict=True)
    ]
    return _identity(config) | {"frames": frames}


def _write_json(path: Path, value: dict[str, object]) -> None:
    _write_bytes(path, (json.dumps(value, indent=1) + "\n").encode())


def _write_bytes(path: Path, data: bytes) -> None:
    with atomic_path(path, durable=False) as temporary:
        temporary.write_bytes(data)


def _write_png(path: Path, image: NDArray[np.uint8]) -> None:
    with atomic_path(path, durable=False) as temporary:
        Image.fromarray(image).save(temporary, format="PNG", compress_level=1)
