# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Maps answer bad input by typed errors, and lose nothing."""

import os
import pickle
import shutil
import sqlite3
import subprocess
import tempfile
import traceback
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fusionslam import ConfigError, DataError, FusionConfig, FusionSlamError, ShapeError
from fusionslam.mapping.map_database import is_map
from fusionslam.mapping.place_map import PlaceMap
from fusionslam.sensors.frame import Frame
from map_rows import restore_crcs
from refusals import refuses
from streets import OPTIONS, WAY, at, frames

pytest.importorskip("small_gicp", reason="the libraries of registration are an extra")
pytest.importorskip("gtsam", reason="the library of pose graphs is an extra")

FRAMES = frames(WAY)
STORED = 4


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("map") / "site.fsmap"
    with PlaceMap.open(path, "monday", **OPTIONS) as site:
        for frame in FRAMES[:STORED]:
            site.add(frame)
    return path


@pytest.fixture
def path(built: Path, tmp_path: Path) -> Path:
    return Path(shutil.copy(built, tmp_path / "site.fsmap"))


@pytest.mark.parametrize("name", ["", " ", "a\0b", "a\n", "\ud800", 5, b"monday"])
def test_names_of_sessions_are_printable(path: Path, name: Any) -> None:
    with refuses("session-name", error=ConfigError):
        PlaceMap.open(path, name)


@pytest.mark.parametrize("name", ["../x", "Montag früh", "'; DROP TABLE session; --", "x" * 10_000])
def test_other_names_of_sessions_are_kept(path: Path, name: str) -> None:
    with PlaceMap.open(path, name) as site:
        site.add(FRAMES[0])
    with PlaceMap.open(path, read_only=True) as site:
        assert [each.name for each in site.sessions] == ["monday", name]


SCALED, MIRRORED, SHEARED = at(20, 0, 0), at(20, 0, 0), at(20, 0, 0)
SCALED[:3, :3] *= 2
MIRRORED[2, 2] = -1
SHEARED[3] = 1, 2, 3, 4


@pytest.mark.parametrize(
    ("odometry", "code"),
    [
        (np.full((4, 4), np.nan), "not-finite"),
        (at(np.inf, 0, 0), "not-finite"),
        (SCALED, "not-a-rotation"),
        (MIRRORED, "not-a-rotation"),
        (SHEARED, "not-a-rotation"),
        (np.zeros((4, 4)), "not-a-rotation"),
    ],
)
def test_odometry_that_is_no_rigid_motion_changes_nothing(
    path: Path, odometry: Any, code: str
) -> None:
    with PlaceMap.open(path, "monday") as site:
        with refuses(code):
            site.add(FRAMES[STORED], odometry=odometry)
        with refuses(code):
            site.localize(FRAMES[STORED], odometry=odometry)
        assert len(site) == STORED
        assert site.add(FRAMES[STORED]).why is None  # what was refused was no jump either


@pytest.mark.parametrize("odometry", [np.eye(3), "north"])
def test_odometry_of_another_shape_changes_nothing(path: Path, odometry: Any) -> None:
    with PlaceMap.open(path, "monday") as site:
        with pytest.raises(ShapeError):
            site.add(FRAMES[STORED], odometry=odometry)
        with pytest.raises(ShapeError):
            site.localize(FRAMES[STORED], odometry=odometry)
        assert len(site) == STORED


@pytest.mark.parametrize("number", [-1, 2**70, 1.5, "x"])
def test_numbers_of_frames_are_integers(path: Path, number: Any) -> None:
    last = FRAMES[STORED]
    frame = Frame(index=0, number=number, points=last.points, odometry=last.odometry)
    with PlaceMap.open(path, "monday") as site:
        with refuses("frame-number"):
            site.add(frame)
        with pytest.raises(ShapeError):
            site.add(last.points)
        assert len(site) == STORED


def test_stamps_that_go_back_are_kept_in_the_order_of_the_frames(path: Path) -> None:
    stamps = [-5, 2**63 - 1, 0]
    with PlaceMap.open(path, "monday") as site:
        for stamp, seen in zip(stamps, FRAMES[STORED:], strict=False):
            frame = Frame(
                index=seen.number, stamp_ns=stamp, points=seen.points, odometry=seen.odometry
            )
            site.add(frame)
    with PlaceMap.open(path, read_only=True) as site:
        assert site.trajectory("monday")[0][STORED:].tolist() == stamps
        assert site.check() == []


