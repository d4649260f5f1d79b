# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The joint map of a site: it grows as drives arrive, and says which it cannot take in."""

import shutil
from pathlib import Path
from typing import Any

import pytest

from error_codes import has_code
from fleets import plan_of, write_drive
from fusionslam.errors import ConfigError, DataError
from fusionslam.fleet.config import FleetSettings
from fusionslam.fleet.site_maps import MAPS, SiteMerge, forget_drive, merge_site, site_map_path
from fusionslam.fleet.site_records import SiteRecord
from fusionslam.fleet.work import PlannedRecording
from fusionslam.mapping import PlaceMap
from fusionslam.mapping.config import MapConfig
from streets import RETURN, WAY

pytest.importorskip("gtsam", reason="maps are an extra")


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Drives in the order of their names: elsewhere; there and back; back; one that is bad."""
    root = tmp_path_factory.mktemp("drives")
    write_drive(root / "yard/r0/a-elsewhere", WAY[:3], 300, place=7)
    write_drive(root / "yard/r1/b-monday", WAY[:6], 0)
    write_drive(root / "yard/r2/c-tuesday", RETURN[3:], 100)
    bad = write_drive(root / "yard/r2/d-bad", WAY[:2], 0)
    for path in (bad / "clouds").iterdir():
        path.write_bytes(b"12345")
    return root


def planned(root: Path, folder: Path, *names: str) -> tuple[list[PlannedRecording], FleetSettings]:
    plan, settings = plan_of(root, folder)
    all_of = {each.recording.session.rpartition("/")[2]: each for each in plan.recordings}
    return [all_of[name] for name in names or all_of], settings


def merge(root: Path, folder: Path, *names: str) -> SiteMerge:
    recordings, settings = planned(root, folder, *names)
    return merge_site(folder, "yard", recordings, settings, mapping=MapConfig())


def sessions_of(folder: Path) -> set[str]:
    with PlaceMap.open(site_map_path(folder, "yard"), read_only=True) as site:
        return {each.name.rpartition("/")[2] for each in site.sessions}


def names(sessions: object) -> set[str]:
    return {each.rpartition("/")[2] for each in sessions}


@pytest.mark.slow
def test_drives_are_joined_as_they_arrive_and_the_others_wait(
    drives: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Alone, one that no other joins begins the map.
    first = merge(drives, tmp_path, "a-elsewhere", "d-bad")
    assert (names(first.added), names(first.left_out)) == ({"a-elsewhere"}, {"d-bad"})
    # Two that join one another make it begin anew.
    second = merge(drives, tmp_path)
    assert names(second.added) == {"b-monday", "c-tuesday"}
    assert names(second.left_out) == {"a-elsewhere", "d-bad"}
    assert sessions_of(tmp_path) == {"b-monday", "c-tuesday"}
    before = site_map_path(tmp_path, "yard").read_bytes()
    with monkeypatch.context() as patched:  # nothing is compared again
        patched.setattr(PlaceMap, "merge", None)
        third = merge(drives, tmp_path)
    assert not third.added and names(third.known) == {"b-monday", "c-tuesday"}
    assert names(third.left_out) == {"a-elsewhere", "d-bad"}
    assert third.left_out == second.left_out
    assert site_map_path(tmp_path, "yard").read_bytes() == before
    # A drive that is forgotten leaves the joint map, and has none of its own any more.
    ((monday,), _) = planned(drives, tmp_path, "b-monday")
    own = {*(tmp_path / MAPS / "yard").glob("*b-monday*.fsmap")}
    forget_drive(tmp_path, monday.recording)
    assert sessions_of(tmp_path) == {"c-tuesday"}
    assert len(own) == 1 and not any(path.exists() for path in own)
    assert "b-monday" not in record_file(tmp_path).read_text()


def record_file(folder: Path) -> Path:
    return site_map_path(folder, "yard").with_suffix("") / "joined.json"


JOINT = ""
"""Name of a joint map of one drive, which is compared as the others are."""


def compared(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the drives whose maps are compared with a joint one from now on."""
    plain, calls = PlaceMap.merge, []

    def count(self: PlaceMap, other: Path, **more: Any) -> Any:
        calls.append(other.stem.rpartition("_")[2].rpartition("-")[0])
        return plain(self, other, **more)

    monkeypatch.setattr(PlaceMap, "merge", count)
    return calls


