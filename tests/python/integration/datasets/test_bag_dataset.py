# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Bags as datasets: which messages make a frame, where everything was, and what is refused."""

import dataclasses
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import yaml

from bags import (
    BLUE,
    OPTICAL,
    RED,
    SECOND,
    SPEED,
    START,
    SUFFIXES,
    camera_info,
    changed,
    copies,
    delayed,
    drive,
    extrinsics,
    odometry,
    picture,
    put_bag,
    scan,
    static,
    translation,
    without,
    write_bag,
)
from cli import error_of, fails, info_of, succeeds
from error_codes import has_code
from fusionslam import fuse
from fusionslam.datasets import open_dataset, write_poses_tum
from fusionslam.datasets.bags.dataset import BagDataset
from fusionslam.datasets.base import OdometryOrigin, PosesOrigin
from fusionslam.errors import ConfigError, DataError
from fusionslam.pipelines.overview import look_at
from fusionslam.pipelines.recording import Recording
from fusionslam.sensors.frame import Camera, Frame
from fusionslam.sensors.messages import Event, FrameTransforms
from fusionslam.sensors.synchronizer import SyncConfig
from rows import rows

Logs = pytest.LogCaptureFixture

KINDS = {"bag": "rosbag1", "db3": "rosbag2", "mcap": "mcap"}
BASE_FROM_SCANNER = translation(-0.1, 0, 0.3)
NO_CAMERA = {"camera_matrix": np.zeros((3, 3)), "projection": np.zeros((3, 4))}


@rows("suffix", SUFFIXES)
def test_each_scan_becomes_a_frame_with_image_camera_and_pose(tmp_path: Path, suffix: str) -> None:
    dataset = open_dataset(write_bag(tmp_path / f"drive.{suffix}", drive()))
    assert dataset.kind == KINDS[suffix] and len(dataset) == 5
    assert dataset.sensors == ("points", "left") and dataset.counts == {"points": 5, "left": 21}
    assert ((dataset.stamps_ns - START) / SECOND).tolist() == [0, 0.5, 1, 1.5, 2]
    assert dataset.numbers.tolist() == [0, 1, 2, 3, 4] and dataset.gaps == []
    assert dataset.pose_frame == "base" and dataset.poses_origin is PosesOrigin.ODOMETRY
    assert dataset.odometry_topic == "/odom" and dataset.odometry_origin is OdometryOrigin.TOPIC
    np.testing.assert_allclose(dataset.body_from_points, BASE_FROM_SCANNER)
    frame = dataset[3]
    pose = translation(1.5 * SPEED)
    np.testing.assert_allclose(frame.pose, pose)
    np.testing.assert_allclose(frame.odometry, pose)
    np.testing.assert_allclose(frame.robot_from_points, BASE_FROM_SCANNER)
    np.testing.assert_array_equal(frame.points, scan(x=4 - 1.5 * SPEED).points)
    assert frame.intensities is not None and frame.intensities.dtype == np.float32
    assert frame.intensities.tolist() == list(range(41))
    np.testing.assert_array_equal(frame.images["left"], picture().image)
    expected = np.linalg.inv(OPTICAL) @ BASE_FROM_SCANNER
    np.testing.assert_allclose(frame.cameras["left"].rectified_from_points, expected)


def test_the_halves_of_the_wall_get_the_colours_of_the_halves_of_the_image(tmp_path: Path) -> None:
    cloud = fuse(open_dataset(put_bag(tmp_path, drive()))[0])
    left, right = cloud.points[:, 1] > 0.05, cloud.points[:, 1] < -0.05
    assert cloud.colors is not None and left.sum() > 10 and right.sum() > 10
    assert (cloud.colors[left] == RED).all() and (cloud.colors[right] == BLUE).all()


