# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of the steps of fusion, and fused clouds in bags."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial.transform import Rotation

import fusionslam
from cli import fails, succeeds
from fusionslam import Camera, Frame, FusionConfig
from fusionslam.datasets import open_dataset
from fusionslam.datasets.bags import open_bag
from fusionslam.datasets.base import PosesOrigin
from fusionslam.errors import DataError
from fusionslam.pipelines.export_bag import _Maker, write_cloud_bag
from fusionslam.pipelines.recording import Recording, body_from_clouds
from fusionslam.report.fusion_stages import _Eye, draw_stages, write_stages
from fusionslam.sensors.messages import FrameTransforms, Odometry, Scan
from kitti import write_sequence
from rows import rows


@pytest.fixture(scope="module")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Path:
    base = tmp_path_factory.mktemp("data")
    return write_sequence(base, [0, 2, 5, 9], [300] * 4, metres=1.5, width=64)


def test_each_step_of_a_frame_has_its_picture(sequence: Path) -> None:
    frame = open_dataset(sequence)[1]
    config = FusionConfig(ground="height", ground_height=0.0)
    titles = [axis.get_title(loc="left") for axis in draw_stages(frame, config).axes]
    fused = fusionslam.fuse(frame, config)
    whole = fusionslam.fuse(frame, FusionConfig())
    assert 0 < len(fused) < len(whole)
    assert titles == [
        "camera image, 64 x 48",
        "scan, 300 points, colour is height",
        f"coloured cloud, {len(whole)} points",
        f"without ground (height), {len(fused)} points",
    ]
    last = draw_stages(frame, FusionConfig()).axes[3]
    assert "ground left in" in last.get_title(loc="left") and not last.collections


def test_clouds_alone_and_empty_clouds_are_drawn_too() -> None:
    config = FusionConfig(source="cloud", ground="plane")
    for size in (0, 1, 50):
        points = np.random.default_rng(size).normal(size=(size, 3)).astype(np.float32)
        if size == 1:
            config = FusionConfig(source="cloud")
        axes = draw_stages(Frame(points=points), config).axes
        assert axes[0].get_title(loc="left") == "no camera image" and len(axes) == 4


@rows("up, driving", [("z", "x"), ("-y", "z"), ("x", "y")])
def test_the_eye_sees_what_is_ahead_left_and_high_where_it_should(up: Any, driving: Any) -> None:
    above = np.eye(3)["xyz".index(up[-1])] * (-1 if up[0] == "-" else 1)
    ahead = np.eye(3)["xyz".index(driving)]
    left = np.cross(above, ahead)
    points = np.stack([10 * ahead, 10 * ahead + left, 10 * ahead + above, -30 * ahead, 20 * ahead])
    config = FusionConfig(up=up, segments={"driving": driving})
    at, which = _Eye(points.astype(np.float32), config).look(points.astype(np.float32))
    assert sorted(which) == [0, 1, 2, 4]  # what lies behind is not seen
    assert which[0] == 4  # what is far is drawn first
    seen = dict(zip(which.tolist(), at, strict=True))
    assert abs(seen[0][0]) < 1e-6 and seen[1][0] < -0.02 and seen[2][1] > seen[0][1] + 0.02


def test_a_cloud_fills_its_picture() -> None:
    """What a camera sees of a room: a few metres ahead, to both sides and low."""
    rng = np.random.default_rng(3)
    points = rng.uniform([3, -1, -0.2], [6, 1, 0.6], (500, 3)).astype(np.float32)
    at, which = _Eye(points, FusionConfig()).look(points)
    assert len(which) > 480
    widths = np.ptp(at, axis=0) / [2, 2 * 3 / 4]
    assert widths.max() > 0.8 and np.abs(at[:, 1].min() + at[:, 1].max()) < 0.15


@pytest.mark.slow
def test_pictures_are_spread_over_the_recording(sequence: Path, tmp_path: Path) -> None:
    dataset, steps = open_dataset(sequence), []
    paths = write_stages(
        dataset, tmp_path / "p", FusionConfig(), 2, lambda *step: steps.append(step)
    )
    assert [path.name for path in paths] == ["000000.png", "000003.png"]
    assert steps == [(1, 2), (2, 2)]
    for path in paths:
        shown = np.asarray(Image.open(path).convert("RGB"))
        assert min(shown.shape[:2]) > 600 and len(np.unique(shown @ [65536, 256, 1])) > 100
    assert len(write_stages(dataset, tmp_path / "q", FusionConfig(), 99)) == 4


@rows("name", ["clouds.bag", "clouds.db3", "clouds.mcap"])
def test_clouds_in_a_bag_are_those_of_fuse(sequence: Path, tmp_path: Path, name: str) -> None:
    pytest.importorskip("rosbags")
    config, dataset = FusionConfig(), open_dataset(sequence)
    write_cloud_bag(Recording.at(sequence), tmp_path / name, config, jobs=2)
    with open_bag(tmp_path / name) as bag:
        events = list(bag.events())
    clouds = [e.message for e in events if isinstance(e.message, Scan)]
    assert len(clouds) == 4
    for frame, cloud in zip(dataset, clouds, strict=True):
        expected = fusionslam.fuse(frame, config)
        assert cloud.stamp_ns == frame.stamp_ns and cloud.frame_id == "lidar"
        assert np.array_equal(cloud.points, expected.points)
        assert np.array_equal(cloud.colors, expected.colors)
    assert {event.topic for event in events} == {"/rgb_cloud", "/ground_truth", "/tf", "/tf_static"}