def test_threads_share_a_map(path: Path) -> None:
    with PlaceMap.open(path, "monday") as site, ThreadPoolExecutor(4) as pool:

        def add(number: int) -> int | None:
            assert site.localize(FRAMES[0]).reason is None and site.sessions
            return site.add(FRAMES[number]).keyframe

        keyframes = [*pool.map(add, range(STORED, STORED + 6))]
        assert sorted(k for k in keyframes if k is not None) == [*range(STORED, STORED + 6)]
        assert site.check() == [] and len(site) == STORED + 6


def test_an_open_map_cannot_be_pickled(path: Path) -> None:
    with PlaceMap.open(path) as site, pytest.raises(TypeError, check=lambda e: str(path) in str(e)):
        pickle.dumps(site)


def test_a_link_leads_to_the_map_and_stays(path: Path, tmp_path: Path) -> None:
    (tmp_path / "links").mkdir()
    link, new = tmp_path / "links/a.fsmap", tmp_path / "links/new.fsmap"
    link.symlink_to("../site.fsmap")
    new.symlink_to("../new.fsmap")
    for each in (link, new):
        with PlaceMap.open(each, "tuesday", **OPTIONS) as site:
            site.add(FRAMES[0])
            with refuses("locked"):  # the same file by another name
                PlaceMap.open(each.resolve(), "other")
        assert each.is_symlink() and is_map(each.resolve())
    assert sorted(os.listdir(tmp_path / "links")) == ["a.fsmap", "new.fsmap"]
    with PlaceMap.open(path, read_only=True) as site:
        assert len(site) == STORED + 1


@pytest.mark.parametrize("read_only", [True, False])
def test_what_is_no_file_is_refused(tmp_path: Path, read_only: bool) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "loop").symlink_to("loop")
    names = ["pipe", "loop", "x" * 300, "a\0b", "/dev/null", ""]
    if read_only:  # else its folder is made
        names.append("none/a.fsmap")
    for name in names:
        assert not is_map(tmp_path / name)
        with pytest.raises(DataError):
            PlaceMap.open(tmp_path / name, read_only=read_only)


def as_another_user(work: Any) -> None:
    """Run something in a child process that may not write what root owns."""
    child = os.fork()
    if not child:
        code = 1
        try:
            os.setgid(65534)
            os.setuid(65534)
            work()
            code = 0
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(code)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


@pytest.fixture
def foreign(built: Path) -> Iterator[Path]:
    """A map that another user owns, in a folder that only that user may change."""
    if os.geteuid() != 0:
        pytest.skip("only root can become another user")
    with PlaceMap.open(built, read_only=True) as site:
        assert site.check() == []  # loads modules, which the other user may not be able to read
    # Folders of pytest belong to one user alone.
    with tempfile.TemporaryDirectory() as folder:
        os.chmod(folder, 0o755)
        yield Path(shutil.copy(built, folder))


def test_a_map_in_a_folder_that_cannot_be_written_is_read(foreign: Path) -> None:
    def read() -> None:
        with PlaceMap.open(foreign, read_only=True) as site:
            assert len(site) == STORED and site.check() == []
        for path in (foreign, foreign.with_name("new.fsmap")):
            with refuses("cannot-write", str(path)):
                PlaceMap.open(path, "tuesday")

    as_another_user(read)
    assert os.listdir(foreign.parent) == ["site.fsmap"]


def test_a_map_that_may_not_be_read_is_named(foreign: Path) -> None:
    foreign.chmod(0o600)

    def read() -> None:
        assert not is_map(foreign)
        with refuses("cannot-read", str(foreign)):
            PlaceMap.open(foreign, read_only=True)

    as_another_user(read)


