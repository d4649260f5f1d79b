# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Options of the views commands, and functions that open their data."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fusionslam.cli import options as opt
from fusionslam.storage.progress import Step, label_progress

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fusionslam.datasets import Dataset
    from fusionslam.pipelines.recording import Recording
    from fusionslam.views.scene_set import SceneSet

SceneSets = Annotated[
    list[Path], typer.Argument(metavar="SCENES...", help="Scene sets or .npz recordings.")
]
Tuned = Annotated[
    str | None,
    typer.Option("--tuned", metavar="NAME", help="Values found by tune that come with fusionslam."),
]
SkipEmpty = Annotated[
    bool, typer.Option("--skip-empty", help="Leave out scans of which nothing is left.")
]
Rule = Annotated[str, typer.Option("--rule", help="How views are judged: paper or author.")]
Folder = Annotated[Path, typer.Option("--output", "-o", help="Folder for what is written.")]


def build_config(
    tuned: str | None, file: Path | None, settings: list[str] | None, **first: Any
) -> Any:
    """Return the configuration of all stages, with clouds in the robot's frame without ground.

    It is changed by ``first``, then by the tuned values, the file and the settings.
    """
    from fusionslam.config import merged, with_file, with_settings
    from fusionslam.fusion import ROBOT_FUSION
    from fusionslam.views.presets import tuned_path

    fusion = ROBOT_FUSION.model_dump(exclude_unset=True)
    whole = merged(opt.everything(), {"fusion": fusion, **first})
    for path in ([tuned_path(tuned)] if tuned else []) + ([file] if file else []):
        whole = with_file(whole, path)
    return with_settings(whole, settings or [])


def open_data(recording: "Recording", whole: Any) -> "tuple[Dataset, Any]":
    """Open the recording; return it and the configuration with the source of its clouds."""
    from dataclasses import replace

    from fusionslam.config import merged
    from fusionslam.datasets.base import CloudDataset

    recording = replace(recording, shapes=whole.recording.shapes)
    whole = merged(whole, {"fusion": {"source": opt.source_of(None, whole, recording)}})
    dataset = recording.open()
    if isinstance(dataset, CloudDataset):
        return dataset, whole
    return recording.open(whole.fusion.source), whole


def open_scenes(
    recording: "Recording",
    whole: Any,
    step: Step,
    *,
    jobs: int = 1,
    features: "Sequence[str]" = (),
) -> "SceneSet":
    """Return a stored scene set, or make one from a recording."""
    from fusionslam.datasets.range_recording import RangeRecording
    from fusionslam.pipelines.scenes import record_scenes

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
        source={"path": recording.path, "config": settings.model_dump(mode="json")},
        progress=label_progress(step, "reading" if from_ranges else "fusing"),
    )
