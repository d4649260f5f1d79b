# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Compare the accuracy and cost of descriptors on one recording.

recording = Recording.at("kitti/dataset", sequence="06")
for evaluation in benchmark(recording, "out", ["m2dp", "cm2dp"]):
    print(evaluation.run.source, evaluation.run.descriptor, evaluation.curves["revisit"])
"""

import logging
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fusionslam.config import merged
from fusionslam.descriptors import DESCRIPTORS, descriptor_named
from fusionslam.errors import DataError
from fusionslam.evaluation import DescriptorRun, Evaluation, EvaluationConfig, evaluate
from fusionslam.fusion import fuse
from fusionslam.pipelines.describe import (
    PipelineConfig,
    describe_dataset,
    first_that_works,
    load_runs,
    settled,
)
from fusionslam.pipelines.loops import find_loops
from fusionslam.pipelines.recording import Recording
from fusionslam.pipelines.results import Work, claim, runs_folder
from fusionslam.pipelines.reusable_runs import Stored, with_poses_of
from fusionslam.storage.progress import Progress

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset

logger = logging.getLogger(__name__)

Step = Callable[[str, int, int], None]
"""Progress callback: called with the name of the step, how much is done, and the total."""

DEMO: Mapping[str, Mapping[str, Any]] = {"stereo": {"fusion": {"voxel": 0.2}}}
"""Settings that the demo changes, by source: dense stereo clouds are thinned to save time."""

DEMO_DESCRIPTORS: Mapping[str, Sequence[str]] = {
    "lidar": tuple(DESCRIPTORS),
    "stereo": tuple(DESCRIPTORS),
    "cloud": ("m2dp",),
}
"""The demo's sources and the descriptors computed from each."""

INDOOR: Mapping[str, Any] = {
    "evaluation": {"radius": 0.8, "window": 40},
    "loop_closure": {"window": 40},
}
"""Settings that the demo changes indoors: places are smaller; 40 scans are 20 s."""
INDOOR_DESCRIPTORS: Mapping[str, Sequence[str]] = {"lidar": tuple(DESCRIPTORS)}
"""The indoor demo's source: a robot's scan, coloured by its camera."""
DEMO_NOTE = (
    "The LiDAR's full circle is described by m2dp only: the camera sees and colours a part of it, "
    "which cm2dp and cshot need, and shot is slow for so many points."
)


def benchmark(
    recording: Recording,
    folder: str | os.PathLike[str],
    names: Sequence[str] | Mapping[str, Sequence[str]] = tuple(DESCRIPTORS),
    *,
    configs: Mapping[str, PipelineConfig] | None = None,
    jobs: int = 1,
    bad_frames: str = "error",
    command: str = "",
    step: Step | None = None,
    demo: bool = False,
) -> list[Evaluation]:
    """Describe a recording, find its loops and evaluate them, for every source and descriptor.

    Runs are stored in ``folder/descriptors``; existing ones are reused. The time of a stage is
    that of one frame while ``jobs`` frames are processed in parallel.

    Args:
        recording: the data.
        folder: output folder.
        names: descriptors, or descriptors by source; those that need colours are left out where
            clouds have none.
        configs: by source; None for the defaults with every source that the data allow.
        jobs: number of frames processed in parallel.
        bad_frames: as for ``describe_dataset``.
        command: the command line to store with the results.
        step: progress callback.
        demo: whether a later demo may replace the results.

    Raises:
        DataError: the data cannot be used, or the folder cannot be written or holds the results
            of other data.
        ConfigError: an unknown descriptor.
    """
    configs = configs or {source: PipelineConfig() for source in recording.sources()}
    wanted = names if isinstance(names, Mapping) else dict.fromkeys(configs, names)
    for name in (name for source in configs for name in wanted[source]):
        descriptor_named(name)
    evaluations = []
    for source, config in configs.items():
        own = for_source(config, source)
        dataset = recording.open(source)
        usable = describable(dataset, wanted[source], own, bad_frames)
        runs = work_on(
            recording,
            dataset,
            folder,
            usable,
            config=own,
            jobs=jobs,
            bad_frames=bad_frames,
            command=command,
            step=step,
            demo=demo,
        )
        evaluations += [assessed(run, own, step) for run in runs]
    return evaluations


def for_source(config: PipelineConfig, source: str) -> PipelineConfig:
    """Return the configuration with this source of clouds."""
    return merged(config, {"fusion": {"source": source}})


def describable(
    dataset: "Dataset", names: Sequence[str], config: PipelineConfig, bad_frames: str = "error"
) -> list[str]:
    """Return the descriptors that the clouds allow; logs those that need missing colours."""

    def has_colors(index: int) -> bool:
        return fuse(dataset[index], config.fusion).colors is not None

    colorful = [name for name in names if descriptor_named(name).needs_colors]
    if not colorful or first_that_works(dataset, has_colors, bad_frames):
        return list(names)
    logger.warning("%s has no colours: left out %s", dataset.name, ", ".join(colorful))
    if len(colorful) == len(names):
        raise DataError(f"{dataset.name} has no colours, which {', '.join(names)} need")
    return [name for name in names if name not in colorful]


