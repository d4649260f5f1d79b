# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Chunks: their keys say what is in them, their files hold each frame once."""

import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from fleets import (
    FRAMES,
    MONDAY,
    TUESDAY,
    WEDNESDAY,
    chunk_files,
    describe_fleet,
    digests,
    keys_of,
    plan_of,
    settings_for,
    with_fleet,
    write_drive,
)
from fusionslam import Cloud, DescriptorConfig, _core
from fusionslam.datasets import open_dataset, write_cloud
from fusionslam.descriptors import describe
from fusionslam.fleet.chunk import ChunkStore, StoredChunk, describe_chunk, is_stored
from fusionslam.fleet.config import FleetSettings
from fusionslam.fleet.recordings import Labels, find_recordings
from fusionslam.fleet.work import Plan
from fusionslam.loop_closure import observation
from kitti import write_sequence
from refusals import refuses
from rows import rows
from streets import WAY, at, drift


def stored(folder: Path) -> list[StoredChunk]:
    return [StoredChunk.load(path) for path in chunk_files(folder)]


def test_keys_stay_for_what_decides_nothing(fleet: Path, described: Path) -> None:
    settings = FleetSettings.load(described)
    expected = keys_of(fleet, settings)
    assert keys_of(fleet, with_fleet(settings, tries=9)) == expected
    threads = settings.descriptors.model_copy(update={"threads": 2})
    assert keys_of(fleet, replace(settings, descriptors=threads)) == expected
    assert len({key for keys in expected.values() for key in keys}) == 9


