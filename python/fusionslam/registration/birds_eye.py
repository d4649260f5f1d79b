# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Searches poses of clouds whose z axes point up: matched filtering of bird's-eye images.

What both clouds show above the ground is drawn from above, in layers by height. The source's
images, turned in steps, are correlated with the target's over all shifts at once, by FFT.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats, Matrix, Points
from fusionslam.errors import DataError

Spectra = NDArray[np.complex64]

_CELLS = 64
"""Of an image, in x and y."""
_RADIUS = 0.43
"""Of what is drawn, in images: the rest is for shifts, which else wrap around."""
_LAYERS = (0.75, 1.5)
"""Heights above the ground between layers, in cells."""
_STEPS = 60
"""Turns, of 6 degrees: the refinement takes it from there."""
_NEAR_STEPS = 4
"""Nearer turns are one hypothesis."""
_BLUR = 0.7
"""Standard deviation, in cells."""

_fx, _fy = np.fft.fftfreq(_CELLS)[:, None], np.fft.rfftfreq(_CELLS)[None]
_FILTER = np.exp(-2 * (np.pi * _BLUR) ** 2 * (_fx**2 + _fy**2)).astype(np.float32)
# A spectrum of real images holds one of each two conjugate columns.
_WEIGHTS = np.where(np.isin(np.arange(_CELLS // 2 + 1), (0, _CELLS // 2)), 1, 2)
_TURNS = np.linspace(0, 2 * np.pi, _STEPS, endpoint=False, dtype=np.float64)


class Hypothesis(NamedTuple):
    """A pose, float64 (4, 4) target_from_source, to be refined; its correlation is at most 1."""

    pose: Matrix
    correlation: float


@dataclass(frozen=True)
class SearchImage:
    """A cloud's images from above, kept in 1.5 kB.

    Attributes:
        bits: the cells with points, (layers, cells, cells), packed.
        ground_level: height of the ground, metres.

    Raises:
        DataError: bits of another length (code "damaged").
    """

    bits: bytes
    ground_level: float

    def __post_init__(self) -> None:
        expected = (len(_LAYERS) + 1) * _CELLS**2 // 8
        if len(self.bits) != expected:
            raise DataError(
                f"images from above are damaged: {len(self.bits)} bytes of {expected}",
                code="damaged",
            )

    @classmethod
    def of(cls, points: Points, ground: float, cell: float) -> "SearchImage":
        """Draw float32 (N, 3), points above the ground, in cells of this many metres."""
        return cls(np.packbits(_draw(points, ground, cell, _TURNS[:1])).tobytes(), ground)

    @property
    def spectra(self) -> Spectra:
        """Of the images, complex64 (layers, cells, cells/2+1)."""
        return _spectra_of(self.bits)


@lru_cache(256)
def _spectra_of(bits: bytes) -> Spectra:
    cells = np.unpackbits(np.frombuffer(bits, np.uint8))
    spectra: Spectra = _spectra(cells.reshape(1, -1, _CELLS, _CELLS))[0]
    return spectra


def draw_turned(points: Points, ground: float, cell: float) -> Spectra:
    """Conjugate spectra of a cloud's images, turned in steps.

    Args:
        points: float32 (N, 3), above the ground.
        ground: height of the ground.
        cell: metres.

    Returns:
        complex64 (turns, layers, cells, cells/2+1).
    """
    spectra: Spectra = _spectra(_draw(points, ground, cell, _TURNS)).conj()
    return spectra


def _draw(points: Points, ground: float, cell: float, turns: Floats) -> NDArray[np.uint8]:
    scaled = (points - np.array([0, 0, ground], np.float32)) / np.float32(cell)
    near = scaled[np.hypot(scaled[:, 0], scaled[:, 1]) < _RADIUS * _CELLS]
    layers = np.searchsorted(_LAYERS, near[:, 2])
    cos, sin = np.cos(turns, dtype=np.float32)[:, None], np.sin(turns, dtype=np.float32)[:, None]
    rows = np.floor(cos * near[:, 0] - sin * near[:, 1]).astype(np.intp) % _CELLS
    columns = np.floor(sin * near[:, 0] + cos * near[:, 1]).astype(np.intp) % _CELLS
    images = np.zeros((len(turns), len(_LAYERS) + 1, _CELLS, _CELLS), np.uint8)
    images[np.arange(len(turns))[:, None], layers, rows, columns] = 1
    return images


def _spectra(images: NDArray[np.uint8]) -> Spectra:
    from scipy.fft import rfft2

    spectra = rfft2(images.astype(np.float32)) * _FILTER
    power = (spectra.real**2 + spectra.imag**2) * _WEIGHTS
    norms = np.sqrt(power.sum(axis=(1, 2, 3), dtype=np.float64, keepdims=True)) / _CELLS
    normed: Spectra = (spectra / np.maximum(norms, 1e-6)).astype(np.complex64)
    return normed


def find_hypotheses(turned: Spectra, target: Spectra, cell: float, most: int) -> list[Hypothesis]:
    """Return the poses that correlate best, of turns that differ, the best first.

    Args:
        turned: of the source, from ``draw_turned``.
        target: of a ``SearchImage``.
        cell: metres.
        most: number of poses.
    """
    shifts = _correlate(turned, target)
    peaks = shifts.argmax(axis=1)
    heights = shifts[np.arange(_STEPS), peaks]
    found: list[Hypothesis] = []
    while len(found) < most and heights.max() > 0:
        best = int(heights.argmax())
        shift = (np.array(divmod(int(peaks[best]), _CELLS)) + _CELLS // 2) % _CELLS - _CELLS // 2
        cos, sin = np.cos(_TURNS[best]), np.sin(_TURNS[best])
        pose = np.eye(4)
        pose[:2, :2] = [[cos, -sin], [sin, cos]]
        pose[:2, 3] = cell * shift
        found.append(Hypothesis(pose, float(heights[best])))
        apart = (np.arange(_STEPS) - best + _STEPS // 2) % _STEPS - _STEPS // 2
        heights[np.abs(apart) < _NEAR_STEPS] = 0
    return found


def coarse(spectra: Spectra) -> Spectra:
    """The low frequencies of spectra: those of images of cells twice as wide."""
    quarter = _CELLS // 4
    rows = np.r_[:quarter, _CELLS - quarter : _CELLS]
    low: Spectra = np.ascontiguousarray(spectra[..., rows, : quarter + 1])
    low[..., quarter, :] = low[..., :, quarter] = 0  # these lack their conjugates
    low /= 2  # the inverse transform of a product divides by a quarter of the cells
    return low


def find_height(turned: Spectra, target: Spectra) -> float:
    """Return the largest correlation over all turns and shifts, at most 1."""
    return float(_correlate(turned, target).max())


def _correlate(turned: Spectra, target: Spectra) -> NDArray[np.float32]:
    """Correlations of each turn, float32 (turns, cells * cells)."""
    from scipy.fft import irfft2

    cells = target.shape[-2]
    products = np.einsum("tlxy,lxy->txy", turned, target)
    shifts: NDArray[np.float32] = irfft2(products, s=(cells, cells))
    return shifts.reshape(len(turned), -1)
