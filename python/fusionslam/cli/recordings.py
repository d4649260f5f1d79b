# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""DATA of commands as a recording; for a world, of a drive that is simulated first."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import OPENING, progress
from fusionslam.cli.failures import needs_extra
from fusionslam.errors import ConfigError, DataError
from fusionslam.storage.progress import Step, label_progress

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from fusionslam.datasets import Dataset
    from fusionslam.pipelines.recording import Recording
    from fusionslam.views.scene_set import SceneSet

_WORLD_FILES = (".glb", ".world", ".sdf")

Data = Annotated[
    Path,
    typer.Argument(
        metavar="DATA",
        help="A recording (folder, bag, .npz), a world (.glb, .world, .sdf), or town, warehouse, "
        "house, hospital; its kind is recognised.",
    ),
]


def build_recording(
    data: Data,
    kind: Annotated[
        str | None,
        opt.one_of(
            "--kind", names=opt.KINDS, check=False, help="Kind of DATA; by default recognised."
        ),
    ] = None,
    sequence: Annotated[
        str | None, typer.Option(help="Sequence to take if DATA holds several.")
    ] = None,
    topic: Annotated[
        list[str] | None,
        typer.Option(
            metavar="WHAT=/NAME",
            help="Topic of a bag for points, left, camera_info, right, right_camera_info, "
            "odometry, truth or a further camera; may be repeated.",
        ),
    ] = None,
    stamps: Annotated[
        str,
        opt.one_of(
            "--stamps",
            names=opt.STAMPS,
            help="Times of a bag's messages: of their headers, or of their arrival (bag).",
        ),
    ] = "header",
    sync: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUE",
            help="How a bag's images are paired with its scans: policy=last_before, "
            "max_difference=0.05, ...",
        ),
    ] = None,
    calib: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="calib.yaml for a bag or folder without one."),
    ] = None,
    skip_gaps: Annotated[
        bool, typer.Option("--skip-gaps", help="Leave out frames that lack a file.")
    ] = False,
    gt: opt.Truth = None,
) -> "Recording":
    """Build the recording that the options name; of a simulated world it is made first."""
    from fusionslam.pipelines.recording import Recording

    topics, changes = _parse_topics(topic or []), _parse_sync(sync or [])
    path, simulated = _record_if_world(data, kind)
    return Recording.at(
        path,
        kind=kind,
        sequence=sequence,
        gaps="skip" if skip_gaps else "error",
        poses=gt,
        topics=topics,
        stamps=stamps,
        sync=changes,
        calibration=calib,
        simulated=simulated,
    )


def _parse_topics(texts: list[str]) -> dict[str, str]:
    """Parse texts such as points=/velodyne_points."""
    from fusionslam.datasets.bags.topics import ROLES, can_be_camera

    _check_pairs("--topic", texts, "WHAT=/NAME")
    for text in texts:
        what = text.partition("=")[0]
        if not can_be_camera(what):
            opt.check_choice(f"--topic {text}: WHAT", what, tuple(ROLES))
    return dict(text.split("=", 1) for text in texts)


def _parse_sync(texts: list[str]) -> dict[str, Any]:
    """Return the values of SyncConfig that differ from its defaults."""
    from fusionslam.config import with_settings
    from fusionslam.sensors.synchronizer import SyncConfig

    _check_pairs("--sync", texts, "KEY=VALUE, such as policy=last_before")
    try:
        return with_settings(SyncConfig(), texts).model_dump(exclude_defaults=True)
    except ConfigError as error:
        raise ConfigError(f"--sync {', '.join(texts)}: {error}") from error


def _check_pairs(option: str, texts: list[str], expected: str) -> None:
    for text in texts:
        if "=" not in text:
            raise ConfigError(f"{option} {text}: expected {expected}")


def _record_if_world(data: Path, kind: str | None) -> tuple[Path, str | None]:
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
    from fusionslam.sim.recordings import record_world

    with progress() as step:
        show = label_progress(step, f"driving: {path.name}")
        return record_world(path, jobs=opt.cores(None), progress=show), path.stem


def check_seeds(build_recording: "Callable[[], Recording]") -> Path:
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


def record_seed(name: str, seed: int, *, jobs: int, step: Step) -> "Recording":
    """Return the recording of a drive through a made world of this seed."""
    from fusionslam.pipelines.recording import Recording
    from fusionslam.sim import recordings

    show = label_progress(step, f"driving: {name} {seed}")
    path = recordings.record_seed(name, seed, jobs=jobs, progress=show)
    return Recording.at(path, simulated=name)


def _has_world(folder: Path) -> bool:
    """Tell whether a folder is one of Gazebo's, with its world in worlds/."""
    return any(path.suffix in _WORLD_FILES[1:] for path in folder.glob("worlds/*"))


def _check_name(path: Path) -> None:
    """Raise DataError unless a nonexistent path is the name of a simulated world."""
    from fusionslam.config import nearest_name, suggest
    from fusionslam.sim.catalogue import MADE

    if str(path) in MADE:
        return
    near = nearest_name(str(path), MADE)
    raise DataError(
        f"{path} does not exist: expected a recording, a world's file or one of "
        f"{', '.join(MADE)}{suggest(str(path), MADE)}",
        code="no-such-data",
        fields=() if near is None else (near,),
    )


def open_data(recording: "Recording", whole: Any) -> "tuple[Dataset, Any]":
    """Open the recording; return it and the configuration with source and frame of its clouds."""
    from dataclasses import replace

    from fusionslam.config import merged
    from fusionslam.datasets.base import CloudDataset
    from fusionslam.datasets.range_recording import is_recording
    from fusionslam.pipelines.recording import settle_frame
    from fusionslam.views.scene_set import is_scene_set

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


def open_scenes(
    recording: "Recording",
    whole: Any,
    step: Step,
    *,
    features: "Sequence[str]" = (),
    skip_empty: Annotated[
        bool, typer.Option("--skip-empty", help="Leave out scans without points above the floor.")
    ] = False,
    skip_bad_frames: opt.SkipBad = False,
    jobs: opt.Jobs = None,
) -> "SceneSet":
    """Return a stored scene set, or make one from a recording."""
    from fusionslam.datasets.range_recording import RangeRecording
    from fusionslam.pipelines.scenes import record_scenes

    step(OPENING, 0, 1)
    dataset, whole = open_data(recording, whole)
    step(OPENING, 1, 1)
    from_ranges = isinstance(dataset, RangeRecording)
    settings = whole.recording if from_ranges else whole.fusion
    scenes = record_scenes(
        dataset,
        fusion=whole.fusion,
        recording=whole.recording,
        features=features,
        descriptors=whole.descriptors,
        jobs=opt.cores(jobs),
        bad_frames=opt.bad_frames(skip_bad_frames),
        source={"path": recording.path, "config": settings.model_dump(mode="json")},
        progress=label_progress(step, "reading" if from_ranges else "fusing"),
    )
    return scenes.without_empty() if skip_empty else scenes
