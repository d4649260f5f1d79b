# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Scene sets recorded while a robot drives, against those recorded of its data."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli import succeeds
from fusionslam import open_dataset
from fusionslam.datasets import write_poses_tum
from fusionslam.datasets.range_recording import RangeRecording
from fusionslam.errors import ClockError, ConfigError, DataError, FusionSlamError, ShapeError
from fusionslam.fusion import ROBOT_FUSION, fuse
from fusionslam.pipelines.scenes import record_scenes
from fusionslam.sensors.frame import Cloud
from fusionslam.sensors.messages import Odometry
from fusionslam.sensors.pose_buffer import PoseBuffer
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.scene_recorder import SceneRecorder
from fusionslam.views.scene_set import SceneSet
from fusionslam.views.scenes import Scene, SceneConfig, build_scene
from refusals import refuses
from rows import rows
from scenes import LAPS, NOTHING, differing, drive, place, write_recording

S = 1_000_000_000


def record(scenes: SceneSet, **options: Any) -> SceneRecorder:
    """What a recorder makes of the clouds of a set when they come one by one."""
    assert scenes.clouds is not None
    recorder = SceneRecorder(scenes.name, frame=scenes.frame, **options)
    config = options.get("scene_config")
    for index in range(len(scenes)):
        cloud = scenes.clouds[index]
        item = cloud if config is None else build_scene(cloud.points, cloud.colors, config=config)
        pose = None if scenes.poses is None else scenes.poses[index]
        recorder.add(int(scenes.stamps_ns[index]), item, pose)
    return recorder


@rows("only_scenes", [False, True])
def test_a_recorder_gives_what_the_command_writes(tmp_path: Path, only_scenes: bool) -> None:
    source = tmp_path / "boxes.npz"
    write_recording(source, (*LAPS, 8, -1, 8))
    flags = ["--only-scenes"] if only_scenes else []
    succeeds("views", "record", source, "-o", tmp_path / "set.npz", *flags)
    whole = record_scenes(RangeRecording.open(source))
    record(whole, scene_config=SceneConfig() if only_scenes else None).save(tmp_path / "live.npz")
    live, written = (SceneSet.load(tmp_path / f"{name}.npz") for name in ("live", "set"))
    assert differing(live, written) == ["source"] and live.empty.any()
    assert live.fits(SceneConfig()) is only_scenes


