# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Plain folders of clouds and images: which files belong together, and when they were taken."""

from pathlib import Path

import numpy as np
import pytest

from error_codes import has_code
from fusionslam.datasets import open_dataset, read_calib_yaml, write_poses_tum
from fusionslam.errors import DataError
from fusionslam.fusion import fuse
from fusionslam.sensors.frame import Frame
from kitti import COLORS, P2, POINTS, POSE_LINE, folder, pose_lines, put_image, put_scan, put_text
from project import PROJECT
from rows import rows


@rows("suffix", [".ply", ".pcd"])
def test_a_folder_of_coloured_clouds_gives_colours(tmp_path: Path, suffix: str) -> None:
    dataset = open_dataset(folder(tmp_path, suffix=suffix))
    assert dataset.kind == "folder" and len(dataset) == 3 and dataset.pose_frame == "points"
    assert np.array_equal(dataset[1].points, POINTS)
    assert np.array_equal(dataset[1].colors, COLORS)
    assert dataset.cameras == {} and dataset[1].images["left"].shape == (3, 4, 3)


def test_a_slice_is_a_dataset_of_these_frames(tmp_path: Path) -> None:
    put_text(folder(tmp_path, ("1", "3", "4", "6")) / "poses.txt", POSE_LINE.format(2) * 7)
    dataset = open_dataset(tmp_path, gaps="skip")
    some = dataset[1:-1]
    assert some.numbers.tolist() == [3, 4] and len(some) == 2
    assert some.stamps_ns.tolist() == dataset.stamps_ns[1:3].tolist()
    assert some.poses is not None and some.poses.shape == (2, 4, 4)
    assert [frame.index for frame in some] == [0, 1]
    assert np.array_equal(some[-1].points, dataset[2].points)
    assert dataset[-1].stamp_ns == dataset[3].stamp_ns and len(dataset[:0]) == 0
    with pytest.raises(DataError, check=has_code("frame-order", dataset.name)):
        dataset[::-1]
    for index in (4, -5):
        with pytest.raises(IndexError, match=f"{index}: expected 0 to 3"):
            dataset[index]
        with pytest.raises(IndexError, match=f"{index}: expected 0 to 3"):
            dataset.only([index])


def test_datasets_and_frames_say_in_a_line_what_they_are(tmp_path: Path) -> None:
    dataset = open_dataset(folder(tmp_path))
    assert repr(dataset) == f"<FileDataset folder {tmp_path}: 3 frames of points, left>"
    frame = dataset[1]
    assert repr(frame) == "<Frame 1 at 0.100000000 s: points, left image>"
    assert len(frame.points) == len(POINTS)
    assert f"{len(POINTS)} points" in repr(frame)
    assert repr(Frame()) == "<Frame 0 at 0.000000000 s: empty>"


def test_clouds_may_lie_in_the_folder_and_errors_name_their_number(tmp_path: Path) -> None:
    for name in ("scan_9.bin", "scan_10.bin", "scan_11.bin"):
        put_scan(tmp_path / name)
    dataset = open_dataset(tmp_path)
    assert dataset.numbers.tolist() == [9, 10, 11] and dataset[0].colors is None
    frame = dataset[2]
    assert (frame.index, frame.number) == (2, 11)
    with pytest.raises(DataError, match="frame 11 ", check=has_code("missing-sensor", "left")):
        fuse(frame)


def test_clouds_and_images_belong_together_by_the_number_in_their_names(tmp_path: Path) -> None:
    for number in range(3):
        put_scan(tmp_path / f"clouds/cloud_{number:03d}.bin")
        put_image(tmp_path / f"left/left_{number}.png")
        put_image(tmp_path / f"right/right_{number}.jpg")
    assert open_dataset(tmp_path).sensors == ("points", "left", "right")
    (tmp_path / "clouds/cloud_001.bin").unlink()
    with pytest.raises(DataError, check=has_code("gaps", tmp_path / "clouds/cloud_001.bin")):
        open_dataset(tmp_path)


