# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``VisualOdometry``: speed and turn rate from camera images alone (Milford & Wyeth 2004).

>>> odometry = VisualOdometry()
>>> odometry.process(first, 0)                   # one image alone gives no speed
>>> odometry.process(second, 100_000_000)
VisualSpeed(v=0.41, w=0.12, dt=0.1, ...)
"""

import logging
from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import model_validator

from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Floats
from fusionslam.config import Section, merged, option
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.ratslam.image_profiles import (
    Lens,
    best_shift,
    best_stretch,
    profile,
    row_range,
    standardise,
)
from fusionslam.sensors.frame import Camera
from fusionslam.sensors.messages import NANOSECONDS
from fusionslam.views.visual_templates import check_image, size_text

logger = logging.getLogger(__name__)

Rows = tuple[float, float]

_LEAST_WAY_M = 1.0
_LEAST_COLUMNS = 16
# In deviations: images related by one turn and one growth leave at most a quarter of this.
_UNLIKE = 0.5


class VisualOdometryConfig(Section):
    """Image rows, matching and scale; options of a single preset say so."""

    preset: Literal["robust", "openratslam"] = option(
        "robust", "robust (ours) or openratslam (Ball et al. 2013, as its program behaves)"
    )
    turn_rows: Rows = option(
        (0.0, 0.6), "rows used for turning, first and end", unit="parts of the height"
    )
    speed_rows: Rows = option(
        (0.0, 0.6), "rows used for speed, first and end", unit="parts of the height"
    )
    field_of_view: float = option(
        1.0, "angle from the left edge to the right one", unit="rad", gt=0, lt=float(np.pi)
    )
    focal_px: float | None = option(
        None, "robust: focal length, instead of the field of view", unit="px", gt=0
    )
    centre_px: float | None = option(
        None, "robust: column of the optical axis; null: the middle", unit="px", ge=0
    )
    max_shift: int = option(40, "openratslam: largest shift tried", unit="px", ge=1)
    rate_hz: float = option(10.0, "openratslam: assumed images a second, stamps ignored", gt=0)
    difference_scale: float = option(
        20.0, "openratslam: speed at a mean difference of 1, black to white", unit="m/s", gt=0
    )
    max_turn: float = option(2.0, "robust: fastest turn searched for", unit="rad/s", gt=0)
    max_stretch: float = option(
        0.6, "robust: fastest growth searched for: speed over distance", unit="1/s", gt=0
    )
    distance_m: float = option(
        4.0, "robust: mean distance of the scene; see fit_speed", unit="m", gt=0
    )
    max_speed: float = option(1.0, "limit of the reported speed", unit="m/s", gt=0)
    max_gap_s: float = option(1.0, "robust: images farther apart are not compared", unit="s", gt=0)

    @model_validator(mode="after")
    def _check_rows(self) -> "VisualOdometryConfig":
        for name in ("turn_rows", "speed_rows"):
            first, end = getattr(self, name)
            if not 0 <= first < end <= 1:
                raise ValueError(f"{name} is {(first, end)}, expected 0 <= first < end <= 1")
        return self


class VisualSpeed(NamedTuple):
    """The motion between two images.

    Attributes:
        v: m/s forward, if the scale is right: a single camera cannot measure it.
        w: rad/s, counter-clockwise.
        dt: seconds from the previous image to this one.
        shift_px: columns that the image moved to the right.
        change: the quantity that v is a multiple of: growth of the image in 1/s, or the least
            difference.
        why: the reason not to trust v and w; empty if there is none.
        doubt: kind of that reason, "no-contrast" or "images-differ"; empty if there is none.
    """

    v: float
    w: float
    dt: float
    shift_px: float
    change: float
    why: str = ""
    doubt: str = ""


class Sight(NamedTuple):
    """The parts of an image that visual odometry uses.

    Attributes:
        shape: rows and columns of the image.
        turn, speed: float64 (columns), 0 .. 1, mean brightness of each column over the rows used
            for turn and for speed.
    """

    shape: tuple[int, int]
    turn: Floats
    speed: Floats


class _LastImage(NamedTuple):
    stamp_ns: int
    sight: Sight


@checked
class VisualOdometry:
    """Estimates speed and turn rate by comparing each image with the previous one.

    Args:
        config: None for the defaults.
        camera: its focal length and centre replace the configured ones.
        changes: configuration values to override.

    Raises:
        ConfigError: an unknown key, or a value out of range.
    """

    def __init__(
        self,
        config: VisualOdometryConfig | None = None,
        *,
        camera: Camera | None = None,
        **changes: Any,
    ) -> None:
        config = merged(config or VisualOdometryConfig(), changes)
        self.config = config if camera is None else _with_camera(config, camera)
        self._camera_size = None if camera is None else camera.size
        self._before: _LastImage | None = None

    def process(self, image: NDArray[np.uint8], stamp_ns: int) -> VisualSpeed | None:
        """Compare an image with the previous one.

        Args:
            image: uint8 (H, W) grey or (H, W, 3) RGB, without distortion. If the camera gives its
                size, rows below those used may be missing.
            stamp_ns: its time stamp.

        Returns:
            None for the first image, and for one more than ``max_gap_s`` after the previous one
            (logged).

        Raises:
            ShapeError: a wrong shape or type, or another size than the previous image.
            DataError: a stamp that is not later than the previous one. A refused image changes
                nothing.
        """
        return self.compare(self.sight(image), stamp_ns)

    @checked
    def compare(self, sight: Sight, stamp_ns: int) -> VisualSpeed | None:
        """``process`` for a result of ``sight``. Returns and raises the same."""
        now, before = _LastImage(int(stamp_ns), sight), self._before
        if before is None:
            self._before = now
            return None
        if before.sight.shape != sight.shape:
            sizes = size_text(sight.shape), size_text(before.sight.shape)
            raise ShapeError(f"image: {sizes[0]}, expected {sizes[1]} as before")
        if now.stamp_ns <= before.stamp_ns:
            raise DataError(
                f"image at {now.stamp_ns} ns: expected a stamp after {before.stamp_ns} ns, that "
                "of the image before"
            )
        self._before = now
        dt = (now.stamp_ns - before.stamp_ns) / NANOSECONDS
        if self.config.preset == "openratslam":
            return self._compare_openratslam(before.sight, sight, dt)
        if dt > self.config.max_gap_s:
            logger.warning("no image for %.2f s before %d ns: no speed", dt, now.stamp_ns)
            return None
        return self._compare_robust(before.sight, sight, dt)

    def sight(self, image: NDArray[np.uint8]) -> Sight:
        """Reduce an image to the parts used; changes no state. Raises ShapeError as ``process``."""
        pixels = check_image(image)
        shape = self._whole_shape(pixels.shape[0], pixels.shape[1])
        ranges = (
            row_range(rows, shape[0]) for rows in (self.config.turn_rows, self.config.speed_rows)
        )
        turn, speed = (profile(pixels, first, end) for first, end in ranges)
        return Sight(shape, turn, speed)

    def rows_used(self, height: int) -> int:
        """Number of rows used, counted from the top of the image."""
        return max(
            row_range(rows, height)[1] for rows in (self.config.turn_rows, self.config.speed_rows)
        )

    def _whole_shape(self, height: int, width: int) -> tuple[int, int]:
        """Rows and columns of the whole image, whose unused lower rows may be missing."""
        found = f"image: {size_text((height, width))}, expected"
        if width < _LEAST_COLUMNS or not height:
            raise ShapeError(f"{found} {_LEAST_COLUMNS} columns or more")
        if self._camera_size is None:
            return height, width
        whole = self._camera_size[::-1]
        if width != whole[1] or not self.rows_used(whole[0]) <= height <= whole[0]:
            raise ShapeError(f"{found} {size_text(whole)} of the calibration")
        return whole

    def _compare_openratslam(self, before: Sight, now: Sight, dt: float) -> VisualSpeed:
        config, width = self.config, now.shape[1]
        shift, _ = best_shift(before.turn, now.turn, config.max_shift)
        _, difference = best_shift(before.speed, now.speed, config.max_shift)
        return VisualSpeed(
            v=min(difference * config.difference_scale, config.max_speed),
            w=shift * config.field_of_view / width * config.rate_hz,
            dt=dt,
            shift_px=float(shift),
            change=difference,
        )

    def _compare_robust(self, before: Sight, now: Sight, dt: float) -> VisualSpeed:
        config, width = self.config, now.shape[1]
        focal = config.focal_px or width / 2 / np.tan(config.field_of_view / 2)
        centre = (width - 1) / 2 if config.centre_px is None else config.centre_px
        lens = Lens(width, float(focal), float(centre))
        turned, turns = (standardise(lens.by_angle(sight.turn)) for sight in (before, now))
        sped, speeds = (standardise(lens.by_angle(sight.speed)) for sight in (before, now))
        if not all(values.any() for values in (turned, turns, sped, speeds)):
            why = "an image without contrast"
            return VisualSpeed(0.0, 0.0, dt, 0.0, 0.0, why, "no-contrast")
        reach = min(int(np.ceil(config.max_turn * dt / lens.step)), lens.width // 2)
        shift, _ = best_shift(turned, turns, max(reach, 1))
        found = best_stretch(sped, speeds, shift, lens, config.max_stretch * dt)
        differ = found.error > _UNLIKE
        growth = found.stretch / dt
        return VisualSpeed(
            v=float(np.clip(growth * config.distance_m, -config.max_speed, config.max_speed)),
            w=found.shift * lens.step / dt,
            dt=dt,
            shift_px=found.shift,
            change=growth,
            why=f"the images differ by {found.error:.2f} deviations" if differ else "",
            doubt="images-differ" if differ else "",
        )

    def state(self) -> dict[str, NDArray[Any]]:
        """The state that the next image is compared with, as arrays; empty before the first."""
        held = self._before
        if held is None:
            return {}
        return {
            "stamp_ns": np.array(held.stamp_ns, np.int64),
            "shape": np.array(held.sight.shape, np.int64),
            "turn": held.sight.turn.copy(),
            "speed": held.sight.speed.copy(),
        }

    @checked
    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Resume exactly from a ``state``.

        Raises:
            DataError: an array is missing, of another shape, or not finite; nothing changes.
        """
        if not state:
            self._before = None
            return
        try:
            stamp, (height, width) = int(state["stamp_ns"]), state["shape"].tolist()
            profiles = [np.array(state[name], np.float64) for name in ("turn", "speed")]
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise DataError(f"visual odometry: no saved state: {error!r}") from error
        for name, values in zip(("turn", "speed"), profiles, strict=True):
            if values.shape != (width,) or not np.isfinite(values).all():
                raise DataError(f"visual odometry: {name} {values.shape}, expected {width} numbers")
        self._before = _LastImage(stamp, Sight((int(height), int(width)), *profiles))


