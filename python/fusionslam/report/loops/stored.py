# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Write report.html and metrics.json from the runs stored in a folder."""

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fusionslam.config import merged
from fusionslam.errors import DataError
from fusionslam.evaluation import Evaluation
from fusionslam.fusion import FusionConfig, fuse
from fusionslam.pipelines.recording import Recording
from fusionslam.pipelines.results import Work
from fusionslam.sensors.frame import Cloud, Frame

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset
from fusionslam.pipelines.compare_descriptors import DEMO_NOTE, evaluate_stored, stored_config


def write_stored_metrics(
    folder: str | os.PathLike[str], evaluations: Sequence[Evaluation], *, command: str = ""
) -> Path:
    """Write ``folder/metrics.json``: every figure under every protocol. Raises DataError."""
    from fusionslam.report.loops.exports import metrics_of
    from fusionslam.report.page.html import write_figures
    from fusionslam.storage.machine import machine, versions

    dataset = evaluations[0].run.dataset
    about = {"dataset": dataset, "command": command, "versions": versions(), "machine": machine()}
    path = Path(folder) / "metrics.json"
    write_figures(path, about, [metrics_of(evaluation) for evaluation in evaluations])
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
        folder: folder that ``benchmark`` wrote.
        evaluations: evaluations of these runs; None computes them.
        output: None writes the report into ``folder``.
        protocol: protocol that judges the loops; None for that of the stored configuration.
        command: None for the stored one.

    Raises:
        DataError: no runs, or the output cannot be written.
        FusionSlamError: matplotlib or jinja2 is not installed.
    """
    from fusionslam.report import write_report

    if evaluations is None:
        evaluations, _ = evaluate_stored(folder)
    work = Work.load(folder)
    runs = [evaluation.run for evaluation in evaluations]
    fusion = {run.source: merged(FusionConfig(), run.config["fusion"]) for run in runs}
    pictured = _Pictured(work.recording, fusion) if work else None
    return write_report(
        evaluations,
        output or folder,
        dataset_name=runs[0].dataset,
        command=(work.command if work and command is None else command) or "",
        config={f"{run.source} / {run.descriptor}": run.config for run in runs},
        protocol=protocol or stored_config(folder).protocol,
        clouds=pictured.cloud if pictured else None,
        images=pictured.image if pictured else None,
        notes=[DEMO_NOTE] if work and work.demo and "cloud" in fusion else [],
    )


@dataclass(frozen=True)
class _Pictured:
    """Reads frames of a recording by their number in the file names, for the report's pictures."""

    recording: Recording
    fusion: Mapping[str, FusionConfig]

    @cached_property
    def _opened(self) -> "Callable[[str], tuple[Dataset, dict[int, int]]]":
        # Gaps do not matter here: the number identifies the frame.
        recording = replace(self.recording, gaps="skip")

        @cache
        def opened(source: str) -> "tuple[Dataset, dict[int, int]]":
            found = recording.open(source)
            return found, {number: i for i, number in enumerate(found.numbers.tolist())}

        return opened

    def cloud(self, source: str, number: int) -> Cloud:
        return fuse(self._frame(source, number), self.fusion[source])

    def image(self, source: str, number: int) -> NDArray[np.uint8]:
        """Return the left image; clouds without images take it from a source that has one."""
        for other in ("lidar", "stereo"):
            with suppress(DataError):
                return self._frame(other, number).images["left"]
        self._opened(source)  # an error of the recording itself is the better reason
        raise DataError(f"{self.recording.path}, frame {number}: no left image")

    def _frame(self, source: str, number: int) -> Frame:
        dataset, places = self._opened(source)
        if number not in places:
            raise DataError(f"{self.recording.path}: frame {number} is not there")
        return dataset[places[number]]
