# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Maps answer bad input by typed errors, and lose nothing."""

import os
import pickle
import shutil
import signal
import sqlite3
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from artefacts import copy_artefact
from fusionslam import ConfigError, DataError, FusionConfig, ShapeError
from fusionslam.mapping.map_database import is_map
from fusionslam.mapping.map_file import MapFile
from fusionslam.mapping.place_map import PlaceMap
from fusionslam.pipelines.place_maps import export_map
from fusionslam.sensors.frame import Frame
from fuzz.bit_flips import DATABASES, flip_bits, flipped
from fuzz.crafted_files import ENDLESS, MAPS
from map_fixtures import FRAMES, STORED, build
from map_rows import restore_crcs
from refusals import refuses
from rows import rows
from streets import OPTIONS, at, changed

pytest.importorskip("gtsam", reason="the library of pose graphs is an extra")


@rows("name", ["", " ", "a\0b", "a\n", "\ud800", 5, b"monday", "x" * 201, "\u00e4" * 101])
def test_names_of_sessions_are_printable_and_short(short: Path, name: Any) -> None:
    with refuses("session-name", error=ConfigError):
        PlaceMap.open(short, name)


def test_other_names_of_sessions_are_kept(short: Path) -> None:
    names = ["../x", "Montag früh", "'; DROP TABLE session; --", "x" * 200]
    for name in names:
        build(short, FRAMES[:1], name)
    with PlaceMap.open(short, read_only=True) as site:
        assert [each.name for each in site.sessions] == ["monday", *names]


SCALED, MIRRORED, SHEARED = at(20, 0, 0), at(20, 0, 0), at(20, 0, 0)
SCALED[:3, :3] *= 2
MIRRORED[2, 2] = -1
SHEARED[3] = 1, 2, 3, 4


def test_odometry_that_is_no_rigid_motion_changes_nothing(short: Path) -> None:
    wrong: dict[str, list[Any]] = {
        "not-finite": [np.full((4, 4), np.nan), at(np.inf, 0, 0)],
        "not-a-rotation": [SCALED, MIRRORED, SHEARED, np.zeros((4, 4))],
        "shape": [np.eye(3), "north"],
    }
    with PlaceMap.open(short, "monday") as site:
        for code, odometry in ((code, one) for code, some in wrong.items() for one in some):
            error = ShapeError if code == "shape" else DataError
            for ask in (site.add, site.localize):
                with refuses(code, error=error):
                    ask(FRAMES[STORED], odometry=odometry)
            assert len(site) == STORED
        assert site.add(FRAMES[STORED]).why is None  # what was refused was no jump either


def test_numbers_of_frames_are_integers(short: Path) -> None:
    last = FRAMES[STORED]
    with PlaceMap.open(short, "monday") as site:
        for number in (-1, 2**70, 1.5):
            with refuses("frame-number"):
                site.add(changed(last, index=0, number=number))
        with pytest.raises(ShapeError):
            site.add(last.points)
        assert len(site) == STORED


def test_stamps_that_go_back_are_kept_in_the_order_of_the_frames(short: Path) -> None:
    stamps = [-5, 2**63 - 1, 0]
    with PlaceMap.open(short, "monday") as site:
        for stamp, seen in zip(stamps, FRAMES[STORED:], strict=False):
            site.add(changed(seen, stamp_ns=stamp))
    with PlaceMap.open(short, read_only=True) as site:
        assert site.trajectory("monday")[0][STORED:].tolist() == stamps
        assert site.check() == []


def test_threads_share_a_map(short: Path) -> None:
    with PlaceMap.open(short, "monday") as site, ThreadPoolExecutor(4) as pool:

        def add(number: int) -> int | None:
            assert site.localize(FRAMES[0]).reason is None and site.sessions
            return site.add(FRAMES[number]).keyframe

        keyframes = [*pool.map(add, range(STORED, STORED + 4))]
        assert sorted(k for k in keyframes if k is not None) == [*range(STORED, STORED + 4)]
        assert site.check() == [] and len(site) == STORED + 4


def test_an_open_map_cannot_be_pickled(short: Path) -> None:
    with PlaceMap.open(short) as site, pytest.raises(TypeError, match=str(short)):
        pickle.dumps(site)


def test_a_link_leads_to_the_map_and_stays(short: Path, tmp_path: Path) -> None:
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
    with PlaceMap.open(short, read_only=True) as site:
        assert len(site) == STORED + 1


@rows("read_only", [True, False])
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


