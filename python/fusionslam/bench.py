# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Descriptors side by side on one recording: accuracy and cost.

recording = Recording.at("kitti/dataset", sequence="06")
for evaluation in benchmark(recording, "out", ["m2dp", "cm2dp"]):
    print(evaluation.run.source, evaluation.run.descriptor, evaluation.curves["revisit"])
write_stored_report("out")
"""

import logging
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fusionslam import _core
from fusionslam.config import merged
from fusionslam.descriptors import DESCRIPTORS, descriptor_named
from fusionslam.errors import DataError, FusionSlamError
from fusionslam.evaluation import DescriptorRun, Evaluation, EvaluationConfig, evaluate
from fusionslam.fusion import FusionConfig, fuse
from fusionslam.loop_report import find_loops
from fusionslam.pipeline import (
    PipelineConfig,
    Progress,
    describe_dataset,
    load_runs,
    run_path,
    settled,
)
from fusionslam.sensors import Cloud
from fusionslam.workspace import Recording, Work, claim, runs_folder

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset

logger = logging.getLogger(__name__)

Step = Callable[[str, int, int], None]
"""Called with what is being done, how much of it is done, and how much there is."""

DEMO: Mapping[str, Mapping[str, Any]] = {"stereo": {"fusion": {"voxel": 0.2}}}
"""What the demo changes, by source: dense stereo clouds are thinned, or it would take long."""

DEMO_DESCRIPTORS: Mapping[str, Sequence[str]] = {
    "lidar": tuple(DESCRIPTORS),
    "stereo": tuple(DESCRIPTORS),
    "cloud": ("m2dp",),  # the full circle, which a camera cannot colour and SHOT takes long for
}
"""The demo's sources and what is computed of each."""

# The result is the same for any number of threads.
_IRRELEVANT = {"threads"}


