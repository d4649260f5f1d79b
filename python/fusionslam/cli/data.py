# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""DATA of commands: the recording or world that it names, opened as clouds or scenes."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from fusionslam.base.progress import Step, label_progress
from fusionslam.cli import options as opt
from fusionslam.cli.console import during, progress
from fusionslam.cli.failures import needs_extra
from fusionslam.config import merged, nearest_name, suggest, with_settings
from fusionslam.datasets import Dataset
from fusionslam.datasets.bags.topics import ROLES, can_be_further
from fusionslam.datasets.base import CloudDataset
from fusionslam.datasets.range_recording import RangeRecording, is_recording
from fusionslam.errors import ConfigError, DataError
from fusionslam.pipelines.recording import Recording, settle_frame
from fusionslam.pipelines.scenes import record_scenes
from fusionslam.sensors.synchronizer import SyncConfig
from fusionslam.sim import recordings
from fusionslam.sim.catalogue import MADE
from fusionslam.views.scene_set import SceneSet, is_scene_set

_WORLD_FILES = (".glb", ".world", ".sdf")


def parse_topics(texts: list[str]) -> dict[str, str]:
    """Parse texts such as points=/velodyne_points."""
    _check_pairs("--topic", texts, "WHAT=/NAME")
    topics: dict[str, str] = {}
    for text in texts:
        what, _, name = text.partition("=")
        if not can_be_further(what):
            opt.check_choice(f"--topic {text}: WHAT", what, tuple(ROLES))
        if what in topics:
            more = "; NAME_points=/TOPIC names a further scanner" if what == "points" else ""
            raise ConfigError(
                f"--topic {text}: {what} is {topics[what]} already, expected one topic of each"
                f"{more}",
                code="given-twice",
                fields=("--topic", what),
            )
        topics[what] = name
    return topics


def parse_sync(texts: list[str]) -> dict[str, Any]:
    """Return the values of SyncConfig that differ from its defaults."""
    _check_pairs("--sync", texts, "KEY=VALUE, such as policy=last_before")
    try:
        return with_settings(SyncConfig(), texts).model_dump(exclude_defaults=True)
    except ConfigError as error:
        raise ConfigError(f"--sync {', '.join(texts)}: {error}") from error


def _check_pairs(option: str, texts: list[str], expected: str) -> None:
    for text in texts:
        if "=" not in text:
            raise ConfigError(f"{option} {text}: expected {expected}")


def record_if_world(data: Path, kind: str | None) -> tuple[Path, str | None]:
    """Return DATA and None, or the recording made in the world that DATA names, and its name.

    Raises:
        DataError: there is no such file or world, or the world cannot be read.
    """
    path = data.expanduser()
    if not path.exists():
        _check_name(path)
    elif not (path.suffix.lower() in _WORLD_FILES if path.is_file() else _has_world(path)):
        return path, None
    if kind is not None:  # recording takes minutes
        opt.check_choice("--kind", kind, opt.KINDS)
    for extra in ("sim", "bags"):
        needs_extra(extra)
    with progress() as step:
        show = label_progress(step, f"driving: {path.name}")
        return recordings.record_world(path, jobs=opt.cores(None), progress=show), path.stem


def check_seeds(build_recording: Callable[[], Recording]) -> Path:
    """Return DATA of a command with seeds: the name of a made world, which alone has any.

    Args:
        build_recording: of the command, with its options filled in.

    Raises:
        ConfigError: DATA is something else (code "choice"), or another option says how it is read.
        FusionSlamError: an extra that worlds need is not installed.
    """
    given = opt.filled(build_recording)
    data = given["data"]
    opt.check_choice("DATA with --seeds", str(data), opt.WORLDS)
    for name, value in given.items():
        if name not in ("data", "stamps") and value:
            raise ConfigError(
                f"--{name.replace('_', '-')} is for recordings; --seeds makes worlds",
                code="choice",
                fields=(f"--{name.replace('_', '-')}", str(value)),
            )
    for extra in ("sim", "bags"):
        needs_extra(extra)
    return Path(data)


def record_seed(name: str, seed: int, *, jobs: int, step: Step) -> Recording:
    """Return the recording of a drive through a made world of this seed."""
    show = label_progress(step, f"driving: {name} {seed}")
    path = recordings.record_seed(name, seed, jobs=jobs, progress=show)
    return Recording.at(path, simulated=name)


def _has_world(folder: Path) -> bool:
    """Tell whether a folder is one of Gazebo's, with its world in worlds/."""
    return any(path.suffix in _WORLD_FILES[1:] for path in folder.glob("worlds/*"))


def _check_name(path: Path) -> None:
    """Raise DataError unless a nonexistent path is the name of a simulated world."""
    if str(path) in MADE:
        return
    near = nearest_name(str(path), MADE)
    raise DataError(
        f"{path} does not exist: expected a recording, a world's file or one of "
        f"{', '.join(MADE)}{suggest(str(path), MADE)}",
        code="no-such-data",
        fields=() if near is None else (near,),
    )


def open_data(recording: Recording, whole: Any) -> tuple[Dataset, Any]:
    """Open the recording; return it and the configuration with source and frame of its clouds."""
    recording = replace(recording, shapes=whole.recording.shapes)
    whole = merged(whole, {"fusion": {"source": opt.choose_source(None, whole, recording)}})
    # Coloured clouds serve whatever the source. Other data are opened with its sensors alone, as
    # those of others may be damaged.
    path = Path(recording.path)
    own_clouds = path.is_file() and (is_recording(path) or is_scene_set(path))
    dataset = recording.open(None if own_clouds else whole.fusion.source)
    if isinstance(dataset, CloudDataset):
        return dataset, whole
    return dataset, whole.model_copy(update={"fusion": settle_frame(whole.fusion, dataset)})


def record_scenes_of(
    recording: Recording,
    whole: Any,
    step: Step,
    features: Sequence[str],
    jobs: int,
    bad_frames: str,
) -> SceneSet:
    """Return a stored scene set, or make one from a recording.

    Args:
        recording: of either.
        whole: the configuration.
        step: progress callback.
        features: descriptors to store as well.
        jobs: number of frames in parallel.
        bad_frames: "error" or "skip".
    """
    with during(step):
        dataset, whole = open_data(recording, whole)
    from_ranges = isinstance(dataset, RangeRecording)
    settings = whole.recording if from_ranges else whole.fusion
    return record_scenes(
        dataset,
        fusion=whole.fusion,
        recording=whole.recording,
        features=features,
        descriptors=whole.descriptors,
        jobs=jobs,
        bad_frames=bad_frames,
        source={"path": recording.path, "config": settings.model_dump(mode="json")},
        progress=label_progress(step, "reading" if from_ranges else "fusing"),
    )
