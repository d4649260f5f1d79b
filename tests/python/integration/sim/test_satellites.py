# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Satellite receivers of simulated robots: from the drive into bags, and out of them again."""

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("embreex", reason="the simulator is an extra")

from bags import SUFFIXES, delayed, write_bag
from cli import succeeds
from fusionslam.config import merged
from fusionslam.datasets import open_dataset
from fusionslam.geometry.globe import MapOrigin
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.mapping import PlaceMap
from fusionslam.sensors.messages import Event, Fix
from fusionslam.sim.simulator import SimulationConfig, event_count, simulate
from rows import rows
from worlds import bare_robot, hall, straight

pyproj = pytest.importorskip("pyproj", reason="positions on the globe are an extra")

CLEAR = {"noise_m": 0.0, "multipath_m": 0.0, "position_m": (0.5, 0.0, 1.2)}
TURN = Trajectory(
    np.array([0.0, 4.0]), np.array([-4.0, -4.0]), np.zeros(2), np.array([0, np.pi / 2])
)
"""From east to north, on the spot."""


def drive(**changes: object) -> list[Event]:
    robot = merged(
        bare_robot(rings=2, azimuths=60), {"gnss": {"main": CLEAR | changes}}, new_names=True
    )
    config = SimulationConfig(seed=1)
    events = [*simulate(hall(), robot, TURN, config)]
    assert len(events) == event_count(robot, TURN, config)
    return events


def test_fixes_are_those_of_the_antenna_that_the_robot_swings_round() -> None:
    fixes = [event.message for event in drive() if event.topic == "/gps/fix"]
    assert len(fixes) == 20
    for message, angle in ((fixes[0], 0.0), (fixes[10], np.pi / 4)):
        assert isinstance(message, Fix) and message.position is not None
        latitude, longitude, height = message.position
        assert height == pytest.approx(1.2, abs=1e-5)
        azimuth, _, far = pyproj.Geod(ellps="WGS84").inv(8.4, 49.0, longitude, latitude)
        found = far * np.array([np.sin(np.radians(azimuth)), np.cos(np.radians(azimuth))])
        antenna = [-4 + 0.5 * np.cos(angle), 0.5 * np.sin(angle)]
        np.testing.assert_allclose(found, antenna, atol=1e-4)


@rows("suffix", SUFFIXES)
def test_a_bag_gives_the_fixes_that_were_written(tmp_path: Path, suffix: str) -> None:
    events = drive(gap_every_s=0.5, gap_s=1.0, noise_m=1.0)
    written = [event.message for event in events if event.topic == "/gps/fix"]
    dataset = open_dataset(write_bag(tmp_path / f"drive.{suffix}", events))
    read = [*dataset.fixes()]
    assert len(read) == len(written) == 20
    for one, other in zip(read, written, strict=True):
        assert isinstance(other, Fix)
        assert (one.stamp_ns, one.frame_id) == (other.stamp_ns, other.frame_id)
        np.testing.assert_array_equal(one.position, other.position)
        np.testing.assert_array_equal(one.covariance, other.covariance)
    assert 0 < sum(each.position is None for each in read) < 20
    mount = dataset.robot_from_antenna()
    assert mount is not None
    np.testing.assert_allclose(mount[:3, 3], [0.5, 0, 1.2])


def test_info_says_what_a_receiver_says_and_lacks(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "drive.bag", drive(noise_m=2.0))
    out = succeeds("info", bag).stdout
    assert "fix /gps/fix" in out
    assert "20 positions in 20 messages, near 49.00" in out
    assert "stated deviation 2 m, antenna at 0.50, 0.00, 1.20 m" in out
    without = succeeds("info", bag, "--topic", "fix=").stdout
    assert "satellites" not in without


@pytest.mark.slow
def test_a_map_of_a_drive_is_exported_where_the_drive_was(tmp_path: Path) -> None:
    """The map begins at (-4, 0) of a world whose x axis points 40 degrees north of east."""
    pytest.importorskip("gtsam", reason="the library of pose graphs is an extra")
    robot = merged(
        bare_robot(rings=16, azimuths=180, rate_hz=5), {"gnss": {"main": CLEAR}}, new_names=True
    )
    config = SimulationConfig(origin=MapOrigin(latitude=49.0, longitude=8.4, heading=40.0))
    bag = write_bag(tmp_path / "drive.bag", simulate(hall(), robot, straight(8.0), config))
    site, out = tmp_path / "site.fsmap", tmp_path / "out"
    words = ("map", "build", bag, "-o", site, "--no-report")
    assert "origin" not in succeeds(*words, "-d", "m2dp", "--topic", "fix=").stdout
    said = succeeds(*words).stdout  # the map has all frames, and gets the fixes
    before = site.read_bytes()
    assert succeeds(*words).stdout == said and site.read_bytes() == before
    succeeds("map", "export", site, "-o", out)
    (feature,) = json.loads((out / "trajectory.geojson").read_text())["features"]
    along = [feature["geometry"]["coordinates"][k] for k in (0, -1)]
    for (longitude, latitude, height), x in zip(along, (-4.0, -0.5), strict=True):
        azimuth, _, far = pyproj.Geod(ellps="WGS84").inv(8.4, 49.0, longitude, latitude)
        found = far * np.exp(1j * np.radians(90 - azimuth))
        assert abs(found - x * np.exp(1j * np.radians(40))) < (0.02 if x == -4 else 0.5)
        assert abs(height) < 0.02
    with PlaceMap.open(site, "drive") as again:
        origin = again.content.origin
        assert origin is not None and str(origin) in said
        again.solve()  # from what the file has
        assert str(again.content.origin) == str(origin)
        again.forget("drive")
        assert again.content.origin is None and again.file.positions() == []


@pytest.mark.slow
def test_fixes_that_place_no_map_are_named_and_the_map_is_made(tmp_path: Path) -> None:
    """The robot turns on the spot, or its receiver has another clock."""
    pytest.importorskip("gtsam", reason="the library of pose graphs is an extra")
    late = 3600 * 1_000_000_000
    events = drive(noise_m=1.0)
    for name, bag, word in (
        ("spot", write_bag(tmp_path / "spot.bag", events), "not on the globe"),
        ("late", write_bag(tmp_path / "late.bag", delayed(events, "/gps/fix", late)), "+3600"),
    ):
        site = tmp_path / f"{name}.fsmap"
        ran = succeeds("map", "build", bag, "-o", site, "-d", "m2dp", "--no-report")
        assert word in ran.stderr
        with PlaceMap.open(site, read_only=True) as made:
            assert len(made) > 1 and made.content.origin is None
