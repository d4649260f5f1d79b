# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Places of a small fleet, described from clouds, and a client of the service of them."""

import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from clouds import Points, scan_blocks
from fleets import InProcess
from fusionslam import DescriptorConfig, FusionConfig, LoopConfig
from fusionslam.base.arrays import Floats32, Matrix
from fusionslam.datasets import write_cloud
from fusionslam.fleet.config import FleetConfig, FleetSettings
from fusionslam.fleet.folder import FleetFolder
from fusionslam.fleet.places import Places
from fusionslam.fleet.recordings import Labels, find_recordings
from fusionslam.fleet.settings import settle_settings
from fusionslam.fleet.site_maps import site_map_path
from fusionslam.fleet.work import Plan
from fusionslam.mapping import Edge, MapConfig
from fusionslam.mapping.map_file import MapFile, StoredCloud, StoredKeyframe
from fusionslam.mapping.map_settings import MapSettings
from fusionslam.pipelines.describe import PipelineConfig
from fusionslam.registration import RegistrationConfig
from fusionslam.sensors.frame import Cloud
from fusionslam.service.config import ServiceConfig

SITES = {"depot": 12, "yard": 13}
"""Numbers of made places by site."""
FRAMES = 4
KEY = "a-key-for-tests-0123456789"
LENGTH = 192
"""Of vectors of m2dp."""


def pose_at(frame: float) -> Matrix:
    """Where the robot of each recording is at a frame."""
    pose = np.eye(4)
    pose[:2, 3] = 3.0 * frame, 0.5 * frame
    return pose


def scan_at(site: str, frame: float, seed: int = 99) -> Points:
    return scan_blocks(pose_at(frame), seed, count=12000, place=SITES[site])


def describe_fleet(folder: Path) -> Path:
    """Describe a recording at each of two sites, with clouds; return the folder of places."""
    for site in SITES:
        recording = folder / "recordings" / site / "robot-1" / f"{site}-monday"
        for frame in range(FRAMES):
            write_cloud(recording / f"{frame:06d}.bin", Cloud(scan_at(site, frame, seed=frame)))
        rows = [" ".join(map(str, pose_at(frame)[:3].ravel())) for frame in range(FRAMES)]
        (recording / "poses.txt").write_text("\n".join(rows) + "\n")
    found = find_recordings(folder / "recordings", Labels(("site", "robot")))
    places = FleetFolder(
        folder / "places",
        settle_settings(
            found, ("m2dp",), PipelineConfig(), FleetConfig(), folder / "places", source="cloud"
        ),
    )
    plan = Plan.make(folder / "recordings", found, places.settings, None)
    assert not places.describe(plan, InProcess())
    return places.path


def as_npy(array: Any) -> bytes:
    """An array as a .npy file."""
    buffer = io.BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()


def as_npz(array: Any) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, array)
    return buffer.getvalue()


def make_folder(path: Path, *, clouds: bool = False) -> FleetFolder:
    """Make a folder of places of m2dp without any."""
    settings = FleetSettings.of(("m2dp",), PipelineConfig(), FleetConfig(clouds=clouds))
    path.mkdir(parents=True)
    settings.save(path)
    FleetFolder(path, settings).database(read_only=False).close()
    return FleetFolder(path, settings)


def vectors_of(seed: int, count: int) -> Floats32:
    return np.random.default_rng(seed).normal(size=(count, LENGTH)).astype(np.float32)


def add_places(folder: Path, session: str, count: int = 20, **about: Any) -> Floats32:
    """Add places of a session, a second apart; return their vectors."""
    vectors = vectors_of(sum(session.encode()), count)
    poses = np.stack([pose_at(frame) for frame in range(count)])
    poses[0] = np.nan
    names = [f"{session}:{row}" for row in range(count)]
    stamps = np.arange(count, dtype=np.int64) * 10**9
    with FleetFolder.open(folder).database(read_only=False) as database:
        database.add(Places(names, vectors, stamps, stamps // 10**9, session, poses=poses, **about))
    return vectors


def map_pose_at(frame: float) -> Matrix:
    """Where ``pose_at`` is in the joint map: turned to the left, and moved along its x axis."""
    turned = np.eye(4)
    turned[:2, :2] = [[0, -1], [1, 0]]
    turned[0, 3] = 100.0
    return turned @ pose_at(frame)


def write_joint_map(folder: Path, site: str, drives: Mapping[str, Mapping[int, int]]) -> Path:
    """Write the joint map of a site, whose drives are where ``map_pose_at`` says.

    Args:
        folder: of the fleet.
        site: name of the site.
        drives: by session, parts of the map by the frames that are keyframes. Odometry connects
            those of one part.
    """
    path = site_map_path(folder, site)
    path.parent.mkdir(exist_ok=True)
    settings = MapSettings(
        "m2dp:robust",
        LoopConfig(),
        DescriptorConfig(),
        FusionConfig(source="cloud"),
        RegistrationConfig(),
        MapConfig(),
    )
    rows = [(name, *each) for name, parts in drives.items() for each in parts.items()]
    poses = np.array([map_pose_at(frame) for _, frame, _ in rows])
    with MapFile(path) as file, file.transaction():
        file.store_setting("config", settings.dump())
        numbers = {name: file.add_session(name) for name in drives}
        for number, (name, frame, part) in enumerate(rows):
            keyframe = StoredKeyframe(number, numbers[name], frame, 0, np.eye(4), np.eye(4))
            vector = np.ones(LENGTH, np.float32)
            file.add_keyframe(keyframe, StoredCloud(b"", None, 0.0, b""), {"m2dp": vector})
            if number and rows[number - 1][::2] == (name, part):
                step = number - 1, number, np.eye(4), np.eye(6)
                file.store_edge(Edge(number, "odometry", *step, "believed"))
        parts = np.array([part for _, _, part in rows], np.int64)
        file.store_solution(np.arange(len(rows)), poses, parts)
    return path


@contextmanager
def serving(folder: Path, keys: Any = None, **config: Any) -> Iterator[Any]:
    """Yield a client of the application, which answers in this process."""
    testclient = pytest.importorskip("fastapi.testclient", reason="the extra fleet is missing")
    from fusionslam.service.app import create_app

    app = create_app(folder, ServiceConfig(**config), keys)
    with testclient.TestClient(
        app, base_url="http://localhost", raise_server_exceptions=False
    ) as client:
        yield client