def fit_speed(
    config: VisualOdometryConfig, seen: Sequence[VisualSpeed], speeds: ArrayLike
) -> VisualOdometryConfig:
    """Calibrate the scale to known speeds, from wheel odometry or a tape measure.

    A single camera cannot tell a fast drive through a large room from a slow one through a small
    room; a few metres of known motion settle it, for rooms of that size. The fit is least squares
    over pieces of a second, because the noise of single steps would make the scale too small.

    Args:
        config: the configuration used for ``seen``.
        seen: results of ``process``, n steps.
        speeds: float (n), true speed in m/s during each.

    Raises:
        ShapeError: another number of speeds.
        DataError: a speed that is not finite, less than 1 m of distance, or no motion seen.
    """
    driven = np.asarray(speeds, np.float64)
    if driven.shape != (len(seen),):
        raise ShapeError(f"speeds: {driven.shape}, expected ({len(seen)},): one for each step")
    if (bad := np.flatnonzero(~np.isfinite(driven))).size:
        raise DataError(f"speed {bad[0]} is {driven[bad[0]]}, expected a number")
    seconds = np.array([one.dt for one in seen])
    way = float(np.abs(driven * seconds).sum())
    if way < _LEAST_WAY_M:
        raise DataError(f"the drive is {way:.2f} m long, expected {_LEAST_WAY_M} m or more")
    pieces = np.floor(np.cumsum(seconds) - seconds / 2).astype(np.int64)
    moved = np.bincount(pieces, np.array([one.change for one in seen]) * seconds)
    known = np.bincount(pieces, driven * seconds)
    scale = float(moved @ known / (moved @ moved)) if moved.any() else 0.0
    if not scale > 0:
        raise DataError("the images do not move with the speeds: there is no scale that fits")
    name = "distance_m" if config.preset == "robust" else "difference_scale"
    return merged(config, {name: scale})


def _with_camera(config: VisualOdometryConfig, camera: Camera) -> VisualOdometryConfig:
    focal, centre = float(camera.projection[0, 0]), float(camera.projection[0, 2])
    if not (focal > 0 and centre >= 0):
        raise ConfigError(
            f"camera: focal length {focal}, centre {centre}, expected positive ones",
            code="out-of-range",
            fields=("camera", str(focal), str(centre)),
        )
    changes = {"focal_px": focal, "centre_px": centre}
    if camera.size is not None:
        changes["field_of_view"] = 2 * float(np.arctan(camera.size[0] / 2 / focal))
    return merged(config, changes)
