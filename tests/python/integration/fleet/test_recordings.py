# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings below a folder: found at any depth, each by its name, with whose and where."""

import os
import shutil
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from bags import drive as drive_events
from bags import write_bag
from error_codes import has_code
from fleets import LABELS, MONDAY, TUESDAY, WEDNESDAY, describe_fleet, settings_for, write_drive
from fusionslam.base.write_lock import lock_folder
from fusionslam.errors import ConfigError
from fusionslam.fleet.config import FILE, FleetConfig, FleetSettings
from fusionslam.fleet.places import ABOUT
from fusionslam.fleet.recordings import FleetRecording, Labels, find_recordings
from fusionslam.fleet.settings import settle_settings
from fusionslam.fleet.work import load_failures
from fusionslam.pipelines.describe import PipelineConfig
from kitti import write_sequence
from permissions import bound_by_permissions
from recordings import write_drive as write_ranges
from refusals import refuses
from rows import rows
from streets import WAY, write_street


def names_of(root: Path, **how: Path) -> list[str]:
    return [each.session for each in find_recordings(root, Labels(), **how).recordings]


def test_recordings_are_found_at_any_depth_in_the_order_of_their_names(fleet: Path) -> None:
    found = find_recordings(fleet, LABELS)
    assert [tuple(getattr(each, name) for name in ABOUT) for each in found.recordings] == [
        (MONDAY, "r1", "north", ""),
        (TUESDAY, "r2", "north", ""),
        (WEDNESDAY, "r3", "south", ""),
    ]
    assert found.refused == {}


def test_a_folder_that_is_a_recording_has_its_own_name(fleet: Path) -> None:
    assert names_of(fleet / MONDAY) == ["monday"]


