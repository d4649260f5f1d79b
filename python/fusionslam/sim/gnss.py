# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a satellite receiver on a moving robot takes its position to be."""

from typing import NamedTuple

import numpy as np

from fusionslam.base.arrays import Floats, Mask
from fusionslam.geometry.globe import MapOrigin, geographic
from fusionslam.sim.robot import GnssMount

_UP = 2.0
"""Heights err more than places: satellites are all above."""


class GnssTrack(NamedTuple):
    """What a receiver says at N times.

    Attributes:
        positions: float64 (N, 3), latitude, longitude, degrees, and height, metres.
        known: bool (N), false in gaps.
        covariance: float64 (3, 3), m^2, east, north, up: of noise and multipath, which it states.
    """

    positions: Floats
    known: Mask
    covariance: Floats


def simulate_gnss(
    antenna: Floats, mount: GnssMount, seconds: Floats, origin: MapOrigin, rng: np.random.Generator
) -> GnssTrack:
    """Measure positions of an antenna.

    Multipath is a bias that changes by a Gauss-Markov process of first order: its values t seconds
    apart correlate by exp(-t / ``multipath_s``). Outliers lie ``outlier_m`` away, in any horizontal
    direction.

    Args:
        antenna: float64 (N, 3), true positions in the world.
        mount: errors.
        seconds: float64 (N,), times of the positions, at equal steps.
        origin: of the world.
        rng: source of the errors.

    Raises:
        FusionSlamError: pyproj is not installed (code "missing-extra").
    """
    size = np.array([1.0, 1.0, _UP])
    count = len(seconds)
    errors = mount.noise_m * rng.standard_normal((count, 3))
    errors += mount.multipath_m * _gauss_markov(count, 1 / mount.rate_hz / mount.multipath_s, rng)
    errors *= size
    is_outlier = rng.random(count) < mount.outliers
    angle = rng.uniform(0, 2 * np.pi, count)
    away = np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
    errors += mount.outlier_m * away * is_outlier[:, None]
    longitude, latitude, height = geographic(antenna + errors, origin).T
    stated = (mount.noise_m**2 + mount.multipath_m**2) * size**2
    return GnssTrack(
        np.stack([latitude, longitude, height], axis=1),
        ~_in_gaps(seconds, mount, rng),
        np.diag(np.maximum(stated, 1e-6)),
    )


def _gauss_markov(count: int, step: float, rng: np.random.Generator) -> Floats:
    """Values of deviation 1, (count, 3), each of which keeps exp(-step) of the one before."""
    from scipy.signal import lfilter

    kept = np.exp(-step)
    new = rng.standard_normal((count, 3))
    new[1:] *= np.sqrt(1 - kept**2)
    return np.asarray(lfilter([1.0], [1.0, -kept], new, axis=0))


def _in_gaps(seconds: Floats, mount: GnssMount, rng: np.random.Generator) -> Mask:
    """Whether times are in gaps, which begin at random after the last one's end."""
    inside = np.zeros(len(seconds), bool)
    if mount.gap_every_s is None or not len(seconds):
        return inside
    at = seconds[0] + rng.exponential(mount.gap_every_s)
    while at <= seconds[-1]:
        inside |= (seconds >= at) & (seconds < at + mount.gap_s)
        at += mount.gap_s + rng.exponential(mount.gap_every_s)
    return inside
