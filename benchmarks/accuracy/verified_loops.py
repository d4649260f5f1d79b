# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Measures how many loops of simulated towns are found, by direction of the revisit.

python -m benchmarks.accuracy.verified_loops               # towns that nothing was fitted to
python -m benchmarks.accuracy.verified_loops 1 2 -d shot # these towns, this descriptor
python -m benchmarks.accuracy.verified_loops --write       # verified loops alone, into the docs

Prints the mean and the range over the towns of each source and protocol, of descriptors alone and
of verified loops. Towns are taken from the cache and recorded if missing, as by
``benchmarks.accuracy.loop_thresholds``, whose runs are used. Verifying takes about five minutes of
processor time a town; what is verified is kept in the cache.
"""

import argparse
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from textwrap import fill

import numpy as np

from benchmarks.accuracy.loop_thresholds import NAMES, describe_town
from benchmarks.accuracy.markdown import table, write_between
from benchmarks.accuracy.presets import CLOUDS, ROOT, mean_and_range, record_towns
from fusionslam import FusionConfig, PipelineConfig
from fusionslam.base.cache import cache_folder
from fusionslam.datasets import open_dataset
from fusionslam.evaluation import DIRECTIONS, Evaluation, VerifiedRun, evaluate, evaluate_verified
from fusionslam.pipelines.recording import Recording
from fusionslam.pipelines.verified_loops import verify_recording

PAGE = ROOT / "docs" / "stages" / "loop_closure.md"
SEEDS = (1, 2, 3, 5, 7)
DESCRIPTORS = ("m2dp:robust", "cm2dp:robust", "scan_context")
PROPOSERS = {"lidar": "cm2dp", "stereo": "cm2dp", "cloud": "m2dp"}
"""The detector's descriptor by source."""
PROTOCOLS = ("revisit", "pose-1m-5deg", "pose-2m-5deg")
ALL = "all"
HEADER = ("clouds", "found by", "protocol", "figure", ALL, *DIRECTIONS)

Figures = dict[tuple[str, str], dict[str, float]]
"""Values by (protocol, figure) and direction, or ``ALL``."""


def evaluate_town(seed: int, folder: Path, names: Sequence[str]) -> list[Evaluation]:
    """Evaluate the runs of a town's drive; ``folder`` keeps them."""
    runs = describe_town(seed, folder, names).values()
    plain = [evaluate(run, protocols=PROTOCOLS) for run in runs]
    return plain + [
        evaluate_verified(verify_town(seed, source), protocols=PROTOCOLS) for source in PROPOSERS
    ]


def verify_town(seed: int, source: str) -> VerifiedRun:
    """Prove the loops of a town's drive with the defaults."""
    (drive,) = record_towns([seed])
    config = PipelineConfig(fusion=FusionConfig.model_validate({"source": source}))
    return verify_recording(
        Recording.at(drive),
        open_dataset(drive),
        cache_folder() / "verified-loops" / str(seed),
        PROPOSERS[source],
        config=config,
        jobs=os.cpu_count() or 1,
    )


def figures_of(evaluation: Evaluation) -> Figures:
    """Collect top-1, recall at 100 % precision and what a detector accepted."""
    found: Figures = {}
    for name, curve in evaluation.curves.items():
        shares = evaluation.by_direction[name]
        full = curve.recall_at_full_precision
        found[name, "top-1"] = _known({ALL: curve.top1} | {k: v.top1 for k, v in shares.items()})
        found[name, "recall at 100 % precision"] = _known(
            {ALL: full} | {kind: each.recall_at_full_precision for kind, each in shares.items()}
        )
        if name in evaluation.accepted:
            accepted = evaluation.accepted[name]
            found[name, "recall of the accepted"] = _known(
                {ALL: accepted.recall} | {kind: each.accepted for kind, each in shares.items()}
            )
            found[name, "wrong ones accepted"] = {ALL: accepted.wrong}
    return found


def _known(values: dict[str, float | None]) -> dict[str, float]:
    return {kind: value for kind, value in values.items() if value is not None}


def rows(towns: Sequence[Sequence[Evaluation]]) -> Iterator[list[str]]:
    """Yield a row for each source, run, protocol and figure: mean (lowest to highest) over towns.

    A direction in which some towns have no revisits is that of the others.
    """
    runs: dict[tuple[str, str], list[Figures]] = {}
    for evaluation in (evaluation for town in towns for evaluation in town):
        key = evaluation.run.source, evaluation.run.name
        runs.setdefault(key, []).append(figures_of(evaluation))
    for (source, name), found in runs.items():
        for protocol, figure in dict.fromkeys(key for town in found for key in town):
            values = [town.get((protocol, figure), {}) for town in found]
            cells = [[town[kind] for town in values if kind in town] for kind in (ALL, *DIRECTIONS)]
            yield [
                CLOUDS[source],
                f"`{name}`",
                protocol,
                figure,
                *(mean_and_range(np.array(cell, np.float64)) if cell else "" for cell in cells),
            ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seeds", nargs="*", type=int, default=SEEDS)
    parser.add_argument("-d", "--descriptors", nargs="+", choices=NAMES, default=DESCRIPTORS)
    parser.add_argument("--runs", type=Path, default=cache_folder() / "loop-thresholds")
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    seeds = arguments.seeds or SEEDS
    names = [] if arguments.write else arguments.descriptors
    towns = [evaluate_town(seed, arguments.runs / str(seed), names) for seed in seeds]
    about = (
        f"Towns of seeds {', '.join(map(str, seeds))}; radius 10 m, window 50 frames. Mean (lowest "
        "to highest) over the towns. Recall at 100 % precision of one direction: share of its "
        "revisits found at the threshold at which all loops of the town are right."
    )
    lines = list(rows(towns))
    if arguments.write:
        command = "`python -m benchmarks.accuracy.verified_loops --write`: "
        text = f"{fill(command + about, 100)}\n\n{table(HEADER, lines)}"
        write_between(PAGE, "verified", text)
    print(f"{fill(about, 100)}\n\n{table(HEADER, lines)}")


if __name__ == "__main__":
    main()
