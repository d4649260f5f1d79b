# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Scene sets: recorded from data and while a robot drives, kept in files, matched by odometry."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli import fails, succeeds
from fusionslam import open_dataset
from fusionslam.datasets import write_poses_tum
from fusionslam.datasets.range_recording import RangeRecording
from fusionslam.errors import ClockError, ConfigError, DataError, FusionSlamError, ShapeError
from fusionslam.evaluation import ViewRun
from fusionslam.fusion import ROBOT_FUSION, FusionConfig, fuse
from fusionslam.geometry.se2 import places_of
from fusionslam.pipelines.scenes import record_scenes
from fusionslam.pipelines.views import odometry_of, run_views, sweep_thresholds
from fusionslam.report import write_view_report
from fusionslam.sensors.frame import Cloud
from fusionslam.sensors.messages import Odometry
from fusionslam.sensors.pose_buffer import PoseBuffer
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.recognisers import ViewMatcherConfig
from fusionslam.views.scene_recorder import SceneRecorder
from fusionslam.views.scene_set import CloudArray, SceneSet, is_scene_set, pack_bytes, unpack_bytes
from fusionslam.views.scenes import Scene, SceneConfig, build_scene
from refusals import refuses
from rows import rows
from scenes import (
    APART,
    LAPS,
    LOOKS,
    NOTHING,
    THERE_AND_BACK,
    differing,
    drive,
    matcher,
    place,
    write_recording,
)
from stored import change_archive, check_damaged_files


def whole_set() -> SceneSet:
    rows = np.arange(8, dtype=np.float32).reshape(4, 2)
    rows[1] = np.nan
    kept = replace(
        drive((0, -1, 1, 0)), features={"cm2dp": rows}, source={"path": "x", "config": {"a": 1}}
    )
    return kept.with_scenes(SceneConfig())


@rows("kept", [whole_set(), whole_set().without_clouds(), drive((0, 1))])
def test_a_set_is_read_back_as_it_was_written(kept: SceneSet, tmp_path: Path) -> None:
    kept.save(tmp_path / "set.npz")
    assert is_scene_set(tmp_path / "set.npz")
    assert differing(SceneSet.load(tmp_path / "set.npz"), kept) == []


def test_scenes_take_less_room_than_their_clouds(tmp_path: Path) -> None:
    whole_set().save(tmp_path / "clouds.npz")
    whole_set().without_clouds().save(tmp_path / "scenes.npz")
    sizes = [(tmp_path / f"{name}.npz").stat().st_size for name in ("scenes", "clouds")]
    assert sizes[0] < sizes[1]


def test_a_set_without_poses_can_be_matched_but_not_judged(tmp_path: Path) -> None:
    drive(LAPS, poses=False).save(tmp_path / "set.npz")
    scenes = SceneSet.load(tmp_path / "set.npz")
    run = run_views(scenes, ViewMatcher())
    assert run.ids.tolist() == list(LAPS)
    with refuses("no-poses"):
        run.with_truth("objects")
    with refuses("no-poses"):
        sweep_thresholds(scenes, ViewMatcherConfig())


def test_scans_left_empty_are_kept_marked_and_can_be_left_out() -> None:
    scenes = drive((0, -1, 1, -1, 0))
    assert scenes.empty.tolist() == [False, True, False, True, False]
    assert run_views(scenes, ViewMatcher()).ids.tolist() == [0, -1, 1, -1, 0]
    filled = scenes.without_empty()
    assert filled.numbers.tolist() == [0, 2, 4] and not filled.empty.any()
    assert np.array_equal(filled.true_poses(), scenes.true_poses()[[0, 2, 4]])
    assert run_views(filled, ViewMatcher()).ids.tolist() == [0, 1, 0]


