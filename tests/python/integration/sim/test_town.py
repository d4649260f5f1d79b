# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The simulated drive: same seed same bytes, KITTI's layout, geometry that fits together."""

import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("embreex", reason="the simulator is an extra")

from error_codes import has_code
from fusionslam import FusionConfig, fuse
from fusionslam.datasets import open_dataset
from fusionslam.errors import ConfigError, DataError
from fusionslam.evaluation.loops.revisits import visits
from fusionslam.sim import (
    CarConfig,
    DriveConfig,
    LidarConfig,
    SimConfig,
    StereoConfig,
    TownConfig,
    embedded_drive,
    record,
)
from fusionslam.sim.camera import camera_rays, parent_from_camera, photograph, projection
from fusionslam.sim.lidar import scan
from fusionslam.sim.scene import RayCaster
from fusionslam.sim.town import kitti_recorder as recorder
from fusionslam.sim.town.car import RING, RingConfig, car_from_lidar
from fusionslam.sim.town.layout import make_town
from fusionslam.sim.town.route import make_drive
from rows import rows

TOWN = TownConfig(seed=5, blocks=(1, 1), block_m=44.0)
DRIVE = DriveConfig(laps=(((0, 0), (1, 0)), ((1, 0), (1, 1))), spacing_m=14.0)
LIDAR = LidarConfig(rings=16, azimuths=180)
CAMERA = StereoConfig(width=160, height=48, focal_px=92.0, centre_px=(79.0, 23.5))
TINY = SimConfig(town=TOWN, drive=DRIVE, car=CarConfig(lidar=LIDAR, camera=CAMERA))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(TINY, tmp_path_factory.mktemp("tiny") / "drive")


@pytest.fixture(scope="module")
def caster() -> RayCaster:
    return RayCaster(make_town(TOWN, lap=0))


@pytest.fixture(scope="module")
def poses() -> np.ndarray:
    """world_from_car of the tiny drive."""
    return make_drive(DRIVE, TOWN.block_m, TINY.seed).poses


def contents(root: Path) -> dict[str, bytes]:
    files = sorted(path for path in root.rglob("*") if path.is_file())
    return {str(path.relative_to(root)): path.read_bytes() for path in files}


@pytest.mark.slow
def test_a_seed_decides_all_bytes_with_any_number_of_jobs(recorded: Path, tmp_path: Path) -> None:
    assert contents(record(TINY, tmp_path / "again", jobs=2)) == contents(recorded)
    seeded = TINY.model_copy(update={"seed": 1})
    other = contents(record(seeded, tmp_path / "other", jobs=2))
    same = [name for name, data in contents(recorded).items() if other[name] == data]
    assert sorted(Path(name).name for name in same) == ["calib.txt", "times.txt"]


def test_an_interrupted_recording_goes_on_and_a_complete_one_is_kept(
    recorded: Path, tmp_path: Path
) -> None:
    class Stop(Exception):
        pass

    def stop(done: int, total: int) -> None:
        if done == 2:
            raise Stop

    with pytest.raises(Stop):
        record(TINY, tmp_path, progress=stop)
    assert not (tmp_path / "sim.json").exists()
    first = tmp_path / "sequences" / "00" / "image_3" / "000000.png"
    written = first.stat().st_mtime_ns
    seen: list[tuple[int, int]] = []
    record(TINY, tmp_path, progress=lambda *step: seen.append(step))
    assert first.stat().st_mtime_ns == written
    assert seen[0][0] > 2 and seen[-1][0] == seen[-1][1]
    assert contents(tmp_path) == contents(recorded)

    def refuse(done: int, total: int) -> None:
        raise AssertionError("nothing was left to write")

    assert record(TINY, recorded, progress=refuse) == recorded


def test_the_embedded_drive_is_made_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FUSIONSLAM_CACHE", str(tmp_path))
    monkeypatch.setattr(recorder, "SimConfig", lambda: TINY)
    steps: list[int] = []
    folder = embedded_drive(progress=lambda done, total: steps.append(done))
    assert folder.parent == tmp_path and (folder / "sim.json").exists()
    made = len(steps)
    assert embedded_drive(progress=lambda done, total: steps.append(done)) == folder
    assert len(steps) == made > 0


