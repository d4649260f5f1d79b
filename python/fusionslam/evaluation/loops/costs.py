# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Cost of a run: time per stage, memory, bytes per descriptor."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusionslam.argument_types import checked
from fusionslam.evaluation.loops.descriptor_run import DescriptorRun
from fusionslam.evaluation.loops.verified_run import LoopRun


@dataclass(frozen=True)
class StageCost:
    """Milliseconds per frame: the median and the 95th percentile over the frames."""

    median_ms: float
    p95_ms: float


@checked
@dataclass(frozen=True)
class Costs:
    """Cost of a run.

    Attributes:
        stages: cost of each stage, by its name.
        frame: cost of all stages of a frame together; None if no stage was timed.
        bytes_per_descriptor: size of one row; None of verified loops.
        peak_memory_bytes: memory needed to describe the largest cloud, beyond what was in use;
            None of verified loops.
        median_points: median number of points of a described cloud.
    """

    stages: dict[str, StageCost]
    frame: StageCost | None
    bytes_per_descriptor: int | None
    peak_memory_bytes: int | None
    median_points: float | None


@checked
def summarise_costs(run: LoopRun) -> Costs:
    """Summarise the costs of a run; figures of a run without frames are left out."""
    timed = {stage: seconds for stage, seconds in run.seconds.items() if len(seconds)}
    size = peak = None
    if isinstance(run, DescriptorRun):
        size = run.descriptors.shape[1] * run.descriptors.itemsize
        peak = run.peak_memory_bytes
    return Costs(
        stages={stage: _stage_cost(seconds) for stage, seconds in timed.items()},
        frame=_stage_cost(np.sum(list(timed.values()), axis=0)) if timed else None,
        bytes_per_descriptor=size,
        peak_memory_bytes=peak,
        median_points=float(np.median(run.points)) if len(run) else None,
    )


def _stage_cost(seconds: NDArray[np.float64]) -> StageCost:
    median, p95 = np.percentile(seconds, (50, 95)) * 1e3
    return StageCost(float(median), float(p95))