def test_scenes_are_those_of_the_clouds_or_the_stored_ones() -> None:
    config, other = SceneConfig(), SceneConfig(preset="author", eps=0.3)
    scenes = drive((0, 1))
    cloud = place(1)
    assert scenes.scenes_with(config)[1] == build_scene(cloud.points, cloud.colors, config=config)
    small = scenes.with_scenes(config).without_clouds()
    assert small.scenes_with(config) == small.scenes and small.fits(config)
    with refuses("no-clouds"):
        small.scenes_with(other)
    assert not small.fits(other) and scenes.with_scenes(config).scenes_with(other)[1]
    with pytest.raises(DataError, match="boxes"):
        run_views(scenes.without_clouds(), ViewMatcher())


def test_digests_tell_other_scans_poses_and_scenes_apart() -> None:
    sets = [drive((0, 1)), drive((0, 2)), drive((0, 1), poses=False), drive((0, 1), gap_s=4)]
    sets += [drive((0, 1)).with_scenes(SceneConfig()).without_clouds()]
    assert len({scenes.digest() for scenes in sets}) == len(sets)
    assert drive((0, 1)).digest() == sets[0].digest()


def test_byte_strings_are_joined_and_parted() -> None:
    texts = [b"ab", b"", b"c"]
    array, offsets = pack_bytes(texts)
    assert unpack_bytes(array, offsets) == texts and unpack_bytes(*pack_bytes([])) == []
    with refuses("wrong-offsets"):
        unpack_bytes(array, offsets[:-1])


@rows(
    "change, error, code",
    [
        ({"numbers": np.arange(3)}, ShapeError, "shape"),
        ({"poses": np.zeros((2, 2))}, ShapeError, "shape"),
        ({"poses": np.array([[0, 0, 0], [0, np.nan, 0]])}, DataError, "not-finite"),
        ({"stamps_ns": np.array([5, 4])}, DataError, "stamps-decrease"),
        ({"features": {"m2dp": np.zeros((3, 4))}}, ShapeError, "shape"),
        ({"clouds": CloudArray.of([NOTHING])}, ShapeError, "shape"),
    ],
)
def test_arrays_that_do_not_fit_each_other_are_refused(change: Any, error: Any, code: str) -> None:
    with refuses(code, error=error):
        replace(drive((0, 1)), **change)


def test_a_cloud_without_colours_among_coloured_ones_is_refused_by_number() -> None:
    with refuses("no-colors", "1"):
        CloudArray.of([place(0), Cloud(place(1).points)])


def test_files_that_are_cut_foreign_or_of_another_version_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "set.npz"
    whole_set().save(path)
    check_damaged_files(path, SceneSet.load)
    change_archive(path, lambda about, _: about.update({"format": "fusionslam.scene_set.0"}))
    assert is_scene_set(path)
    with pytest.raises(DataError, match=r"set\.npz.*scene_set\.0"):
        SceneSet.load(path)
    whole_set().save(path)
    change_archive(path, lambda _, arrays: arrays.update(offsets=arrays["offsets"][:-1]))
    with refuses("wrong-offsets"):
        SceneSet.load(path)
    path.write_bytes(path.read_bytes()[:-1])
    assert not is_scene_set(path)


def test_a_dataset_is_recorded_frame_by_frame_whatever_the_jobs(kitti: Path) -> None:
    dataset, fusion = open_dataset(kitti), FusionConfig(ground="height")
    one, two = (
        record_scenes(dataset, fusion=fusion, features=["m2dp"], jobs=jobs) for jobs in (1, 2)
    )
    assert differing(one, two) == [] and len(one) == len(dataset) and one.frame == "scan"
    assert one.clouds is not None
    for index in (0, 7):
        cloud = fuse(dataset[index], fusion)
        assert np.array_equal(one.clouds[index].points, cloud.points)
        assert np.array_equal(one.clouds[index].colors, cloud.colors)
    assert one.features["m2dp"].shape == (len(dataset), 192)
    # KITTI's world has y down and z ahead; here it is seen from above.
    steps = np.diff(one.true_poses()[:, :2], axis=0)
    assert np.linalg.norm(steps, axis=1) == pytest.approx(20)