def test_folders_with_something_else_are_left_alone(recorded: Path, tmp_path: Path) -> None:
    (tmp_path / "sequences").mkdir()
    with pytest.raises(DataError, check=has_code("other-data")):
        record(TINY, tmp_path)
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(DataError, match="file"):
        record(TINY, tmp_path / "file" / "out")
    with pytest.raises(DataError, check=has_code("other-recording")):
        record(TINY.model_copy(update={"seed": 99}), recorded)


@rows(
    "laps, message",
    [
        ((((0, 0), (1, 1)),), r"\(0, 0\) and \(1, 1\)"),
        ((((0, 0), (1, 0), (0, 0)),), "turn back"),
        ((((0, 0), (1, 0)), ((0, 0), (0, 1))), r"lap 1 .*\(0, 0\).*\(1, 0\)"),
        ((((0, 0),),), "at least two"),
        ((((1, 1), (2, 1)),), r"drive\.laps: .*\(2, 1\).*\(1, 1\)"),
    ],
)
def test_a_route_that_cannot_be_driven_is_refused(laps: object, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        SimConfig(town=TOWN, drive={"laps": laps})


def test_the_folder_has_the_layout_of_kitti_odometry_and_its_configuration(recorded: Path) -> None:
    sequence = recorded / "sequences" / "00"
    times = np.loadtxt(sequence / "times.txt")
    frames = [f"{k:06d}" for k in range(len(times))]
    for name, suffix in (("velodyne", ".bin"), ("image_2", ".png"), ("image_3", ".png")):
        assert sorted(path.name for path in (sequence / name).iterdir()) == [
            frame + suffix for frame in frames
        ]
    assert len(np.loadtxt(recorded / "poses" / "00.txt")) == len(times)
    assert np.allclose(np.diff(times), DRIVE.spacing_m / DRIVE.speed_m_s)
    image = Image.open(sequence / "image_2" / "000000.png")
    assert (image.mode, image.size) == ("RGB", (CAMERA.width, CAMERA.height))
    points = np.fromfile(sequence / "velodyne" / "000000.bin", np.float32).reshape(-1, 4)
    assert points[:, 3].min() >= 0 and points[:, 3].max() <= 1
    assert np.linalg.norm(points[:, :3], axis=1).max() < LIDAR.range_m + 0.5
    summary = json.loads((recorded / "sim.json").read_text())
    assert SimConfig.model_validate(summary["config"]) == TINY
    assert {frame["lap"] for frame in summary["frames"]} == {0, 1}
    assert {frame["visit"] for frame in summary["frames"]} == {"new"}


def test_poses_are_rigid_and_start_at_identity(recorded: Path) -> None:
    poses = np.loadtxt(recorded / "poses" / "00.txt").reshape(-1, 3, 4)
    turns = poses[:, :, :3]
    assert np.allclose(poses[0], np.eye(3, 4), atol=1e-9)
    assert np.allclose(turns @ turns.transpose(0, 2, 1), np.eye(3), atol=1e-9)
    assert np.allclose(np.linalg.det(turns), 1)
    steps = np.linalg.norm(np.diff(poses[:, :, 3], axis=0), axis=1)
    assert 0.85 * DRIVE.spacing_m < steps.min() and steps.max() < 1.02 * DRIVE.spacing_m
    assert poses[1, 2, 3] > 10  # z of the camera points forward


def test_points_project_onto_their_depth(
    recorded: Path, caster: RayCaster, poses: np.ndarray
) -> None:
    text = (recorded / "sequences" / "00" / "calib.txt").read_text()
    lines = (line.split(": ") for line in text.splitlines())
    calib = {name: np.array(values.split(), float).reshape(3, 4) for name, values in lines}
    camera_poses = np.loadtxt(recorded / "poses" / "00.txt").reshape(-1, 3, 4)
    frame = 1
    scan = recorded / "sequences" / "00" / "velodyne" / f"{frame:06d}.bin"
    points = np.fromfile(scan, np.float32).reshape(-1, 4)[:, :3]
    tr = np.vstack([calib["Tr"], [0, 0, 0, 1]])
    pixels = np.column_stack([points, np.ones(len(points))]) @ (calib["P2"] @ tr).T
    u, v, depth = pixels[:, 0] / pixels[:, 2], pixels[:, 1] / pixels[:, 2], pixels[:, 2]
    seen = (depth > 1) & (u > 0) & (u < CAMERA.width - 1) & (v > 0) & (v < CAMERA.height - 1)
    assert seen.sum() > 150
    rays = np.column_stack([u, v, np.ones(len(u))])[seen] @ np.linalg.inv(calib["P2"][:, :3]).T
    world_from_first = poses[0] @ parent_from_camera(CAMERA)
    pose = world_from_first @ np.vstack([camera_poses[frame], [0, 0, 0, 1]])
    hits = caster.cast(pose[:3, 3].astype(np.float32), (rays @ pose[:3, :3].T).astype(np.float32))
    error = np.abs(hits.distance - depth[seen])
    # The LiDAR sees past some edges that hide things from the camera.
    assert np.mean(error < 0.08 + 0.01 * depth[seen]) > 0.9
    assert np.median(error) < 0.04


def test_pictures_match_at_the_disparity_of_the_depth(caster: RayCaster, poses: np.ndarray) -> None:
    camera = StereoConfig()
    left, right = (
        photograph(caster, camera, pose, (1, 1, 1), np.random.default_rng(k)).mean(axis=2)
        for k, pose in enumerate(
            poses[1] @ parent_from_camera(camera, right=side) for side in (False, True)
        )
    )
    pose = poses[1] @ parent_from_camera(camera)
    rays = camera_rays(camera) @ pose[:3, :3].T.astype(np.float32)
    depth = caster.cast(pose[:3, 3].astype(np.float32), rays).distance
    depth = depth.reshape(camera.height, camera.width)
    p3 = projection(camera, right=True)
    assert match(left, right, depth, p3, shift=0.0) > 0.8
    assert match(left, right, depth, p3, shift=4.0) < 0.5


def match(
    left: np.ndarray, right: np.ndarray, depth: np.ndarray, p3: np.ndarray, shift: float
) -> float:
    """Mean correlation of 11 x 11 patches with those at the predicted disparity plus a shift."""
    scores = []
    for row in range(20, left.shape[0] - 20, 12):
        for column in range(100, left.shape[1] - 20, 12):
            patch = np.s_[row - 5 : row + 6, column - 5 : column + 6]
            flat = np.isfinite(depth[patch]).all() and np.ptp(depth[patch]) < 1.0
            if flat and left[patch].std() > 6:
                # u_right - u_left = P3[0, 3] / z
                moved = np.arange(left.shape[1]) + p3[0, 3] / depth[row, column] + shift
                warped = np.stack(
                    [np.interp(moved, np.arange(left.shape[1]), r) for r in right[patch[0]]]
                )
                pair = left[patch].ravel(), warped[:, patch[1]].ravel()
                scores.append(np.corrcoef(*pair)[0, 1])
    assert len(scores) > 40
    return float(np.mean(scores))


def test_shots_are_lost_at_the_configured_rate(caster: RayCaster, poses: np.ndarray) -> None:
    pose, none = poses[1] @ car_from_lidar(TINY.car), {"dropout": 0.0, "far_dropout": 0.0}

    def count(**rates: float) -> int:
        config = LidarConfig(rings=32, azimuths=360, **rates)
        return len(scan(caster, config, pose, np.random.default_rng(3)).points)

    complete, usual = count(**none, grazing_dropout=0.0), count()
    grazing = count(**none, grazing_dropout=1.0)
    assert 0.04 < 1 - usual / complete < 0.09
    assert grazing < 0.98 * complete


def test_a_later_lap_is_photographed_with_its_own_exposure(recorded: Path, tmp_path: Path) -> None:
    gains = ((1.0, 1.0, 1.0), (0.35, 0.36, 0.39))
    camera = CAMERA.model_copy(update={"exposure": gains})
    dark = record(
        TINY.model_copy(update={"car": CarConfig(lidar=LIDAR, camera=camera)}), tmp_path, jobs=2
    )
    laps = [frame["lap"] for frame in json.loads((dark / "sim.json").read_text())["frames"]]
    assert 1 in laps
    for frame, lap in enumerate(laps):
        name = f"sequences/00/image_2/{frame:06d}.png"
        usual, other = (np.asarray(Image.open(root / name), float) for root in (recorded, dark))
        # The usual gains of the second lap are twice these.
        ratio = other.mean(axis=(0, 1)) / usual.mean(axis=(0, 1))
        assert ratio == pytest.approx(1.0 if lap == 0 else 0.5, rel=0.02)


@pytest.mark.slow
def test_towns_differ_by_seed_and_laps_by_parked_cars_alone() -> None:
    built = make_town(TOWN.model_copy(update={"parked_cars": 0.0})).mesh
    first, second = (make_town(TOWN, lap).mesh for lap in (0, 1))
    count = len(built)
    assert len(first) > count and len(second) > count
    assert np.array_equal(first.triangles[:count], built.triangles)
    assert np.array_equal(second.triangles[:count], built.triangles)
    assert not np.array_equal(first.triangles[count:], second.triangles[count:])
    assert len(make_town(TOWN.model_copy(update={"seed": 6})).mesh) != len(first)


def test_the_default_drive_returns_in_both_directions() -> None:
    config = SimConfig()
    drive = make_drive(config.drive, config.town.block_m, config.seed)
    found = visits(drive.poses)
    kinds = Counter(visit.kind for visit in found)
    assert 300 < len(found) < 420
    assert kinds["same"] >= 80
    assert kinds["opposite"] >= 60
    assert kinds["new"] >= 150
    offsets = [
        np.linalg.norm(drive.poses[k, :2, 3] - drive.poses[visit.earlier, :2, 3])
        for k, visit in enumerate(found)
        if visit.kind == "opposite" and visit.earlier is not None
    ]
    assert 3.0 < np.median(offsets) < 4.5
    # The car keeps to the right of the middle line.
    calm = DriveConfig(laps=(((0, 0), (1, 0)),), wander_m=0.0)
    assert np.allclose(make_drive(calm, 60.0, seed=0).poses[:, 1, 3], -calm.lane_m)


def test_the_ray_caster_reports_what_it_misses(caster: RayCaster) -> None:
    up = np.array([[0.0, 0.0, 1.0]], np.float32)
    hits = caster.cast(np.array([0.0, 0.0, 1.0], np.float32), up)
    assert np.isinf(hits.distance[0]) and hits.triangle[0] == -1
    down = caster.cast(np.array([0.0, 0.0, 1.5], np.float32), -2 * up)
    assert down.distance[0] == pytest.approx(0.75, abs=1e-3)


RING_CONFIG = RingConfig(width=75, height=28, focal_px=31.5, centre_px=(37.0, 3.5))
RINGED = SimConfig(
    town=TOWN, drive=DRIVE, car=CarConfig(lidar=LIDAR, cameras="four", ring=RING_CONFIG)
)


@pytest.mark.slow
def test_four_cameras_colour_scans_all_round(tmp_path: Path) -> None:
    folder = record(RINGED, tmp_path / "drive", jobs=2)
    dataset = open_dataset(folder)
    assert (dataset.kind, dataset.sensors) == ("folder", ("points", "left"))
    assert list(dataset[0].images) == list(dataset.cameras) == list(RING)
    assert [dataset.counts[name] for name in RING] == [len(dataset)] * 4
    drive = make_drive(DRIVE, TOWN.block_m, RINGED.seed)
    assert np.allclose(dataset.poses, drive.poses @ car_from_lidar(RINGED.car), atol=1e-9)
    assert np.allclose(dataset[0].robot_from_points, car_from_lidar(RINGED.car))
    for frame in dataset:
        assert len(fuse(frame)) > 0.97 * len(frame.points)
        assert len(fuse(frame, FusionConfig(cameras=("left",)))) < 0.5 * len(frame.points)
    again = record(RINGED, folder, progress=lambda *_: pytest.fail("it was complete"))
    assert again == folder
    with pytest.raises(DataError, check=has_code("other-recording")):
        record(TINY, folder)


def test_the_identity_of_recordings_of_the_pair_is_what_it_was_before_the_ring() -> None:
    identity = recorder._identity(SimConfig())
    assert identity["config"]["car"].keys() == {"lidar", "camera"}
    assert "cameras" in recorder._identity(RINGED)["config"]["car"]
