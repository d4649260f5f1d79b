# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Visual-template views of a drive's images, cached for rendered images."""

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fusionslam.errors import DataError
from fusionslam.sensors.image_series import ImageSeries
from fusionslam.storage.archive import load_archive, save_archive
from fusionslam.storage.cache import cached_path
from fusionslam.storage.parallel import ordered_results
from fusionslam.storage.progress import Progress, reported
from fusionslam.views.visual_templates import VisualTemplates, VisualTemplatesConfig

FORMAT = "fusionslam.template_views.1"

# Other values of VisualTemplatesConfig do not change the view of an image.
_OF_VIEWS = ("columns", "rows", "top", "bottom", "left", "right", "mean", "patch")


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
        save_archive(path, FORMAT, {"build_ms": made.build_ms}, {"views": made.views})
    return made


def _load_views(
    path: Path, images: ImageSeries, config: VisualTemplatesConfig
) -> TemplateViews | None:
    """Load cached views; return None if there are none, or for a file that is not ours."""
    try:
        with load_archive(path, FORMAT, "template views") as (about, stored):
            views, build_ms = stored["views"], float(about["build_ms"])
    except DataError:
        return None
    fits = views.dtype == np.float32 and views.shape == (len(images), config.columns * config.rows)
    return TemplateViews(views, build_ms) if fits else None
