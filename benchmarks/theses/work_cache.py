# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``WorkCache``: intermediate results in a folder, in files named by what they depend on."""

import hashlib
import json
import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from fusionslam import _core
from fusionslam.base.files import atomic_path
from fusionslam.errors import DataError

logger = logging.getLogger(__name__)

T = TypeVar("T")


@dataclass(frozen=True)
class WorkCache:
    """A folder of intermediate results.

    A result is finished if its file exists: files are written atomically, and their names carry a
    digest of everything configured that determines the content. Of the code it covers only the
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
        """Load the result stored under this name and configuration; else make and store it.

        Args:
            name: name of the result, for display.
            made_with: everything that determines the result, in types that JSON can hold.
            make: computes the result.
            save: writes a file, whole or not at all.
            load: reads it back; raises DataError if it is damaged.
            suffix: suffix of the file.

        Raises:
            DataError: the folder cannot be written; or from ``make``.
        """
        name = name.replace(":", "-")  # not every file system allows a colon
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
        """Return the file of a finished result."""
        text = json.dumps([_core.__version__, made_with], sort_keys=True)
        key = hashlib.sha256(text.encode()).hexdigest()[:12]
        return self.folder / f"{name}.{key}{suffix}"

    def _forget_others(self, name: str, path: Path) -> None:
        """Delete the result of another configuration."""
        for other in self.folder.glob(f"{name}.*{path.suffix}"):
            stem = other.name.removeprefix(f"{name}.").removesuffix(path.suffix)
            if other != path and len(stem) == 12:
                other.unlink(missing_ok=True)


def save_json(content: Any, path: Path) -> None:
    """Write JSON, whole or not at all. Raises DataError."""
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", "utf-8")


def load_json(path: Path) -> Any:
    """Read what ``save_json`` wrote. Raises DataError that names the file."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: cannot be read: {error}") from error


def state_of(path: Path) -> list[Any]:
    """Return values that change when a file changes. Raises DataError if it does not exist."""
    try:
        status = path.stat()
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror}") from error
    return [str(path.resolve()), status.st_size, status.st_mtime_ns]