def benchmark(
    recording: Recording,
    folder: str | os.PathLike[str],
    names: Sequence[str] | Mapping[str, Sequence[str]] = tuple(DESCRIPTORS),
    *,
    configs: Mapping[str, PipelineConfig] | None = None,
    jobs: int = 1,
    command: str = "",
    step: Step | None = None,
    demo: bool = False,
) -> list[Evaluation]:
    """Describe a recording, find its loops and judge them, for every source and descriptor.

    Runs are stored in ``folder/descriptors``; those there already are taken as they are. Times
    of stages are those of one frame while ``jobs`` frames are worked on.

    Args:
        recording: the data.
        folder: where results go.
        names: descriptors, or descriptors by source; those that need colours are left out where
            clouds have none.
        configs: by source; None for the defaults with every source that the data allow.
        jobs: frames worked on at a time.
        command: what to store as the command that led here.
        step: told about progress.
        demo: whether a later demo may replace the results.

    Raises:
        DataError: the data cannot be used, or the folder cannot be written or holds other work.
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
        usable = describable(dataset, wanted[source], own)
        runs = work_on(
            recording,
            dataset,
            folder,
            usable,
            config=own,
            jobs=jobs,
            command=command,
            step=step,
            demo=demo,
        )
        evaluations += [judged(with_matching_time(run, own), own.evaluation) for run in runs]
    return evaluations


def for_source(config: PipelineConfig, source: str) -> PipelineConfig:
    """The configuration with this source of clouds."""
    return merged(config, {"fusion": {"source": source}})


def describable(dataset: "Dataset", names: Sequence[str], config: PipelineConfig) -> list[str]:
    """The descriptors that the clouds allow; says in the log which need colours in vain."""
    colorful = [name for name in names if descriptor_named(name).needs_colors]
    if not colorful or fuse(dataset[0], config.fusion).colors is not None:
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
    command: str = "",
    step: Step | None = None,
    inside: str = "descriptors",
    demo: bool = False,
) -> list[DescriptorRun]:
    """Say in ``folder/run.json`` what is being done, and describe what has yet to be.

    Args: as for ``benchmark``; runs go to ``folder/inside``.
    """
    source = config.fusion.source
    work = Work(
        recording=recording,
        dataset=dataset.name,
        command=command,
        configs={source: config.model_dump(mode="json")},
        numbers={source: dataset.numbers.tolist()},
        demo=demo,
    )
    claim(folder, work)
    label = f"describing {source} clouds"
    progress = (lambda done, total: step(label, done, total)) if step else None
    return describe_missing(
        dataset, names, Path(folder) / inside, config=config, jobs=jobs, progress=progress
    )


def describe_missing(
    dataset: "Dataset",
    names: Sequence[str],
    folder: str | os.PathLike[str],
    *,
    config: PipelineConfig,
    jobs: int = 1,
    progress: Progress | None = None,
) -> list[DescriptorRun]:
    """``describe_dataset`` for the descriptors whose run is not stored in the folder yet.

    A stored run counts if it was made of the same frames with the same configuration, and is
    newer than the recording's files and the core in use. True poses are taken anew.

    Raises:
        DataError: as ``describe_dataset``; or a run of other data is where one would be written.
    """
    config = settled(dataset, names, config)
    runs = {name: _stored(dataset, name, folder, config) for name in names}
    missing = [name for name, run in runs.items() if run is None]
    if missing:
        made = describe_dataset(
            dataset, missing, folder, config=config, jobs=jobs, progress=progress
        )
        runs |= {run.descriptor: run for run in made}
    return [replace(run, poses=dataset.poses) for run in runs.values() if run is not None]


def _stored(
    dataset: "Dataset", name: str, folder: str | os.PathLike[str], config: PipelineConfig
) -> DescriptorRun | None:
    path = run_path(folder, config.fusion.source, name)
    if not path.exists():
        return None
    try:
        run = DescriptorRun.load(path)
    except DataError as error:
        logger.warning("%s; describing again", error)
        return None
    if run.dataset != dataset.name:
        raise DataError(f"{path} is a run of {run.dataset}: choose another folder or delete it")
    same = (
        path.stat().st_mtime >= _newest(dataset)
        and np.array_equal(run.stamps_ns, dataset.stamps_ns)
        and _relevant(run.config, name) == _relevant(config.model_dump(mode="json"), name)
    )
    return run if same else None


def _newest(dataset: "Dataset") -> float:
    """When the recording or the compiled core changed last."""
    files = [path for stream in dataset.streams.values() for path in stream.files.values()]
    with suppress(OSError):  # a file that is gone is reported when it is read
        return max(path.stat().st_mtime for path in (Path(str(_core.__file__)), *files))
    return float("inf")


def _relevant(config: Mapping[str, Any], name: str) -> tuple[Any, Any]:
    """What of a stored configuration decides a descriptor."""
    ignored = _IRRELEVANT | (set() if DESCRIPTORS[name].needs_normals else {"normal_radius"})
    described = config.get("descriptors", {})
    return config.get("fusion"), {k: v for k, v in described.items() if k not in ignored}


def with_matching_time(run: DescriptorRun, config: PipelineConfig) -> DescriptorRun:
    """The run with the time that finding each frame's nearest candidate takes."""
    report = find_loops(run, config.loop_closure)
    return replace(run, seconds=run.seconds | {"match": report.seconds})


def judged(run: DescriptorRun, config: EvaluationConfig) -> Evaluation:
    """The run judged under every protocol with a configuration's radius and window."""
    return evaluate(run, radius=config.radius, window=config.window)


