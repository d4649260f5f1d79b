# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Image profiles (mean brightness of each column) and their alignment between images."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats
from fusionslam.views.visual_templates import LUMINANCE

# Contrast of a profile, 0 .. 1, below which it is only noise.
_FLAT = 1e-3
_STRETCHES, _BESIDE = 17, 2


def row_range(rows: tuple[float, float], height: int) -> tuple[int, int]:
    """First and end row of the range between two fractions of the height."""
    first = min(int(rows[0] * height), height - 1)
    return first, max(int(rows[1] * height), first + 1)


def profile(pixels: NDArray[np.uint8], first: int, end: int) -> Floats:
    """Mean brightness of each column over rows ``first`` to ``end - 1``: float64 (W), 0 .. 1."""
    band = pixels[first:end]
    # Integer sums of bytes are exact.
    sums = band.sum(axis=0, dtype=np.uint32)
    grey = sums @ LUMINANCE if sums.ndim == 2 else sums.astype(np.float64)
    means: Floats = grey / (255 * len(band))
    return means


def standardise(values: Floats) -> Floats:
    """Scale to mean 0 and deviation 1, to be independent of exposure; zeros without contrast."""
    centred = values - values.mean()
    deviation = centred.std()
    scaled: Floats = centred / deviation if deviation > _FLAT else np.zeros_like(centred)
    return scaled


@dataclass(frozen=True)
class Lens:
    """Horizontal geometry of a pinhole camera: width, focal length and centre in pixels."""

    width: int
    focal: float
    centre: float

    @cached_property
    def angles(self) -> Floats:
        """float64 (W): angles in equal steps from the left edge to the right one, radians."""
        edges = np.arctan((np.array([0, self.width - 1]) - self.centre) / self.focal)
        return np.linspace(edges[0], edges[1], self.width)

    @property
    def step(self) -> float:
        """Step between these angles, radians."""
        return float((self.angles[-1] - self.angles[0]) / (self.width - 1))

    def by_angle(self, values: Floats) -> Floats:
        """Resample a profile to equal angular steps, so that a turn shifts all of it equally."""
        columns = self.centre + self.focal * np.tan(self.angles)
        return np.interp(columns, np.arange(self.width), values)


def best_shift(before: Floats, now: Floats, reach: int) -> tuple[int, float]:
    """Best shift in columns to the right, and its mean absolute difference.

    The smallest of equal shifts. Shifts that leave less than half of the columns are not tried.
    """
    width = len(now)
    reach = min(reach, width // 2)
    shifts = sorted(range(-reach, reach + 1), key=abs)
    errors = [
        np.abs(now[max(k, 0) : width + min(k, 0)] - before[max(-k, 0) : width - max(k, 0)]).mean()
        for k in shifts
    ]
    best = int(np.argmin(errors))
    return shifts[best], float(errors[best])


class Stretch(NamedTuple):
    """The transformation of a profile into the next one.

    Attributes:
        shift: columns to the right.
        stretch: growth of its angles.
        error: remaining mean absolute difference, in deviations of the profiles.
    """

    shift: float
    stretch: float
    error: float


def best_stretch(before: Floats, now: Floats, start: int, lens: Lens, reach: float) -> Stretch:
    """The shift near ``start`` and growth up to ``reach`` of least mean absolute difference.

    Driving forward by a fraction k of the distance moves a point at angle a to a + k sin a.
    A parabola refines both between the values tried.
    """
    before, now = _standardise_shared(before, now, start)
    shifts = start + np.arange(-_BESIDE, _BESIDE + 1.0)
    stretches = np.linspace(-reach, reach, _STRETCHES)
    errors = _errors(before, now, shifts[:, None, None], stretches[:, None], lens)
    row, column = divmod(int(errors.argmin()), len(stretches))
    between = _vertex(errors[row], column) * (stretches[1] - stretches[0])
    return Stretch(
        float(shifts[row] + _vertex(errors[:, column], row)),
        float(stretches[column] + between),
        float(errors[row, column]),
    )


def _standardise_shared(before: Floats, now: Floats, shift: int) -> tuple[Floats, Floats]:
    """Standardise both profiles over the columns that both contain."""
    width, right, left = len(now), max(shift, 0), max(-shift, 0)
    shared = before[left : width - right], now[right : width - left]
    if not all(part.std() > _FLAT for part in shared):
        return before, now
    one, other = (
        (values - part.mean()) / part.std()
        for values, part in zip((before, now), shared, strict=True)
    )
    return one, other


def _errors(before: Floats, now: Floats, shifts: Floats, stretches: Floats, lens: Lens) -> Floats:
    """Mean absolute differences, (shifts, stretches), over the columns in both profiles."""
    turned = lens.angles - shifts * lens.step
    source = (turned - lens.angles[0] - stretches * np.sin(turned)) / lens.step
    last = len(before) - 1
    known = (source >= 0) & (source <= last)
    column = np.clip(source, 0, last - 1).astype(np.intp)
    slopes = np.append(np.diff(before), 0)
    differences = before[column] + (source - column) * slopes[column] - now
    seen = known.sum(axis=-1)
    sums = np.abs(differences).sum(axis=-1, where=known)
    errors: Floats = np.where(seen >= len(now) // 4, sums / np.maximum(seen, 1), np.inf)
    return errors


def _vertex(errors: Floats, least: int) -> float:
    """Steps from the least error to the vertex of the parabola through it and its neighbours."""
    if not 0 < least < len(errors) - 1:
        return 0.0
    left, middle, right = errors[least - 1 : least + 2]
    bend = left - 2 * middle + right
    return float(0.5 * (left - right) / bend) if 0 < bend < np.inf else 0.0
