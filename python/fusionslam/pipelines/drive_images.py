# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Visual templates and visual odometry of all images of a drive, cached for rendered images."""

import logging
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.archive import load_archive, save_archive
from fusionslam.base.cache import cached_path
from fusionslam.base.parallel import ordered_results
from fusionslam.base.progress import Progress, Step, label_progress, reported
from fusionslam.errors import DataError
from fusionslam.pipelines.drives import Drive
from fusionslam.ratslam.events import Motion
from fusionslam.ratslam.visual_odometry import (
    Sight,
    VisualOdometry,
    VisualOdometryConfig,
    VisualSpeed,
)
from fusionslam.sensors.image_series import ImageSeries
from fusionslam.sensors.messages import Odometry
from fusionslam.views.visual_templates import VisualTemplates, VisualTemplatesConfig

logger = logging.getLogger(__name__)

TEMPLATES_FORMAT = "fusionslam.template_views.1"

# Other values of VisualTemplatesConfig do not change the view of an image.
_OF_VIEWS = ("columns", "rows", "top", "bottom", "left", "right", "mean", "patch")
PROFILES_FORMAT = "fusionslam.image_profiles.1"

_DOUBTS = {
    "no-contrast": "too little contrast",
    "images-differ": "the image differs too much from the one before it",
}
"""Descriptions of ``VisualSpeed.doubt``."""


@dataclass(frozen=True, eq=False)
class TemplateViews:
    """The visual-template views of a drive's images.

    Attributes:
        views: float32 (n, columns * rows).
        build_ms: median time to make a view from an image.
    """

    views: NDArray[np.float32]
    build_ms: float


def template_views(
    images: ImageSeries,
    config: VisualTemplatesConfig,
    *,
    jobs: int = 1,
    progress: Progress | None = None,
) -> TemplateViews:
    """Make the view of each image; those of rendered images are kept in the user's cache.

    Args:
        images: of the drive.
        config: of the templates.
        jobs: number of images read or rendered in parallel; does not change the result.
        progress: called with (images done, total images).

    Raises:
        DataError: an image cannot be read or rendered, or the cache cannot be written.
        ShapeError: an image cannot become a template.
    """
    path = None
    if images.key is not None:
        identity = [images.key, {name: getattr(config, name) for name in _OF_VIEWS}]
        path = cached_path("template-views", identity, ".npz")
    stored = None if path is None else _load_views(path, images, config)
    if stored is not None:
        return stored
    templates, spent = VisualTemplates(config), np.empty(len(images))
    views = np.empty((len(images), config.columns * config.rows), np.float32)
    with ordered_results(images.image, range(len(images)), jobs) as loaded:
        for index, image in enumerate(reported(loaded, progress, len(images))):
            begin = time.perf_counter()
            views[index] = templates.view(image)
            spent[index] = time.perf_counter() - begin
    made = TemplateViews(views, float(np.median(spent) * 1e3) if len(images) else 0.0)
    if path is not None:
        save_archive(path, TEMPLATES_FORMAT, {"build_ms": made.build_ms}, {"views": made.views})
    return made


def _load_views(
    path: Path, images: ImageSeries, config: VisualTemplatesConfig
) -> TemplateViews | None:
    """Load cached views; return None if there are none, or for a file that is not ours."""
    try:
        with load_archive(path, TEMPLATES_FORMAT, "template views") as (about, stored):
            views, build_ms = stored["views"], float(about["build_ms"])
    except DataError:
        return None
    fits = views.dtype == np.float32 and views.shape == (len(images), config.columns * config.rows)
    return TemplateViews(views, build_ms) if fits else None


def visual_speeds(
    images: ImageSeries,
    odometry: VisualOdometry,
    *,
    jobs: int = 1,
    progress: Progress | None = None,
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
    sights = _load_sights(images, odometry, jobs, progress)
    return [
        odometry.compare(sight, stamp_ns)
        for sight, stamp_ns in zip(sights, stamps_ns.tolist(), strict=True)
    ]


def estimate_motions(
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
        raise DataError(f"{drive.name}: no images, which visual odometry needs", code="no-images")
    odometry = VisualOdometry(config, camera=images.camera)
    if images.camera is not None and images.camera.size is not None:
        images = drive.images(odometry.rows_used(images.camera.size[1])) or images
    show = label_progress(progress, f"{drive.name}: {images.origin}")
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
    doubts = Counter(speed.doubt for speed in speeds if speed is not None and speed.doubt)
    for doubt, count in doubts.items():
        logger.warning("visual odometry: %s at %d of %d images", _DOUBTS[doubt], count, len(speeds))
    return [
        Motion(stamp_ns, 0.0, 0.0) if speed is None else Motion(stamp_ns, speed.v, speed.w)
        for stamp_ns, speed in zip(stamps_ns.tolist(), speeds, strict=True)
    ]


def image_stamps_ns(images: ImageSeries) -> NDArray[np.int64]:
    """int64 (n): time stamps of the images."""
    return np.round(images.seconds * 1e9).astype(np.int64)


def _load_sights(
    images: ImageSeries, odometry: VisualOdometry, jobs: int, progress: Progress | None
) -> list[Sight]:
    """Return the part of each image that is used; for rendered images it is cached.

    Raises:
        DataError, ShapeError: an image cannot be read or used, or the cache cannot be written.
    """
    path = None
    if images.key is not None:
        rows = odometry.config.turn_rows, odometry.config.speed_rows
        path = cached_path("profiles", [images.key, *rows], ".npz")
    cached = None if path is None else _read_cache(path, len(images))
    if cached is not None:
        return cached
    with ordered_results(images.image, range(len(images)), jobs) as loaded:
        sights = [odometry.sight(image) for image in reported(loaded, progress, len(images))]
    if path is not None and sights:
        turns, speeds = (np.stack([getattr(s, n) for s in sights]) for n in ("turn", "speed"))
        about = {"shape": sights[0].shape}
        save_archive(path, PROFILES_FORMAT, about, {"turns": turns, "speeds": speeds})
    return sights


def _read_cache(path: Path, count: int) -> list[Sight] | None:
    """Load cached sights; return None if there are none, or for a file that is not ours."""
    try:
        with load_archive(path, PROFILES_FORMAT, "profiles of images") as (about, stored):
            (height, width), turns, speeds = about["shape"], stored["turns"], stored["speeds"]
    except DataError:
        return None
    if not turns.shape == speeds.shape == (count, width) or turns.dtype != np.float64:
        return None
    shape = (int(height), int(width))
    return [Sight(shape, *pair) for pair in zip(turns, speeds, strict=True)]
