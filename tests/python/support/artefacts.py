# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings, maps and fleets that tests share, made once on a machine.

They stand in a folder of the user's cache (``FUSIONSLAM_TEST_ARTEFACTS`` names another one), each
below a name and a digest of what makes it: the package, these helpers, the maker's own file and the
libraries. All workers and all runs share them; a lock has each made once. Tests only read them, and
copy what they change (``copy_artefact``).
"""

import hashlib
import json
import os
import shutil
import stat
import sys
import sysconfig
import tempfile
import time
import warnings
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path

import platformdirs
from filelock import FileLock

import fusionslam

MANIFEST = "artefact.json"
_CONTENT = "content"
_DIGEST_BYTES = 8
_UNUSED_S = 7 * 86_400  # after which versions that nobody used go
_IN_USE_S = 3_600  # after which they go if there are more than
_KEPT = 3
_checked: dict[Path, Path] = {}


class ArtefactWarning(UserWarning):
    """Says why an artefact is made anew, or not kept."""


def artefact(name: str, make: Callable[[Path], object]) -> Path:
    """The folder that ``make`` filled, in this run or in a former one.

    Args:
        name: a file name; one for each maker.
        make: fills the empty folder that it gets, always with the same content.
    """
    folder = _root() / f"{name}-{_digest_of(make)}"
    if folder not in _checked:
        try:
            _checked[folder] = _find_or_make(folder, name, make)
        except OSError as error:  # a full or read-only disk; what make raises tells more by itself
            _warn(f"artefact {name} is not kept: {error}")
            _checked[folder] = _made(Path(tempfile.mkdtemp(dir=_fallback())), make)
    return _checked[folder]


def copy_artefact(source: Path, target: Path) -> Path:
    """Copy a folder or file of an artefact so that a test may change it; times are kept."""
    if source.is_file():
        copy = Path(shutil.copy2(source, target))
    else:
        copy = Path(shutil.copytree(source, target, symlinks=True))
    for path in (copy, *copy.rglob("*")):
        if not path.is_symlink():
            path.chmod(path.stat().st_mode | stat.S_IWUSR)
    return copy


def _find_or_make(folder: Path, name: str, make: Callable[[Path], object]) -> Path:
    with FileLock(folder.parent / f"{name}.lock"):
        if folder.exists():
            problem = _damage(folder)
            if problem is None:
                os.utime(folder / MANIFEST)
                return folder / _CONTENT
            _warn(f"artefact {name} is made anew: {problem}")
            _remove(folder)
        _remove_old(folder.parent.glob(f"{name}-{'[0-9a-f]' * 2 * _DIGEST_BYTES}"))
        try:
            return _made(folder, make)
        except BaseException:
            _remove(folder)
            raise


def _remove_old(versions: Iterable[Path]) -> None:
    """Remove unfinished versions, and those that nobody used lately but for the last few.

    Another checkout may use one at this time.
    """
    used = {}
    for each in versions:
        manifest = each / MANIFEST
        used[each] = manifest.stat().st_mtime if manifest.exists() else 0.0
    for place, each in enumerate(sorted(used, key=used.__getitem__, reverse=True)):
        age_s = time.time() - used[each]
        if age_s > _UNUSED_S or (place >= _KEPT and age_s > _IN_USE_S):
            _remove(each)


def _made(folder: Path, make: Callable[[Path], object]) -> Path:
    """Fill a folder where it stays, since what is made may name its path; the manifest is last."""
    content = folder / _CONTENT
    content.mkdir(parents=True)
    make(content)
    files = _describe(content)
    for path in (content, *content.rglob("*")):
        if not path.is_symlink():
            path.chmod(path.stat().st_mode & ~(stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH))
    (folder / MANIFEST).write_text(json.dumps(files), encoding="utf-8")
    return content


def _describe(content: Path) -> dict[str, str]:
    """Digest of each file, where a link leads, and what is a folder, by its path."""
    found = {}
    for path in sorted(content.rglob("*")):
        name = path.relative_to(content).as_posix()
        if path.is_symlink():
            found[name] = f"-> {path.readlink()}"
        else:
            found[name] = "folder" if path.is_dir() else _digest(path)
    return found


def _damage(folder: Path) -> str | None:
    """What differs from what was made, or None."""
    try:
        wanted = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        found = _describe(folder / _CONTENT)
        assert isinstance(wanted, dict), MANIFEST
    except (OSError, ValueError, AssertionError) as error:
        return f"it cannot be read ({error})"
    changed = sorted(name for name in {*wanted, *found} if wanted.get(name) != found.get(name))
    return f"{changed[0]} is not what was made" if changed else None


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=16)).hexdigest()


def _digest_of(make: Callable[[Path], object]) -> str:
    """Of what decides about the content: code, helpers, the maker's file, Python and libraries."""
    digest = hashlib.blake2b(_digest_of_code().encode(), digest_size=_DIGEST_BYTES)
    digest.update(Path(make.__code__.co_filename).read_bytes())
    return digest.hexdigest()


@cache
def _digest_of_code() -> str:
    package = Path(fusionslam.__file__).parent
    support = Path(__file__).parent
    files = [
        *sorted(path for path in package.rglob("*") if path.suffix in (".py", ".so")),
        *sorted(support.glob("*.py")),
    ]
    libraries = sorted(
        path.name for path in Path(sysconfig.get_path("purelib")).glob("*.dist-info")
    )
    digest = hashlib.blake2b(f"{sys.version} {libraries}".encode(), digest_size=16)
    for path in files:
        digest.update(path.read_bytes())
    return digest.hexdigest()


@cache
def _root() -> Path:
    """The folder of all artefacts, which can be written."""
    named = os.environ.get("FUSIONSLAM_TEST_ARTEFACTS")
    root = Path(named) if named else platformdirs.user_cache_path("fusionslam-tests")
    try:
        root.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=root):
            return root
    except OSError as error:
        _warn(f"artefacts are kept for this run only: {error}")
        return _fallback()


@cache
def _fallback() -> Path:
    """A folder that this process removes at its end."""
    kept = tempfile.TemporaryDirectory(prefix="fusionslam-artefacts-", ignore_cleanup_errors=True)
    _fallbacks.append(kept)
    return Path(kept.name)


_fallbacks: list[tempfile.TemporaryDirectory[str]] = []


def _remove(folder: Path) -> None:
    """Move a folder aside before it goes, so that nobody finds half of it."""
    aside = Path(tempfile.mkdtemp(dir=folder.parent, prefix=".gone-")) / "folder"
    folder.rename(aside)
    for path in (aside, *aside.rglob("*")):
        if path.is_dir() and not path.is_symlink():
            path.chmod(0o755)
    shutil.rmtree(aside.parent)


def _warn(text: str) -> None:
    warnings.warn(text, ArtefactWarning, stacklevel=4)