def test_a_bag_gives_its_set_frame_by_frame(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    from bags import drive as bag_drive
    from bags import write_bag
    from fusionslam.datasets.bags.reader import open_bag

    path = write_bag(tmp_path / "drive.bag", bag_drive(4.0))
    dataset = open_dataset(path)
    poses, recorder = PoseBuffer(), SceneRecorder(dataset.name)
    with open_bag(path) as bag:
        for event in bag.events(["/odom"]):
            assert isinstance(event.message, Odometry)
            poses.add(event.message)
    for frame in dataset:
        recorder.add(frame.stamp_ns, fuse(frame, ROBOT_FUSION), poses.at(frame.stamp_ns))
    # As a file of true poses: odometry is none.
    write_poses_tum(tmp_path / "poses.txt", dataset.stamps_ns, dataset.poses)
    judged = open_dataset(path, poses=tmp_path / "poses.txt")
    live, whole = recorder.scene_set(), record_scenes(judged)
    assert record_scenes(dataset).poses is None
    assert len(live) > 5 and np.ptp(live.true_poses()[:, 0]) > 0.5
    np.testing.assert_allclose(live.true_poses(), whole.true_poses(), atol=1e-9)
    assert differing(replace(live, poses=whole.poses, source=whole.source), whole) == []


def test_a_recorded_set_can_be_matched_and_tuned_on(tmp_path: Path) -> None:
    path = tmp_path / "live.npz"
    record(drive((*LAPS, -1))).save(path)
    succeeds("views", "match", path, "-o", tmp_path / "out", "--no-report")
    stats = json.loads((tmp_path / "out" / "matches.json").read_text())["stats"]
    counts = {name: stats[name] for name in ("processed", "matched", "new", "nothing")}
    assert counts == {"processed": 15, "matched": 8, "new": 6, "nothing": 1}
    succeeds("views", "curve", path, "-o", tmp_path / "curve", "--set", "views.method=objects")
    quick = ("--set", "tuning.population=4", "--set", "tuning.generations=2", "--jobs", "1")
    succeeds("tune", path, "-o", tmp_path / "tuned", *quick)


def test_scans_without_a_pose_are_left_out_and_counted() -> None:
    recorder = SceneRecorder("boxes")
    poses = [(0, 0, 0), None, (1, 2, 3), None]
    for number, pose in enumerate(poses):
        recorder.add(number * S, place(number), pose)
    scenes = recorder.scene_set()
    assert (len(recorder), recorder.without_pose, recorder.dropped) == (2, 2, 0)
    assert scenes.numbers.tolist() == [0, 2] and scenes.stamps_ns.tolist() == [0, 2 * S]
    assert scenes.true_poses().tolist() == [[0, 0, 0], [1, 2, 3]]
    assert scenes.clouds is not None and len(scenes.clouds[1]) == len(place(2))


def test_no_more_scans_are_kept_than_allowed_and_the_others_are_counted() -> None:
    recorder = record(drive(LAPS), max_scans=5)
    assert (len(recorder), recorder.dropped) == (5, len(LAPS) - 5)
    assert recorder.scene_set().numbers.tolist() == [0, 1, 2, 3, 4]


def test_a_recorder_without_scans_writes_a_set_without_scans(tmp_path: Path) -> None:
    for scenes in (None, SceneConfig()):
        SceneRecorder("none", scene_config=scenes).save(tmp_path / "set.npz")
        assert len(SceneSet.load(tmp_path / "set.npz")) == 0


def test_clouds_are_copied_so_that_buffers_can_be_used_again() -> None:
    recorder, cloud = SceneRecorder("boxes"), place(0)
    recorder.add(0, cloud, (0, 0, 0))
    cloud.points[:] = 0
    kept = recorder.scene_set().clouds
    assert kept is not None and np.array_equal(kept[0].points, place(0).points)


def test_scenes_of_views_are_what_a_matcher_compares() -> None:
    config = SceneConfig()
    recorder, builder = SceneRecorder("boxes", scene_config=config), ViewMatcher().comparison
    for number in range(3):
        scene = builder.scene(builder.view(place(number)))
        assert isinstance(scene, Scene)
        recorder.add(number, scene, (0, 0, 0))
    cloud = place(2)
    expected = build_scene(cloud.points, cloud.colors, config=config)
    assert recorder.scene_set().scenes[2] == Scene.from_bytes(expected.to_bytes())


def test_a_clock_that_goes_back_is_refused_and_changes_nothing() -> None:
    recorder = SceneRecorder("boxes")
    recorder.add(9 * S, place(0), (0, 0, 0))
    with pytest.raises(ClockError, match="8 s"):
        recorder.add(S, place(1), (0, 0, 0))
    recorder.add(9 * S, place(1), (0, 0, 0))
    assert recorder.scene_set().numbers.tolist() == [0, 1]


def break_cloud(row: int) -> Cloud:
    cloud = place(0)
    cloud.points[row, 1] = np.inf
    return cloud


@rows(
    "item, pose, error, code",
    [
        (Cloud(place(0).points), (0, 0, 0), DataError, "no-colors"),
        (break_cloud(3), (0, 0, 0), DataError, "not-finite"),
        (Cloud(np.zeros((2, 3)), np.zeros((2, 3), "u1")), (0, 0, 0), ShapeError, "shape"),
        (Cloud(place(0).points, place(1).colors[:4]), (0, 0, 0), ShapeError, "shape"),
        (build_scene(NOTHING.points, NOTHING.colors), (0, 0, 0), ShapeError, "shape"),
        (place(0), (0, np.nan, 0), DataError, "data"),
        (place(0), (0, 0), ShapeError, "shape"),
    ],
)
def test_wrong_scans_are_refused_and_change_nothing(
    item: Any, pose: Any, error: type[FusionSlamError], code: str
) -> None:
    recorder = SceneRecorder("boxes")
    with refuses(code, error=error):
        recorder.add(5, item, pose)
    assert len(recorder) == recorder.without_pose == 0
    recorder.add(0, place(0), (0, 0, 0))
    assert recorder.scene_set().numbers.tolist() == [0]


def test_clouds_where_scenes_are_kept_and_a_negative_bound_are_refused() -> None:
    with pytest.raises(ShapeError):
        SceneRecorder("boxes", scene_config=SceneConfig()).add(0, place(0), (0, 0, 0))
    with pytest.raises(ConfigError, match="max_scans"):
        SceneRecorder("boxes", max_scans=-1)
