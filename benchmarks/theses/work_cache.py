# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Finished pieces of work in a folder, each under a name that says what it was made with."""

import hashlib
import json
import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from fusionslam import _core
from fusionslam.errors import DataError
from fusionslam.storage.files import atomic_path

logger = logging.getLogger(__name__)

T = TypeVar("T")


@dataclass(frozen=True)
class WorkCache:
    """A folder of pieces.

    A piece counts as finished if its file is there: files appear whole, and their names carry a
    digest of all that decides what is in them, as far as that is configured; of the code it is the
    version.
    """

    folder: Path

    def load_or_make(
        self,
        name: str,
        made_with: Mapping[str, Any],
        make: Callable[[], T],
        save: Callable[[T, Path], None],
        load: Callable[[Path], T],
        suffix: str = ".npz",
    ) -> T:
        """What is stored under this name if it was made with the same; else it is made and stored.

        Args:
            name: for people.
            made_with: all that decides what is in the piece, as JSON can hold it.
            make: does the work.
            save: writes a file, whole or not at all.
            load: reads it again; raises DataError where it is damaged.
            suffix: of the file.

        Raises:
            DataError: the folder cannot be written; or from ``make``.
        """
        name = name.replace(":", "-")  # which not every file system takes
        path = self.path(name, made_with, suffix)
        if path.exists():
            try:
                return load(path)
            except DataError as error:
                logger.warning("%s; made again", error)
        made = make()
        save(made, path)
        self._forget_others(name, path)
        return made

    def path(self, name: str, made_with: Mapping[str, Any], suffix: str = ".npz") -> Path:
        """Where a piece lies once it is finished."""
        text = json.dumps([_core.__version__, made_with], sort_keys=True)
        key = hashlib.sha256(text.encode()).hexdigest()[:12]
        return self.folder / f"{name}.{key}{suffix}"

    def _forget_others(self, name: str, path: Path) -> None:
        """Delete the piece that another configuration left."""
        for other in self.folder.glob(f"{name}.*{path.suffix}"):
            stem = other.name.removeprefix(f"{name}.").removesuffix(path.suffix)
            if other != path and len(stem) == 12:
                other.unlink(missing_ok=True)


def save_json(content: Any, path: Path) -> None:
    """Write JSON, whole or not at all. Raises DataError."""
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", "utf-8")


def load_json(path: Path) -> Any:
    """What ``save_json`` wrote. Raises DataError that names the file."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: cannot be read: {error}") from error


def state_of(path: Path) -> list[Any]:
    """What changes when a file does. Raises DataError where there is none."""
    try:
        status = path.stat()
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror}") from error
    return [str(path.resolve()), status.st_size, status.st_mtime_ns]
