# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Run visual odometry over all images of a drive and convert it to the input of a map."""

import hashlib
import json
import logging
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fusionslam.errors import DataError
from fusionslam.pipelines.drives import Drive, Step
from fusionslam.ratslam.events import Motion
from fusionslam.ratslam.visual_odometry import (
    Sight,
    VisualOdometry,
    VisualOdometryConfig,
    VisualSpeed,
)
from fusionslam.sensors.images import Images
from fusionslam.sensors.messages import Odometry
from fusionslam.storage.archive import load_arrays, save_arrays
from fusionslam.storage.parallel import in_order
from fusionslam.storage.progress import Progress

logger = logging.getLogger(__name__)


def visual_speeds(
    images: Images, odometry: VisualOdometry, *, jobs: int = 1, progress: Progress | None = None
) -> list[VisualSpeed | None]:
    """Return the speed from visual odometry at each image; None where it has no estimate.

    Args:
        images: of the drive.
        odometry: new; it has processed all images afterwards.
        jobs: number of images read or rendered in parallel; does not change the result.
        progress: called with (images done, total images).

    Raises:
        DataError, ShapeError: an image cannot be read or used.
    """
    stamps_ns = image_stamps_ns(images)
    sights = all_sights(images, odometry, jobs, progress)
    return [
        odometry.compare(sight, stamp_ns)
        for sight, stamp_ns in zip(sights, stamps_ns.tolist(), strict=True)
    ]


def seen_motions(
    drive: Drive,
    config: VisualOdometryConfig | None = None,
    *,
    jobs: int = 1,
    progress: Step | None = None,
) -> tuple[str, list[Odometry | Motion]]:
    """Return a description of visual odometry, for people, and its motions on a drive.

    Args:
        drive: with images.
        config: None for the defaults.
        jobs: number of images read or rendered in parallel; does not change the result.
        progress: progress callback.

    Raises:
        DataError: the drive has no images, or as ``visual_speeds``.
    """
    images = drive.images()
    if images is None or not len(images):
        raise DataError(f"{drive.name}: no images, which visual odometry looks at")
    odometry = VisualOdometry(config, camera=images.camera)
    if images.camera is not None and images.camera.size is not None:
        images = drive.images(odometry.rows_used(images.camera.size[1])) or images
    label = f"{drive.name}: {images.origin}"
    show = None if progress is None else lambda done, total: progress(label, done, total)
    speeds = visual_speeds(images, odometry, jobs=jobs, progress=show)
    title = f"visual odometry ({odometry.config.preset})"
    return title, [*visual_motions(image_stamps_ns(images), speeds)]


def visual_motions(
    stamps_ns: NDArray[np.int64], speeds: Sequence[VisualSpeed | None]
) -> list[Motion]:
    """Return odometry messages at the stamps of images; without an estimate the robot stands still.

    Args:
        stamps_ns: int64 (n).
        speeds: result of ``visual_speeds``.
    """
    doubts = Counter(
        speed.why.partition(" by ")[0] for speed in speeds if speed is not None and speed.why
    )
    for why, count in doubts.items():
        logger.warning("visual odometry: at %d of %d images %s", count, len(speeds), why)
    return [
        Motion(stamp_ns, 0.0, 0.0) if speed is None else Motion(stamp_ns, speed.v, speed.w)
        for stamp_ns, speed in zip(stamps_ns.tolist(), speeds, strict=True)
    ]


def image_stamps_ns(images: Images) -> NDArray[np.int64]:
    """int64 (n): time stamps of the images."""
    return np.round(images.seconds * 1e9).astype(np.int64)


def all_sights(
    images: Images, odometry: VisualOdometry, jobs: int = 1, progress: Progress | None = None
) -> list[Sight]:
    """Return the part of each image that is used; for rendered images it is cached.

    Raises:
        DataError, ShapeError: an image cannot be read or used, or the cache cannot be written.
    """
    path = None if images.key is None else _cache_path(images.key, odometry)
    kept = None if path is None else _kept(path, len(images))
    if kept is not None:
        return kept
    made = [*_made(images, odometry, jobs, progress)]
    if path is not None and made:
        turns, speeds = (np.stack([getattr(s, n) for s in made]) for n in ("turn", "speed"))
        save_arrays(path, {"shape": made[0].shape, "turns": turns, "speeds": speeds})
    return made


def _made(
    images: Images, odometry: VisualOdometry, jobs: int, progress: Progress | None
) -> Iterator[Sight]:
    with ThreadPoolExecutor(max(jobs, 1)) as pool:
        try:
            loaded = in_order(pool, images.image, range(len(images)), 4 * max(jobs, 1))
            for done, image in enumerate(loaded, 1):
                yield odometry.sight(image)
                if progress is not None:
                    progress(done, len(images))
        except BaseException:
            pool.shutdown(wait=True, cancel_futures=True)
            raise


def _cache_path(key: str, odometry: VisualOdometry) -> Path:
    from fusionslam.storage.cache import cache_folder

    text = json.dumps([key, odometry.config.turn_rows, odometry.config.speed_rows])
    return cache_folder() / f"profiles-{hashlib.sha256(text.encode()).hexdigest()[:12]}.npz"


def _kept(path: Path, count: int) -> list[Sight] | None:
    """Load cached sights; return None if there are none, or for a file that is not ours."""
    try:
        with load_arrays(path, "profiles of images") as stored:
            (height, width), turns, speeds = stored["shape"], stored["turns"], stored["speeds"]
    except DataError:
        return None
    if not turns.shape == speeds.shape == (count, width) or turns.dtype != np.float64:
        return None
    shape = (int(height), int(width))
    return [Sight(shape, *pair) for pair in zip(turns, speeds, strict=True)]
