# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Recognises places by descriptors alone, without proof."""

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.real.protocol import find_near, find_revisits
from benchmarks.real.recordings import CLOUDS, Recording
from fusionslam import DescriptorConfig, LoopDetector
from fusionslam.base.arrays import Floats, Integers, Mask
from fusionslam.descriptors import (
    NAMES,
    describe_or_zeros,
    for_clouds,
    for_sequence,
    missing_data,
    needs_up,
)
from fusionslam.evaluation.loops.precision_recall import sweep_thresholds

NEAREST = 10


@dataclass(frozen=True)
class Recognised:
    """The frames that a descriptor finds nearest.

    Attributes:
        name: of the descriptor.
        candidates: int64 (N, 10), the nearest first; -1 where there are fewer.
        distances: float64 (N,), of the nearest; inf without one.
        near, revisits: bool (N, N), which frames are of one place; bool (N,), which have an older
            one.
        milliseconds: of processor time to describe a cloud and to compare it, the mean.
    """

    name: str
    candidates: Integers
    distances: Floats
    near: Mask
    revisits: Mask
    milliseconds: float

    @property
    def right(self) -> Mask:
        """Bool (N, 10): candidates that are of the place."""
        rows = np.arange(len(self.near))[:, None]
        return np.asarray(self.near[rows, self.candidates] & (self.candidates >= 0), np.bool_)

    def cells(self) -> list[str]:
        """Top-1, one of ten, F1max, recall at full precision and milliseconds."""
        curve = sweep_thresholds(self.distances, self.right[:, 0], self.revisits)
        found = self.right[self.revisits]
        figures = [found[:, 0].mean(), found.any(axis=1).mean()]
        figures += [curve["max_f1"], curve["recall_at_full_precision"]]
        return [*(f"{value:.3f}" for value in figures), f"{self.milliseconds:.1f}"]


def can_describe(recording: Recording, name: str) -> bool:
    """Whether a descriptor takes the clouds: they have what it needs of points, and a z axis."""
    lacks_up = recording.registration.gravity is False and needs_up(name, DescriptorConfig())
    return not lacks_up and missing_data(recording.clouds[0], name) is None


def recognise_all(recording: Recording) -> Iterator[Recognised]:
    """Recognise places by every descriptor that takes the clouds."""
    return (recognise(recording, name) for name in NAMES if can_describe(recording, name))


def recognise(recording: Recording, name: str) -> Recognised:
    """Describe the clouds and find the nearest of the older ones for each."""
    config = for_clouds(DescriptorConfig(), name, CLOUDS)
    config = for_sequence(config, [name], recording.leveled[0])
    rule, clouds = recording.rule, recording.leveled
    count = len(clouds)
    detector = LoopDetector(
        name,
        threshold=0.0,
        verify=False,
        window=rule.frames,
        window_seconds=rule.seconds,
        describe=config,
        fusion=CLOUDS,
    )
    candidates, distances = np.full((count, NEAREST), -1), np.full(count, np.inf)
    start = time.process_time()
    for row, (cloud, stamp) in enumerate(zip(clouds, recording.stamps_ns.tolist(), strict=True)):
        vector, _ = describe_or_zeros(cloud, name, config)
        detector.add_descriptor(vector, stamp_ns=stamp)
        found = detector.candidates(NEAREST)
        candidates[row, : len(found)] = [match for match, _ in found]
        if found:
            distances[row] = found[0][1]
    milliseconds = (time.process_time() - start) * 1e3 / count
    near = find_near(recording.poses, rule)
    revisits = find_revisits(recording.poses, recording.stamps_ns, rule)
    return Recognised(name, candidates, distances, near, revisits, milliseconds)


def join(several: list[Recognised]) -> list[str]:
    """Cells of several descriptors together: whether one of them finds the place."""
    right: Mask = np.any([each.right[each.revisits] for each in several], axis=0)
    milliseconds = sum(each.milliseconds for each in several)
    shares = [right[:, 0].mean(), right.any(axis=1).mean()]
    return [*(f"{value:.3f}" for value in shares), "-", "-", f"{milliseconds:.1f}"]
