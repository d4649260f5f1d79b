# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The drives of chapter 5: recordings, or worlds simulated and recorded here."""

import logging
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.theses.config import QUICK_EACH, QUICK_M, ReproduceConfig
from benchmarks.theses.work_cache import state_of
from fusionslam.base.progress import Step
from fusionslam.config import merged
from fusionslam.errors import DataError
from fusionslam.evaluation.views.published import world_of
from fusionslam.pipelines.drives import Drive, open_drive
from fusionslam.pipelines.recording import Recording
from fusionslam.sensors.image_series import ImageSeries
from fusionslam.sim.rendered_images import rendered_images

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Source:
    """A drive through one of the thesis's worlds, or through a simulated world like it.

    Attributes:
        world: "warehouse", "house" or "hospital".
        path: the recording; None for a simulated world.
        quick: True to use only one scan of several, and shorter drives through simulated worlds.
        jobs: number of frames processed in parallel.
        step: progress callback.
    """

    world: str
    path: Path | None
    quick: bool
    jobs: int
    step: Step | None

    @property
    def made(self) -> bool:
        """Whether the world is simulated here instead of the thesis's."""
        return self.path is None

    @property
    def words(self) -> str:
        """Description of the drive, for display."""
        thinned = f", one scan of {QUICK_EACH}" if self.quick else ""
        if self.path is None:
            part = f", {QUICK_M:g} m of it" if self.quick else ""
            return f"{self.world}, made by fusionslam{part}{thinned}"
        return f"{self.path.stem}, a recording in the thesis's world{thinned}"

    @cached_property
    def identity(self) -> list[Any]:
        """Values that determine the scans."""
        return [*([self._bag.name] if self.path is None else state_of(self.path)), self.quick]

    @cached_property
    def recording(self) -> Path:
        """File of the recording, simulated first if it is missing.

        Raises:
            DataError: the cache cannot be written.
            FusionSlamError: the simulator's extra is not installed.
        """
        if self.path is not None:
            return self.path
        from fusionslam.sim.recordings import embedded_bag

        label, step = f"driving: {self.world}", self.step
        progress = partial(step, label) if step is not None else None
        return embedded_bag(self.world, self._config, jobs=self.jobs, progress=progress)

    @cached_property
    def drive(self) -> Drive:
        """The scans, which are slow to read. Raises as ``open_drive``."""
        return ThinnedDrive(self.whole_drive) if self.quick and self.path else self.whole_drive

    @cached_property
    def whole_drive(self) -> Drive:
        """All scans, and the path of the robot. Raises as ``open_drive``."""
        simulated = self.world if self.path is None else None
        recording = Recording.at(self.recording, simulated=simulated)
        return open_drive(recording, render=rendered_images, jobs=self.jobs, step=self.step)

    @property
    def _config(self) -> Any:
        from fusionslam.sim.recordings import embedded_config

        config = embedded_config(self.world)
        return _thin_config(config) if self.quick else config

    @property
    def _bag(self) -> Path:
        from fusionslam.sim.recordings import embedded_path

        return embedded_path(self.world, self._config)


def sources(config: ReproduceConfig, jobs: int, step: Step | None) -> list[Source]:
    """Find the drives of a configuration: recordings where available, else simulated worlds.

    Raises:
        DataError: the data folder does not exist.
    """
    known = {} if config.data is None else _recordings(Path(config.data).expanduser())
    for world in config.worlds:
        if config.data is not None and world not in known:
            logger.info("%s: no recording of %s, which is made instead", config.data, world)
    return [Source(world, known.get(world), config.quick, jobs, step) for world in config.worlds]


def _recordings(folder: Path) -> dict[str | None, Path]:
    if not folder.is_dir():
        raise DataError(f"{folder}: expected a folder with recordings/<world>.npz")
    return {world_of(path.stem): path for path in sorted((folder / "recordings").glob("*.npz"))}


def _thin_config(config: Any) -> Any:
    """Return a configuration for a short drive with fewer scans and images."""
    robot = config.robot
    slower: dict[str, Any] = {
        kind: {name: {"rate_hz": one.rate_hz / QUICK_EACH} for name, one in mounted.items()}
        for kind, mounted in (("lidars", robot.lidars), ("cameras", robot.cameras))
    }
    return merged(config, {"robot": slower, "plan": {"length_m": QUICK_M}})


class ThinnedDrive(Drive):
    """A drive with a part of the scans and a matching part of the images."""

    def __init__(self, drive: Drive) -> None:
        self.__dict__.update(drive.__dict__)
        rows = np.arange(0, len(drive.scenes), QUICK_EACH)
        self.scenes = drive.scenes.subset(rows.astype(np.int64))
        self._whole = drive

    @property
    def dropped(self) -> int:
        """Number of dropped scans in the whole drive."""
        return self._whole.dropped

    def images_with_poses(self, bottom: int | None = None) -> ImageSeries | None:
        """Return the latest image at or before each scan."""
        found = self._whole.images_with_poses(bottom)
        return None if found is None else _thin_images(found, self.scenes.seconds)


def _thin_images(
    images: ImageSeries, seconds: np.ndarray[Any, np.dtype[np.float64]]
) -> ImageSeries:
    """Return the latest image at or before each scan."""
    rows = np.unique(np.maximum(np.searchsorted(images.seconds, seconds + 1e-6, "right") - 1, 0))
    return ImageSeries(
        images.seconds[rows],
        None if images.poses is None else images.poses[rows],
        lambda index: images.image(int(rows[index])),
        images.origin,
        None if images.key is None else f"{images.key} {rows.tolist()}",
    )
