# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A ``RatSlam`` as one file, and back: it goes on as if nothing had been."""

import io
import json
import os
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.config import merged
from fusionslam.errors import DataError, FusionSlamError
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.ratslam.slam import Memory, RatSlam, RatSlamConfig
from fusionslam.ratslam.view_sources import KINDS, ViewSource
from fusionslam.storage.files import DAMAGED, atomic_path

FORMAT = "fusionslam.ratslam.1"
_PARTS = ("cells", "map", "alone")
_RUN, _VIEWS = "run", "views"

Arrays = dict[str, NDArray[Any]]


def save_ratslam(
    slam: RatSlam, path: str | os.PathLike[str], *, run: RatSlamRun | None = None
) -> None:
    """Write one .npz, whole or not at all: ``load_ratslam`` goes on exactly from here.

    Args:
        slam: with its cells, its map, and the source of its views.
        path: the file.
        run: what it did so far, to be kept with it.

    Raises:
        DataError: it cannot be written.
    """
    about = {
        "format": FORMAT,
        "config": slam.config.model_dump(mode="json"),
        "views": None if slam.views is None else slam.views.kind,
        "memory": asdict(slam.memory),
    }
    arrays: Arrays = {}
    for name in _PARTS:
        state = getattr(slam, name).state()
        arrays |= {f"{name}.{key}": np.asarray(value) for key, value in state.items()}
    if slam.views is not None:
        arrays[_VIEWS] = _array(slam.views.to_bytes())
    if run is not None:
        content = io.BytesIO()
        run.write(content)
        arrays[_RUN] = _array(content.getvalue())
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        np.savez(stream, about=np.array(json.dumps(about)), **arrays)  # type: ignore[arg-type]


def load_ratslam(path: str | os.PathLike[str], *, views: ViewSource | None = None) -> RatSlam:
    """Go on from what ``save_ratslam`` wrote.

    Args:
        path: the file.
        views: for a source that is none of ``KINDS``: the like of it, without views.

    Raises:
        DataError: missing, cut short, damaged, of another version or with another source of views;
            the message names the file.
    """
    about, arrays = _read(Path(path))
    try:
        slam = RatSlam(
            merged(RatSlamConfig(), about["config"]), views=_views(about["views"], views)
        )
        for name in _PARTS:
            getattr(slam, name).restore(_part(arrays, name))
        if slam.views is not None:
            slam.views.restore(arrays[_VIEWS].tobytes())
        slam.memory = Memory.of(about["memory"])
        _check(slam)
    except FusionSlamError as error:
        raise DataError(f"{path}: {error}") from error
    except (ValueError, KeyError, TypeError, IndexError, AttributeError) as error:
        raise DataError(f"{path}: no stored RatSLAM, or damaged: {error!r}") from error
    return slam


def stored_run(path: str | os.PathLike[str]) -> RatSlamRun | None:
    """What the ``RatSlam`` in a file did so far; None where that was not kept with it.

    Raises:
        DataError: as ``load_ratslam``.
    """
    _, arrays = _read(Path(path))
    if _RUN not in arrays:
        return None
    try:
        return RatSlamRun.read(io.BytesIO(arrays[_RUN].tobytes()))
    except (FusionSlamError, ValueError, KeyError, TypeError) as error:
        raise DataError(f"{path}: its run cannot be read: {error}") from error


def _views(kind: str | None, given: ViewSource | None) -> ViewSource | None:
    """The source, without views, into which they are read."""
    if given is not None:
        if given.kind != kind:
            raise DataError(f"it recognises by {kind or 'nothing'}, expected {given.kind}")
        return given
    if kind is None:
        return None
    if kind not in KINDS:
        raise DataError(f"it recognises by {kind}: name a source like that (views=...)")
    return KINDS[kind]()


def _check(slam: RatSlam) -> None:
    nodes = len(slam.map.nodes)
    made = (len(slam.memory.node_stamps_ns), len(slam.memory.node_views))
    if made != (nodes, nodes):
        raise DataError(f"{nodes} nodes, but stamps and views of {made}")


def _part(arrays: Arrays, name: str) -> Arrays:
    return {
        key.removeprefix(f"{name}."): array
        for key, array in arrays.items()
        if key.startswith(f"{name}.")
    }


def _array(content: bytes) -> NDArray[np.uint8]:
    return np.frombuffer(content, np.uint8)


def _read(path: Path) -> tuple[dict[str, Any], Arrays]:
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
            about = json.loads(str(stored["about"]))
            found = about.get("format")
            if found != FORMAT:
                raise DataError(f"{path}: is of format {found}, expected {FORMAT}")
            return about, {name: stored[name] for name in stored.files if name != "about"}
    except OSError as error:
        raise DataError(f"cannot read {path}: {error.strerror or error}") from error
    except DataError:
        raise
    except DAMAGED as error:
        raise DataError(f"{path}: no stored RatSLAM, or cut short: {error}") from error