def test_names_that_are_nanoseconds_are_times(tmp_path: Path) -> None:
    stems = ("1317354879229752001", "1317354879329752002")
    dataset = open_dataset(folder(tmp_path, stems))
    assert dataset.stamps_ns.tolist() == [int(stem) for stem in stems]
    assert dataset.numbers.tolist() == [0, 1]
    missing = tmp_path / f"images/{stems[1]}.png"
    missing.unlink()
    with pytest.raises(DataError, check=has_code("gaps", missing)):
        open_dataset(tmp_path)
    put_image(missing)
    put_image(tmp_path / "images/1317354879300000000.png")  # no gap between the scans
    assert open_dataset(tmp_path, sensors=("points",)).numbers.tolist() == [0, 1]
    missing = tmp_path / "clouds/1317354879300000000.ply"
    with pytest.raises(DataError, check=has_code("gaps", missing)):
        open_dataset(tmp_path)
    with pytest.raises(DataError, check=has_code("missing-sensor", "right")):
        open_dataset(tmp_path, sensors=("right",))


def test_names_without_numbers_are_taken_in_their_order(tmp_path: Path) -> None:
    dataset = open_dataset(folder(tmp_path, ("kitchen", "attic")))
    assert dataset.streams["points"].files[0].stem == "attic"


def test_two_files_of_one_frame_are_refused(tmp_path: Path) -> None:
    files = (tmp_path / "clouds/001.bin", folder(tmp_path) / "clouds/001.ply")
    put_scan(files[0])
    with pytest.raises(DataError, check=has_code("two-files", *files)):
        open_dataset(tmp_path)


def test_two_cameras_in_one_folder_are_refused_with_where_they_belong(tmp_path: Path) -> None:
    stamps = (1403715273262142976, 1403715280562142976)
    files = [tmp_path / f"images/{stamp}_{camera}.png" for stamp in stamps for camera in (0, 1)]
    for path in files:
        put_image(path)
    with pytest.raises(DataError, check=has_code("two-files", files[0], files[2])) as error:
        open_dataset(tmp_path)
    assert "right/" in str(error.value)


def test_the_tree_of_an_asl_recording_is_no_recording(tmp_path: Path) -> None:
    for camera in ("cam0", "cam1"):
        put_image(tmp_path / f"mav0/{camera}/data/1403715273262142976.png")
        put_text(tmp_path / f"mav0/{camera}/data.csv", "1403715273262142976,a.png\n")
    places, check = "files in clouds/, points/, images/ or left/", has_code("no-recording")
    for path in (tmp_path, tmp_path / "mav0", tmp_path / "mav0/cam0", tmp_path / "mav0/cam0/data"):
        with pytest.raises(DataError, match=places, check=check):
            open_dataset(path)


def test_tum_poses_give_a_folder_its_times_and_kittis_are_matched_by_number(tmp_path: Path) -> None:
    stamps = np.array([1_317_354_879_229_752_001, 1_317_354_879_329_752_002, 1 << 60])
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, 0, 3] = (1, 2, 3)
    write_poses_tum(tmp_path / "poses.txt", stamps, poses)
    dataset = open_dataset(folder(tmp_path))
    assert np.array_equal(dataset.stamps_ns, stamps) and dataset.recorded == 3
    assert np.array_equal(dataset.poses, poses)
    put_text(tmp_path / "kitti/poses.txt", pose_lines(5))
    numbered = open_dataset(folder(tmp_path / "kitti", ("2", "3", "4")))
    assert numbered.poses[:, 0, 3].tolist() == [2, 3, 4]


