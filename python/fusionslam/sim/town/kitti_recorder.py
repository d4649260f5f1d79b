# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Drive the car through the town and write a folder in the layout of KITTI odometry.

With four cameras (``car.cameras``) it is a plain folder instead.

``sim.json`` is written last, so a folder with it is complete. An interrupted recording leaves
``sim.partial.json`` and is resumed with the missing frames.
"""

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydantic import model_validator

from fusionslam.base.arrays import Floats
from fusionslam.base.cache import cached_path
from fusionslam.base.files import reading, write_file
from fusionslam.base.parallel import available_cores, ordered_results
from fusionslam.base.progress import Progress
from fusionslam.config import Section, option
from fusionslam.datasets import write_cloud
from fusionslam.errors import DataError
from fusionslam.evaluation.loops.revisits import visits
from fusionslam.sensors.frame import Cloud
from fusionslam.sim.camera import LensConfig, parent_from_camera, photograph, projection
from fusionslam.sim.folder_writer import calibration_text, write_png
from fusionslam.sim.lidar import scan
from fusionslam.sim.scene import RayCaster
from fusionslam.sim.town.car import RING, CarConfig, car_from_lidar, car_from_ring_camera
from fusionslam.sim.town.layout import TownConfig, make_town
from fusionslam.sim.town.route import Drive, DriveConfig, make_drive

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


class _Shots(NamedTuple):
    """The images of one camera.

    Attributes:
        folder: where they are.
        lens: of the camera.
        car_from_camera: float64 (4, 4).
        gains: of red, green and blue on each lap, (L, 3); the last one serves later laps.
    """

    folder: str
    lens: LensConfig
    car_from_camera: Floats
    gains: Floats


class _Layout(NamedTuple):
    """Where a recording has its files; paths are relative to its folder.

    Attributes:
        scans: folder of the scans.
        shots: the images of each camera.
        texts: path and text of calibration, times and poses.
    """

    scans: str
    shots: tuple[_Shots, ...]
    texts: dict[str, str]


def _kitti_layout(car: CarConfig, drive: Drive) -> _Layout:
    """Sequence 00 of KITTI odometry, whose poses are those of the left camera."""
    lens = car.camera
    left = parent_from_camera(lens)
    cameras = drive.poses @ left
    shots = tuple(
        _Shots(
            f"sequences/00/image_{number}",
            lens,
            parent_from_camera(lens, right=number == 3),
            np.array(lens.exposure),
        )
        for number in (2, 3)
    )
    first, second = (projection(lens, right=right) for right in (False, True))
    lidar = np.linalg.inv(left) @ car_from_lidar(car)
    rows = {"P0": first, "P1": second, "P2": first, "P3": second, "Tr": lidar[:3]}
    texts = {
        "sequences/00/times.txt": _times(drive),
        "sequences/00/calib.txt": _lines([f"{name}: {_row(rows[name])}" for name in rows]),
        "poses/00.txt": _lines([_row(pose[:3]) for pose in np.linalg.inv(cameras[0]) @ cameras]),
    }
    return _Layout("sequences/00/velodyne", shots, texts)


def _folder_layout(car: CarConfig, drive: Drive) -> _Layout:
    """A plain folder with the images of the four cameras, whose poses are those of the LiDAR."""
    ring, lidar = car.ring, car_from_lidar(car)
    shots = tuple(
        _Shots(name, ring, car_from_ring_camera(ring, name), gain * np.array(ring.exposure))
        for name, gain in zip(RING, np.array(ring.gains), strict=True)
    )
    cameras = {shot.folder: (ring, projection(ring), shot.car_from_camera) for shot in shots}
    texts = {
        "times.txt": _times(drive),
        "calib.yaml": calibration_text(lidar, cameras),
        "poses.txt": _lines([_row(pose[:3]) for pose in drive.poses @ lidar]),
    }
    return _Layout("clouds", shots, texts)


def _times(drive: Drive) -> str:
    return _lines([f"{second:.6e}" for second in drive.seconds])


def _row(matrix: Floats) -> str:
    return " ".join(f"{value:.12e}" for value in matrix.ravel())


def _lines(lines: list[str]) -> str:
    return "\n".join(lines) + "\n"


@dataclass(frozen=True)
class _Recorder:
    """Writes single frames; shared by all threads."""

    config: SimConfig
    drive: Drive
    layout: _Layout
    root: Path

    def write_frames(self, jobs: int) -> Iterator[int]:
        """Write the missing frames lap by lap; yield the number of frames that exist."""
        laps = self.drive.lap
        missing = [k for k in range(len(laps)) if not all(p.exists() for p in self._paths(k))]
        done = len(laps) - len(missing)
        for lap in np.unique(laps[missing]).tolist():
            caster = RayCaster(make_town(self.config.town, lap))
            frames = [k for k in missing if laps[k] == lap]
            with ordered_results(partial(self._write, caster), frames, jobs) as written:
                for _ in written:
                    done += 1
                    yield done

    def _write(self, caster: RayCaster, frame: int) -> None:
        """Simulate and write one frame: LiDAR sweep and images."""
        (cloud, *images), car = self._paths(frame), self.config.car
        world_from_car = self.drive.poses[frame]
        swept = world_from_car @ car_from_lidar(car)
        sweep = scan(caster, car.lidar, swept, self._rng(frame, 0))
        write_cloud(cloud, Cloud(sweep.points, None, sweep.intensity))
        for sensor, (path, shots) in enumerate(zip(images, self.layout.shots, strict=True), 1):
            gain = shots.gains[min(self.drive.lap[frame], len(shots.gains) - 1)]
            pose, rng = world_from_car @ shots.car_from_camera, self._rng(frame, sensor)
            write_png(path, photograph(caster, shots.lens, pose, gain, rng))

    def _paths(self, frame: int) -> list[Path]:
        """The scan's, then those of the images."""
        images = [self.root / shot.folder / f"{frame:06d}.png" for shot in self.layout.shots]
        return [self.root / self.layout.scans / f"{frame:06d}.bin", *images]

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
    layout = (_folder_layout if config.car.cameras == "four" else _kitti_layout)(config.car, drive)
    for name, text in layout.texts.items():
        write_file(root / name, text, durable=False)
    for done in _Recorder(config, drive, layout, root).write_frames(jobs):
        if progress is not None:
            progress(done, len(drive.poses))
    frames = [
        {"lap": int(lap), "visit": visit.kind, "earlier": visit.earlier}
        for lap, visit in zip(drive.lap, visits(drive.poses), strict=True)
    ]
    _write_json(root / _DONE, _identity(config) | {"frames": frames})
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
    return cached_path("drive", _identity(SimConfig()))


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
            with reading(root / name, "the identity of a recording"):
                read = json.loads((root / name).read_text())
                found = {key: read[key] for key in ("format", "config")}
            if found != _identity(config):
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


def _write_json(path: Path, value: dict[str, object]) -> None:
    write_file(path, json.dumps(value, indent=1) + "\n", durable=False)