def stored_evaluations(
    folder: str | os.PathLike[str],
    changes: Mapping[str, Any] | None = None,
    truth: str | os.PathLike[str] | None = None,
) -> tuple[list[Evaluation], EvaluationConfig]:
    """Judge every run that a folder of results holds.

    Args:
        folder: what ``benchmark`` or ``describe_dataset`` wrote.
        changes: of the evaluation's configuration that is stored there.
        truth: file of true poses in KITTI or TUM format, instead of those in the runs.

    Raises:
        DataError: no such folder, no runs in it, or poses that do not fit.
        ConfigError: a value out of range.
    """
    if not Path(folder).is_dir():
        raise DataError(f"{folder} is no folder: expected one with descriptor runs")
    work = Work.load(folder)
    stored = next(iter(work.configs.values()), {}) if work else {}
    config = merged(PipelineConfig(), {"evaluation": stored.get("evaluation", {})})
    config = merged(config, {"evaluation": changes or {}})
    runs = load_runs(runs_folder(folder))
    if truth is not None:
        runs = [_with_truth(run, Path(truth), work) for run in runs]
    timed = [with_matching_time(run, config) for run in runs]
    return [judged(run, config.evaluation) for run in timed], config.evaluation


def _with_truth(run: DescriptorRun, path: Path, work: Work | None) -> DescriptorRun:
    from fusionslam.datasets import match_poses

    numbers = run.frames
    if work is not None and run.source in work.numbers:
        numbers = np.array(work.numbers[run.source], np.int64)[run.frames]
    return replace(run, poses=match_poses(path, numbers, run.stamps_ns))


def write_stored_metrics(
    folder: str | os.PathLike[str], evaluations: Sequence[Evaluation], *, command: str = ""
) -> Path:
    """Write ``folder/metrics.json``: every figure under every protocol. Raises DataError."""
    from fusionslam.report.exports import write_metrics
    from fusionslam.report.machine import machine, versions

    dataset = evaluations[0].run.dataset
    about = {"dataset": dataset, "command": command, "versions": versions(), "machine": machine()}
    path = Path(folder) / "metrics.json"
    write_metrics(path, evaluations, about)
    return path


def write_stored_report(
    folder: str | os.PathLike[str],
    evaluations: Sequence[Evaluation] | None = None,
    *,
    output: str | os.PathLike[str] | None = None,
    protocol: str | None = None,
    command: str | None = None,
) -> Path:
    """Write report.html for the runs in a folder, with pictures if the recording is still there.

    Args:
        folder: what ``benchmark`` wrote.
        evaluations: of these runs; None judges them.
        output: None writes the report into ``folder``.
        protocol: by which loops are judged; None for the configuration's.
        command: None for the one that is stored.

    Raises:
        DataError: no runs, or the output cannot be written.
        FusionSlamError: matplotlib or jinja2 is not installed.
    """
    from fusionslam.report import write_report

    if evaluations is None:
        evaluations, config = stored_evaluations(folder)
        protocol = protocol or config.protocol
    work = Work.load(folder)
    runs = [evaluation.run for evaluation in evaluations]
    return write_report(
        evaluations,
        output or folder,
        dataset_name=runs[0].dataset,
        command=(work.command if work and command is None else command) or "",
        config={f"{run.source} / {run.descriptor}": run.config for run in runs},
        protocol=protocol or EvaluationConfig().protocol,
        clouds=_cloud_reader(work, runs) if work else None,
        images=_image_reader(work) if work else None,
    )


def _cloud_reader(work: Work, runs: Sequence[DescriptorRun]) -> Callable[[str, int], Cloud]:
    opened = cache(work.recording.open)
    fusion = {run.source: merged(FusionConfig(), run.config["fusion"]) for run in runs}

    def read(source: str, frame: int) -> Cloud:
        return fuse(opened(source)[frame], fusion[source])

    return read


def _image_reader(work: Work) -> Callable[[str, int], NDArray[np.uint8]]:
    """Left images of frames, found by their number: sources may have gaps of their own."""

    @cache
    def dataset() -> "tuple[Dataset, dict[int, int]]":
        for source in ("lidar", "stereo"):
            with suppress(FusionSlamError):
                found = work.recording.open(source)
                return found, {number: i for i, number in enumerate(found.numbers.tolist())}
        raise DataError(f"{work.recording.path} has no images")

    def read(source: str, frame: int) -> NDArray[np.uint8]:
        found, places = dataset()
        number = work.numbers[source][frame]
        if number not in places:
            raise DataError(f"frame {number} has no image")
        return found[places[number]].images["left"]

    return read
