# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Table of descriptors over several made towns, by direction of the revisits."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from textwrap import fill

import numpy as np

from benchmarks.accuracy.markdown import table
from benchmarks.accuracy.presets import FIGURES, figures_of, mean_and_range
from fusionslam.evaluation import DIRECTIONS, DescriptorRun, evaluate, visits

COLUMNS = FIGURES[:4]
Town = Mapping[tuple[str, str], DescriptorRun]
"""Runs by kind of clouds and name of the descriptor."""


def compare_towns(
    module: str, seeds: Sequence[int], towns: Sequence[Town], keys: Iterable[tuple[str, str, str]]
) -> str:
    """Return a Markdown table of mean (lowest to highest) over towns, and a line about it.

    Args:
        module: that prints it, of benchmarks.accuracy.
        seeds: of the towns.
        towns: one mapping of runs each.
        keys: kind of clouds, name of the descriptor, and the kind as it is to be called.
    """
    rows = []
    for kind, name, called in keys:
        found = np.array([figures_of(evaluate(town[kind, name])) for town in towns], float)
        figures = [mean_and_range(found[:, column]) for column in range(len(COLUMNS))]
        rows.append([called, f"`{name}`", *figures])
    directions: Counter[str] = Counter()
    for town in towns:
        poses = next(iter(town.values())).poses
        assert poses is not None  # the simulator always writes them
        directions += Counter(visit.kind for visit in visits(poses))
    about = fill(
        f"`python -m benchmarks.accuracy.{module}`: the towns of seeds "
        f"{', '.join(map(str, seeds))}, revisits by direction: "
        f"{', '.join(f'{directions[kind]} {kind}' for kind in DIRECTIONS)}; protocol revisit, "
        "10 m, 50 frames. Mean (lowest to highest) over the towns.",
        100,
    )
    return f"{about}\n\n{table(['clouds', 'descriptor', *COLUMNS], rows)}"
