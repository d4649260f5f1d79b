# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A file is the old one or the new one, whatever happens, and nothing is left behind that grows."""

import os
import resource
import signal
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from error_codes import has_code
from fusionslam.base import files
from fusionslam.base.files import atomic_path, scratch_folder
from fusionslam.errors import DataError
from fusionslam.fusion import FusionConfig
from fusionslam.pipelines.export_folder import write_clouds
from fusionslam.pipelines.recording import Recording
from fuzz import killed_writers
from fuzz.killed_writers import REPLACING, KillCount, Writer, kill_writer
from kitti import write_sequence
from permissions import exit_code_of, fork
from rows import rows


def write(path: Path, text: str) -> None:
    with atomic_path(path) as temporary:
        temporary.write_text(text)


@contextmanager
def umask(mask: int) -> Iterator[None]:
    before = os.umask(mask)
    try:
        yield
    finally:
        os.umask(before)


def mode_of(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


@rows("mask, mode", [(0o022, 0o644), (0o077, 0o600), (0o002, 0o664)])
def test_a_new_file_has_the_mode_of_the_process(tmp_path: Path, mask: int, mode: int) -> None:
    with umask(mask):
        write(tmp_path / "a", "new")
    assert mode_of(tmp_path / "a") == mode


@rows("mode", [0o600, 0o640, 0o664])
def test_a_file_that_is_written_again_keeps_its_mode(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "a"
    path.write_text("old")
    path.chmod(mode)
    with atomic_path(path) as temporary:
        assert not mode_of(temporary) & ~mode
        temporary.write_text("new")
    assert (path.read_text(), mode_of(path)) == ("new", mode)


def test_a_link_is_kept_and_what_it_leads_to_is_replaced(tmp_path: Path) -> None:
    for folder in ("real", "links"):
        (tmp_path / folder).mkdir()
    (tmp_path / "real/a").write_text("old")
    (tmp_path / "links/a").symlink_to("../real/a")
    (tmp_path / "links/b").symlink_to("a")
    (tmp_path / "links/new").symlink_to("../real/new")
    for name in ("a", "b", "new"):
        write(tmp_path / "links" / name, name)
        assert (tmp_path / "links" / name).is_symlink()
        assert (tmp_path / "links" / name).read_text() == name
    assert sorted(os.listdir(tmp_path / "real")) == ["a", "new"]
    (tmp_path / "links/loop").symlink_to("loop")
    with pytest.raises(DataError, check=has_code("cannot-write")):
        write(tmp_path / "links/loop", "no")


def test_the_name_of_a_temporary_file_cannot_be_guessed_or_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with atomic_path(tmp_path / "a") as one, atomic_path(tmp_path / "a") as other:
        assert one != other
    victim = tmp_path / "victim"
    victim.write_text("kept")
    monkeypatch.setattr(files.secrets, "token_hex", lambda _: "0" * 16)
    with atomic_path(tmp_path / "a") as temporary:
        planted = temporary
    planted.symlink_to(victim)
    with pytest.raises(DataError, check=has_code("cannot-write")):
        write(tmp_path / "a", "over")
    assert victim.read_text() == "kept"


def test_long_names_are_written(tmp_path: Path) -> None:
    name = "\N{CJK UNIFIED IDEOGRAPH-4E00}" * 85
    write(tmp_path / name, "x")
    assert os.listdir(tmp_path) == [name]


def test_what_killed_writers_leave_is_deleted_by_the_next(tmp_path: Path) -> None:
    def begin() -> None:
        with atomic_path(tmp_path / "a") as temporary, scratch_folder(tmp_path / "b") as folder:
            (folder / "part").write_text("x")
            temporary.with_name(f"{temporary.name}.7.0.tmp").write_text("of the C++ core")
            os.kill(os.getpid(), signal.SIGKILL)

    others = (".hidden", ".a.fusionslam-00000000-1-0123456789abcdef", "a.fusionslam")
    for name in others:
        (tmp_path / name).write_text("of others")
    assert exit_code_of(fork(begin)) == -signal.SIGKILL
    assert len(os.listdir(tmp_path)) == 6
    with atomic_path(tmp_path / "c") as alive:
        write(tmp_path / "a", "new")
        assert alive.exists()
        alive.write_text("c")
    assert sorted(os.listdir(tmp_path)) == sorted([*others, "a", "c"])


def test_old_leftovers_of_other_machines_are_deleted(tmp_path: Path) -> None:
    left = tmp_path / ".a.fusionslam-00000000-1-0123456789abcdef"
    left.write_text("old")
    os.utime(left, (0, 0))
    write(tmp_path / "a", "new")
    assert os.listdir(tmp_path) == ["a"]


@pytest.mark.slow
@rows("name", REPLACING)
def test_a_killed_writer_leaves_the_old_or_the_new_file(tmp_path: Path, name: str) -> None:
    assert kill_writer(REPLACING[name], tmp_path, kills=2) == KillCount(kills=2, lost=0, left=0)


def test_kills_of_a_writer_that_is_not_atomic_lose_and_leave_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    this = os.getpid()

    def save(folder: Path) -> None:
        (folder / f"of process {os.getpid()}").touch()
        (folder / "a").write_text("")
        if os.getpid() != this:
            os.kill(os.getpid(), signal.SIGKILL)
        (folder / "a").write_text("whole")

    def check(folder: Path) -> None:
        assert (folder / "a").read_text() == "whole"

    def wait_for_its_end(_: float) -> None:
        os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOWAIT)

    monkeypatch.setattr(killed_writers.time, "sleep", wait_for_its_end)
    assert kill_writer(Writer(save, check), tmp_path, kills=3) == KillCount(3, lost=3, left=3)


@pytest.mark.slow
def test_a_killed_fuse_leaves_whole_clouds_and_the_next_completes_them(tmp_path: Path) -> None:
    sequence = write_sequence(tmp_path, [0, 1, 2, 3] * 5, [4000] * 20, metres=3, width=64)
    recording = Recording.at(sequence)

    def write(folder: Path, last: int = -1) -> None:
        def kill(done: int, _: int) -> None:
            if done == last:
                os.kill(os.getpid(), signal.SIGKILL)

        write_clouds(recording, folder, FusionConfig(), jobs=2, progress=kill)

    def clouds(folder: Path) -> dict[str, bytes]:
        return {path.name: path.read_bytes() for path in (folder / "clouds").iterdir()}

    write(tmp_path / "whole")
    whole, names = clouds(tmp_path / "whole"), sorted(os.listdir(tmp_path / "whole"))
    for last in np.linspace(1, 19, 3).astype(int):
        folder = tmp_path / str(last)
        assert exit_code_of(fork(partial(write, folder, last))) == -signal.SIGKILL
        found = {name: data for name, data in clouds(folder).items() if name[0] != "."}
        assert len(found) >= last and found.items() <= whole.items()
        files._cleaned.clear()
        write(folder)
        assert clouds(folder) == whole and sorted(os.listdir(folder)) == names


@pytest.mark.parametrize("share", [0.0, pytest.param(0.1, marks=pytest.mark.nightly), 0.9])
@rows("name", REPLACING)
def test_a_full_disk_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, name: str, share: float
) -> None:
    save, check = REPLACING[name].save, REPLACING[name].check
    save(tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    room = int(share * max(map(len, before.values())))

    def save_without_room() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))
        with pytest.raises(DataError, check=has_code("cannot-write")):
            save(tmp_path)

    assert exit_code_of(fork(save_without_room)) == 0
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    check(tmp_path)