def test_bags_range_recordings_and_sequences_are_recordings(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    write_bag(tmp_path / "a/drive.one.bag", drive_events())
    write_ranges(tmp_path / "house.npz")
    third = write_sequence(tmp_path / "kitti", [0, 1], [50, 50], metres=20, width=64)
    shutil.copytree(third, third.with_name("04"))
    expected = ["a/drive.one", "house", "kitti/03", "kitti/04"]
    found = find_recordings(tmp_path, Labels())
    assert [each.session for each in found.recordings] == expected and not found.refused
    assert all(len(each.recording.open()) for each in found.recordings)


def test_of_two_recordings_of_one_name_the_second_is_left_out(tmp_path: Path) -> None:
    write_ranges(tmp_path / "drive.npz")
    write_street(tmp_path / "drive", WAY[:2])
    found = find_recordings(tmp_path, Labels())
    assert [each.session for each in found.recordings] == ["drive"]
    ((path, error),) = found.refused.items()
    assert (Path(path).stem, error.code, error.fields) == ("drive", "same-name", ("drive",))


def test_results_hidden_folders_and_links_back_are_not_looked_into(own_fleet: Path) -> None:
    expected = names_of(own_fleet)
    describe_fleet(own_fleet, own_fleet / "north/older")
    (own_fleet / "south/back").symlink_to(own_fleet)
    write_street(own_fleet / ".trash/drive", WAY[:2])
    np.savez(own_fleet / "south/other.npz", about='{"format": "fusionslam.view_run.1"}')
    found = find_recordings(own_fleet, LABELS)
    assert [each.session for each in found.recordings] == expected and not found.refused
    write_street(own_fleet / "out/drive", WAY[:2])
    assert names_of(own_fleet) == [*expected[:2], "out/drive", expected[2]]
    assert names_of(own_fleet, excluded=own_fleet / "out") == expected


def test_a_link_that_is_found_before_its_target_names_nothing(own_fleet: Path) -> None:
    expected = names_of(own_fleet)
    (own_fleet / "a").symlink_to(own_fleet / "south")
    (own_fleet / "north/r0").symlink_to(own_fleet / MONDAY)
    assert names_of(own_fleet) == expected
    outside = (own_fleet / "south").rename(own_fleet.parent / "outside")
    for link, target in (("a", outside), ("b", own_fleet / "a")):
        (own_fleet / link).unlink(missing_ok=True)
        (own_fleet / link).symlink_to(target)
    assert names_of(own_fleet) == [WEDNESDAY.replace("south", "a"), *expected[:2]]


@rows("name", ["new\nline", "bell\a", "\x7f", "c1\x85"])
def test_names_with_control_characters_are_refused(tmp_path: Path, name: str) -> None:
    for number, labels in enumerate((Labels(), Labels(site=name))):
        root = tmp_path / str(number)
        write_street(root / ("drive" if number else name), WAY[:2])
        found = find_recordings(root, labels)
        assert not found.recordings
        assert [each.code for each in found.refused.values()] == ["bad-name"]


def test_a_folder_that_must_not_be_read_is_named(own_fleet: Path) -> None:
    (own_fleet / "north").chmod(0)

    def find() -> None:
        found = find_recordings(own_fleet, LABELS)
        assert [each.session for each in found.recordings] == [WEDNESDAY]
        assert found.refused[str(own_fleet / "north")].code == "unreadable"

    bound_by_permissions(find)
    (own_fleet / "north").chmod(0o755)


def test_a_name_that_is_no_text_is_refused_and_the_others_are_found(own_fleet: Path) -> None:
    strange = os.fsdecode(os.fsencode(own_fleet) + b"/south/\xff")
    (own_fleet / "south/r3").rename(strange)
    found = find_recordings(own_fleet, LABELS)
    assert len(found.recordings) == 2
    assert [error.code for error in found.refused.values()] == ["bad-name"]


def test_a_root_that_is_no_folder_is_refused(tmp_path: Path) -> None:
    with refuses("missing-file", str(tmp_path / "none")):
        find_recordings(tmp_path / "none", Labels())


@rows(
    "folders, session, expected",
    [
        ((), "a/b/c", ("R", "S", "")),
        (("site",), "a/b/c", ("R", "a", "")),
        (("region", "site", "robot"), "a/b/c/d", ("c", "b", "a")),
        (("region", "site", "robot"), "a/b/c", ("c", "b", "a")),
        (("region", "site", "robot"), "a/b", ("R", "b", "a")),
        (("robot",), "alone", ("alone", "S", "")),
    ],
)
def test_folders_are_names_and_options_stand_in_where_there_are_none(
    folders: tuple[str, ...], session: str, expected: tuple[str, str, str]
) -> None:
    found = Labels(folders, robot="R", site="S").of(session)
    assert (found["robot"], found["site"], found["region"]) == expected


def test_unknown_names_of_folders_are_refused() -> None:
    for folders in (("site", "site"), ("town",), ("site", "")):
        with pytest.raises(ConfigError, check=has_code("choice", "--folders")):
            Labels(folders)


def test_a_recording_is_the_same_after_it_was_stored(fleet: Path) -> None:
    for each in find_recordings(fleet, LABELS).recordings:
        assert FleetRecording.load(asdict(each)) == each


def test_cut_and_unreadable_files_are_failures_and_the_rest_goes_on(own_fleet: Path) -> None:
    (own_fleet / "south/cut.bag").write_bytes(b"#ROSBAG V2.0\nxx")
    (own_fleet / "south/short.npz").write_bytes(b"PK\3\4 no more")
    failures = describe_fleet(own_fleet, own_fleet.parent / "places")
    assert [each.session for each in failures] == ["south/cut", "south/short"]
    assert all(str(own_fleet / each.session) in each.reason for each in failures)
    assert load_failures(own_fleet.parent / "places") == failures


def test_settings_are_the_same_after_they_were_stored(described: Path, tmp_path: Path) -> None:
    settings = FleetSettings.load(described)
    assert settings.names == ("m2dp:robust",)
    settings.save(tmp_path)
    assert FleetSettings.load(tmp_path) == settings
    assert FleetSettings.load(tmp_path).digest == settings.digest


def test_what_was_fitted_to_streets_stays_in_a_room(own_fleet: Path, own_places: Path) -> None:
    before = FleetSettings.load(own_places)
    write_room(own_fleet / "a/r0/sunday")
    found = find_recordings(own_fleet, LABELS)
    assert found.recordings[0].session == "a/r0/sunday"
    assert settings_for(found, own_places).dump() == before.dump()
    new = settings_for(found, own_places.parent / "new").registration
    assert new.voxel < before.registration.voxel


def write_room(folder: Path) -> None:
    """Clouds that do not reach far, for which registration has smaller lengths."""
    write_drive(folder, WAY[:2], 0)
    for path in (folder / "clouds").iterdir():
        points = np.fromfile(path, np.float32).reshape(-1, 4)
        (points * np.float32([0.1, 0.1, 0.1, 1])).tofile(path)


@rows(
    "name, voxel, chunk, field",
    [
        ("shot", 0.0, 4, "names"),
        ("m2dp", 0.3, 4, "fusion.voxel"),
        ("m2dp", 0.0, 9, "fleet.chunk"),
    ],
)
def test_a_folder_made_with_others_is_refused_by_the_name_of_what_differs(
    fleet: Path, described: Path, name: str, voxel: float, chunk: int, field: str
) -> None:
    fusion = FleetSettings.load(described).fusion
    config = PipelineConfig(fusion=fusion.model_copy(update={"voxel": voxel or fusion.voxel}))
    found = find_recordings(fleet, LABELS)
    with pytest.raises(ConfigError, check=has_code("other-configuration", described, field)):
        settle_settings(found, [name], config, FleetConfig(chunk=chunk), described)


def test_what_decides_nothing_may_differ_and_counts(fleet: Path, own_places: Path) -> None:
    found = find_recordings(fleet, LABELS)
    assert settings_for(found, own_places, tries=7).fleet.tries == 7


def test_a_first_recording_of_bad_scans_is_passed_over(own_fleet: Path, tmp_path: Path) -> None:
    bad = own_fleet / "a/r0/sunday/clouds"
    bad.mkdir(parents=True)
    for number in range(3):
        (bad / f"{number:06d}.bin").write_bytes(b"12345")
    found = find_recordings(own_fleet, LABELS)
    assert settings_for(found, tmp_path / "places").names == ("m2dp:robust",)


def test_without_any_recording_nothing_is_made(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with refuses("no-recording"):
        settings_for(find_recordings(tmp_path / "empty", Labels()), tmp_path / "places")
    assert not (tmp_path / "places").exists()


def test_an_unknown_descriptor_is_refused(fleet: Path, tmp_path: Path) -> None:
    found = find_recordings(fleet, LABELS)
    with pytest.raises(ConfigError):
        settle_settings(found, ["m3dp"], PipelineConfig(), FleetConfig(), tmp_path / "places")
    assert not (tmp_path / "places").exists()


def test_damaged_settings_are_named(fleet: Path, own_places: Path) -> None:
    text = (own_places / FILE).read_text()
    (own_places / FILE).write_text(text.replace('"tries": 3', '"tries": 4'))
    with refuses("wrong-digest"):
        settings_for(find_recordings(fleet, LABELS), own_places)
    (own_places / FILE).write_text(text[:50])
    with refuses("damaged-file"):
        settings_for(find_recordings(fleet, LABELS), own_places)


def test_two_processes_do_not_settle_one_folder_at_once(fleet: Path, tmp_path: Path) -> None:
    lock = lock_folder(tmp_path)
    with refuses("locked"):
        settings_for(find_recordings(fleet, LABELS), tmp_path)
    lock.release()
    assert settings_for(find_recordings(fleet, LABELS), tmp_path).names == ("m2dp:robust",)


def test_a_folder_that_cannot_be_written_is_named(fleet: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("kept")
    with refuses("cannot-write"):
        settings_for(find_recordings(fleet, LABELS), tmp_path / "file/places")
    assert (tmp_path / "file").read_text() == "kept"
