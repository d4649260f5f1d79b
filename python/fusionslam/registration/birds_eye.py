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

from fusionslam.base.arrays import Floats, Floats32, Matrix, Points
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
_FILTER = np.repeat(np.exp(-2 * (np.pi * _BLUR) ** 2 * (_fx**2 + _fy**2)), 2, axis=1)
"""Factors of the real and imaginary parts of a spectrum, next to each other."""
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
        return cls(np.packbits(_draw(points, ground, cell, _TURNS[:1]) > 0).tobytes(), ground)

    @property
    def spectra(self) -> Spectra:
        """Of the images, complex64 (layers, cells, cells/2+1)."""
        return _spectra_of(self.bits)

    @property
    def coarse_spectra(self) -> Spectra:
        """Their low frequencies, as ``coarse`` returns them."""
        return _coarse_of(self.bits)


@lru_cache(256)
def _spectra_of(bits: bytes) -> Spectra:
    cells = np.unpackbits(np.frombuffer(bits, np.uint8)).astype(np.float32)
    spectra: Spectra = _spectra(cells.reshape(1, -1, _CELLS, _CELLS), 1)[0]
    return spectra


@lru_cache(256)
def _coarse_of(bits: bytes) -> Spectra:
    return coarse(_spectra_of(bits))


def draw_turned(points: Points, ground: float, cell: float) -> Spectra:
    """Conjugate spectra of a cloud's images, turned in steps.

    Args:
        points: float32 (N, 3), above the ground.
        ground: height of the ground.
        cell: metres.

    Returns:
        complex64 (turns, layers, cells, cells/2+1).
    """
    return _spectra(_draw(points, ground, cell, _TURNS), -1)


def _draw(points: Points, ground: float, cell: float, turns: Floats) -> Floats32:
    """1 in cells with points, float32 (turns, layers, cells, cells)."""
    scaled = (points - np.array([0, 0, ground], np.float32)) / np.float32(cell)
    near = scaled[np.hypot(scaled[:, 0], scaled[:, 1]) < _RADIUS * _CELLS]
    layers = np.searchsorted(_LAYERS, near[:, 2])
    cos, sin = np.cos(turns, dtype=np.float32)[:, None], np.sin(turns, dtype=np.float32)[:, None]
    x, y = np.ascontiguousarray(near[:, :2].T)
    rows = np.floor(cos * x - sin * y).astype(np.int32) & (_CELLS - 1)
    columns = np.floor(sin * x + cos * y).astype(np.int32) & (_CELLS - 1)
    images = np.zeros((len(turns), len(_LAYERS) + 1, _CELLS, _CELLS), np.float32)
    firsts = np.arange(len(turns))[:, None] * (len(_LAYERS) + 1) + layers
    images.reshape(-1)[(firsts * _CELLS + rows) * _CELLS + columns] = 1
    return images


def _spectra(images: Floats32, sign: int) -> Spectra:
    """Spectra of blurred images, each of power 1; of sign -1 their conjugates."""
    from scipy.fft import rfft2

    # Of complex numbers NumPy would make passes that take several times as long.
    values = rfft2(images).view(np.float32)
    values *= (_FILTER * np.tile([1, sign], _CELLS // 2 + 1)).astype(np.float32)
    edges = values[..., [0, 1, -2, -1]]
    # A spectrum of real images holds one of each two conjugate columns, but for the first and last.
    power = 2 * np.einsum("tlxy,tlxy->t", values, values) - (edges**2).sum(axis=(1, 2, 3))
    norms = np.maximum(np.sqrt(power) / _CELLS, np.float32(1e-6))
    values *= (1 / norms)[:, None, None, None]
    spectra: Spectra = values.view(np.complex64)
    return spectra


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
    columns = spectra[..., : quarter + 1]
    low: Spectra = np.concatenate([columns[..., :quarter, :], columns[..., -quarter:, :]], axis=-2)
    low[..., quarter, :] = low[..., :, quarter] = 0  # these lack their conjugates
    low /= 2  # the inverse transform of a product divides by a quarter of the cells
    return low


def find_height(turned: Spectra, target: Spectra) -> float:
    """Return the largest correlation over all turns and shifts, at most 1."""
    return float(_correlate(turned, target).max())


def _correlate(turned: Spectra, target: Spectra) -> Floats32:
    """Correlations of each turn, float32 (turns, cells * cells)."""
    from scipy.fft import irfft2

    cells = target.shape[-2]
    products = turned[:, 0] * target[0]
    for layer in range(1, len(target)):
        products += turned[:, layer] * target[layer]
    shifts: Floats32 = irfft2(products, s=(cells, cells), overwrite_x=True)
    return shifts.reshape(len(turned), -1)
