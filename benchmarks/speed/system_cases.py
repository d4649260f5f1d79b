# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The pipeline as a whole: one frame on a robot, and a recording worked through in parallel."""

import tempfile
from collections.abc import Iterator

import numpy as np

import fusionslam
from benchmarks.speed.cases import Agreement, Bound, Case, agree, times_faster
from benchmarks.speed.inputs import Inputs, Points, random_descriptors
from benchmarks.speed.peers import native, numpy_colorize, numpy_search
from benchmarks.speed.search_cases import filled
from benchmarks.speed.settings import Settings
from benchmarks.speed.timing import Times, timer
from fusionslam.datasets import Dataset
from fusionslam.evaluation import DescriptorRun
from fusionslam.pipelines.describe import describe_dataset


def frame_cases(inputs: Inputs, settings: Settings) -> Iterator[Case]:
    """Scan in, loop answer out: colour, c-M2DP, nearest of the map."""
    scene = inputs.frame
    arguments = (scene.points, scene.image, scene.projection)
    rows = random_descriptors(settings.tables[0][0], 576)
    rows[len(rows) // 2] = fusionslam.cm2dp(*fusionslam.colorize(*arguments)[:2], preset="paper")
    index, searched = filled(rows), numpy_search(rows)

    def ours(preset: str) -> tuple[int, Points]:
        points, colors, _ = fusionslam.colorize(*arguments)
        descriptor = fusionslam.cm2dp(points, colors, preset=preset)
        found, _ = index.query(descriptor)
        return int(found[0]), descriptor

    def naive() -> tuple[int, Points]:
        points, colors, _ = numpy_colorize(*arguments)
        descriptor = native.paper_cm2dp(points, colors).astype(np.float32)
        found, _ = searched(descriptor[None])
        return int(found[0]), descriptor

    count = len(fusionslam.colorize(*arguments)[0])
    for preset in ("paper", "robust"):
        yield Case(
            f"scan of {len(scene.points):,} points in, loop answer out "
            f"({count:,} coloured, c-M2DP {preset}, map of {len(rows):,})",
            "NumPy, the papers word by word, NumPy",
            timer(ours, preset),
            timer(naive),
            lambda: _same_answer(ours("paper"), naive()),
            Bound("median", "<=", 5),
        )


def _same_answer(ours: tuple[int, Points], theirs: tuple[int, Points]) -> Agreement:
    if ours[0] != theirs[0]:
        return agree("frame that was found", abs(ours[0] - theirs[0]), 0)
    error = float(np.linalg.norm(ours[1] - theirs[1]))
    return agree("`paper`: same frame; L2 of descriptors", error, 1e-5)


def describe_cases(inputs: Inputs, settings: Settings) -> Iterator[Case]:
    """describe over a sequence, files included, by one job and by two."""
    one = _Described(inputs.sequence, 1)
    two = _Described(inputs.sequence, 2)
    yield Case(
        f"describe (c-M2DP) over {len(inputs.sequence)} frames of {inputs.sequence.name}, 2 jobs",
        "1 job",
        timer(two),
        timer(one),
        lambda: _same_runs(two(), one()),
        times_faster(1.8),
        detail=one.bounded_by,
    )


class _Described:
    """describe_dataset with a number of jobs, into a new folder each time."""

    def __init__(self, dataset: Dataset, jobs: int) -> None:
        self._dataset = dataset
        self._jobs = jobs
        self._run: DescriptorRun | None = None

    def __call__(self) -> DescriptorRun:
        with tempfile.TemporaryDirectory() as folder:
            runs = describe_dataset(self._dataset, ["cm2dp"], folder, jobs=self._jobs)
        self._run = runs[0]
        return runs[0]

    def bounded_by(self) -> str:
        """Where a frame's time goes with this many jobs, from the last run."""
        assert self._run is not None  # asked after the timing
        stages = {
            name: Times.of(seconds.tolist()).median for name, seconds in self._run.seconds.items()
        }
        total = sum(stages.values())
        parts = ", ".join(
            f"{name} {1e3 * seconds:.1f} ms ({seconds / total:.0%})"
            for name, seconds in stages.items()
        )
        return f"a frame's time, {self._jobs} job: {parts}"


def _same_runs(ours: DescriptorRun, theirs: DescriptorRun) -> Agreement:
    differ = (ours.descriptors != theirs.descriptors).any(axis=1)
    return agree("frames with another descriptor", int(differ.sum()), 0)
