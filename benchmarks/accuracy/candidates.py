# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Measures how often one of several descriptors' nearest frames is the place, in full circles.

python -m benchmarks.accuracy.candidates              # towns that voters are chosen on, and others
python -m benchmarks.accuracy.candidates --seeds 1 2  # these alone
python -m benchmarks.accuracy.candidates --write      # put the table into the docs

Each descriptor proposes its 10 nearest frames; what verified loops are found among is their union.
"""

import argparse
from collections.abc import Sequence
from itertools import combinations
from textwrap import fill

import numpy as np
from numpy.typing import NDArray

from benchmarks.accuracy.loop_thresholds import FITTED, describe_town
from benchmarks.accuracy.markdown import table, write_between
from benchmarks.accuracy.presets import PAGE, mean_and_range
from fusionslam.base.cache import cache_folder
from fusionslam.evaluation import DescriptorRun, find_matches, visits

VOTERS = ("m2dp:robust", "scan_context", "bev_spectrum")
UNIONS = [names for size in (1, 2, 3) for names in combinations(VOTERS, size)]
SHOWN = (1, 2, 3, 5, 7)
NEAREST = 10
RADIUS, WINDOW = 10.0, 50


def found(run: DescriptorRun) -> NDArray[np.bool_]:
    """bool (N,): whether one of the candidates of each frame is its place."""
    assert run.poses is not None  # the simulator always writes them
    places = run.poses[:, :3, 3]
    candidates = find_matches(run.descriptors, window=WINDOW, k=NEAREST, metric=run.metric).indices
    apart = np.linalg.norm(places[candidates] - places[:, None], axis=2)
    near: NDArray[np.bool_] = ((apart < RADIUS) & (candidates >= 0)).any(axis=1)
    return near


def recalls(seed: int) -> list[float]:
    """Share of a town's revisits found by each of ``UNIONS``."""
    runs = describe_town(seed, cache_folder() / "loop-thresholds" / str(seed), VOTERS)
    by_name = {name: runs["cloud", name] for name in VOTERS}
    poses = by_name[VOTERS[0]].poses
    assert poses is not None
    revisits = np.array([v.kind != "new" for v in visits(poses, radius=RADIUS, window=WINDOW)])
    right = {name: found(run) for name, run in by_name.items()}
    return [float(np.any([right[n] for n in names], axis=0)[revisits].mean()) for names in UNIONS]


def column(seeds: Sequence[int]) -> list[str]:
    values = np.array([recalls(seed) for seed in seeds])
    return [mean_and_range(values[:, row]) for row in range(len(UNIONS))]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", nargs="+", type=int)
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    groups = [arguments.seeds] if arguments.seeds else [FITTED, SHOWN]
    names = [", ".join(f"`{name}`" for name in union) for union in UNIONS]
    header = ["descriptors", *(f"towns {', '.join(map(str, seeds))}" for seeds in groups)]
    rows = zip(names, *(column(seeds) for seeds in groups), strict=True)
    shown = table(header, [list(row) for row in rows])
    about = fill(
        f"`python -m benchmarks.accuracy.candidates`: share of the revisits of which one of the "
        f"{NEAREST} nearest frames of a descriptor, or of several together, is within "
        f"{RADIUS:.0f} m; full circles, window {WINDOW} frames. Mean (lowest to highest).",
        100,
    )
    print(f"{about}\n\n{shown}")
    if arguments.write:
        write_between(PAGE, "candidates", f"{about}\n\n{shown}")


if __name__ == "__main__":
    main()
