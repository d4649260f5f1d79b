# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What all places of a folder share: settled by the first recording, kept for all others."""

from pathlib import Path

import numpy as np
import pytest

from error_codes import has_code
from fleets import LABELS, settings_for, write_drive
from fusionslam.errors import ConfigError
from fusionslam.fleet.config import FILE, FleetConfig, FleetSettings
from fusionslam.fleet.recordings import Labels, find_recordings
from fusionslam.fleet.settings import settle_settings
from fusionslam.fleet.write_lock import WriteLock
from fusionslam.pipelines.describe import PipelineConfig
from refusals import refuses
from rows import rows
from streets import WAY


def test_settings_are_the_same_after_they_were_stored(described: Path, tmp_path: Path) -> None:
    settings = FleetSettings.load(described)
    assert settings.names == ("m2dp:robust",)
    settings.save(tmp_path)
    assert FleetSettings.load(tmp_path) == settings
    assert FleetSettings.load(tmp_path).digest == settings.digest


def test_what_was_fitted_stays_when_a_room_comes_before_the_streets(
    own_fleet: Path, own_places: Path
) -> None:
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
    lock = WriteLock(tmp_path)
    with refuses("locked"):
        settings_for(find_recordings(fleet, LABELS), tmp_path)
    lock.release()
    assert settings_for(find_recordings(fleet, LABELS), tmp_path).names == ("m2dp:robust",)


def test_a_folder_that_cannot_be_written_is_named(fleet: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("kept")
    with refuses("cannot-write"):
        settings_for(find_recordings(fleet, LABELS), tmp_path / "file/places")
    assert (tmp_path / "file").read_text() == "kept"
