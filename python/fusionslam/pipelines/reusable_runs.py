# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Decide whether stored runs can be reused, and if not, why."""

import logging
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fusionslam import _core
from fusionslam.descriptors import DESCRIPTORS
from fusionslam.errors import DataError
from fusionslam.evaluation import DescriptorRun
from fusionslam.pipelines.describe import PipelineConfig, run_path

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset

logger = logging.getLogger(__name__)

# The number of threads does not change the result.
_IRRELEVANT = {"threads"}


@dataclass(frozen=True)
class Stored:
    """The runs in a folder that were made from a dataset with a configuration."""

    dataset: "Dataset"
    folder: Path
    config: PipelineConfig
    bad_frames: str = "error"

    def run(self, name: str) -> DescriptorRun | None:
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
            raise DataError(f"{path} is a run of {run.dataset}: choose another folder or delete it")
        changes = [*self._changes(run, path)]
        if changes:
            logger.warning("%s is replaced by a new run: %s", path, "; ".join(changes))
        return None if changes else run

    def _changes(self, run: DescriptorRun, path: Path) -> Iterator[str]:
        """Yield the differences between the run and the requested one."""
        before, now = (
            _relevant(config, run.descriptor)
            for config in (run.config, self.config.model_dump(mode="json"))
        )
        for key in dict.fromkeys([*before, *now]):
            if before.get(key) != now.get(key):
                yield f"{key} was {_shown(before.get(key))}, is {_shown(now.get(key))}"
        if self.bad_frames == "error" and run.skipped:
            yield f"it lacks {len(run.skipped)} frames that cannot be described"
        elif not self._has_all_frames(run):
            yield f"it was made of {len(run)} frames, now there are others"
        elif path.stat().st_mtime < self._newest:
            yield "the recording or the program is newer"

    def _has_all_frames(self, run: DescriptorRun) -> bool:
        left = ~np.isin(self.dataset.numbers, list(run.skipped))
        return np.array_equal(run.numbers, self.dataset.numbers[left]) and np.array_equal(
            run.stamps_ns, self.dataset.stamps_ns[left]
        )

    @cached_property
    def _newest(self) -> float:
        """Time of the last change of the recording or the compiled core."""
        with suppress(OSError):  # a missing file is reported when it is read
            return max(
                path.stat().st_mtime for path in (Path(str(_core.__file__)), *self.dataset.files())
            )
        return float("inf")


def with_poses_of(dataset: "Dataset", run: DescriptorRun) -> DescriptorRun:
    """Return the run with the current poses of the dataset."""
    return replace(run, poses=None if dataset.poses is None else dataset.poses[run.frames])


def _relevant(config: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return the values of a configuration that affect a descriptor, by dotted key."""
    ignored = _IRRELEVANT | (set() if DESCRIPTORS[name].needs_normals else {"normal_radius"})
    if DESCRIPTORS[name].needs_normals:
        ignored |= {"preset", "color_space", "m2dp"}
    described = {k: v for k, v in config.get("descriptors", {}).items() if k not in ignored}
    return {
        **_flat("fusion", config.get("fusion", {})),
        **_flat("descriptors", described),
    }


def _flat(where: str, values: Mapping[str, Any]) -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in values.items():
        inner = isinstance(value, Mapping)
        flat |= _flat(f"{where}.{key}", value) if inner else {f"{where}.{key}": value}
    return flat


def _shown(value: Any) -> str:
    return "none" if value is None else str(value)
