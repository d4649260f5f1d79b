# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Compares the presets of M2DP and c-M2DP on simulated towns and prints Markdown tables.

python -m benchmarks.accuracy.presets            # six towns that nothing was fitted to
python -m benchmarks.accuracy.presets DRIVE ...  # other recordings of the simulator
python -m benchmarks.accuracy.presets --write    # and put the tables into the docs

The embedded drive's town, on which ``robust`` was developed, is not among the six. They are
recorded into the user's cache, about two minutes of processor time each, where they are missing.
"""

import argparse
import os
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.accuracy.markdown import table, write_between
from fusionslam import DescriptorConfig, FusionConfig, PipelineConfig, describe_dataset
from fusionslam.base.cache import cache_folder
from fusionslam.datasets import open_dataset
from fusionslam.evaluation import DIRECTIONS, Evaluation, evaluate, visits
from fusionslam.sim import SimConfig, TownConfig, record
from fusionslam.sim.town.route import DriveConfig

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "stages" / "descriptors.md"
SUMMARY = ROOT / "docs" / "results" / "index.md"
SEEDS = (11, 12, 13, 14, 15, 16)
PRESETS = ("author", "paper", "robust")
SOURCES = {"lidar": ["m2dp", "cm2dp"], "stereo": ["m2dp", "cm2dp"], "cloud": ["m2dp"]}
CLOUDS = {"lidar": "LiDAR-camera", "stereo": "stereo", "cloud": "LiDAR, full circle"}
FIGURES = ("top-1", "same direction", "opposite", "recall at 100 % precision", "max F1", "AP")
COMPARED = (FIGURES.index("top-1"), FIGURES.index("recall at 100 % precision"))


@dataclass(frozen=True)
class Comparison:
    """Figures of every cloud, descriptor and preset on each drive.

    Attributes:
        rows: cloud and descriptor of each row.
        values: float64 (drives, rows, presets, figures).
        visits: revisits by direction, over all drives.
    """

    rows: list[tuple[str, str]]
    values: NDArray[np.float64]
    visits: Counter[str]


def record_towns(seeds: Sequence[int] = SEEDS) -> list[Path]:
    """The drives through the towns of these seeds, from the cache where they are there."""
    jobs = os.cpu_count() or 1
    return [
        record(
            SimConfig(town=TownConfig(seed=seed), seed=seed),
            cache_folder() / f"town-{seed}",
            jobs=jobs,
        )
        for seed in seeds
    ]


def record_returns(seeds: Sequence[int]) -> list[Path]:
    """Second drives through the same towns: other noise, the first lap the opposite way."""
    jobs = os.cpu_count() or 1
    return [
        record(
            SimConfig(town=TownConfig(seed=seed), seed=seed + RETURN, drive=RETURN_DRIVE),
            cache_folder() / f"town-{seed}-return",
            jobs=jobs,
        )
        for seed in seeds
    ]


RETURN = 1000
RETURN_DRIVE = DriveConfig(
    laps=(
        ((1, 0), (0, 0), (0, 1), (1, 1), (2, 1), (2, 0), (1, 0)),
        ((1, 0), (1, 1), (0, 1), (0, 0), (1, 0)),
    ),
    lap_shift_m=(-0.6, 0.3),
)


def evaluate_preset(drive: Path, source: str, preset: str) -> list[Evaluation]:
    """The descriptors of one source under one preset, judged with 10 m and 50 frames."""
    config = PipelineConfig(
        fusion=FusionConfig.model_validate(
            {"source": source, "voxel": 0.2 if source == "stereo" else 0}
        ),
        descriptors=DescriptorConfig.model_validate({"preset": preset}),
    )
    with tempfile.TemporaryDirectory() as folder:
        runs = describe_dataset(
            open_dataset(drive), SOURCES[source], folder, config=config, jobs=os.cpu_count() or 1
        )
    return [evaluate(run) for run in runs]


def figures_of(evaluation: Evaluation) -> list[float | None]:
    """The values of ``FIGURES``."""
    curve = evaluation.curves["revisit"]
    directions = evaluation.by_direction["revisit"]
    by_direction = [directions[kind].top1 for kind in ("same", "opposite")]
    return [
        curve.top1,
        *by_direction,
        curve.recall_at_full_precision,
        curve.max_f1,
        curve.average_precision,
    ]


def compare(drives: Sequence[Path]) -> Comparison:
    """Every preset on every drive."""
    rows = [(CLOUDS[source], name) for source, names in SOURCES.items() for name in names]
    values: list[NDArray[np.float64]] = []
    directions: Counter[str] = Counter()
    for drive in drives:
        poses = open_dataset(drive).poses
        assert poses is not None  # the simulator always writes them
        directions += Counter(visit.kind for visit in visits(poses))
        by_preset = [
            [
                figures_of(evaluation)
                for source in SOURCES
                for evaluation in evaluate_preset(drive, source, preset)
            ]
            for preset in PRESETS
        ]
        values.append(np.array(by_preset, np.float64).transpose(1, 0, 2))
    return Comparison(rows, np.array(values, np.float64), directions)


def mean_and_range(values: NDArray[np.float64]) -> str:
    """``0.31 (0.22 to 0.40)``; the value alone where there is one."""
    if len(values) == 1:
        return f"{values[0]:.3f}"
    return f"{values.mean():.3f} ({values.min():.3f} to {values.max():.3f})"


def full_table(found: Comparison) -> str:
    """All figures of all presets."""
    rows = [
        [*name, preset, *(mean_and_range(found.values[:, i, j, k]) for k in range(len(FIGURES)))]
        for i, name in enumerate(found.rows)
        for j, preset in enumerate(PRESETS)
    ]
    return table(["cloud", "descriptor", "preset", *FIGURES], rows)


def short_table(found: Comparison) -> str:
    """Top-1 and recall at 100 % precision of ``robust``, and of the better original."""
    original = found.values[:, :, :2].max(axis=2)
    rows = []
    for i, (cloud, name) in enumerate(found.rows):
        cells = [
            mean_and_range(values[:, i, k])
            for k in COMPARED
            for values in (original, found.values[:, :, 2])
        ]
        rows.append([f"{cloud}, {name}", *cells])
    header = ["clouds, descriptor"]
    for k in COMPARED:
        header += [f"{FIGURES[k]}, better original", "`robust`"]
    return table(header, rows)


def count_wins(found: Comparison) -> tuple[int, int, int]:
    """How often ``robust`` beats, equals and loses to the better original of each drive."""
    compared = found.values[..., COMPARED]
    gain = compared[:, :, 2] - compared[:, :, :2].max(axis=2)
    return int((gain > 0).sum()), int((gain == 0).sum()), int((gain < 0).sum())


def describe_drives(found: Comparison) -> str:
    """One sentence on the drives, one on who wins."""
    won, equal, lost = count_wins(found)
    counts = ", ".join(f"{found.visits[kind]} {kind}" for kind in DIRECTIONS)
    return (
        f"{len(found.values)} drives, revisits by direction: {counts}; protocol revisit, 10 m, 50 "
        f"frames. Mean (lowest to highest) over the drives. Beside the better original of each "
        f"drive, `robust` wins {won} of {won + equal + lost} comparisons of top-1 and of recall at "
        f"100 % precision, and loses {lost}."
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("drives", nargs="*", type=Path)
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    found = compare(arguments.drives or record_towns())
    print(f"{describe_drives(found)}\n\n{full_table(found)}\n\n{short_table(found)}")
    if arguments.write:
        command = "`python -m benchmarks.accuracy.presets`"
        write_between(SUMMARY, "presets", short_table(found))
        write_between(
            PAGE, "presets", f"{command}: {describe_drives(found)}\n\n{full_table(found)}"
        )


if __name__ == "__main__":
    main()
