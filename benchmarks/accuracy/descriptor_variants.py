# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Compares descriptors of upright clouds, and M2DP about its axes and about the vertical.

python -m benchmarks.accuracy.descriptor_variants            # five towns that nothing was fitted to
python -m benchmarks.accuracy.descriptor_variants --write    # and put the table into the docs

Towns are recorded, and descriptors computed, where benchmarks.accuracy.loop_thresholds did not.
"""

import argparse
from collections import Counter
from textwrap import fill

import numpy as np

from benchmarks.accuracy.loop_thresholds import SOURCES, describe_town
from benchmarks.accuracy.markdown import table, write_between
from benchmarks.accuracy.presets import CLOUDS, PAGE, figures_of, mean_and_range
from fusionslam.evaluation import DIRECTIONS, evaluate, visits
from fusionslam.storage.cache import cache_folder

SEEDS = (1, 2, 3, 5, 7)
VARIANTS = (
    *("scan_context", "cscan_context", "bev_spectrum"),
    *("m2dp:robust", "m2dp:upright", "cm2dp:robust", "cm2dp:upright"),
)
FIGURES = ("top-1", "same direction", "opposite", "recall at 100 % precision")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    folder = cache_folder() / "loop-thresholds"
    towns = [describe_town(seed, folder / str(seed), VARIANTS) for seed in SEEDS]
    rows = []
    for source in SOURCES:
        for name in (name for name in VARIANTS if (source, name) in towns[0]):
            found = np.array([figures_of(evaluate(town[source, name])) for town in towns], float)
            figures = [mean_and_range(found[:, column]) for column in range(len(FIGURES))]
            rows.append([CLOUDS[source], f"`{name}`", *figures])
    directions: Counter[str] = Counter()
    for town in towns:
        poses = next(iter(town.values())).poses
        assert poses is not None  # the simulator always writes them
        directions += Counter(visit.kind for visit in visits(poses))
    shown = table(["clouds", "descriptor", *FIGURES], rows)
    about = fill(
        "`python -m benchmarks.accuracy.descriptor_variants`: the towns of seeds "
        f"{', '.join(map(str, SEEDS))}, revisits by direction: "
        f"{', '.join(f'{directions[kind]} {kind}' for kind in DIRECTIONS)}; protocol revisit, "
        "10 m, 50 frames. Mean (lowest to highest) over the towns.",
        100,
    )
    print(f"{about}\n\n{shown}")
    if arguments.write:
        write_between(PAGE, "variants", f"{about}\n\n{shown}")


if __name__ == "__main__":
    main()
