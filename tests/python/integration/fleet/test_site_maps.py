# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The joint map of a site: it grows as drives arrive, and says which it cannot take in."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from artefacts import artefact, copy_artefact
from error_codes import has_code
from fleet_service import map_pose_at, write_joint_map
from fleets import plan_of, write_drive
from fusionslam.base.arrays import Floats
from fusionslam.errors import ConfigError, DataError
from fusionslam.fleet.config import FleetSettings
from fusionslam.fleet.joint_map import JoinedDrive, JointMap
from fusionslam.fleet.site_maps import (
    MAPS,
    SiteMerge,
    SiteRecord,
    forget_drive,
    merge_site,
    site_map_path,
)
from fusionslam.fleet.work import PlannedRecording
from fusionslam.mapping import PlaceMap
from fusionslam.mapping.config import MapConfig
from rows import rows
from streets import RETURN, WAY

pytest.importorskip("gtsam", reason="maps are an extra")


@pytest.fixture(scope="module")
def drives() -> Path:
    """Drives in the order of their names: elsewhere; there and back; back; one that is bad."""

    def write(root: Path) -> None:
        write_drive(root / "yard/r0/a-elsewhere", WAY[:3], 300, place=7)
        write_drive(root / "yard/r1/b-monday", WAY[:6], 0)
        write_drive(root / "yard/r2/c-tuesday", RETURN[3:], 100)
        damage(write_drive(root / "yard/r2/d-bad", WAY[:2], 0))

    return artefact("site-drives", write)


@pytest.fixture(scope="module")
def joined(drives: Path) -> Path:
    """Results of all drives: two are joined, two wait."""

    def join(folder: Path) -> None:
        # Alone, one that no other joins begins the map.
        first = merge(drives, folder, "a-elsewhere", "d-bad")
        assert (names(first.added), names(first.left_out)) == ({"a-elsewhere"}, {"d-bad"})
        # Two that join one another make it begin anew.
        second = merge(drives, folder)
        assert (names(second.added), names(second.left_out)) == (BOTH, WAITING)
        assert keyframes_of(folder).keys() == BOTH

    return artefact("site-joined", join)


def damage(drive: Path) -> None:
    for path in (drive / "clouds").iterdir():
        path.write_bytes(b"12345")


BOTH, WAITING = {"b-monday", "c-tuesday"}, {"a-elsewhere", "d-bad"}


def planned(root: Path, folder: Path, *names: str) -> tuple[list[PlannedRecording], FleetSettings]:
    plan, settings = plan_of(root, folder)
    all_of = {each.recording.session.rpartition("/")[2]: each for each in plan.recordings}
    return [all_of[name] for name in names or all_of], settings


def merge(root: Path, folder: Path, *names: str) -> SiteMerge:
    recordings, settings = planned(root, folder, *names)
    return merge_site(folder, "yard", recordings, settings, mapping=MapConfig())


def keyframes_of(folder: Path) -> dict[str, int]:
    """Of each session of the joint map, by name."""
    with PlaceMap.open(site_map_path(folder, "yard"), read_only=True) as site:
        return {each.name.rpartition("/")[2]: each.keyframes for each in site.sessions}


def names(sessions: object) -> set[str]:
    return {each.rpartition("/")[2] for each in sessions}


