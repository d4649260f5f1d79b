# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Describe a recording where no stored run can be reused; log why a run cannot."""

import logging
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from fusionslam import _core
from fusionslam.base.progress import Step, label_progress
from fusionslam.config import flatten
from fusionslam.descriptors import find_descriptor, own_files
from fusionslam.errors import DataError
from fusionslam.evaluation import DescriptorRun, LoopRun, VerifiedRun
from fusionslam.pipelines.describe import (
    PipelineConfig,
    describe_dataset,
    fit_descriptors,
    for_descriptor,
)
from fusionslam.pipelines.recording import Recording
from fusionslam.pipelines.results import Work, claim, delete_page, run_path

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset

logger = logging.getLogger(__name__)

Run = TypeVar("Run", DescriptorRun, VerifiedRun)


def describe_recording(
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
    """Record the work in ``folder/run.json`` and describe what is not described yet.

    A stored run is reused if it was made from the same frames with the same configuration, and is
    newer than the recording's files and the core in use; otherwise the log says what differs.
    Ground-truth poses are always read again.

    Args:
        recording, dataset: the data, and as opened for the source of ``config``.
        folder: output folder.
        names: descriptors.
        config: of all stages.
        jobs, bad_frames: as for ``describe_dataset``.
        command: the command line to store with the results.
        step: progress callback.
        inside: folder of the runs below ``folder``.
        demo: whether a later demo may replace the results.

    Raises:
        DataError: as ``describe_dataset``; or the folder holds runs of other data.
    """
    source, path = config.fusion.source, Path(folder) / inside
    values = config.model_dump(mode="json")
    claim(folder, Work(recording, dataset.name, command, {source: values}, demo=demo))
    config = fit_descriptors(dataset, names, config, bad_frames)
    runs = {name: _load_stored(dataset, path, config, name, bad_frames) for name in names}
    missing = [name for name, run in runs.items() if run is None]
    if missing:
        if any(run_path(path, source, name).exists() for name in missing):
            delete_page(folder, "report")
        made = describe_dataset(
            dataset,
            missing,
            path,
            config=config,
            jobs=jobs,
            bad_frames=bad_frames,
            progress=label_progress(step, f"describing clouds, source {source}"),
        )
        runs |= dict(zip(missing, made, strict=True))
    return [with_true_poses(run, dataset) for run in runs.values() if run is not None]


def with_true_poses(run: Run, dataset: "Dataset") -> Run:
    """Return a stored run with the true poses that its frames have in the recording now."""
    poses = dataset.true_poses
    return replace(run, poses=None if poses is None else poses[run.frames])


def _load_stored(
    dataset: "Dataset", folder: Path, config: PipelineConfig, name: str, bad_frames: str
) -> DescriptorRun | None:
    """Return the stored run of a descriptor; None, with the reason logged, if it must be made.

    Raises:
        DataError: there is a run of other data, which must not be overwritten.
    """
    path = run_path(folder, config.fusion.source, name)
    if not path.exists():
        return None
    try:
        run = DescriptorRun.load(path)
    except DataError as error:
        logger.warning("%s; describing again", error)
        return None
    if run.dataset != dataset.name:
        raise DataError(
            f"{path} is a run of {run.dataset}: choose another folder or delete it",
            code="other-results",
            fields=(str(path), run.dataset),
        )
    options = find_descriptor(run.descriptor).keys
    before, now = (
        flatten(
            {
                "fusion": values.get("fusion", {}),
                "descriptors": {
                    key: value
                    for key, value in values.get("descriptors", {}).items()
                    if key in options
                },
            }
        )
        for values in (run.config, for_descriptor(config, name).model_dump(mode="json"))
    )
    changes = [*differences(before, now)]
    if bad_frames == "error" and run.skipped:
        changes.append(f"it lacks {len(run.skipped)} frames that cannot be described")
    elif not has_all_frames(run, dataset):
        changes.append(f"it was made of {len(run)} frames, now there are others")
    elif is_outdated(path, dataset, run.descriptor):
        changes.append("the recording or the program is newer")
    if changes:
        logger.warning("%s is replaced by a new run: %s", path, "; ".join(changes))
    return None if changes else run


def has_all_frames(run: LoopRun, dataset: "Dataset") -> bool:
    """Return whether a run has all frames of a dataset but those that it skipped."""
    left = ~np.isin(dataset.numbers, list(run.skipped))
    return np.array_equal(run.numbers, dataset.numbers[left]) and np.array_equal(
        run.stamps_ns, dataset.stamps_ns[left]
    )


def is_outdated(path: Path, dataset: "Dataset", name: str) -> bool:
    """Return whether a stored run is older than the recording or what describes it."""
    files = (Path(str(_core.__file__)), *dataset.files(), *own_files([name]))
    with suppress(OSError):  # a missing file is reported when it is read
        return path.stat().st_mtime < max(file.stat().st_mtime for file in files)
    return True


def differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """Yield which values of two configurations, by dotted key, differ and how."""
    for key in dict.fromkeys([*before, *now]):
        if before.get(key) != now.get(key):
            then, new = ("none" if v.get(key) is None else v[key] for v in (before, now))
            yield f"{key} was {then}, is {new}"