def test_frames_that_cannot_be_fused_are_named(kitti: Path) -> None:
    fusion = FusionConfig(frame="odometry")
    with pytest.raises(DataError, match=r"03, \w+ 0\b"):
        record_scenes(open_dataset(kitti), fusion=fusion)


def test_places_are_seen_from_above_whatever_the_worlds_axes() -> None:
    yaw = np.array([0.0, 0.4, -2.0])
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, 0, 0] = poses[:, 1, 1] = np.cos(yaw)
    poses[:, 1, 0], poses[:, 0, 1] = np.sin(yaw), -np.sin(yaw)
    poses[:, :3, 3] = [[0, 0, 0.2], [3, 1, 0.2], [-2, 5, 0.2]]
    level = places_of(poses)
    assert level == pytest.approx(np.column_stack([poses[:, :2, 3], yaw]))
    world = np.array([[0, -1.0, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])
    turned = places_of(world @ poses)
    for first, second in ((0, 1), (1, 2)):
        lengths = [np.hypot(*(p[first] - p[second])[:2]) for p in (level, turned)]
        turns = [np.angle(np.exp(1j * (p[first] - p[second])[2])) for p in (level, turned)]
        assert lengths[0] == pytest.approx(lengths[1]) and turns[0] == pytest.approx(turns[1])


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


def corridor(odometry: bool = True) -> SceneSet:
    """There and back along a corridor; odometry begins elsewhere and is 2 % too long."""
    scenes = drive([LOOKS[place] for place in THERE_AND_BACK])
    x = APART * np.array(THERE_AND_BACK)
    poses = np.stack([x, 0 * x, 0 * x], axis=1)
    measured = np.stack([0 * x - 7, 1.02 * x + 3, 0 * x + np.pi / 2], axis=1)
    return replace(scenes, poses=poses, odometry=measured if odometry else None)


@rows("kind, follows", [(None, True), ("recorded", True), ("drift", True), ("none", False)])
def test_odometry_tells_look_alike_places_of_a_corridor_apart(
    kind: str | None, follows: bool
) -> None:
    scenes, one = corridor(), ViewMatcher()
    run = run_views(scenes, one, odometry=odometry_of(scenes, one, kind))
    assert run.follows_odometry == follows
    assert (run.ids.tolist() == list(THERE_AND_BACK)) == follows


def test_a_set_keeps_its_odometry(tmp_path: Path) -> None:
    scenes = corridor()
    scenes.save(tmp_path / "set.npz")
    kept = SceneSet.load(tmp_path / "set.npz")
    np.testing.assert_array_equal(kept.odometry, scenes.odometry)
    some = kept.subset(np.array([1, 3]))
    assert some.odometry is not None and scenes.odometry is not None
    np.testing.assert_array_equal(some.odometry, scenes.odometry[[1, 3]])
    corridor(odometry=False).save(tmp_path / "set.npz")
    assert SceneSet.load(tmp_path / "set.npz").odometry is None
    with pytest.raises(ShapeError, match="odometry"):
        replace(scenes, odometry=np.zeros((2, 3)))


def test_a_recorder_takes_odometry_where_it_is_known() -> None:
    recorder, bare = SceneRecorder("a drive"), SceneRecorder("another")
    for k, odometry in enumerate([None, (1.0, 2.0, 0.1), None]):
        recorder.add(k, place(k), (0.0, 0.0, 0.0), odometry)
        bare.add(k, place(k), (0.0, 0.0, 0.0))
    assert bare.scene_set().odometry is None
    kept = recorder.scene_set().odometry
    np.testing.assert_array_equal(kept, [[np.nan] * 3, [1, 2, 0.1], [np.nan] * 3])
    with pytest.raises(DataError):
        recorder.add(3, place(3), (0.0, 0.0, 0.0), (np.inf, 0.0, 0.0))
    assert len(recorder) == 3


def test_odometry_that_is_unknown_for_a_while_is_no_reason_to_stop() -> None:
    scenes, matcher = corridor(), ViewMatcher()
    assert scenes.odometry is not None
    scenes.odometry[4] = np.nan
    run = run_views(scenes, matcher, odometry=odometry_of(scenes, matcher))
    assert len(run.ids) == len(THERE_AND_BACK)
    assert "may be anywhere" in run.matches[4].reason
    assert run.ids[:4].tolist() == [0, 1, 2, 3]


@rows("values", [{"method": "objects"}, {"odometry": False}])
def test_a_matcher_without_filter_uses_no_odometry(values: dict[str, Any]) -> None:
    assert odometry_of(corridor(), matcher(**values)) is None
    with refuses("no-filter", error=ConfigError):
        odometry_of(corridor(), matcher(**values), "recorded")


def test_a_set_without_odometry_is_matched_without() -> None:
    bare = corridor(odometry=False)
    assert odometry_of(bare, ViewMatcher()) is None
    with refuses("no-odometry"):
        odometry_of(bare, ViewMatcher(), "recorded")
    with pytest.raises(DataError):
        odometry_of(replace(bare, poses=None), ViewMatcher(), "drift")


def doubtful_run() -> ViewRun:
    """The robot is carried to a place that looks like two."""
    scenes, matcher = corridor(), ViewMatcher()
    assert scenes.odometry is not None
    scenes.odometry[8:] += [50.0, 0.0, 0.0]
    run = run_views(scenes, matcher, odometry=odometry_of(scenes, matcher))
    return run.with_truth("by odometry")


def test_a_run_holds_the_belief_and_why_answers_were_held_back(tmp_path: Path) -> None:
    run = doubtful_run()
    assert run.known is not None and run.others is not None
    assert ((run.known >= 0) & (run.others >= 0) & (run.known + run.others <= 1 + 1e-9)).all()
    (row, reason), *_ = run.held_back
    assert row == 8 and "the robot is lost" in reason and run.ids[8] == -1
    # Two places look like this one, and neither is more probable.
    assert run.known[8] < 0.6 and run.others[8] > 0.3
    run.save(tmp_path / "run.npz")
    kept = ViewRun.load(tmp_path / "run.npz")
    np.testing.assert_array_equal(kept.known, run.known)
    assert [tuple(each) for each in kept.held_back] == [tuple(each) for each in run.held_back]


def test_the_report_shows_the_belief(tmp_path: Path) -> None:
    text = write_view_report(doubtful_run(), tmp_path).read_text(encoding="utf-8")
    assert "Answers that were held back" in text and "the robot is lost" in text
    assert len([*tmp_path.glob("views_belief_*.png")]) == 1


def test_the_report_of_scans_alone_shows_no_belief(tmp_path: Path) -> None:
    alone = run_views(corridor(), ViewMatcher()).with_truth("alone")
    text = write_view_report(alone, tmp_path).read_text(encoding="utf-8")
    assert "held back" not in text and not [*tmp_path.glob("views_belief_*.png")]


def test_the_command_takes_the_odometry_of_a_set_unless_told_otherwise(tmp_path: Path) -> None:
    corridor().save(tmp_path / "set.npz")
    corridor(odometry=False).save(tmp_path / "bare.npz")
    options = ("-o", tmp_path / "out", "--no-report")
    said = succeeds("views", "match", tmp_path / "set.npz", *options).stdout
    assert "weighed by odometry: 0 ambiguous" in said
    said = succeeds("views", "match", tmp_path / "set.npz", *options, "--odometry", "none").stdout
    assert "weighed by odometry" not in said
    wanted = (*options, "--odometry", "recorded")
    assert "has no odometry" in fails(1, "views", "match", tmp_path / "bare.npz", *wanted)
