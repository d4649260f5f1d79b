# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A simulated car's stereo pair: bag and folder give one cloud, as deep as the scan."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

pytest.importorskip("embreex", reason="the simulator is an extra")
pytest.importorskip("rosbags", reason="bags are an extra")

from artefacts import artefact
from cli import succeeds
from fusionslam import Cloud, Frame, FusionConfig, fuse
from fusionslam.config import merged
from fusionslam.datasets import open_dataset, open_writer
from fusionslam.sim.catalogue import MADE, drive_through
from fusionslam.sim.folder_writer import folder_writer
from fusionslam.sim.motion.planner import PlanConfig
from fusionslam.sim.robot import robot_named
from fusionslam.sim.simulator import SimulationConfig, simulate

STEREO = FusionConfig(source="stereo")
PICTURES = ("jpeg", "png")


@pytest.fixture(scope="module")
def recorded() -> Path:
    return artefact("stereo-drive", record_drive)


def record_drive(root: Path) -> None:
    """Three instants of one drive: two bags and a folder."""
    car = robot_named("car")
    town = MADE["town"]
    small = merged(town.settings, {"house_types": 2})
    world, way = drive_through(town.make(small), car, PlanConfig())
    events = list(simulate(world, car, way, SimulationConfig(seconds=0.3)))
    topics = [camera.picture_topic() for camera in car.cameras.values()]
    for stored in PICTURES:
        with open_writer(root / f"{stored}.bag", images=dict.fromkeys(topics, stored)) as bag:
            for event in events:
                bag.write(event)
    with folder_writer(root / "folder", car) as folder:
        for event in events:
            folder.write(event)


def test_the_bag_gives_the_folders_clouds_and_where_the_scanner_is(recorded: Path) -> None:
    exact, folder = open_dataset(recorded / "png.bag"), open_dataset(recorded / "folder")
    assert exact.sensors == folder.sensors == ("points", "left", "right")
    assert len(exact) == len(folder) == 3
    for mine, its in zip(exact, folder, strict=True):
        first, second = fuse(mine, STEREO), fuse(its, STEREO)
        assert len(first) > 20_000
        np.testing.assert_allclose(first.points, second.points, rtol=0, atol=1e-4)
        np.testing.assert_array_equal(first.colors, second.colors)
    np.testing.assert_allclose(exact[0].robot_from_points, folder[0].robot_from_points, atol=1e-12)


def test_compression_moves_few_points(recorded: Path) -> None:
    exact, lossy = (
        fuse(open_dataset(recorded / f"{kind}.bag")[0], STEREO) for kind in ("png", "jpeg")
    )
    distances, _ = cKDTree(exact.points).query(lossy.points)
    assert abs(len(lossy) / len(exact) - 1) < 0.1
    assert np.quantile(distances / np.linalg.norm(lossy.points, axis=1), 0.8) < 0.01


def test_the_depth_of_the_pair_is_that_of_the_scan(recorded: Path) -> None:
    dataset = open_dataset(recorded / "jpeg.bag")
    errors = np.concatenate([relative_errors(frame) for frame in dataset])
    print(f"{len(errors)} scan points: median {np.median(np.abs(errors)):.3f} of the depth")
    assert len(errors) > 3000
    assert np.median(np.abs(errors)) < 0.03
    assert abs(np.median(errors)) < 0.01


def relative_errors(frame: Frame) -> NDArray[np.float64]:
    """Of the pair's depth where a point of the scan within 40 m is seen less than a pixel off."""
    scan, depths = project_cloud(frame, Cloud(frame.points))
    near = (depths > 1) & (depths < 40)
    pixels, found = project_cloud(frame, fuse(frame, STEREO))
    away, nearest = cKDTree(pixels).query(scan[near])
    hit = away < 1.0
    errors: NDArray[np.float64] = found[nearest[hit]] / depths[near][hit] - 1
    return errors


def project_cloud(frame: Frame, cloud: Cloud) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Pixels of the left camera, (N, 2), and depths, (N,)."""
    points = np.column_stack([cloud.points, np.ones(len(cloud))])
    places = points @ frame.cameras["left"].projection_from_points.T
    return places[:, :2] / places[:, 2:], places[:, 2]


def test_bench_describes_scans_and_pairs(recorded: Path, tmp_path: Path) -> None:
    succeeds("describe", recorded / "jpeg.bag", "-d", "m2dp", "--source", "stereo", "-o", tmp_path)
    assert (tmp_path / "stereo-m2dp.npz").exists()
    out = " ".join(succeeds("info", recorded / "jpeg.bag").stdout.split())
    assert "baseline 0.540 m" in out