def test_a_bag_of_clouds_knows_where_its_frames_were(sequence: Path, tmp_path: Path) -> None:
    """Its points lie in the world where those of the recording do."""
    pytest.importorskip("rosbags")
    for name in ("scan", "camera"):
        path = tmp_path / f"{name}.bag"
        write_cloud_bag(Recording.at(sequence), path, FusionConfig(frame=name))
        made, given = open_dataset(path), open_dataset(sequence)
        assert made.poses is not None and given.poses is not None
        assert made.body_from_points is not None and given.body_from_points is not None
        frame = made[3]
        assert frame.points is not None
        place = made.poses[3] @ made.body_from_points
        cloud = fusionslam.fuse(given[3], FusionConfig())
        truth = given.poses[3] @ given.body_from_points
        for one, other in zip(frame.points, cloud.points, strict=True):
            assert (place @ [*one, 1])[:3] == pytest.approx((truth @ [*other, 1])[:3], abs=1e-4)


@rows("name", ["scan", "camera", "robot", "odometry"])
def test_clouds_of_every_frame_lie_in_the_body_where_the_scan_does(name: Any) -> None:
    """The scanner turns on the robot; the body of the poses is fixed to it."""
    rng = np.random.default_rng(1)

    def rigid() -> NDArray[np.float64]:
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_rotvec(rng.normal(0, 1, 3)).as_matrix()
        pose[:3, 3] = rng.normal(0, 2, 3)
        return pose

    body_from_robot, points = rigid(), rng.normal(0, 5, (30, 3)).astype(np.float32)
    frames = [
        Frame(
            index=index,
            points=points,
            odometry=rigid(),
            robot_from_points=rigid(),
            cameras={"left": Camera(np.eye(3, 4), rigid())},
        )
        for index in range(3)
    ]

    class Turning(list[Frame]):
        """A recording of these frames."""

    config = FusionConfig(source="cloud", frame=name)
    dataset: Any = Turning(frames)
    dataset.body_from_robot = body_from_robot
    dataset.body_from_points = body_from_robot @ frames[0].robot_from_points
    places = body_from_clouds(dataset, config)
    assert places is not None and places.shape == (3, 4, 4)
    for frame, place in zip(frames, places, strict=True):
        assert frame.robot_from_points is not None
        cloud = np.c_[fusionslam.fuse(frame, config).points, np.ones(30)]
        true = body_from_robot @ frame.robot_from_points
        np.testing.assert_allclose(cloud @ place.T, np.c_[points, np.ones(30)] @ true.T, atol=1e-4)
    dataset.body_from_points = None
    assert body_from_clouds(dataset, config) is None


def test_odometry_and_the_robots_frame_are_written_where_they_are_known() -> None:
    turned = np.array([[0.0, -1, 0, 4], [1, 0, 0, 2], [0, 0, 1, 0], [0, 0, 0, 1]])
    lifted = np.eye(4)
    lifted[2, 3] = 0.17
    frame = Frame(
        points=np.ones((5, 3), np.float32),
        odometry=turned,
        robot_from_points=lifted,
        cameras={"left": Camera(np.eye(3, 4), turned)},
        pose=turned @ lifted,
    )

    class One:
        stamps_ns = np.array([5])
        numbers = np.array([0])
        body_from_points = None
        poses_origin = PosesOrigin.TRUTH

        def __getitem__(self, index: int) -> Frame:
            return frame

    config = FusionConfig(source="cloud", frame="odometry")
    maker: Any = _Maker(One(), config)
    found = {event.topic: event.message for event in maker.events(0)}
    tree = found["/tf"]
    assert isinstance(tree, FrameTransforms)
    links = {(link.parent, link.child): link.parent_from_child for link in tree.transforms}
    assert list(links) == [
        ("world", "odom"),
        ("odom", "base_footprint"),
        ("base_footprint", "lidar"),
        ("lidar", "camera"),
    ]
    assert links["world", "odom"] == pytest.approx(np.eye(4))
    assert links["base_footprint", "lidar"] == pytest.approx(lifted)
    assert links["lidar", "camera"] == pytest.approx(np.linalg.inv(turned))
    odometry, truth = found["/odom"], found["/ground_truth"]
    assert isinstance(odometry, Odometry) and isinstance(truth, Odometry)
    assert odometry.pose == pytest.approx(turned) and truth.pose == pytest.approx(turned)


def test_a_frame_that_cannot_be_fused_is_named_and_the_others_are_kept(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    data = write_sequence(tmp_path, [0, 2, 5], [300] * 3, metres=1.5, width=64)
    (data / "velodyne" / "000002.bin").write_bytes(b"1234567")
    with pytest.raises(DataError, match=r" 2: .*000002\.bin"):
        write_cloud_bag(Recording.at(data), tmp_path / "out.bag", FusionConfig())
    assert not (tmp_path / "out.bag").exists()
    with open_bag(tmp_path / "out.partial.bag") as bag:
        assert sum(isinstance(event.message, Scan) for event in bag.events()) >= 1


def test_fuse_writes_bags_and_pictures(sequence: Path, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    bag = tmp_path / "out.mcap"
    assert str(bag) in succeeds("fuse", sequence, "-o", bag, "--pictures", "1").stdout
    assert [path.name for path in (tmp_path / "out.pictures").iterdir()] == ["000000.png"]
    assert len(open_dataset(bag)) == 4
    folder = tmp_path / "out"
    succeeds("fuse", sequence, "-o", folder, "--pictures", "2")
    assert len(list((folder / "pictures").iterdir())) == 2
    assert len(open_dataset(folder)) == 4
    said = fails(1, "fuse", sequence, "-o", folder, "--set", "fusion.frame=robot")
    assert "another" in said or "fusion.frame=robot needs" in said
