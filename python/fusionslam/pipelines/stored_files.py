# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Describe files of results that fusionslam stored: their kind, metadata and counts."""

from collections import Counter
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from fusionslam.config import flatten
from fusionslam.errors import DataError
from fusionslam.evaluation import DescriptorRun
from fusionslam.help_texts import counted
from fusionslam.mapping.map_database import is_map
from fusionslam.mapping.map_file import MapFile
from fusionslam.pipelines.describe import PipelineConfig, run_files
from fusionslam.pipelines.results import FILE, Work, load_verified, runs_folder
from fusionslam.storage.archive import format_of, load_archive, load_json

_PREFIX = "fusionslam."
_IN_FOLDERS = (
    "run.json",
    "detector.npz",
    "detector.json",
    "run.npz",
    "matcher.npz",
    "curve.json",
    "calib_check.json",
)
"""Files by which a folder of results is described, the first of them that is there."""
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
    "verified_run": "verified loops of a recording, for eval and report",
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
    "loop_detector": {"frames": "numbers"},
    "ratslam": {"nodes": "map.nodes", "links": "map.ends"},
    "ratslam_run": {"nodes": "nodes", "links": "links", "steps": "stamps_ns"},
    "verified_run": {"frames": "frames"},
    "view_matcher": {"views": "slots"},
}
"""Arrays of a format whose length is the number of something."""


def _map_rows(path: Path) -> list[tuple[str, str]]:
    with MapFile(path, read_only=True) as file:
        keyframes = Counter(each.session for each in file.keyframes())
        rows = [("kind", "map, by map build")]
        for name, number in file.sessions().items():
            rows.append((f"session {name}", counted(keyframes[number], "keyframe")))
        loops = Counter(each.state for each in file.edges() if each.kind != "odometry")
    if not keyframes:
        return [*rows, ("keyframes", "none yet: map build adds them")]
    measured = ", ".join(f"{count} {state}" for state, count in sorted(loops.items()))
    return [*rows, ("registered pairs", measured or "none")]


def stored_rows(path: Path) -> list[tuple[str, str]] | None:
    """Return (label, value) pairs about a stored file or folder; None for anything else.

    Raises:
        DataError: the file is damaged.
    """
    if is_map(path):
        return _map_rows(path)
    file = path
    if path.is_dir():
        inner = [path / name for name in _IN_FOLDERS if (path / name).is_file()]
        if not inner:
            return None
        file = inner[0]
    format = _json_format(file) if file.suffix == ".json" else format_of(file)
    if format is None or not format.startswith(_PREFIX):
        return None
    rows = _json_rows if file.suffix == ".json" else _archive_rows
    return [
        ("name", path.name),
        ("kind", f"{describe_format(format)} ({format}); no recording"),
        ("folder", str(path.parent)),
        *(_work_rows(file.parent) if _name_of(format) == "work" else rows(file, format)),
        *([("files", _files_in(path))] if path.is_dir() else []),
    ]


def _files_in(folder: Path) -> str:
    """Name the stored files in a folder, with what each holds."""
    found = []
    for path in sorted(folder.iterdir()):
        format = _json_format(path) if path.suffix == ".json" else format_of(path)
        if format is not None and format.startswith(_PREFIX):
            found.append(f"{path.name} ({describe_format(format)})")
    return "; ".join(found)


def _work_rows(folder: Path) -> Iterator[tuple[str, str]]:
    """Yield what was done with which data, and what differs from the defaults."""
    work = Work.load(folder)
    assert work is not None  # its file is there
    yield "dataset", f"{work.dataset} ({work.recording.path})"
    yield "command", work.command or "none: written by a program"
    written = datetime.fromtimestamp((folder / FILE).stat().st_mtime, UTC)
    yield "written", f"{written:%Y-%m-%d %H:%M} UTC"
    defaults = flatten(PipelineConfig().model_dump(mode="json"))
    for source, config in work.configs.items():
        values = {**flatten(config), "fusion.source": defaults["fusion.source"]}
        other = [f"{key}={value}" for key, value in values.items() if value != defaults.get(key)]
        yield f"source {source}", ", ".join(other) or "defaults"
    for path in run_files(runs_folder(folder)):
        run = DescriptorRun.load(path)
        skipped = f", {len(run.skipped)} left out" if run.skipped else ""
        yield f"{run.source} {run.descriptor}", f"{counted(len(run), 'frame')}{skipped}"
    for proven in load_verified(folder):
        loops = counted(int(proven.accepted.sum()), "loop")
        yield f"{proven.source} {proven.name}", f"{loops} in {counted(len(proven), 'frame')}"


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
        counts = _COUNTS.get(_name_of(format), {})
        for thing, name in counts.items():
            if name in arrays:
                yield thing, str(len(arrays[name]))
        if counts:
            return
        shapes = {name: " x ".join(map(str, rows.shape)) for name, rows in arrays.items()}
        yield "arrays", ", ".join(f"{name} {shape or 1}" for name, shape in shapes.items())


def _values(content: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    for name, value in content.items():
        if isinstance(value, str | int | float) and name != "format":
            yield name if name != "name" else "of", str(value)


def _is_long(value: Any) -> bool:
    return isinstance(value, list | dict)