def test_a_part_of_a_page_that_a_full_disk_left_is_no_damage(short: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy.fsmap"
    with PlaceMap.open(short, "monday") as site:
        site.add(FRAMES[STORED])
        for suffix in ("", "-wal"):
            shutil.copyfile(f"{short}{suffix}", f"{copy}{suffix}")
    with copy.open("ab") as file:
        file.write(bytes(1000))
    with PlaceMap.open(copy, "monday") as site:
        assert len(site) == STORED + 1 and site.check() == []
        site.add(FRAMES[STORED + 1])
    with PlaceMap.open(copy, read_only=True) as site:
        assert len(site) == STORED + 2 and site.check() == []


@rows("written", ["by damage", "by a map"])
@rows(
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
        "INSERT INTO setting VALUES ('reason', '{\"code\": 1}', 0)",
        "UPDATE vector SET rows = x'00'",
        "UPDATE cloud SET ground_level = 9e999",
        "DELETE FROM cloud",
        "DELETE FROM vector",
        "DELETE FROM session",
        "DROP TABLE edge",
    ],
)
def test_senseless_values_are_damage(
    first_part: Path, tmp_path: Path, statement: str, written: str
) -> None:
    path = copy_artefact(first_part, tmp_path / "site.fsmap")
    with closing(sqlite3.connect(path)) as database:
        try:
            database.execute(statement)
        except sqlite3.IntegrityError:
            return  # SQLite refuses it
        if written == "by a map":
            restore_crcs(database)
        database.commit()
    check_damage(path)


def check_damage(path: Path) -> None:
    """A map is said to be damaged, in few words, when it is opened, or when it is checked."""
    try:
        with PlaceMap.open(path, read_only=True) as site:
            problems = site.check()
    except DataError as error:
        assert error.code == "damaged", error
        problems = [str(error)]
    assert problems and all(len(each) < 800 for each in problems)


OPTICAL = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])
"""robot_from_points of clouds whose z axis points ahead."""


def seen_from(frame: Frame, mount: Any, scale: float = 1.0) -> Frame:
    """What a scanner that is mounted otherwise sees of the same place."""
    assert frame.points is not None
    back = np.linalg.inv(mount)
    points = scale * (frame.points @ back[:3, :3].T + back[:3, 3])
    return changed(frame, points=points.astype(np.float32), robot_from_points=mount)


@rows("mount, scale, code", [(OPTICAL, 1.0, "not-up"), (np.eye(4), 1000.0, "far-points")])
def test_clouds_of_another_frame_or_unit_change_nothing(
    short: Path, mount: Any, scale: float, code: str
) -> None:
    seen = seen_from(FRAMES[1], mount, scale)
    with PlaceMap.open(short, "tuesday") as site:
        for ask in (site.add, site.localize):
            with refuses(code):
                ask(seen)
        assert len(site) == STORED and [each.name for each in site.sessions] == ["monday"]


