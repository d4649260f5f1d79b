# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated satellite receivers say where their antenna is, with the errors that are stated."""

from typing import Any

import numpy as np
import pytest

from fusionslam.base.arrays import Floats
from fusionslam.geometry.globe import MapOrigin
from fusionslam.sim.gnss import GnssTrack, simulate_gnss
from fusionslam.sim.robot import GnssMount

pyproj = pytest.importorskip("pyproj", reason="positions on the globe are an extra")

ORIGIN = MapOrigin(latitude=48.0, longitude=-122.0, altitude=50.0)


def measure(antenna: Floats, hz: float = 1.0, seed: int = 0, **changes: Any) -> GnssTrack:
    clear: dict[str, Any] = {"noise_m": 0.0, "multipath_m": 0.0}
    mount = GnssMount(**clear | changes, rate_hz=hz)
    seconds = np.arange(len(antenna)) / hz
    return simulate_gnss(antenna, mount, seconds, ORIGIN, np.random.default_rng(seed))


def metres(positions: Floats) -> Floats:
    """East, north and up of the origin, by the earth's centre: EPSG 4979 to 4978."""
    to_centre = pyproj.Transformer.from_crs(4979, 4978)
    here = np.array(to_centre.transform(ORIGIN.latitude, ORIGIN.longitude, ORIGIN.altitude))
    lat, lon = np.radians([ORIGIN.latitude, ORIGIN.longitude])
    east = [-np.sin(lon), np.cos(lon), 0]
    up = [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)]
    axes = np.stack([east, np.cross(up, east), up])
    return np.asarray((np.stack(to_centre.transform(*positions.T), axis=1) - here) @ axes.T)


def test_without_errors_it_says_where_the_antenna_is() -> None:
    antenna = np.array([[0.0, 0, 0], [900, -400, 3], [-2000, 1500, 40]])
    track = measure(antenna)
    np.testing.assert_allclose(metres(track.positions), antenna, atol=1e-6)
    np.testing.assert_allclose(track.positions[0], [48, -122, 50], atol=1e-9)
    assert track.known.all()


def test_errors_have_the_covariance_that_it_states() -> None:
    track = measure(np.zeros((20_000, 3)), noise_m=0.6, multipath_m=0.8, multipath_s=2.0)
    np.testing.assert_allclose(np.cov(metres(track.positions).T), track.covariance, atol=0.15)
    np.testing.assert_allclose(track.covariance, np.diag([1, 1, 4]), atol=1e-12)


@pytest.mark.parametrize("seconds", [1, 10, 30])
def test_multipath_changes_in_the_time_that_is_stated(seconds: int) -> None:
    track = measure(np.zeros((30_000, 3)), multipath_m=1.5, multipath_s=20.0)
    east = metres(track.positions)[:, 0]
    alike = np.corrcoef(east[:-seconds], east[seconds:])[0, 1]
    assert alike == pytest.approx(np.exp(-seconds / 20), abs=0.06)


def test_outliers_lie_as_far_off_as_stated_in_any_direction() -> None:
    off = metres(measure(np.zeros((4000, 3)), outliers=0.1, outlier_m=50.0).positions)
    far = np.linalg.norm(off, axis=1)
    assert (far > 49.9).mean() == pytest.approx(0.1, abs=0.02)
    np.testing.assert_allclose(far[far > 1], 50, atol=1e-6)
    assert np.abs(off[far > 1].mean(axis=0)).max() < 6


def test_gaps_last_as_long_as_stated() -> None:
    known = measure(np.zeros((50_000, 3)), gap_every_s=300.0, gap_s=60.0).known
    edges = np.flatnonzero(np.diff(known.astype(int)))
    lengths = np.diff(edges)[::2]  # it begins with a fix
    assert known[0] and set(lengths) <= {60, 120, 180}
    assert known.mean() == pytest.approx(300 / 360, abs=0.05)
