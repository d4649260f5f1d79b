# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Visual templates: small grey images by which the original RatSLAM recognises places.

>>> from fusionslam.views.visual_templates import VisualTemplates
>>> templates = VisualTemplates(bottom=100)
>>> templates.process(np.full((100, 120), 90, np.uint8))
TemplateMatch(id=0, relative_rotation=0.0, is_new=True, error=inf)
"""

from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from pydantic import model_validator

from fusionslam.base.archive import load_archive, save_archive
from fusionslam.base.arrays import Floats32
from fusionslam.base.files import PathLike
from fusionslam.base.growing_array import Rows
from fusionslam.config import Section, merged, option
from fusionslam.errors import DataError, ShapeError

FORMAT = "fusionslam.visual_templates.1"
LUMINANCE = np.array((0.299, 0.587, 0.114))
"""Shares of red, green and blue in the brightness of a pixel."""
# Pairs compared at a time, so that their differences stay in the processor's cache.
_BATCH = 24
# Rounding error of sums in single precision.
_ROUNDING = 1e-5


class VisualTemplatesConfig(Section):
    """Visual templates; the defaults are those of OpenRatSLAM (Ball et al. 2013)."""

    columns: int = option(60, "blocks across a template", ge=1, le=4096)
    rows: int = option(20, "blocks down a template", ge=1, le=4096)
    top: int = option(0, "first row of the image that is used", unit="px", ge=0)
    bottom: int | None = option(
        150, "first row below the part that is used; none: the image's end", unit="px", ge=1
    )
    left: int = option(0, "first column of the image that is used", unit="px", ge=0)
    right: int | None = option(
        None, "first column right of that part; none: the image's end", unit="px", ge=1
    )
    shift: int = option(
        4, "templates are compared at shifts up to this, to both sides", unit="blocks", ge=0
    )
    step: int = option(1, "distance between two shifts", unit="blocks", ge=1)
    panoramic: bool = option(
        False, "images cover 360 degrees: templates are compared at every rotation"
    )
    threshold: float = option(0.03, "largest mean absolute difference of a match", ge=0, le=1)
    mean_margin: float = option(
        0.005, "skip templates whose mean differs by more than threshold plus this", ge=0
    )
    mean: float | None = option(None, "scale every template to this mean; none: do not scale", gt=0)
    patch: int = option(
        0,
        "normalise values within square patches of this odd side; 0: do not normalise",
        ge=0,
    )

    @model_validator(mode="after")
    def _values_fit_together(self) -> "VisualTemplatesConfig":
        if not self.panoramic and 2 * self.shift >= self.columns:
            raise ValueError(f"shift is {self.shift}, which leaves none of {self.columns} columns")
        if self.patch and self.patch % 2 == 0:
            raise ValueError(f"patch is {self.patch}, expected an odd number, or 0")
        return self


class TemplateMatch(NamedTuple):
    """The template of an image.

    Attributes:
        id: of the template it matches, or of the new one; ids count from 0.
        relative_rotation: rotation of the robot relative to the template, radians,
            counter-clockwise; known for panoramic images, else 0.
        is_new: whether the image became a template.
        error: mean absolute difference (0 .. 1) to the nearest template, whether it matches or
            not; infinite if there was none to compare with.
    """

    id: int
    relative_rotation: float
    is_new: bool
    error: float


class VisualTemplates:
    """Recognises images by templates: crops, block means, shifts (Milford & Wyeth 2004).

    Args:
        config: None for the defaults.
        changes: configuration values to override.

    Raises:
        ConfigError: an unknown key, or a value out of range.
    """

    def __init__(self, config: VisualTemplatesConfig | None = None, **changes: Any) -> None:
        self.config = merged(config or VisualTemplatesConfig(), changes)
        self._image_shape: tuple[int, int] | None = None
        # Column by column, so that the part compared at a shift is contiguous.
        self._size = self.config.columns * self.config.rows
        self._stored = Rows(np.float32, self._size)
        self._means = Rows(np.float32)
        self._column_means = Rows(np.float32, self.config.columns)
        self._shifts = _shifts(self.config)

    def __len__(self) -> int:
        return len(self._stored)

    @property
    def templates(self) -> Floats32:
        """A copy of the templates by id, float32 (n, rows, columns), 0 .. 1."""
        shape = (len(self), self.config.columns, self.config.rows)
        return np.ascontiguousarray(self._stored.all.reshape(shape).transpose(0, 2, 1))

    @property
    def bytes_per_view(self) -> int:
        """Size of a template in memory and on disk, in bytes."""
        return 4 * self._size

    def process(self, image: NDArray[np.uint8]) -> TemplateMatch:
        """Find the template that matches an image, or store the image as a new one.

        Args:
            image: uint8 (H, W) grey or (H, W, 3) RGB.

        Raises:
            ShapeError: a wrong shape or type, another size than earlier images, or fewer pixels
                than the blocks or the crop need.
        """
        return self.recognise(self.view(image))

    def view(self, image: NDArray[np.uint8]) -> Floats32:
        """Reduce an image to a template, float32 (columns * rows,), column by column.

        Args, raises: as for ``process``; from here on all images must have the same size.
        """
        pixels = check_image(image)
        shape = (pixels.shape[0], pixels.shape[1])
        if self._image_shape not in (None, shape):
            before = size_text(self._image_shape)
            raise ShapeError(f"image: {size_text(shape)}, expected {before} as before")
        blocks, config = _average_blocks(_crop(pixels, self.config), self.config), self.config
        self._image_shape = shape
        if config.mean is not None and blocks.any():
            blocks = np.minimum(blocks * (config.mean / blocks.mean()), 1)
        if config.patch:
            blocks = _normalise_patches(blocks, config.patch)
        return np.ascontiguousarray(blocks.T, np.float32).reshape(-1)

    def recognise(self, view: Floats32) -> TemplateMatch:
        """``process`` for the result of ``view``. Raises ShapeError for anything else."""
        expected = (self._size,)
        if view.shape != expected or view.dtype != np.float32:
            raise ShapeError(f"view: {view.dtype} {view.shape}, expected float32 {expected}")
        best, error, shift = self._nearest(view)
        if error <= self.config.threshold:
            # A panorama moves right when the robot turns left.
            part = shift / self.config.columns if self.config.panoramic else 0.0
            rotation = 2 * np.pi * (part if part <= 0.5 else part - 1)
            return TemplateMatch(best, rotation, is_new=False, error=error)
        self._append(view)
        return TemplateMatch(len(self) - 1, 0.0, is_new=True, error=error)

    def save(self, target: PathLike | BinaryIO) -> None:
        """Write configuration and templates to a path (atomically) or to a stream.

        Raises:
            DataError: the file cannot be written.
        """
        about = {"config": self.config.model_dump(mode="json"), "image_shape": self._image_shape}
        save_archive(target, FORMAT, about, {"templates": self._stored.all})

    @classmethod
    def load(cls, source: PathLike | BinaryIO) -> "VisualTemplates":
        """Read what ``save`` wrote, from a path or a stream.

        Raises:
            DataError: the file is missing, truncated, of another version or of another kind.
        """
        with load_archive(source, FORMAT, "stored visual templates") as (about, arrays):
            templates = cls(merged(VisualTemplatesConfig(), about["config"]))
            shape = about["image_shape"]
            templates._image_shape = None if shape is None else (int(shape[0]), int(shape[1]))
            stored, size = arrays["templates"], templates._size
            if stored.dtype != np.float32 or stored.ndim != 2 or stored.shape[1] != size:
                raise DataError(
                    f"templates {stored.dtype} {stored.shape}, expected float32 (n, {size})"
                )
            if not np.isfinite(stored).all():
                raise DataError("a template is not finite", code="not-finite")
            for view in stored:
                templates._append(view)
        return templates

    def _append(self, view: Floats32) -> None:
        self._stored.append(view)
        self._means.append(view.mean())
        self._column_means.append(view.reshape(-1, self.config.rows).mean(axis=1))

    def _nearest(self, view: Floats32) -> tuple[int, float, int]:
        """Id, error and shift of the nearest template; the first one of equals.

        Pairs whose lower bound exceeds the error of another pair are not compared in full.
        """
        reach = self.config.threshold + self.config.mean_margin
        near = np.flatnonzero(np.abs(self._means.all - view.mean()) <= reach)
        if not near.size:
            return -1, np.inf, 0
        bounds = self._lower_bounds(view, near).ravel()
        likely = self._compare(view, near, np.array([bounds.argmin()]))
        left = np.flatnonzero(bounds <= likely[0] + _ROUNDING)
        left = left[np.argsort(bounds[left], kind="stable")]
        best = (np.inf, 0, 0)
        for start in range(0, len(left), _BATCH):
            if bounds[left[start]] > best[0] + _ROUNDING:
                break
            best = min(best, self._compare(view, near, left[start : start + _BATCH]))
        error, id, column = best
        return id, error, int(self._shifts[column])

    def _lower_bounds(self, view: Floats32, ids: NDArray[np.intp]) -> Floats32:
        """Lower bounds of the errors, (ids, shifts), from differences of column means."""
        stored = self._column_means.all[ids]
        current = view.reshape(-1, self.config.rows).mean(axis=1)
        bounds = np.empty((len(ids), len(self._shifts)), np.float32)
        for column, shift in enumerate(self._shifts.tolist()):
            difference = stored[:, self._window(shift, 1)] - self._shift_view(current, shift, 1)
            bounds[:, column] = np.abs(difference).mean(axis=1)
        return bounds

    def _compare(
        self, view: Floats32, ids: NDArray[np.intp], pairs: NDArray[np.intp]
    ) -> tuple[float, int, int]:
        """The least error of some pairs, the template's id, and the index of the shift.

        ``pairs`` are indices into the flattened (ids, shifts).
        """
        height, (rows, columns) = self.config.rows, np.divmod(pairs, len(self._shifts))
        width = len(self._shift_view(view, 0, height))
        difference = np.empty((len(pairs), width), np.float32)
        for column in np.unique(columns).tolist():
            shift, some = int(self._shifts[column]), columns == column
            stored = self._stored.all[ids[rows[some]], self._window(shift, height)]
            difference[some] = stored - self._shift_view(view, shift, height)
        errors = np.abs(difference, out=difference).mean(axis=1)
        first = np.lexsort((columns, rows, errors))[0]
        return float(errors[first]), int(ids[rows[first]]), int(columns[first])

    def _window(self, shift: int, height: int) -> slice:
        """The part of a template that is compared; ``height`` is the number of values per column.

        It lies ``shift`` columns to the left of the part of the view compared with it.
        """
        if self.config.panoramic:
            return slice(None)
        most = self.config.shift
        return slice((most - shift) * height, (self.config.columns - most - shift) * height)

    def _shift_view(self, view: Floats32, shift: int, height: int) -> Floats32:
        """The part of a view that is compared: its middle; of a panorama all of it, rotated."""
        if self.config.panoramic:
            return np.roll(view, -shift * height)
        most = self.config.shift
        return view[most * height : (self.config.columns - most) * height]


def _shifts(config: VisualTemplatesConfig) -> NDArray[np.int64]:
    """Shifts of a view to the right in columns, in the order in which they are tried."""
    if config.panoramic:
        return np.arange(0, config.columns, config.step)
    return np.arange(-config.shift, config.shift + 1, config.step)


def _crop(pixels: NDArray[np.uint8], config: VisualTemplatesConfig) -> NDArray[np.uint8]:
    height, width = pixels.shape[:2]
    bottom = height if config.bottom is None else config.bottom
    right = width if config.right is None else config.right
    if bottom > height or right > width:
        raise ShapeError(
            f"image: {size_text((height, width))}, expected {right}x{bottom} or more, "
            "because of visual_templates.right and bottom"
        )
    part = pixels[config.top : bottom, config.left : right]
    if part.shape[0] < config.rows or part.shape[1] < config.columns:
        raise ShapeError(
            f"image: {size_text(part.shape)} after cropping, expected "
            f"{config.columns}x{config.rows} or more: a pixel a block"
        )
    return part


def _average_blocks(
    pixels: NDArray[np.uint8], config: VisualTemplatesConfig
) -> NDArray[np.float64]:
    """Mean brightness of whole blocks, (rows, columns), 0 .. 1; remaining pixels are unused."""
    high, wide = pixels.shape[0] // config.rows, pixels.shape[1] // config.columns
    used = pixels[: high * config.rows, : wide * config.columns]
    # Integer sums of bytes are exact. Rows first, which is the order in memory.
    bands = used.reshape(config.rows, high, -1).sum(axis=1, dtype=np.uint32)
    sums = bands.reshape(config.rows, config.columns, wide, -1).sum(axis=2, dtype=np.uint32)
    grey = sums[..., 0].astype(np.float64) if sums.shape[-1] == 1 else sums @ LUMINANCE
    scaled: NDArray[np.float64] = grey / (255 * high * wide)
    return scaled


def _normalise_patches(blocks: NDArray[np.float64], side: int) -> NDArray[np.float64]:
    """Normalise by the patch around each block: mean -> 1/2, -3 and +3 deviations -> 0 and 1.

    Patches end at the border. A patch without contrast gives 1/2.
    """
    padded = (np.pad(values, side // 2) for values in (np.ones_like(blocks), blocks, blocks**2))
    count, total, squares = (
        sliding_window_view(values, (side, side)).sum(axis=(2, 3)) for values in padded
    )
    mean = total / count
    deviation = np.sqrt(np.maximum(squares / count - mean**2, 0))
    flat = deviation < 1e-6
    part = np.where(flat, 0, (blocks - mean) / np.where(flat, 1, deviation))
    return np.clip((part + 3) / 6, 0, 1)


def check_image(image: Any) -> NDArray[np.uint8]:
    """Return an image, uint8 (H, W) grey or (H, W, 3) RGB. Raises ShapeError for anything else."""
    pixels = np.asarray(image)
    colours = pixels.ndim == 3 and pixels.shape[2] == 3
    if pixels.dtype != np.uint8 or not (pixels.ndim == 2 or colours):
        raise ShapeError(
            f"image: {pixels.dtype} {pixels.shape}, expected uint8 (H, W) or (H, W, 3)"
        )
    return pixels


def size_text(shape: Any) -> str:
    """Width x height as text."""
    return f"{shape[1]}x{shape[0]}"
