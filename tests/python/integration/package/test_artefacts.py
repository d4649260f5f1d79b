# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Artefacts of the suite: made once, found again, made anew where anything is wrong with them."""

import errno
import json
import os
import sys
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

import artefacts
from artefacts import ArtefactWarning, artefact, copy_artefact
from permissions import exit_code_of, fork
from rows import rows


def make(folder: Path) -> None:
    """A file, a link to it, and a folder with a program."""
    (folder / "scan.bin").write_bytes(b"points")
    (folder / "link").symlink_to("scan.bin")
    (folder / "more").mkdir()
    (folder / "more" / "program").write_text("#!/bin/sh\n")
    (folder / "more" / "program").chmod(0o755)
    with (artefacts._root() / "makes").open("a") as file:
        file.write(f"{folder}\n")


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of artefacts of its own."""
    root = tmp_path / "root"
    root.mkdir()
    monkeypatch.setattr(artefacts, "_root", lambda: root)
    monkeypatch.setattr(artefacts, "_checked", {})
    yield root
    for path in root.rglob("*"):
        if path.is_dir() and not path.is_symlink():
            path.chmod(0o755)


def in_the_next_run(maker: Callable[[Path], object] = make) -> Path:
    artefacts._checked.clear()
    return artefact("drive", maker)


def makes(root: Path) -> int:
    path = root / "makes"
    return len(path.read_text().splitlines()) if path.exists() else 0


def test_an_artefact_is_made_once_and_found_again(root: Path) -> None:
    with warnings.catch_warnings(action="error"):
        first = artefact("drive", make)
        assert artefact("drive", make) == first
        assert in_the_next_run() == first
    assert makes(root) == 1
    assert (first / "link").read_bytes() == b"points"
    assert not first.stat().st_mode & 0o222
    assert not (first / "scan.bin").stat().st_mode & 0o222
    assert (first / "more" / "program").stat().st_mode & 0o777 == 0o555


def write_over(path: Path, text: str) -> None:
    path.parent.chmod(0o755)
    path.unlink(missing_ok=True)
    path.write_text(text)


def remove(path: Path) -> None:
    path.parent.chmod(0o755)
    path.unlink()


@rows(
    "change, problem",
    [
        (lambda made: write_over(made / "scan.bin", "other!"), "scan.bin is not what was made"),
        (lambda made: remove(made / "more" / "program"), "more/program is not what was made"),
        (lambda made: write_over(made / "more" / "new", ""), "more/new is not what was made"),
        (lambda made: remove(made / "link"), "link is not what was made"),
        (lambda made: remove(made.parent / artefacts.MANIFEST), "cannot be read"),
        (lambda made: write_over(made.parent / artefacts.MANIFEST, '{"scan'), "cannot be read"),
        (lambda made: write_over(made.parent / artefacts.MANIFEST, "[]"), "cannot be read"),
    ],
)
def test_what_is_damaged_missing_added_or_not_finished_is_made_anew_and_says_so(
    change: Callable[[Path], object],
    problem: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(artefacts, "_root", lambda: tmp_path)
    monkeypatch.setattr(artefacts, "_checked", {})
    change(artefact("drive", make))
    with pytest.warns(ArtefactWarning, match=rf"drive is made anew: .*{problem}"):
        again = in_the_next_run()
    assert makes(tmp_path) == 2
    assert (again / "link").read_bytes() == b"points"
    assert in_the_next_run() == again
    assert makes(tmp_path) == 2
    assert sorted(os.listdir(tmp_path)) == sorted(
        [again.parent.name, "drive.lock", "makes"]
    )  # nothing is left of the damaged one


def test_another_maker_makes_another_artefact(root: Path, tmp_path: Path) -> None:
    found = []
    for text in ("one", "two"):
        (tmp_path / "maker.py").write_text(
            f"def make(folder):\n    (folder / 'a').write_text('{text}')\n"
        )
        spec = spec_from_file_location("maker", tmp_path / "maker.py")
        maker = module_from_spec(spec)
        sys.dont_write_bytecode, before = True, sys.dont_write_bytecode
        spec.loader.exec_module(maker)
        sys.dont_write_bytecode = before
        found.append(in_the_next_run(maker.make))
        assert (found[-1] / "a").read_text() == text
    assert found[0] != found[1] and found[0].is_dir()


def test_versions_that_nobody_used_for_a_week_go_and_others_stay(root: Path) -> None:
    made = artefact("drive", make)
    names = {
        "drive-0123456789abcdef": 8,  # days since it was used
        "drive-fedcba9876543210": 6,
        "drive-in-rain-0123456789abcdef": 8,
    }
    now = (made.parent / artefacts.MANIFEST).stat().st_mtime
    for name, days in names.items():
        (root / name / "content").mkdir(parents=True)
        manifest = root / name / artefacts.MANIFEST
        manifest.write_text(json.dumps({}))
        os.utime(manifest, (now - days * 86_400,) * 2)
    (root / "drive-0000000000000000").mkdir()  # of a run that was killed
    (root / "drive-in-rain-0000000000000000").mkdir()  # which another process makes just now
    (made.parent / artefacts.MANIFEST).unlink()
    with pytest.warns(ArtefactWarning):
        in_the_next_run()
    assert {path.name for path in root.glob("drive-*")} == {
        made.parent.name,
        "drive-fedcba9876543210",
        "drive-in-rain-0123456789abcdef",
        "drive-in-rain-0000000000000000",
    }


def test_a_full_disk_does_not_stop_the_tests(root: Path) -> None:
    def fill(folder: Path) -> None:
        make(folder)
        if folder.is_relative_to(root):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with pytest.warns(ArtefactWarning, match="drive is not kept: .*No space left"):
        made = artefact("drive", fill)
    assert not made.is_relative_to(root) and (made / "link").read_bytes() == b"points"
    assert not list(root.glob("drive-*"))


def test_a_maker_that_fails_leaves_nothing_and_tells_why(root: Path) -> None:
    def fail(folder: Path) -> None:
        make(folder)
        raise ValueError("no such drive")

    for _ in range(2):
        with pytest.raises(ValueError, match="no such drive"):
            artefact("drive", fail)
        assert not list(root.glob("drive-*"))


def test_a_folder_that_cannot_be_written_does_not_stop_the_tests(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("FUSIONSLAM_TEST_ARTEFACTS", str(tmp_path / "file" / "root"))
    with pytest.warns(ArtefactWarning, match="kept for this run only"):
        assert artefacts._root.__wrapped__() == artefacts._fallback()
    monkeypatch.setenv("FUSIONSLAM_TEST_ARTEFACTS", str(tmp_path / "new" / "root"))
    assert artefacts._root.__wrapped__() == tmp_path / "new" / "root"


def test_copies_can_be_written(root: Path, tmp_path: Path) -> None:
    made = artefact("drive", make)
    copy = copy_artefact(made, tmp_path / "copy")
    assert copy == tmp_path / "copy" and (copy / "link").is_symlink()
    assert (copy / "scan.bin").stat().st_mtime_ns == (made / "scan.bin").stat().st_mtime_ns
    assert (copy / "more" / "program").stat().st_mode & 0o777 == 0o755
    (copy / "more" / "new").write_text("")
    for target in (tmp_path / "other.bin", tmp_path):
        file = copy_artefact(made / "scan.bin", target)
        file.write_bytes(b"changed")
    assert file == tmp_path / "scan.bin"
    assert (made / "scan.bin").read_bytes() == b"points"
    assert in_the_next_run() == made


def test_two_processes_at_once_share_it(root: Path) -> None:
    """The first one to make it goes on when the other has asked for it."""
    first, second = root / "asks-0", root / "asks-1"

    def make_when_both_ask(folder: Path) -> None:
        while not (first.exists() and second.exists()):
            os.sched_yield()
        make(folder)

    def ask(asks: Path) -> None:
        asks.touch()
        assert (artefact("drive", make_when_both_ask) / "link").read_bytes() == b"points"

    children = [fork(partial(ask, asks)) for asks in (first, second)]
    assert [exit_code_of(child) for child in children] == [0, 0]
    assert makes(root) == 1
