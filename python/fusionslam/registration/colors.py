# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Compares the colours of clouds that were registered, as evidence for or against the pose."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Floats, Image

FEWEST_COLORS = 20
"""Fewer pairs of points tell nothing about a pose."""

_LARGEST = 20.0
"""Differences count as this much at most: edges and what has moved differ more at right poses."""
_LEAST_CHANCE = 1.0
"""CIELab. Surfaces that differ less have one colour, which fits everywhere."""
_DARK = 1e-3
"""Linear light that keeps the gain of black points finite."""


@checked
@dataclass(frozen=True)
class ColorDifference:
    """How the colours of points differ that a pose puts on each other.

    Attributes:
        mean: CIELab difference of a pair of points, at most 20 each, after a gain of each channel
            that fits the exposure and white balance of one cloud to the other.
        chance: the same of the same points in pairs that do not belong together: what a pose would
            give that has nothing to do with the colours.
        pairs: number of points with a neighbour.
    """

    mean: float
    chance: float
    pairs: int

    @property
    def ratio(self) -> float:
        """Mean by chance: 0 where colours are equal, 1 where the pose says nothing of them."""
        return self.mean / max(self.chance, _LEAST_CHANCE)


def compare_colors(one: Image, other: Image) -> ColorDifference | None:
    """Compare the colours of pairs of points.

    Args:
        one, other: uint8 (N, 3) sRGB; rows belong together.

    Returns:
        The difference; None if there are fewer than 20 pairs.
    """
    if len(one) < FEWEST_COLORS:
        return None
    light = _LINEAR[one], _LINEAR[other]
    gain = np.sqrt((light[1].mean(axis=0) + _DARK) / (light[0].mean(axis=0) + _DARK))
    labs = _lab(light[0] * gain), _lab(light[1] / gain)
    mean = _mean_difference(*labs)
    # Rows far from each other in the order of voxels lie far from each other, too.
    shifts = [len(one) * quarter // 4 for quarter in (1, 2, 3)]
    chance = np.mean([_mean_difference(labs[0], np.roll(labs[1], s, axis=0)) for s in shifts])
    return ColorDifference(mean, float(chance), len(one))


def _mean_difference(one: Floats, other: Floats) -> float:
    return float(np.minimum(np.linalg.norm(one - other, axis=1), _LARGEST).mean())


_VALUES = np.arange(256) / 255
_LINEAR: Floats = np.where(_VALUES <= 0.04045, _VALUES / 12.92, ((_VALUES + 0.055) / 1.055) ** 2.4)
"""Linear light of the 256 values of an sRGB channel (IEC 61966-2-1)."""
_WHITE_FROM_RGB: NDArray[np.float64] = np.array(
    [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
) / np.array([[0.95047], [1.0], [1.08883]])
"""XYZ by that of white (D65), of linear sRGB."""


def _lab(light: Floats) -> Floats:
    """CIE 1976 L*, a*, b* of linear sRGB, float64 (N, 3)."""
    xyz = light @ _WHITE_FROM_RGB.T
    x, y, z = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116).T
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=1)