@pytest.mark.slow
def test_a_drive_that_was_refused_is_compared_again_once_something_has_changed(
    drives: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = tmp_path / "drives"
    shutil.copytree(drives, root)
    shutil.rmtree(root / "yard/r2/d-bad")
    places, calls = tmp_path / "places", compared(monkeypatch)
    first = merge(root, places, "a-elsewhere", "b-monday")
    assert names(first.left_out) == {"b-monday"} and calls
    calls.clear()
    assert merge(root, places, "a-elsewhere", "b-monday").left_out == first.left_out
    assert not calls
    # The joint map is another one.
    second = merge(root, places)
    assert names(second.added) == {"b-monday", "c-tuesday"} and JOINT in calls
    calls.clear()
    assert merge(root, places).left_out == second.left_out and not calls
    # The drive is another one, as its files have other times.
    (root / "yard/r0/a-elsewhere/clouds/000001.bin").touch()
    third = merge(root, places)
    assert names(third.left_out) == {"a-elsewhere"} and calls == ["a-elsewhere"]


@pytest.mark.slow
def test_a_drive_that_waits_is_mapped_anew_with_another_configuration(
    drives: Path, tmp_path: Path
) -> None:
    counts = []
    for distance in (1.0, 1.0, 100.0):
        recordings, settings = planned(drives, tmp_path, "a-elsewhere", "b-monday")
        mapping = MapConfig(keyframe_distance=distance)
        done = merge_site(tmp_path, "yard", recordings, settings, mapping=mapping)
        assert names(done.left_out) == {"b-monday"}
        (path,) = (tmp_path / MAPS).rglob("*b-monday*.fsmap")
        with PlaceMap.open(path, read_only=True) as site:
            counts.append(len(site))
    assert counts[0] == counts[1] > counts[2]


@pytest.mark.slow
def test_a_drive_whose_recording_changed_is_mapped_and_joined_anew(
    drives: Path, tmp_path: Path
) -> None:
    root, places = tmp_path / "drives", tmp_path / "places"
    for name in ("r1/b-monday", "r2/c-tuesday"):
        shutil.copytree(drives / "yard" / name, root / "yard" / name)
    assert names(merge(root, places).added) == {"b-monday", "c-tuesday"}
    before = keyframes_of(places)
    shutil.rmtree(root / "yard/r1/b-monday")
    write_drive(root / "yard/r1/b-monday", WAY[1:6], 50)
    merged = merge(root, places)
    assert names(merged.added) == {"b-monday"} and names(merged.known) == {"c-tuesday"}
    assert not merged.left_out
    assert keyframes_of(places) == before | {"b-monday": before["b-monday"] - 1}
    # One that cannot be mapped any more stays as it was.
    for path in (root / "yard/r1/b-monday/clouds").iterdir():
        path.write_bytes(b"12345")
    for _ in range(2):
        merged = merge(root, places)
        assert names(merged.left_out) == {"b-monday"} and not merged.added
        assert sessions_of(places) == {"b-monday", "c-tuesday"}


def keyframes_of(folder: Path) -> dict[str, int]:
    with PlaceMap.open(site_map_path(folder, "yard"), read_only=True) as site:
        return {each.name.rpartition("/")[2]: each.keyframes for each in site.sessions}


def test_what_is_known_of_a_site_that_is_damaged_is_named(drives: Path, tmp_path: Path) -> None:
    recordings, settings = planned(drives, tmp_path)
    path = record_file(tmp_path)
    path.parent.mkdir(parents=True)
    path.write_text("{}")
    with pytest.raises(DataError, check=lambda error: str(path) in str(error)):
        merge_site(tmp_path, "yard", recordings, settings)
    forget_drive(tmp_path, recordings[0].recording)  # is not kept from it
    assert not path.exists()


def test_lists_of_recordings_without_contents_are_taken_as_they_are(tmp_path: Path) -> None:
    record = SiteRecord(tmp_path / "yard.json", {"old": "", "new": "b"}, "")
    assert not record.has_changed("old", {}) and not record.has_changed("old", {"old": "a"})
    seen: dict[str, str] = {}
    assert not record.has_changed("new", seen) and seen == {"new": "b"}
    assert record.has_changed("new", {"new": "a"})


def test_an_unknown_site_is_refused(drives: Path, tmp_path: Path) -> None:
    recordings, settings = planned(drives, tmp_path)
    with pytest.raises(ConfigError, check=has_code("unknown-site", "site", "port")):
        merge_site(tmp_path, "port", recordings, settings)
    assert not (tmp_path / MAPS).exists()


@pytest.mark.parametrize("site", ["", "a/b", "../up", ".", "Ünï", "a b", "x" * 300])
def test_any_name_of_a_site_has_a_file_of_its_own(site: str, tmp_path: Path) -> None:
    path = site_map_path(tmp_path, site)
    assert path.parent == tmp_path / MAPS and path.suffix == ".fsmap"
    assert path != site_map_path(tmp_path, site.replace("/", "_") + "_")