def test_a_map_of_an_optical_frame_is_told_when_built_and_exported(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with PlaceMap.open(tmp_path / "site.fsmap", "monday", **OPTIONS) as site:
        for frame in FRAMES[:3]:
            assert frame.points is not None
            ahead = frame.points[frame.points[:, 0] > 2 * np.abs(frame.points[:, 1:]).max(axis=1)]
            turned = ahead @ OPTICAL[:3, :3]
            site.add(Frame(index=frame.index, points=turned, odometry=frame.odometry))
        assert len(caplog.messages) >= 3 and all("optical" in each for each in caplog.messages)
        caplog.clear()
        export_map(site, tmp_path / "export")
        count = len(site)
    (message,) = caplog.messages
    assert f"{count} of {count} keyframes" in message and "optical" in message


def test_a_robot_whose_scanner_is_mounted_otherwise_is_found_where_it_is(short: Path) -> None:
    turned = at(0.3, 0.2, 90, 0.5)
    with PlaceMap.open(short, read_only=True) as site:
        poses = [site.localize(seen_from(FRAMES[1], mount)).pose for mount in (np.eye(4), turned)]
    assert poses[0] is not None and poses[1] is not None
    np.testing.assert_allclose(poses[0], poses[1], atol=0.05)


@rows(
    "changes, code",
    [
        ({"descriptor": "cm2dp"}, "no-colors"),
        ({"fusion": FusionConfig(source="cloud", frame="robot")}, "no-transform"),
    ],
)
def test_sensors_that_lack_something_are_named(
    tmp_path: Path, changes: dict[str, Any], code: str
) -> None:
    with PlaceMap.open(tmp_path / "site.fsmap", "monday", **OPTIONS | changes) as site:
        with refuses(code):
            site.add(FRAMES[0])
        assert not len(site)


@rows(
    "table, column",
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
def test_a_flipped_bit_is_damage(first_part: Path, tmp_path: Path, table: str, column: str) -> None:
    path = copy_artefact(first_part, tmp_path / "site.fsmap")
    if table == "solution":
        with PlaceMap.open(path) as site:
            site.solve()
    whole = path.read_bytes()
    for place in (0.1, 0.5, 0.9):
        path.write_bytes(whole)
        with closing(sqlite3.connect(path)) as database:
            value = database.execute(f"SELECT {column} FROM {table}").fetchone()[0]
            other = flipped(value, 8 * int(place * len(value)))
            change = f"UPDATE {table} SET {column} = ? WHERE {column} = ?"
            database.execute(change, (other, value))
            database.commit()
        check_damage(path)


def test_frames_for_a_file_that_was_replaced_are_refused(short: Path, tmp_path: Path) -> None:
    backup = Path(shutil.copy(short, tmp_path / "backup.fsmap"))
    site = PlaceMap.open(short, "monday")
    site.add(FRAMES[STORED])
    os.replace(backup, short)
    with refuses("replaced", str(short)):
        site.add(FRAMES[STORED + 1])
    assert len(site) == STORED + 1
    with refuses("replaced", str(short)):
        site.close()


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


def test_readers_leave_no_files(short: Path) -> None:
    before = short.read_bytes()
    assert is_map(short)
    with PlaceMap.open(short, read_only=True) as one:
        with PlaceMap.open(short, read_only=True) as other:
            assert other.localize(FRAMES[0]).pose is not None
        assert one.localize(FRAMES[0]).pose is not None
    assert [*short.parent.iterdir()] == [short] and short.read_bytes() == before
    with PlaceMap.open(short, "monday") as site, PlaceMap.open(short, read_only=True) as reader:
        site.add(FRAMES[STORED])
        assert len(reader) == STORED
    assert [*short.parent.iterdir()] == [short]


def test_a_reader_sees_the_map_as_it_was(short: Path) -> None:
    with PlaceMap.open(short, "monday") as site, PlaceMap.open(short, read_only=True) as reader:
        for frame in FRAMES[STORED : STORED + 2]:
            site.add(frame)
        assert len(reader) == STORED
        assert reader.localize(FRAMES[1]).keyframe in range(STORED)
        assert reader.check() == []


def test_a_reader_of_a_forgotten_session_is_told_so(short: Path) -> None:
    with PlaceMap.open(short, "monday") as site, PlaceMap.open(short, read_only=True) as reader:
        assert reader.localize(FRAMES[0]).pose is not None
        site.forget("monday")
        site.add(FRAMES[STORED])  # under the number of a keyframe that the reader knows
        for look in (reader.cloud, reader.check, lambda: reader.localize(FRAMES[2])):
            with refuses("changed", str(short)):
                look()
        assert len(reader.trajectory("monday")[0]) == STORED
        assert len(site) == 1 and site.check() == []
    with PlaceMap.open(short, read_only=True) as again:
        assert len(again) == 1 and again.check() == []


FLIPS = int(os.environ.get("FUSIONSLAM_FLIPS", "40").replace("all", "3000"))


@rows("name", MAPS)
def test_a_crafted_map_is_refused_at_once(first_part: Path, tmp_path: Path, name: str) -> None:
    path = copy_artefact(first_part, tmp_path / "site.fsmap")
    MAPS[name](path)
    before, began = path.read_bytes(), time.process_time()
    check_damage(path)
    assert time.process_time() - began < 1.0
    assert path.read_bytes() == before and [*tmp_path.iterdir()] == [path]


def test_ctrl_c_ends_a_statement(short: Path) -> None:
    with MapFile(short, read_only=True) as file:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.02)
        before = signal.signal(signal.SIGVTALRM, signal.default_int_handler)
        try:
            with pytest.raises(KeyboardInterrupt):
                for _ in range(50):
                    with refuses("damaged"):  # each ends by itself
                        file._all(f"{ENDLESS} SELECT id FROM n WHERE id < 0")
        finally:
            signal.setitimer(signal.ITIMER_VIRTUAL, 0)
            signal.signal(signal.SIGVTALRM, before)


def bits_of_all_parts(tried: int, whole: bytes) -> Iterator[int]:
    """Of the header, of what is not 0, as pages that are not full end in 0, and anywhere."""
    rng, used = np.random.default_rng(tried), np.flatnonzero(np.frombuffer(whole, np.uint8))
    for part in (np.arange(100), used, np.arange(len(whole))):
        for place in rng.choice(part, tried // 3).tolist():
            yield 8 * place + int(rng.integers(8))


@pytest.mark.parametrize("tried", [90, pytest.param(30 * FLIPS, marks=pytest.mark.nightly)])
def test_a_flipped_bit_anywhere_is_found_or_changes_nothing(
    first_part: Path, tmp_path: Path, tried: int
) -> None:
    def write(path: Path) -> None:
        with PlaceMap.open(copy_artefact(first_part, path)) as site:
            site.solve()

    def check(path: Path) -> None:
        with MapFile(path, read_only=True) as file:
            if problems := file.check():
                raise DataError(problems[0], code="damaged")

    form = replace(DATABASES["map"], write=write, check=check)
    found = flip_bits(form, tmp_path, partial(bits_of_all_parts, tried))
    assert not found.silent
    assert found.refused > tried / 3