def test_a_part_of_a_page_that_a_full_disk_left_is_no_damage(path: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy.fsmap"
    with PlaceMap.open(path, "monday") as site:
        site.add(FRAMES[STORED])
        for suffix in ("", "-wal"):
            shutil.copy(f"{path}{suffix}", f"{copy}{suffix}")
    with copy.open("ab") as file:
        file.write(bytes(1000))
    with PlaceMap.open(copy, "monday") as site:
        assert len(site) == STORED + 1 and site.check() == []
        site.add(FRAMES[STORED + 1])
    with PlaceMap.open(copy, read_only=True) as site:
        assert len(site) == STORED + 2 and site.check() == []


def test_a_full_file_system_keeps_what_was_acknowledged(tmp_path: Path) -> None:
    mount = ["mount", "-t", "tmpfs", "-o", "size=3m", "tmpfs", str(tmp_path)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("no file system can be mounted")
    try:
        path = tmp_path / "site.fsmap"
        kept = 0
        with PlaceMap.open(path, "monday", **OPTIONS) as site:
            with pytest.raises(DataError, check=lambda e: e.code == "cannot-write"):
                for frame in FRAMES * 9:
                    kept += site.add(frame).keyframe is not None
            assert len(site) == kept > 2
        with PlaceMap.open(path, read_only=True) as site:
            assert len(site) == kept and site.check() == []
    finally:
        subprocess.run(["umount", "--lazy", str(tmp_path)], check=True)


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE keyframe SET frame = 'x'",
        "UPDATE keyframe SET stamp_ns = 0.5",
        "UPDATE keyframe SET odometry = zeroblob(128)",
        "UPDATE keyframe SET session = 77",
        "UPDATE edge SET kind = 'x'",
        "UPDATE edge SET state = 'x'",
        "UPDATE edge SET a = 99",
        "UPDATE edge SET covariance = zeroblob(288)",
        "UPDATE cloud SET evidence = 7",
        "UPDATE cloud SET image = x'00'",
        "UPDATE cloud SET points = x'00'",
        "UPDATE session SET name = x'00'",
        "UPDATE setting SET value = '[1]'",
        "UPDATE setting SET value = '{'",
        "UPDATE vector SET rows = x'00'",
        "UPDATE cloud SET ground_level = 9e999",
        "DELETE FROM cloud",
        "DELETE FROM vector",
        "DROP TABLE edge",
    ],
)
@pytest.mark.parametrize("written", ["by damage", "by a map"])
def test_values_that_make_no_sense_are_damage(path: Path, statement: str, written: str) -> None:
    database = sqlite3.connect(path)
    try:
        database.execute(statement)
        if written == "by a map":
            restore_crcs(database)
        database.commit()
    except sqlite3.IntegrityError:
        pytest.skip("SQLite refuses it")
    finally:
        database.close()
    try:
        with PlaceMap.open(path, read_only=True) as site:
            problems = site.check()
            raise DataError("; ".join(problems) or "nothing found", code="damaged")
    except FusionSlamError as error:
        assert error.code == "damaged" and "nothing found" not in str(error)


OPTICAL = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])
"""robot_from_points of clouds whose z axis points ahead."""


def seen_from(frame: Frame, mount: Any, scale: float = 1.0) -> Frame:
    """What a scanner that is mounted otherwise sees of the same place."""
    assert frame.points is not None
    back = np.linalg.inv(mount)
    points = scale * (frame.points @ back[:3, :3].T + back[:3, 3])
    return Frame(
        index=frame.index,
        stamp_ns=frame.stamp_ns,
        points=points.astype(np.float32),
        odometry=frame.odometry,
        robot_from_points=mount,
    )


@pytest.mark.parametrize(
    ("mount", "scale", "code"),
    [(OPTICAL, 1.0, "not-up"), (np.eye(4), 1000.0, "far-points")],
)
def test_clouds_of_another_frame_or_unit_change_nothing(
    path: Path, mount: Any, scale: float, code: str
) -> None:
    with PlaceMap.open(path, "tuesday") as site:
        with refuses(code):
            site.add(seen_from(FRAMES[1], mount, scale))
        with refuses(code):
            site.localize(seen_from(FRAMES[1], mount, scale))
        assert len(site) == STORED and [each.name for each in site.sessions] == ["monday"]


def test_a_robot_whose_scanner_is_mounted_otherwise_is_found_where_it_is(path: Path) -> None:
    turned = at(0.3, 0.2, 90, 0.5)
    with PlaceMap.open(path, read_only=True) as site:
        poses = [site.localize(seen_from(FRAMES[1], mount)).pose for mount in (np.eye(4), turned)]
    assert poses[0] is not None and poses[1] is not None
    np.testing.assert_allclose(poses[0], poses[1], atol=0.05)


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"descriptor": "cm2dp"}, "no-colors"),
        ({"fusion": FusionConfig(source="cloud", frame="robot")}, "no-transform"),
    ],
)
def test_sensors_that_lack_what_the_map_needs_are_named(
    tmp_path: Path, changes: dict[str, Any], code: str
) -> None:
    path = tmp_path / "site.fsmap"
    with PlaceMap.open(path, "monday", **OPTIONS | changes) as site:
        with refuses(code):
            site.add(FRAMES[0])
        assert not len(site)