def test_keys_change_with_settings_and_the_version(
    fleet: Path, described: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = FleetSettings.load(described)
    before = {*keys_of(fleet, settings)[MONDAY]}
    for changes in ({"chunk": 3}, {"keyframe_distance": 1.0}, {"clouds": False}):
        assert not before & {*keys_of(fleet, with_fleet(settings, **changes))[MONDAY]}
    monkeypatch.setattr(_core, "__version__", "99.0")
    assert not before & {*keys_of(fleet, settings)[MONDAY]}


def _touch(drive: Path) -> None:
    os.utime(drive / "clouds/000003.bin", (1, 1))


def _replace_scan(drive: Path) -> None:
    write_cloud(drive / "clouds/000003.bin", Cloud(np.eye(3, dtype=np.float32)))


def _move_poses(drive: Path) -> None:
    text = (drive / "poses.txt").read_text()
    (drive / "poses.txt").write_text(text.replace("1.7", "1.8", 1))


def _change_odometry(drive: Path) -> None:
    with (drive / "odometry.txt").open("a") as file:
        file.write("9 54 0 0 0 0 0 1\n")


def _calibrate(drive: Path) -> None:
    rows = "[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 1], [0, 0, 0, 1]"
    (drive / "calib.yaml").write_text(f"robot_from_points: [{rows}]\n")


def test_keys_change_with_the_input_of_a_recording_alone(own_fleet: Path, described: Path) -> None:
    settings = FleetSettings.load(described)
    before = keys_of(own_fleet, settings)
    for change in (_touch, _replace_scan, _move_poses, _change_odometry, _calibrate):
        change(own_fleet / MONDAY)
        after = keys_of(own_fleet, settings)
        assert not {*before.pop(MONDAY)} & {*after[MONDAY]}, change
        assert before.items() <= after.items(), change
        before = after


def test_each_frame_is_in_one_file_once(described: Path) -> None:
    frames: dict[str, list[int]] = {}
    for each in stored(described):
        frames.setdefault(str(each.about["session"]), []).extend(each.arrays["frames"].tolist())
    assert {name: sorted(numbers) for name, numbers in frames.items()} == {
        name: [*range(9)] for name in (MONDAY, TUESDAY, WEDNESDAY)
    }


def test_arrays_are_those_that_are_documented(fleet: Path, described: Path) -> None:
    settings = FleetSettings.load(described)
    chunks = {(each.about["session"], each.about["first"]): each for each in stored(described)}
    first = chunks[MONDAY, 0]
    arrays, data = first.arrays, open_dataset(fleet / MONDAY)
    assert_array_equal(arrays["rows"], range(4))
    assert_array_equal(arrays["stamps_ns"], data.stamps_ns[:4])
    assert_allclose(arrays["poses"], WAY[:4], atol=1e-6)
    assert_allclose(arrays["odometry"], drift(WAY[:4]), atol=1e-6)
    assert_array_equal(arrays["robot_from_cloud"], np.tile(np.eye(4), (4, 1, 1)))
    assert arrays["is_place"].all() and arrays["has_cloud"].all()
    cloud = Cloud(data[0].points)
    assert arrays["points"][0] == len(cloud)
    expected = describe(cloud, "m2dp", settings.descriptors)
    name = settings.names[0]
    assert_array_equal(arrays[f"vectors.{name}"][0], expected)
    assert first.skipped == {}


def test_clouds_are_those_of_the_places(described: Path) -> None:
    store = ChunkStore(described, FleetSettings.load(described))
    places = store.places(chunk_files(described)[0].stem)
    clouds = [store.cloud(key) for key in places.keys]
    assert [each.frame.stamp_ns for each in clouds] == places.stamps_ns.tolist()
    assert all(len(each.frame.unpack().points) > 500 for each in clouds)
    assert all(each.frame.image is not None for each in clouds)


@rows("key", ["nothing", "a:b", "a:-1", "", "a:0", "../../victim:0", "/etc/victim:0"])
def test_a_place_of_no_chunk_has_no_cloud(described: Path, key: str) -> None:
    with refuses("no-cloud", key):
        ChunkStore(described, FleetSettings.load(described)).cloud(key)


def test_frames_without_a_description_are_left_out_with_reasons(
    own_fleet: Path, tmp_path: Path
) -> None:
    (own_fleet / MONDAY / "clouds/000001.bin").write_bytes(b"12345")
    write_cloud(own_fleet / MONDAY / "clouds/000002.bin", Cloud(np.empty((0, 3), np.float32)))
    assert describe_fleet(own_fleet, tmp_path / "out") == []
    skipped = {
        number: reason
        for each in stored(tmp_path / "out")
        if each.about["session"] == MONDAY
        for number, reason in each.skipped.items()
    }
    assert sorted(skipped) == [1, 2] and "000001.bin" in skipped[1]
    assert sum(len(each.arrays["frames"]) for each in stored(tmp_path / "out")) == FRAMES - 2


def test_places_are_a_distance_apart_and_one_that_failed_is_none(tmp_path: Path) -> None:
    drive = write_drive(tmp_path / "fleet/drive", [at(step, 0, 0) for step in range(8)], 0)

    def places() -> list[int]:
        plan, settings = plan_of(tmp_path / "fleet", tmp_path / "a", chunk=8, keyframe_distance=2.5)
        (each,) = plan.recordings[0].chunks(8)
        describe_chunk(each, settings, tmp_path / "a")
        arrays = StoredChunk.load(each.path(tmp_path / "a")).arrays
        found: list[int] = arrays["frames"][arrays["is_place"]].tolist()
        assert_array_equal(arrays["has_cloud"], arrays["is_place"])
        return found

    assert places() == [0, 3, 6]
    (drive / "clouds/000003.bin").write_bytes(b"12345")
    assert places() == [0, 4, 7]


def test_a_turn_on_the_spot_makes_places_too(tmp_path: Path) -> None:
    write_drive(tmp_path / "fleet/drive", [at(0, 0, 20 * step) for step in range(5)], 0)
    describe_fleet(tmp_path / "fleet", tmp_path / "a", chunk=8, keyframe_distance=2.5)
    (each,) = stored(tmp_path / "a")
    assert_array_equal(each.arrays["frames"][each.arrays["is_place"]], [0, 2, 4])


def test_zeros_are_no_place(
    own_fleet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan, settings = plan_of(own_fleet, tmp_path / "a", keyframe_distance=100.0)
    original = observation.describe
    seen: list[int] = []

    def none_for_the_first(cloud: Cloud, name: str, config: DescriptorConfig) -> object:
        seen.append(len(cloud))
        return original(cloud, name, config) * (len(seen) > 1)

    monkeypatch.setattr(observation, "describe", none_for_the_first)
    each = plan.recordings[0].chunks(4)[0]
    describe_chunk(each, settings, tmp_path / "a")
    places = ChunkStore(tmp_path / "a", settings).places(each.key)
    assert (list(places.keys), places.frames.tolist()) == ([f"{each.key}:1"], [1])


@rows("left", [0, 21, 1000, -1])
def test_a_file_cut_short_is_not_there(described: Path, tmp_path: Path, left: int) -> None:
    whole = chunk_files(described)[0]
    assert is_stored(whole) and not is_stored(tmp_path / "none") and not is_stored(tmp_path)
    (tmp_path / whole.name).write_bytes(whole.read_bytes()[:left])
    assert not is_stored(tmp_path / whole.name)


def test_files_cut_short_are_made_again(fleet: Path, own_places: Path) -> None:
    expected = digests(own_places)
    for number, path in enumerate(chunk_files(own_places)[:3]):
        path.write_bytes(path.read_bytes()[: 900 * number])
    assert describe_fleet(fleet, own_places) == []
    assert digests(own_places) == expected


def test_the_file_of_another_chunk_is_refused(own_places: Path) -> None:
    first, second = chunk_files(own_places)[:2]
    shutil.copyfile(first, second)
    with refuses("wrong-digest"):
        StoredChunk.load(second)


def test_true_poses_of_kitti_have_z_up(tmp_path: Path) -> None:
    root = write_sequence(tmp_path, [0, 1, 2], [500] * 3, metres=2.0, width=80)
    found = find_recordings(root.parents[1], Labels())
    settings = settings_for(found, tmp_path / "places", chunk=50)
    plan = Plan.make(root.parents[1], found, settings)
    ((chunk,),) = (each.chunks(50) for each in plan.recordings)
    describe_chunk(chunk, settings, tmp_path / "places")
    poses = StoredChunk.load(chunk.path(tmp_path / "places")).arrays["poses"]
    # The camera drives along its z axis, which is ahead.
    assert_allclose(np.diff(poses[:, :3, 3], axis=0), [[2, 0, 0]] * 2, atol=1e-6)
    assert (poses[:, 2, 2] > 0.99).all()
