# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A run of the benchmark: every part, one after the other, in one process."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.speed import (
    alignment_cases,
    curves,
    descriptor_cases,
    fusion_cases,
    inputs,
    learning_cases,
    map_cases,
    memory,
    pose_cell_cases,
    registration_cases,
    search_cases,
    settings,
    similarity_cases,
    system_cases,
    view_cases,
)
from benchmarks.speed.cases import Case, Result, measured
from benchmarks.speed.curves import Curve
from benchmarks.speed.inputs import Inputs
from benchmarks.speed.machine import facts
from benchmarks.speed.memory import Memory
from benchmarks.speed.settings import Settings

Rows = Callable[[Inputs, Settings], Iterator[Case]]

ROWS: dict[str, Rows] = {
    "m2dp": descriptor_cases.m2dp_cases,
    "singular": descriptor_cases.singular_cases,
    "shot": descriptor_cases.shot_cases,
    "colour": fusion_cases.colour_cases,
    "surround": fusion_cases.all_round_cases,
    "stereo": fusion_cases.stereo_cases,
    "search": search_cases.search_cases,
    "views": view_cases.view_cases,
    "learning": learning_cases.learning_cases,
    "similarity": similarity_cases.similarity_cases,
    "alignment": alignment_cases.alignment_cases,
    "cells": pose_cell_cases.pose_cell_cases,
    "map": map_cases.map_cases,
    "registration": registration_cases.registration_cases,
    "frame": system_cases.frame_cases,
    "describe": system_cases.describe_cases,
}
PARTS = (*ROWS, "curves", "memory")

_SLOW = {"describe"}


@dataclass(frozen=True)
class Run:
    """Everything that was measured, and with what."""

    facts: dict[str, str]
    inputs: dict[str, str]
    results: Sequence[Result]
    curves: Sequence[Curve]
    memories: Sequence[Memory]
    seconds: float
    quick: bool

    @property
    def wrong(self) -> list[Result]:
        """Rows whose answer is not the peer's."""
        return [result for result in self.results if result.wrong]


def benchmark(
    parts: Sequence[str], folder: Path, *, quick: bool, step: Callable[[str], None]
) -> Run:
    """Measure the named parts.

    Args:
        parts: some of PARTS.
        folder: for files that the run needs; the caller removes it.
        quick: small sizes and hardly any repetition: the figures mean nothing.
        step: told what is being measured.
    """
    begin = time.perf_counter()
    sizes = settings.QUICK if quick else settings.FULL
    step("inputs")
    made = inputs.load(folder, quick=quick, frames=sizes.frames)
    results = [
        result for part in ROWS if part in parts for result in _rows(part, made, sizes, step)
    ]
    lines: list[Curve] = []
    if "curves" in parts:
        lines = curves.descriptor_curves(made, sizes, step) + curves.search_curves(sizes, step)
        lines += map_cases.map_curves(sizes, step)
    memories = _memories(made, sizes, folder, step) if "memory" in parts else []
    return Run(facts(), _words(made), results, lines, memories, time.perf_counter() - begin, quick)


def _rows(
    part: str, made: Inputs, sizes: Settings, step: Callable[[str], None]
) -> Iterator[Result]:
    limits = sizes.slow if part in _SLOW else sizes.limits
    for case in ROWS[part](made, sizes):
        step(case.name)
        yield measured(part, case, limits, settings.REASONS, judged=sizes.judged)


def _memories(
    made: Inputs, sizes: Settings, folder: Path, step: Callable[[str], None]
) -> list[Memory]:
    clouds = []
    for size in sizes.memory:
        points, colors = made.sized(size)
        clouds.append(folder / f"{size}.npz")
        np.savez(clouds[-1], points=points, colors=colors)
    found = []
    for work, who in memory.DESCRIPTORS.items():
        step(f"memory of {work}")
        found.append(Memory(work, who, sizes.memory, [memory.growth(work, c) for c in clouds]))
    rows = (sizes.index // 10, sizes.index)
    for work, who in memory.INDICES.items():
        step(f"memory of {work}")
        found.append(Memory(work, who, rows, [memory.growth(work, str(count)) for count in rows]))
    return found


def _words(made: Inputs) -> dict[str, str]:
    return {
        "clouds": f"{made.cloud_source}; smaller ones are samples of it, larger ones repeat it "
        f"with {1e3 * inputs.JITTER_M:.0f} mm of jitter",
        "coloured scan": made.scan.source,
        "frame": made.frame.source,
        "stereo pair": made.pair.source,
        "sequence": f"{made.sequence.name}, {len(made.sequence)} frames",
        "descriptors searched": "random unit vectors, without structure that a search could use",
    }
