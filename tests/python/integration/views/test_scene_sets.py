# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Scene sets: what is recorded, kept in files, and refused."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fusionslam import open_dataset
from fusionslam.errors import DataError, ShapeError
from fusionslam.fusion import FusionConfig, fuse
from fusionslam.geometry.se2 import places_of
from fusionslam.pipelines.scenes import record_scenes
from fusionslam.pipelines.views import run_views, sweep_thresholds
from fusionslam.sensors.frame import Cloud
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.recognisers import ViewMatcherConfig
from fusionslam.views.scene_set import CloudArray, SceneSet, is_scene_set, pack_bytes, unpack_bytes
from fusionslam.views.scenes import SceneConfig, build_scene
from refusals import refuses
from rows import rows
from scenes import LAPS, NOTHING, differing, drive, place
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
