# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Compares the presets of M2DP and c-M2DP on simulated drives and prints a Markdown table.

python -m benchmarks.accuracy.presets            # the embedded drive
python -m benchmarks.accuracy.presets DRIVE ...  # other recordings of the simulator
python -m benchmarks.accuracy.presets --write    # and put it into the docs and README.md
"""

import argparse
import os
import tempfile
from collections import Counter
from pathlib import Path

from benchmarks.accuracy.markdown import table, write_between
from fusionslam import DescriptorConfig, FusionConfig, PipelineConfig, describe_dataset
from fusionslam.datasets import open_dataset
from fusionslam.evaluation import DIRECTIONS, Evaluation, evaluate
from fusionslam.evaluation.loops import revisits as visits
from fusionslam.sim import embedded_drive

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "stages" / "descriptors.md"
README = ROOT / "README.md"
PRESETS = ("author", "paper", "robust")
SOURCES = {"lidar": ["m2dp", "cm2dp"], "stereo": ["m2dp", "cm2dp"], "cloud": ["m2dp"]}
WORDS = {"lidar": "LiDAR-camera", "stereo": "stereo", "cloud": "LiDAR, full circle"}


def evaluations(drive: Path, source: str, preset: str) -> list[Evaluation]:
    """The descriptors of one source under one preset, judged with 10 m and 50 frames."""
    config = PipelineConfig(
        fusion=FusionConfig(source=source, voxel=0.2 if source == "stereo" else 0),
        descriptors=DescriptorConfig(preset=preset),
    )
    dataset = open_dataset(drive)
    with tempfile.TemporaryDirectory() as folder:
        runs = describe_dataset(
            dataset, SOURCES[source], folder, config=config, jobs=os.cpu_count() or 1
        )
    return [evaluate(run) for run in runs]


def row(evaluation: Evaluation, preset: str) -> list[str]:
    """Top-1 of all revisits and by direction, recall at 100 % precision, max F1, AP."""
    curve = evaluation.curves["revisit"]
    by_direction = [evaluation.top1_by_direction[kind] for kind in ("same", "opposite")]
    figures = [curve.top1, *by_direction, curve.recall_at_full_precision, curve.max_f1]
    run = evaluation.run
    names = [WORDS[run.source], run.descriptor, preset]
    return [*names, *(f"{x:.3f}" for x in (*figures, curve.average_precision))]


def compare(drive: Path) -> tuple[str, str]:
    """The table of one drive, and a short one of top-1 and recall at 100 % precision."""
    poses = open_dataset(drive).poses
    assert poses is not None  # the simulator always writes them
    kinds = Counter(visit.kind for visit in visits(poses))
    rows, short = [], []
    for source in SOURCES:
        judged = {preset: evaluations(drive, source, preset) for preset in PRESETS}
        for position in range(len(SOURCES[source])):
            columns = [row(judged[preset][position], preset) for preset in PRESETS]
            rows += columns
            short.append(
                [", ".join(columns[0][:2]), *(f"{cells[3]} / {cells[6]}" for cells in columns)]
            )
    header = ["cloud", "descriptor", "preset", "top-1", "same direction", "opposite"]
    text = table([*header, "recall at 100 % precision", "max F1", "AP"], rows)
    counts = ", ".join(f"{kinds[kind]} {kind}" for kind in DIRECTIONS)
    rules = "protocol revisit, 10 m, 50 frames"
    words = f"{len(poses)} frames, revisits by direction: {counts}; {rules}."
    return f"{words}\n\n{text}", table(["clouds, descriptor", *PRESETS], short)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("drives", nargs="*", type=Path)
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    for drive in arguments.drives or [embedded_drive()]:
        text, short = compare(drive)
        print(f"{text}\n")
    if arguments.write:
        write_between(README, "readme", short)
        write_between(PAGE, "presets", f"`python -m benchmarks.accuracy.presets`: {text}")


if __name__ == "__main__":
    main()