def work_on(
    recording: Recording,
    dataset: "Dataset",
    folder: str | os.PathLike[str],
    names: Sequence[str],
    *,
    config: PipelineConfig,
    jobs: int = 1,
    bad_frames: str = "error",
    command: str = "",
    step: Step | None = None,
    inside: str = "descriptors",
    demo: bool = False,
) -> list[DescriptorRun]:
    """Record the work in ``folder/run.json`` and describe the frames that are not described yet.

    Args: as for ``benchmark``; runs go to ``folder/inside``.
    """
    source = config.fusion.source
    work = Work(
        recording=recording,
        dataset=dataset.name,
        command=command,
        configs={source: config.model_dump(mode="json")},
        demo=demo,
    )
    claim(folder, work)
    label = f"describing {source} clouds"
    progress = (lambda done, total: step(label, done, total)) if step else None
    return describe_missing(
        dataset,
        names,
        Path(folder) / inside,
        config=config,
        jobs=jobs,
        bad_frames=bad_frames,
        progress=progress,
    )


def describe_missing(
    dataset: "Dataset",
    names: Sequence[str],
    folder: str | os.PathLike[str],
    *,
    config: PipelineConfig,
    jobs: int = 1,
    bad_frames: str = "error",
    progress: Progress | None = None,
) -> list[DescriptorRun]:
    """Run ``describe_dataset`` for the descriptors whose run is not in the folder yet.

    A stored run is reused if it was made from the same frames with the same configuration, and is
    newer than the recording's files and the core in use; otherwise the log says what differs.
    Ground-truth poses are always read again.

    Raises:
        DataError: as ``describe_dataset``; or a run of other data is in the way.
    """
    config = settled(dataset, names, config, bad_frames)
    stored = Stored(dataset, Path(folder), config, bad_frames)
    runs = {name: stored.run(name) for name in names}
    missing = [name for name, run in runs.items() if run is None]
    if missing:
        made = describe_dataset(
            dataset,
            missing,
            folder,
            config=config,
            jobs=jobs,
            bad_frames=bad_frames,
            progress=progress,
        )
        runs |= {run.descriptor: run for run in made}
    return [with_poses_of(dataset, run) for run in runs.values() if run is not None]


def with_matching_time(
    run: DescriptorRun, config: PipelineConfig, step: Step | None = None
) -> DescriptorRun:
    """Return the run with the time that it takes to find each frame's nearest candidate."""
    label = f"matching {run.source} {run.descriptor}"
    progress = (lambda done, total: step(label, done, total)) if step else None
    report = find_loops(run, config.loop_closure, progress)
    return replace(run, seconds=run.seconds | {"match": report.seconds})


def assessed(run: DescriptorRun, config: PipelineConfig, step: Step | None = None) -> Evaluation:
    """Time and evaluate the run; both take long for many frames."""
    timed = with_matching_time(run, config, step)
    say: Step = step or (lambda label, done, total: None)
    label = f"judging {run.source} {run.descriptor}"
    say(label, 0, 1)
    evaluation = judged(timed, config.evaluation)
    say(label, 1, 1)
    return evaluation


def judged(run: DescriptorRun, config: EvaluationConfig) -> Evaluation:
    """Evaluate the run under every protocol with the configured radius and window."""
    return evaluate(run, radius=config.radius, window=config.window)


def stored_evaluations(
    folder: str | os.PathLike[str],
    changes: Mapping[str, Any] | None = None,
    truth: str | os.PathLike[str] | None = None,
    step: Step | None = None,
) -> tuple[list[Evaluation], EvaluationConfig]:
    """Evaluate every run in a folder of results.

    Args:
        folder: written by ``benchmark`` or ``describe_dataset``.
        changes: to the evaluation configuration stored there.
        truth: file of ground-truth poses in KITTI or TUM format, to use instead of those in the
            runs.
        step: progress callback.

    Raises:
        DataError: no such folder, no runs in it, or poses that do not fit.
        ConfigError: a value out of range.
    """
    if not Path(folder).is_dir():
        raise DataError(f"{folder} is no folder: expected one with descriptor runs")
    config = merged(PipelineConfig(), {"evaluation": stored_config(folder).model_dump()})
    config = merged(config, {"evaluation": changes or {}})
    runs = load_runs(runs_folder(folder))
    if truth is not None:
        runs = [_with_truth(run, Path(truth)) for run in runs]
    return [assessed(run, config, step) for run in runs], config.evaluation


def stored_config(folder: str | os.PathLike[str]) -> EvaluationConfig:
    """Return the evaluation configuration stored in a folder, else the default."""
    work = Work.load(folder)
    stored = next(iter(work.configs.values()), {}) if work else {}
    return merged(EvaluationConfig(), stored.get("evaluation", {}))


def _with_truth(run: DescriptorRun, path: Path) -> DescriptorRun:
    from fusionslam.datasets import match_poses

    return replace(run, poses=match_poses(path, run.numbers, run.stamps_ns))