def test_drives_that_are_joined_stay_and_the_others_wait(
    drives: Path, joined: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    places = copy_artefact(joined, tmp_path / "places")
    before = site_map_path(places, "yard").read_bytes()
    with monkeypatch.context() as patched:  # nothing is compared again
        patched.setattr(PlaceMap, "merge", None)
        again = merge(drives, places)
        assert merge(drives, places).left_out == again.left_out
    assert not again.added and names(again.known) == BOTH and names(again.left_out) == WAITING
    assert site_map_path(places, "yard").read_bytes() == before
    # A drive that is forgotten leaves the joint map, and has none of its own any more.
    ((monday,), _) = planned(drives, places, "b-monday")
    own = [*(places / MAPS / "yard").glob("*b-monday*.fsmap")]
    forget_drive(places, monday.recording)
    assert keyframes_of(places).keys() == {"c-tuesday"}
    assert len(own) == 1 and not own[0].exists()
    assert "b-monday" not in record_file(places).read_text()


def record_file(folder: Path) -> Path:
    return site_map_path(folder, "yard").with_suffix("") / "joined.json"


def compared(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the drives whose maps are compared with a joint one from now on."""
    plain, calls = PlaceMap.merge, []

    def count(self: PlaceMap, other: Path, **more: Any) -> Any:
        calls.append(other.stem.rpartition("_")[2].rpartition("-")[0])
        return plain(self, other, **more)

    monkeypatch.setattr(PlaceMap, "merge", count)
    return calls


@pytest.mark.nightly
def test_a_drive_that_was_refused_is_compared_again_once_something_has_changed(
    drives: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = copy_artefact(drives, tmp_path / "drives")
    shutil.rmtree(root / "yard/r2/d-bad")
    places, calls = tmp_path / "places", compared(monkeypatch)
    first = merge(root, places, "a-elsewhere", "b-monday")
    assert names(first.left_out) == {"b-monday"} and calls
    calls.clear()
    assert merge(root, places, "a-elsewhere", "b-monday").left_out == first.left_out
    assert not calls
    # The joint map is another one.
    second = merge(root, places)
    assert names(second.added) == BOTH and "" in calls  # a joint map of one drive
    calls.clear()
    assert merge(root, places).left_out == second.left_out and not calls
    # The drive is another one, as its files have other times.
    (root / "yard/r0/a-elsewhere/clouds/000001.bin").touch()
    third = merge(root, places)
    assert names(third.left_out) == {"a-elsewhere"} and calls == ["a-elsewhere"]


@pytest.mark.nightly
def test_a_drive_that_waits_is_mapped_as_configured(drives: Path, tmp_path: Path) -> None:
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
def test_a_changed_drive_is_mapped_and_joined_anew(
    drives: Path, joined: Path, tmp_path: Path
) -> None:
    root = copy_artefact(drives, tmp_path / "drives")
    places = copy_artefact(joined, tmp_path / "places")
    before, changed = keyframes_of(places), root / "yard/r1/b-monday"
    shutil.rmtree(changed)
    write_drive(changed, WAY[1:6], 50)
    merged = merge(root, places, *BOTH)
    assert names(merged.added) == {"b-monday"} and names(merged.known) == {"c-tuesday"}
    assert not merged.left_out
    assert keyframes_of(places) == before | {"b-monday": before["b-monday"] - 1}
    # One that cannot be mapped any more stays as it was.
    damage(changed)
    for _ in range(2):
        merged = merge(root, places, *BOTH)
        assert names(merged.left_out) == {"b-monday"} and not merged.added
        assert keyframes_of(places).keys() == BOTH


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


def test_any_name_of_a_site_has_a_file_of_its_own(tmp_path: Path) -> None:
    for site in ("", "a/b", "../up", ".", "Ünï", "a b", "x" * 300):
        path = site_map_path(tmp_path, site)
        assert path.parent == tmp_path / MAPS and path.suffix == ".fsmap"
        assert path != site_map_path(tmp_path, site.replace("/", "_") + "_")


def turned(degrees: float, x: float) -> Floats:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("z", degrees, degrees=True).as_matrix()
    pose[0, 3] = x
    return pose


DRIVE = JoinedDrive(
    frames=np.array([10, 20, 24, 30, 40]),
    poses=np.array(
        [turned(0, 0), turned(90, 4), turned(0, 5), turned(0, 9), np.full((4, 4), np.nan)]
    ),
    stretches=np.array([0, 0, 2, 2, 4]),
)


@rows(
    "frame, expected",
    [
        (10, turned(0, 0)),
        (15, turned(45, 2)),
        (20, turned(90, 4)),
        (22, turned(90, 4)),  # odometry was lost after frame 20
        (27, turned(0, 7)),
        (35, turned(0, 9)),  # the next keyframe is in another part
        (3, turned(0, 0)),
        (40, None),
        (50, None),
    ],
)
def test_a_frame_lies_between_connected_keyframes(frame: int, expected: Floats | None) -> None:
    found = DRIVE.pose_at(frame)
    if expected is None:
        assert found is None
    else:
        np.testing.assert_allclose(found, expected, atol=1e-12)


def test_drives_of_the_first_part_of_a_map_are_read(tmp_path: Path) -> None:
    drives = {"monday": {0: 0, 2: 0, 4: 5}, "tuesday": {1: 0}, "elsewhere": {0: 9}}
    joint = JointMap.read(write_joint_map(tmp_path, "yard", drives))
    assert [*joint.drives] == ["monday", "tuesday"]
    assert joint.drives["monday"].frames.tolist() == [0, 2, 4]
    np.testing.assert_allclose(joint.pose_at("monday", 2), map_pose_at(2))
    assert joint.pose_at("monday", 4) is None and joint.pose_at("elsewhere", 0) is None