def test_a_camera_that_was_elsewhere_by_then_is_placed_there(tmp_path: Path) -> None:
    """Images 40 ms late: the robot is 2 cm further when it takes them."""
    late = delayed(drive(), "/camera/image", SECOND // 25)
    frame = open_dataset(put_bag(tmp_path, late))[2]
    moved = np.linalg.inv(OPTICAL) @ translation(-0.02) @ BASE_FROM_SCANNER
    np.testing.assert_allclose(
        frame.cameras["left"].rectified_from_points, moved, rtol=0, atol=1e-9
    )


def test_the_policy_decides_which_image_belongs_to_a_scan(tmp_path: Path) -> None:
    events = without(drive(), "/points")
    events += [Event("/points", START + SECOND, scan(START + SECOND - SECOND // 50))]
    path = put_bag(tmp_path, sorted(events, key=lambda e: e.time_ns))
    offsets = {}
    for policy in ("nearest", "last_before"):
        dataset = open_dataset(path, sync=SyncConfig(policy=policy))
        offsets[policy] = int((dataset.sensor_stamps("left") - dataset.stamps_ns)[0])
    assert offsets == {"nearest": SECOND // 50, "last_before": -SECOND * 8 // 100}


def test_scans_without_an_image_near_are_gaps(tmp_path: Path, caplog: Logs) -> None:
    dark = [
        e
        for e in drive()
        if e.topic != "/camera/image" or not 0.7 < (e.time_ns - START) / SECOND < 1.3
    ]
    dataset = open_dataset(put_bag(tmp_path, dark))
    assert dataset.numbers.tolist() == [0, 1, 3, 4] and dataset.gaps == [2]
    assert ("/points", "no image near") in [record.args[2:] for record in caplog.records]


def test_frames_can_be_read_by_several_threads(tmp_path: Path) -> None:
    for suffix in SUFFIXES:
        dataset = open_dataset(write_bag(tmp_path / f"drive.{suffix}", drive(4)))
        with ThreadPoolExecutor(4) as pool:
            clouds = list(pool.map(lambda k: dataset[k % 9].points, range(72)))  # noqa: B023
        for k, points in enumerate(clouds):
            np.testing.assert_array_equal(points, scan(x=4 - SPEED * (k % 9) / 2).points)


def test_topics_are_guessed_and_logged_or_named(tmp_path: Path, caplog: Logs) -> None:
    events = [*drive(), *copies(drive(), "/points", "/a_points")]
    events += copies(drive(), "/camera/image", "/camera/depth/image")
    path = put_bag(tmp_path, [*events, *copies(drive(), "/odom", "/truth")])
    dataset = open_dataset(path)
    used = {"points": "/a_points", "left": "/camera/image", "camera_info": "/camera/camera_info"}
    assert dataset.source.roles == used | {"odometry": "/odom", "truth": "/truth"}
    assert "/a_points, /points" in caplog.text
    assert dataset.pose_frame == "base" and dataset.poses_origin is PosesOrigin.TRUTH
    assert dataset.truth_topic == "/truth"
    named = open_dataset(path, topics={"points": "/points", "truth": ""})
    assert named.source.roles["points"] == "/points" and named.name != dataset.name
    assert named.poses_origin is PosesOrigin.ODOMETRY
    for code, topic in (("no-topic", "/lidar"), ("topic-type", "/odom")):
        with pytest.raises(DataError, check=has_code(code, topic, "points")):
            open_dataset(path, topics={"points": topic})
    with pytest.raises(ConfigError, match="'lidar'"):
        open_dataset(path, topics={"lidar": "/points"})


def test_the_calibration_is_that_whose_name_shares_most_with_the_images(tmp_path: Path) -> None:
    names = {"/camera/image": "/rig/b", "/camera/camera_info": "/rig/b/info"}
    events = [dataclasses.replace(e, topic=names.get(e.topic, e.topic)) for e in drive()]
    events += copies(events, "/rig/b/info", "/rig/a/info")
    roles = open_dataset(put_bag(tmp_path, events)).source.roles
    assert (roles["left"], roles["camera_info"]) == ("/rig/b", "/rig/b/info")


def test_true_poses_may_come_from_a_file(tmp_path: Path) -> None:
    path, truth = put_bag(tmp_path, drive()), tmp_path / "poses.txt"
    poses = np.stack([translation(k, 7) for k in range(5)])
    write_poses_tum(truth, open_dataset(path).stamps_ns, poses)
    np.testing.assert_allclose(open_dataset(path, poses=truth).poses, poses)
    # From 0.4 s after the first frame to 0.1 s before the last.
    write_poses_tum(truth, open_dataset(path).stamps_ns[:4] + SECOND * 4 // 10, poses[:4])
    assert open_dataset(path, poses=truth).numbers.tolist() == [1, 2, 3]


def test_frames_before_the_odometry_are_left_out(tmp_path: Path, caplog: Logs) -> None:
    late = [e for e in drive() if e.topic != "/odom" or e.time_ns >= START + SECOND * 7 // 10]
    dataset = open_dataset(put_bag(tmp_path, late))
    assert dataset.numbers.tolist() == [2, 3, 4] and dataset.gaps == [0, 1]
    assert dataset.poses is not None and len(dataset.poses) == 3
    assert dataset.poses[0, 0, 3] == pytest.approx(SPEED * 1.0)
    assert any(record.args[1:3] == (2, 5) for record in caplog.records)


def test_times_of_arrival_can_stand_for_stamps(tmp_path: Path) -> None:
    events = list(changed(drive(), "/points", stamp_ns=0))
    path = put_bag(tmp_path, events)
    with pytest.raises(DataError, check=has_code("equal-stamps", "/points")):
        open_dataset(path)
    assert len(open_dataset(path, stamps="bag")) == 5
    with pytest.raises(ConfigError, match="'clock'"):
        open_dataset(path, stamps="clock")


def test_a_clock_that_jumps_back_is_refused_and_arrival_offered(tmp_path: Path) -> None:
    jumped = delayed(drive(), "/points", -100 * SECOND, after_ns=START + SECOND)
    path = put_bag(tmp_path, jumped)
    with pytest.raises(DataError, check=has_code("clock", "/points", 3)):
        open_dataset(path)
    assert len(open_dataset(path, stamps="bag")) == 5


@rows(
    "events, sensors, word",
    [
        (without(drive(), "/camera/image"), None, None),
        (without(drive(), "/camera/image"), ("points", "left"), "left"),
        (without(drive(), "/camera/camera_info"), ("points", "left"), "/camera/image"),
        (without(drive(), "/points"), ("points", "left"), "points"),
        (without(drive(), "/tf_static"), None, None),
        (without(drive(), "/tf_static"), ("points", "left"), "'velodyne'|'camera'"),
        ([], None, "PointCloud2"),
        (drive(), ("left", "right"), "right"),
        (changed(drive(), "/camera/camera_info", **NO_CAMERA), None, "/camera/camera_info"),
    ],
)
def test_what_a_bag_lacks_is_named(
    tmp_path: Path, events: Iterable[Event], sensors: tuple[str, ...] | None, word: str
) -> None:
    path = put_bag(tmp_path, events)
    if word is None:
        assert open_dataset(path, sensors=sensors).sensors == ("points",)
        return
    with pytest.raises(DataError, match=word) as error:
        open_dataset(path, sensors=sensors)
    assert str(path) in str(error.value)


def test_frames_that_nothing_links_are_named(tmp_path: Path) -> None:
    only_scanner = FrameTransforms(transforms=extrinsics().transforms[:1])
    path = put_bag(
        tmp_path, [Event("/tf_static", START, only_scanner), *without(drive(), "/tf_static")]
    )
    with pytest.raises(DataError, match=r"'camera'.* base, velodyne"):
        open_dataset(path, sensors=("points", "left"))


def test_an_image_is_rectified_and_refused_if_it_is_not_of_its_calibrations_size(
    tmp_path: Path,
) -> None:
    def with_info(**changes: object) -> Frame:
        return open_dataset(put_bag(tmp_path, changed(drive(), "/camera/camera_info", **changes)))[
            0
        ]

    image = with_info(distortion=np.array([-0.3, 0.1, 0, 0, 0])).images["left"]
    assert not np.array_equal(image, picture().image) and image.shape == picture().image.shape
    with pytest.raises(DataError, check=has_code("image-size", "/camera/image")):
        fuse(with_info(size=(128, 96)))


def test_bad_messages_are_left_out_and_named_once(tmp_path: Path, caplog: Logs) -> None:
    loop = dataclasses.replace(extrinsics().transforms[0], parent="velodyne", child="base")
    tf = FrameTransforms(transforms=(loop,))
    broken = dataclasses.replace(camera_info(), camera_matrix=np.full((3, 3), np.nan))
    events = [Event("/tf_static", START + k, tf) for k in (1, 2, 3)]
    events += [Event("/camera/camera_info", START + k, broken) for k in (4, 5)]
    dataset = open_dataset(put_bag(tmp_path, [*drive(), *events]))
    assert isinstance(dataset, BagDataset) and len(dataset) == 5
    assert [count for count, _ in dataset.source.refused.values()] == [3, 2]
    warnings = [str(record.args) for record in caplog.records]
    assert ["base -> velodyne -> base" in warning for warning in warnings] == [True, False]


def test_info_tells_what_is_in_a_bag_and_that_it_can_be_fused(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "drive.mcap", drive(delay_ns=3_000_000))
    out = info_of(path)
    for words in (
        "mcap",
        "sensor_msgs/PointCloud2, 5 messages, 2.00 Hz, arrives +3.0 ms after its stamp",
        "nav_msgs/Odometry, 101 messages, 50.00 Hz",
        "arrives +3.0 ms after",
        "points /points, left /camera/image, camera_info /camera/camera_info, odometry /odom",
        "camera <- base <- velodyne, from TF",
        "5, numbers 0 to 4",
        "possible: ",
    ):
        assert words in out, words
    assert "not possible" not in out


@rows(
    "topic, word",
    [
        ("/camera/image", "no images"),
        ("/camera/camera_info", "no CameraInfo of the camera"),
        ("/tf_static", "TF does not link 'camera' and 'velodyne'"),
        ("/points", "no PointCloud2"),
    ],
)
def test_info_tells_why_a_bag_cannot_be_fused(tmp_path: Path, topic: str, word: str) -> None:
    out = info_of(put_bag(tmp_path, without(drive(), topic)))
    assert f"not possible: {word}" in out


def test_info_does_not_promise_colours_that_no_point_gets(tmp_path: Path) -> None:
    behind = np.array([[-4, 0, 0]], np.float32)
    out = info_of(put_bag(tmp_path, changed(drive(), "/points", points=behind, fields={})))
    assert "doubtful: no point of the first scan falls into its image" in out


def test_commands_take_topics_stamps_and_policies(tmp_path: Path) -> None:
    events = [*drive(), *copies(drive(), "/points", "/a_points")]
    path, options = put_bag(tmp_path, events), ("--topic", "points=/points", "--stamps", "bag")
    out = tmp_path / "clouds"
    succeeds("fuse", path, *options, "--sync", "policy=last_before", "-o", out)
    assert len(open_dataset(out)) == 5
    assert '"points": "/points"' in (out / "run.json").read_text()
    assert error_of(1, "fuse", path, "-o", out).code == "other-results"
    assert "WHAT=/NAME" in fails(2, "info", path, "--topic", "/points")
    assert "policy" in fails(2, "info", path, "--sync", "policy=best")
    assert error_of(2, "info", out, "--topic", "points=/points").code == "other-kind"


def test_a_pack_of_single_messages_is_enough_for_one_frame(tmp_path: Path) -> None:
    messages = {"/tf_static": extrinsics(), "/odom": odometry(START), "/info": camera_info()}
    messages |= {"/image": picture(), "/points": scan()}
    events = [Event(topic, START, message) for topic, message in messages.items()]
    assert len(fuse(open_dataset(put_bag(tmp_path, events))[0])) > 0


def test_shared_recording_is_fused_by_its_own_transforms(test_data: Path) -> None:
    path = test_data / "bags" / "small_house_20s.bag"
    dataset = open_dataset(path, topics={"points": "/velodyne_points_360"})
    assert len(dataset) == 40 and dataset.counts == {"points": 40, "left": 200}
    kinds = Counter(type(event.message).__name__ for event in dataset.source.bag.events())
    counts = {"Scan": 80, "Picture": 200, "CameraInfo": 200, "Odometry": 600}
    assert kinds == {**counts, "FrameTransforms": 601}
    np.testing.assert_allclose(dataset.body_from_points[:3, 3], (-0.064, 0, 0.17), atol=1e-3)
    assert min(len(fuse(dataset[k])) for k in (0, 20, 39)) > 1000


def calib_yaml(path: Path, camera: Camera, **changes: object) -> Path:
    entry = {
        "projection": camera.projection.tolist(),
        "rectified_from_points": camera.rectified_from_points.tolist(),
        "size": list(camera.size or ()),
    }
    content = {key: value for key, value in (entry | changes).items() if value is not None}
    path.write_text(yaml.safe_dump({"left": content}))
    return path


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp("bags") / "whole.bag", drive())


@pytest.fixture(scope="module")
def camera(whole: Path) -> Camera:
    return open_dataset(whole)[0].cameras["left"]


@rows("missing", ["/tf_static", "/camera/camera_info"])
def test_a_calibration_stands_for_what_a_bag_lacks(
    tmp_path: Path, camera: Camera, whole: Path, missing: str
) -> None:
    bag = write_bag(tmp_path / "poor.bag", without(drive(), missing))
    file = calib_yaml(tmp_path / "calib.yaml", camera)
    with pytest.raises(DataError):
        open_dataset(bag, sensors=("points", "left"))
    dataset = open_dataset(bag, sensors=("points", "left"), calibration=file)
    expected_frames = open_dataset(whole)
    assert len(dataset) == len(expected_frames)
    for frame, expected in zip(dataset, expected_frames, strict=True):
        found = frame.cameras["left"]
        assert np.allclose(found.projection_from_points, camera.projection_from_points)
        assert np.array_equal(frame.images["left"], expected.images["left"])


def test_a_calibration_wins_over_the_bags(tmp_path: Path, camera: Camera, whole: Path) -> None:
    moved = camera.rectified_from_points.copy()
    moved[0, 3] += 0.5
    file = calib_yaml(tmp_path / "other.yaml", camera, rectified_from_points=moved.tolist())
    (found, own) = (
        open_dataset(whole, calibration=each)[0].cameras["left"] for each in (file, None)
    )
    assert np.allclose(found.rectified_from_points, moved)
    assert not np.allclose(own.rectified_from_points, moved)


@rows(
    "changes, message",
    [
        ({"size": None}, "left .*size"),
        ({"size": [640, 480]}, "640x480"),
        ({"projection": [0.0] * 12}, "projection"),
    ],
)
def test_a_calibration_that_does_not_fit_is_named(
    tmp_path: Path, camera: Camera, whole: Path, changes: dict[str, object], message: str
) -> None:
    file = calib_yaml(tmp_path / "calib.yaml", camera, **changes)
    with pytest.raises(DataError, match=message):
        _ = open_dataset(whole, calibration=file)[0].images["left"]


def test_a_calibration_that_is_not_there_or_of_kitti_is_refused(
    kitti: Path, tmp_path: Path, camera: Camera, whole: Path
) -> None:
    with pytest.raises(DataError, check=has_code("missing-file", tmp_path / "gone.yaml")):
        open_dataset(whole, calibration=tmp_path / "gone.yaml")
    with pytest.raises(ConfigError, match="kitti-odometry"):
        open_dataset(kitti, calibration=calib_yaml(tmp_path / "calib.yaml", camera))


def test_commands_take_a_calibration_and_info_says_so(tmp_path: Path, camera: Camera) -> None:
    bag = write_bag(tmp_path / "poor.bag", without(drive(), "/tf_static"))
    file = calib_yaml(tmp_path / "calib.yaml", camera)
    seen = dict(look_at(Recording.at(bag, calibration=file)).rows)
    assert "from the calibration" in seen["extrinsics"]
    assert seen["fusion"].startswith("possible")
    words = ("fuse", bag, "--source", "lidar", "-o")
    line = fails(1, *words, tmp_path / "without")
    assert "velodyne" in line and "--calib" in line and "--source cloud" in line
    succeeds(*words, tmp_path / "with", "--calib", file)
    assert open_dataset(tmp_path / "with")[0].colors is not None


def test_the_file_places_a_scanner_that_tf_does_not_link_to_the_robot(tmp_path: Path) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text("robot_from_points: [1,0,0,0.2, 0,1,0,0, 0,0,1,0.5, 0,0,0,1]\n")
    rest = without(drive(), "/tf_static")
    bag = write_bag(tmp_path / "poor.bag", rest)
    placed = open_dataset(bag, sensors=("points",), calibration=file)[0]
    assert placed.robot_from_points[:3, 3].tolist() == [0.2, 0, 0.5]
    assert open_dataset(bag, sensors=("points",))[0].robot_from_points is None
    # One that it links to something else is named.
    mast = FrameTransforms(transforms=(static("mast", "velodyne", np.eye(4)),))
    bag = write_bag(tmp_path / "mast.bag", [Event("/tf_static", START, mast), *rest])
    with pytest.raises(DataError, check=has_code("two-parents", "velodyne", "mast", "base")):
        open_dataset(bag, sensors=("points",), calibration=file)


@rows("missing", ["/tf_static", "/camera/camera_info"])
def test_scans_serve_where_the_camera_is_not_calibrated_and_the_cure_is_named(
    tmp_path: Path, missing: str, caplog: Logs
) -> None:
    bag = write_bag(tmp_path / "poor.bag", without(drive(), missing))
    assert open_dataset(bag).sensors == ("points",)
    (record,) = caplog.records
    assert "--calib" in record.getMessage()
    assert ("--topic camera_info=" in record.getMessage()) == (missing != "/tf_static")
    line = fails(1, "calib-check", bag, "-o", tmp_path / "out")
    assert "--calib" in line and "--source" not in line
    succeeds("ratslam", bag, "-o", tmp_path / "map", "--source", "cloud", "--no-report")
