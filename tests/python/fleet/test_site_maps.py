# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The joint map of a site: it grows as drives arrive, and says which it cannot take in."""

from pathlib import Path

import pytest

from error_codes import has_code
from fleets import LABELS, settings_for, write_drive
from fusionslam.errors import ConfigError
from fusionslam.fleet.recordings import FleetRecording, find_recordings
from fusionslam.fleet.site_maps import MAPS, SiteMerge, forget_drive, merge_site, site_map_path
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


def recordings_of(root: Path, *names: str) -> list[FleetRecording]:
    found = find_recordings(root, LABELS).recordings
    return [each for each in found if not names or each.session.rpartition("/")[2] in names]


def merge(root: Path, folder: Path, *names: str) -> SiteMerge:
    settings = settings_for(find_recordings(root, LABELS), folder)
    recordings = recordings_of(root, *names)
    return merge_site(folder, "yard", recordings, settings, mapping=MapConfig())


def sessions_of(folder: Path) -> set[str]:
    with PlaceMap.open(site_map_path(folder, "yard"), read_only=True) as site:
        return {each.name.rpartition("/")[2] for each in site.sessions}


def names(sessions: object) -> set[str]:
    return {each.rpartition("/")[2] for each in sessions}


@pytest.mark.slow
def test_drives_are_joined_as_they_arrive_and_the_others_wait(drives: Path, tmp_path: Path) -> None:
    # Alone, one that no other joins begins the map.
    first = merge(drives, tmp_path, "a-elsewhere", "d-bad")
    assert (names(first.added), names(first.left_out)) == ({"a-elsewhere"}, {"d-bad"})
    # Two that join one another make it begin anew.
    second = merge(drives, tmp_path)
    assert names(second.added) == {"b-monday", "c-tuesday"}
    assert names(second.left_out) == {"a-elsewhere", "d-bad"}
    assert sessions_of(tmp_path) == {"b-monday", "c-tuesday"}
    before = site_map_path(tmp_path, "yard").read_bytes()
    third = merge(drives, tmp_path)
    assert not third.added and names(third.known) == {"b-monday", "c-tuesday"}
    assert names(third.left_out) == {"a-elsewhere", "d-bad"}
    assert site_map_path(tmp_path, "yard").read_bytes() == before
    # A drive that is forgotten leaves the joint map, and has none of its own any more.
    (monday,) = recordings_of(drives, "b-monday")
    own = {*(tmp_path / MAPS / "yard").glob("*b-monday*.fsmap")}
    forget_drive(tmp_path, monday)
    assert sessions_of(tmp_path) == {"c-tuesday"}
    assert len(own) == 1 and not any(path.exists() for path in own)


def test_an_unknown_site_is_refused(drives: Path, tmp_path: Path) -> None:
    settings = settings_for(find_recordings(drives, LABELS), tmp_path)
    with pytest.raises(ConfigError, check=has_code("unknown-site", "site", "port")):
        merge_site(tmp_path, "port", recordings_of(drives), settings)
    assert not (tmp_path / MAPS).exists()


@pytest.mark.parametrize("site", ["", "a/b", "../up", ".", "Ünï", "a b", "x" * 300])
def test_any_name_of_a_site_has_a_file_of_its_own(site: str, tmp_path: Path) -> None:
    path = site_map_path(tmp_path, site)
    assert path.parent == tmp_path / MAPS and path.suffix == ".fsmap"
    assert path != site_map_path(tmp_path, site.replace("/", "_") + "_")