def test_tum_poses_are_matched_to_times_and_must_be_near(tmp_path: Path) -> None:
    put_text(tmp_path / "times.txt", "10.0\n10.1\n10.2\n")
    line = "{} {} 0 0 0 0 0 1\n"
    put_text(tmp_path / "poses.txt", "# t x\n" + "".join(map(line.format, (10.2, 10.1, 10), "210")))
    dataset = open_dataset(folder(tmp_path))
    assert dataset.poses[:, 0, 3].tolist() == [0, 1, 2]
    put_text(tmp_path / "poses.txt", "".join(map(line.format, (10, 10.9, 10.2), "012")))
    put_text(tmp_path / "times.txt", "10.0\n10.1\n10.4\n")
    with pytest.raises(DataError, check=has_code("no-pose", tmp_path / "poses.txt", 2)):
        open_dataset(tmp_path)


def test_calib_yaml_describes_the_cameras_of_a_folder(tmp_path: Path) -> None:
    put_text(
        tmp_path / "calib.yaml",
        f"left:\n  projection: [{P2.replace(' ', ', ')}]\n  size: [4, 3]\n"
        "  rectified_from_points: [[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]]\n",
    )
    camera = open_dataset(folder(tmp_path)).cameras["left"]
    assert camera.projection[0, 3] == 45 and camera.size == (4, 3)
    assert camera.rectified_from_points[2, 0] == 1


def test_calib_yaml_may_say_only_where_the_scanner_is_on_the_robot(tmp_path: Path) -> None:
    put_text(tmp_path / "calib.yaml", "robot_from_points: [1,0,0,0, 0,1,0,0, 0,0,1,0.5, 0,0,0,1]")
    dataset = open_dataset(folder(tmp_path))
    assert dataset[0].robot_from_points[2, 3] == 0.5 and not dataset.cameras


@rows(
    "text, message",
    [
        ("robot_from_points: [2,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]", "robot_from_points"),
        ("robot_from_points: [.nan,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]", "robot_from_points"),
        ("robot_from_points: [1, 2]", "robot_from_points"),
        ("left: {projection: [1, 2]}", "left.projection"),
        ("left: {projektion: [1, 2]}", "left .*projektion"),
        ("left: {size: [4, 3]}", "left .*projection"),
        ("front: {}", "front .*projection"),
        ("a/b: {projection: [7, 0, 2, 0, 0, 7, 1, 0, 0, 0, 1, 0]}", "a/b"),
        ("left: [", "YAML"),
        ("just text", "left, right"),
        ("right: {projection: [7, 0, 2, 0, 0, 7, 1, 0, 0, 0, 1, 0]}", "'left'"),
        ("left: {projection: [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]}", "projection"),
    ],
)
def test_a_wrong_calib_yaml_is_named_with_its_key(tmp_path: Path, text: str, message: str) -> None:
    put_text(tmp_path / "calib.yaml", text)
    with pytest.raises(DataError, match=message) as error:
        open_dataset(folder(tmp_path))
    assert "calib.yaml" in str(error.value)


def test_the_calib_yaml_of_the_documentation_is_valid(tmp_path: Path) -> None:
    page = (PROJECT / "docs/reference/datasets.md").read_text()
    put_text(tmp_path / "calib.yaml", page.split("```yaml\n")[1].split("```")[0])
    cameras = read_calib_yaml(tmp_path / "calib.yaml")
    assert cameras["left"].size == (1241, 376) and cameras["right"].size is None


def test_files_of_types_that_are_not_read_are_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    put_text(tmp_path / "clouds/000.npy", "")
    with pytest.raises(DataError, match=r"\.npy.*\.bin, \.pcd, \.ply"):
        open_dataset(tmp_path)
    put_image(tmp_path / "left/000.png")
    assert open_dataset(tmp_path).sensors == ("left",)
    assert f"{tmp_path / 'clouds'} holds files of .npy" in caplog.text


@rows("gaps", ["error", "skip"])
def test_sensors_without_a_common_name_are_told_the_rule(tmp_path: Path, gaps: str) -> None:
    folder(tmp_path, [f"17000000000000000{n}0" for n in range(3)])
    put_image(tmp_path / "left/1700000000000000005.png")
    with pytest.raises(DataError, match=r"same number.*00\.ply and left/1700000000000000005\.png"):
        open_dataset(tmp_path, gaps=gaps)
