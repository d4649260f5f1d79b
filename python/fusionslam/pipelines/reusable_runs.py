# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Describe a recording where no stored run can be reused; log why a run cannot."""

import logging
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fusionslam import _core
from fusionslam.config import flatten
from fusionslam.descriptors import find_descriptor, own_files
from fusionslam.errors import DataError
from fusionslam.evaluation import DescriptorRun, VerifiedRun
from fusionslam.pipelines.describe import (
    PipelineConfig,
    describe_dataset,
    fix_radius,
    for_descriptor,
    run_path,
)
from fusionslam.pipelines.recording import Recording
from fusionslam.pipelines.results import Work, claim, delete_page
from fusionslam.storage.progress import Step, label_progress

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset

logger = logging.getLogger(__name__)


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
    config = fix_radius(dataset, names, config, bad_frames)
    stored = _StoredRuns(dataset, path, config, bad_frames)
    runs = {name: stored.load(name) for name in names}
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
    poses = dataset.true_poses
    return [
        replace(run, poses=None if poses is None else poses[run.frames])
        for run in runs.values()
        if run is not None
    ]


@dataclass(frozen=True)
class _StoredRuns:
    """The runs in a folder that were made from a dataset with a configuration."""

    dataset: "Dataset"
    folder: Path
    config: PipelineConfig
    bad_frames: str = "error"

    def load(self, name: str) -> DescriptorRun | None:
        """Return the stored run of a descriptor; None, with the reason logged, if it must be made.

        Raises:
            DataError: there is a run of other data, which must not be overwritten.
        """
        path = run_path(self.folder, self.config.fusion.source, name)
        if not path.exists():
            return None
        try:
            run = DescriptorRun.load(path)
        except DataError as error:
            logger.warning("%s; describing again", error)
            return None
        if run.dataset != self.dataset.name:
            raise DataError(
                f"{path} is a run of {run.dataset}: choose another folder or delete it",
                code="other-results",
                fields=(str(path), run.dataset),
            )
        changes = [*self._changes(run, path, for_descriptor(self.config, name))]
        if changes:
            logger.warning("%s is replaced by a new run: %s", path, "; ".join(changes))
        return None if changes else run

    def _changes(self, run: DescriptorRun, path: Path, config: PipelineConfig) -> Iterator[str]:
        """Yield the differences between the run and the requested one."""
        before, now = (
            _relevant(values, run.descriptor)
            for values in (run.config, config.model_dump(mode="json"))
        )
        yield from differences(before, now)
        if self.bad_frames == "error" and run.skipped:
            yield f"it lacks {len(run.skipped)} frames that cannot be described"
        elif not has_all_frames(run, self.dataset):
            yield f"it was made of {len(run)} frames, now there are others"
        elif path.stat().st_mtime < newest_change(self.dataset, run.descriptor):
            yield "the recording or the program is newer"


def has_all_frames(run: DescriptorRun | VerifiedRun, dataset: "Dataset") -> bool:
    """Whether a run is of all frames of a dataset, but for those that it skipped."""
    left = ~np.isin(dataset.numbers, list(run.skipped))
    return np.array_equal(run.numbers, dataset.numbers[left]) and np.array_equal(
        run.stamps_ns, dataset.stamps_ns[left]
    )


def newest_change(dataset: "Dataset", name: str) -> float:
    """Time of the last change of a recording or of what describes it."""
    files = (Path(str(_core.__file__)), *dataset.files(), *own_files([name]))
    with suppress(OSError):  # a missing file is reported when it is read
        return max(path.stat().st_mtime for path in files)
    return float("inf")


def differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """Yield which values of two configurations, by dotted key, differ and how."""
    for key in dict.fromkeys([*before, *now]):
        if before.get(key) != now.get(key):
            yield f"{key} was {_format(before.get(key))}, is {_format(now.get(key))}"


def _relevant(config: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return the values of a configuration that affect a descriptor, by dotted key."""
    options = find_descriptor(name).keys
    described = {k: v for k, v in config.get("descriptors", {}).items() if k in options}
    return flatten({"fusion": config.get("fusion", {}), "descriptors": described})


def _format(value: Any) -> str:
    return "none" if value is None else str(value)
