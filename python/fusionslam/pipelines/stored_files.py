# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Describe files of results that fusionslam stored: their kind, metadata and counts."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from fusionslam.errors import DataError
from fusionslam.storage.archive import format_of, load_archive, load_json

_PREFIX = "fusionslam."
_IN_FOLDERS = ("detector.json", "run.json")
_KINDS: Mapping[str, str] = {
    "aligned_loops": "loops with their transforms",
    "calib_check": "result of calib-check",
    "described_frames": "frames of a describe that was interrupted; the same command goes on",
    "descriptor_run": "descriptors of a recording, for eval, report and bench",
    "experience_map": "map for other programs, by ratslam",
    "loop_detector": "frames of a LoopDetector, for LoopDetector.load",
    "map_report": "judgement of a map, by ratslam",
    "network": "weights of a network of the second stage",
    "precision_recall": "precision and recall of loops, by eval",
    "ratslam": "state of a map, for ratslam --resume",
    "ratslam_run": "map with all steps that led to it, by ratslam",
    "training": "checkpoint of a training, which the same command resumes",
    "tuning": "state of a tuning, which the same command resumes",
    "view_bench": "tables of bench views",
    "view_curve": "ids judged at many thresholds, by views curve",
    "view_matcher": "views of places, by views match",
    "view_run": "ids of views with the true poses, by views match or bench views",
    "view_source": "views of a ROS node",
    "visual_templates": "visual templates of images",
    "work": "folder of results, which the same command resumes",
}
"""What each format holds, by its name without version."""


_COUNTS: Mapping[str, Mapping[str, str]] = {
    "descriptor_run": {"frames": "frames"},
    "ratslam": {"nodes": "map.nodes", "links": "map.ends"},
    "ratslam_run": {"nodes": "nodes", "links": "links", "steps": "stamps_ns"},
    "view_matcher": {"views": "slots"},
}
"""Arrays of a format whose length is the number of something."""


def stored_rows(path: Path) -> list[tuple[str, str]] | None:
    """Return (label, value) pairs about a stored file or folder; None for anything else.

    Raises:
        DataError: the file is damaged.
    """
    file = path
    if path.is_dir():
        inner = [path / name for name in _IN_FOLDERS if (path / name).is_file()]
        if not inner:
            return None
        file = inner[0]
    format = _json_format(file) if file.suffix == ".json" else format_of(file)
    if format is None or not format.startswith(_PREFIX):
        return None
    return [
        ("name", path.name),
        ("kind", f"{describe_format(format)} ({format}); no recording"),
        ("folder", str(path.parent)),
        *(_json_rows(file, format) if file.suffix == ".json" else _archive_rows(file, format)),
    ]


def describe_format(format: str) -> str:
    """Describe what files of a format hold."""
    name = _name_of(format)
    return _KINDS.get(name, name.replace("_", " "))


def _name_of(format: str) -> str:
    """Name of a format without "fusionslam" and version."""
    return format.removeprefix(_PREFIX).rpartition(".")[0]


def _json_format(path: Path) -> str | None:
    try:
        with load_json(path, None, "stored values") as content:
            return str(content["format"])
    except DataError:
        return None


def _json_rows(path: Path, format: str) -> Iterator[tuple[str, str]]:
    with load_json(path, format, describe_format(format)) as content:
        yield from _values(content)
        counts = [f"{name} {len(value)}" for name, value in content.items() if _is_long(value)]
        yield "counts", ", ".join(counts) or "none"


def _archive_rows(path: Path, format: str) -> Iterator[tuple[str, str]]:
    with load_archive(path, format, describe_format(format)) as (about, arrays):
        yield from _values(about)
        for thing, name in _COUNTS.get(_name_of(format), {}).items():
            if name in arrays:
                yield thing, str(len(arrays[name]))
        shapes = {name: " x ".join(map(str, rows.shape)) for name, rows in arrays.items()}
        yield "arrays", ", ".join(f"{name} {shape or 1}" for name, shape in shapes.items())


def _values(content: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    for name, value in content.items():
        if isinstance(value, str | int | float) and name != "format":
            yield name if name != "name" else "of", str(value)


def _is_long(value: Any) -> bool:
    return isinstance(value, list | dict)