def flip_bit(data: bytes, place: int) -> bytes:
    return data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :]


@pytest.mark.parametrize(
    ("table", "column"),
    [
        ("keyframe", "odometry"),
        ("cloud", "evidence"),
        ("cloud", "image"),
        ("cloud", "points"),
        ("vector", "rows"),
        ("edge", "pose"),
        ("edge", "covariance"),
        ("solution", "poses"),
    ],
)
@pytest.mark.parametrize("place", [0.1, 0.5, 0.9])
def test_one_flipped_bit_is_damage(path: Path, table: str, column: str, place: float) -> None:
    if table == "solution":
        with PlaceMap.open(path) as site:
            site.solve()
    database = sqlite3.connect(path)
    value = database.execute(f"SELECT {column} FROM {table}").fetchone()[0]
    changed = flip_bit(value, int(place * len(value)))
    database.execute(f"UPDATE {table} SET {column} = ? WHERE {column} = ?", (changed, value))
    database.commit()
    database.close()
    with refuses("damaged", str(path)), PlaceMap.open(path, read_only=True) as site:
        raise DataError(
            "; ".join(site.check()), code="damaged" if site.check() else "", fields=(str(path),)
        )


def test_a_new_map_that_is_refused_leaves_no_file(tmp_path: Path) -> None:
    path = tmp_path / "new.fsmap"
    with pytest.raises(ConfigError):
        PlaceMap.open(path, "monday", descriptor="unknown")
    with refuses("session-name", error=ConfigError):
        PlaceMap.open(path, " ")
    assert not [*tmp_path.iterdir()]
    path.touch()  # somebody's own empty file
    with pytest.raises(ConfigError):
        PlaceMap.open(path, "monday", descriptor="unknown")
    assert [*tmp_path.iterdir()] == [path]


def test_readers_leave_no_files(path: Path) -> None:
    before = path.read_bytes()
    assert is_map(path)
    with PlaceMap.open(path, read_only=True) as one:
        with PlaceMap.open(path, read_only=True) as other:
            assert other.localize(FRAMES[0]).pose is not None
        assert one.localize(FRAMES[0]).pose is not None
    assert [*path.parent.iterdir()] == [path] and path.read_bytes() == before
    with PlaceMap.open(path, "monday") as site, PlaceMap.open(path, read_only=True) as reader:
        site.add(FRAMES[STORED])
        assert len(reader) == STORED
    assert [*path.parent.iterdir()] == [path]


def test_a_reader_sees_the_map_as_it_was(path: Path) -> None:
    with PlaceMap.open(path, "monday") as site, PlaceMap.open(path, read_only=True) as reader:
        for frame in FRAMES[STORED : STORED + 2]:
            site.add(frame)
        assert len(reader) == STORED
        assert reader.localize(FRAMES[1]).keyframe in range(STORED)
        assert reader.check() == []


def test_a_reader_of_a_forgotten_session_is_told_so(path: Path) -> None:
    with PlaceMap.open(path, "monday") as site, PlaceMap.open(path, read_only=True) as reader:
        assert reader.localize(FRAMES[0]).pose is not None
        site.forget("monday")
        site.add(FRAMES[STORED])  # under the number of a keyframe that the reader knows
        for look in (reader.cloud, reader.check, lambda: reader.localize(FRAMES[2])):
            with refuses("changed", str(path)):
                look()
        assert len(reader.trajectory("monday")[0]) == STORED
        assert len(site) == 1 and site.check() == []
    with PlaceMap.open(path, read_only=True) as again:
        assert len(again) == 1 and again.check() == []


def test_keyframes_of_a_session_that_is_missing_are_damage(path: Path) -> None:
    with sqlite3.connect(path) as database:
        database.execute("DELETE FROM session")
    database.close()
    with refuses("damaged", str(path)):
        PlaceMap.open(path, read_only=True)
