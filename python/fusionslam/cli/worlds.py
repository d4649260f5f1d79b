# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Worlds as DATA: a drive through the world is recorded first, and kept."""

from pathlib import Path

from fusionslam.cli.console import progress
from fusionslam.cli.failures import needs_extra
from fusionslam.errors import DataError
from fusionslam.storage.progress import label_progress

_FILES = (".glb", ".world", ".sdf")


def record_if_world(data: Path, jobs: int) -> tuple[Path, str | None]:
    """Return the recording that DATA stands for, and the world's name if it is simulated.

    Args:
        data: a recording, which is returned as it is; else the name of a simulated world, or a
            world's file or folder.
        jobs: number of frames rendered in parallel.

    Raises:
        DataError: there is no such file or world, or the world cannot be read.
    """
    path = data.expanduser()
    if not path.exists():
        _check_name(path)
    elif not (path.suffix.lower() in _FILES if path.is_file() else _has_world(path)):
        return path, None
    for extra in ("sim", "bags"):
        needs_extra(extra)
    from fusionslam.sim.recordings import record_world

    with progress() as step:
        show = label_progress(step, f"driving: {path.name}")
        recorded = record_world(path, jobs=jobs, progress=show)
    return recorded, path.stem


def _has_world(folder: Path) -> bool:
    """Tell whether a folder is one of Gazebo's, with its world in worlds/."""
    return any(path.suffix in _FILES[1:] for path in folder.glob("worlds/*"))


def _check_name(path: Path) -> None:
    """Raise DataError unless a nonexistent path is the name of a simulated world."""
    from difflib import get_close_matches

    from fusionslam.sim.catalogue import MADE

    if str(path) in MADE:
        return
    near = get_close_matches(str(path), MADE, n=1, cutoff=0.5)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    raise DataError(
        f"{path} does not exist: expected a recording, a world's file or one of "
        f"{', '.join(MADE)}{hint}"
    )
