# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Does colour all round recognise places from the opposite direction? A Markdown table.

python -m benchmarks.accuracy.all_round_color            # five towns that nothing was fitted to
python -m benchmarks.accuracy.all_round_color --write    # and put the table into the docs

Drives of the made car with four cameras, recorded into the user's cache where they are missing,
two minutes of processor time each.
"""

import argparse
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.accuracy.markdown import write_between
from benchmarks.accuracy.presets import ROOT
from benchmarks.accuracy.towns import compare_towns
from fusionslam import DescriptorConfig, FusionConfig, PipelineConfig, describe_dataset
from fusionslam.base.cache import cache_folder
from fusionslam.datasets import open_dataset
from fusionslam.evaluation import DescriptorRun
from fusionslam.pipelines.results import run_path
from fusionslam.sim import CarConfig, SimConfig, TownConfig, record

PAGE = ROOT / "docs" / "stages" / "descriptors.md"
SEEDS = (1, 2, 3, 5, 7)
COLORED = ("cm2dp:robust", "cm2dp:upright", "cshot")
SHAPES = ("m2dp:robust", "m2dp:upright", "shot")
ABOVE_ROAD: Mapping[str, Any] = {"ground": "height", "voxel": 0.5}
"""Chosen on the town of seed 101: on the road and near the car, points show how the LiDAR scans."""


class Clouds(NamedTuple):
    """Clouds of one kind, and what they are described by."""

    name: str
    fusion: FusionConfig
    color_space: str
    descriptors: Sequence[str]


def _clouds(name: str, descriptors: Sequence[str], space: str = "rgb", **fusion: Any) -> Clouds:
    return Clouds(name, FusionConfig.model_validate(fusion), space, descriptors)


KINDS = (
    _clouds("four cameras, above the road", COLORED, **ABOVE_ROAD),
    _clouds("the same, CIELab", COLORED[:2], "lab", **ABOVE_ROAD),
    _clouds("the same, exposure as it is", COLORED[:2], balance=False, **ABOVE_ROAD),
    _clouds("the same, without colours", SHAPES, source="cloud", **ABOVE_ROAD),
    _clouds("four cameras, whole scans", COLORED[:2]),
    _clouds("the camera ahead, above the road", COLORED, cameras=("left",), **ABOVE_ROAD),
)


def record_ring(seed: int, folder: Path) -> Path:
    """The drive of the car with four cameras through a town; recorded where it is missing."""
    config = SimConfig(town=TownConfig(seed=seed), seed=seed, car=CarConfig(cameras="four"))
    return record(config, folder, jobs=os.cpu_count() or 1)


def describe_town(seed: int) -> dict[tuple[str, str], DescriptorRun]:
    """Describe a town's drive by all clouds and descriptors; the cache keeps the runs."""
    cache, runs = cache_folder(), {}
    for kind in KINDS:
        folder = cache / "all-round-color" / f"{seed} {kind.name}"
        source = kind.fusion.source
        missing = [name for name in kind.descriptors if not run_path(folder, source, name).exists()]
        if missing:
            drive = record_ring(seed, cache / f"town-{seed}-four-cameras")
            config = PipelineConfig(
                fusion=kind.fusion,
                descriptors=DescriptorConfig.model_validate({"color_space": kind.color_space}),
            )
            jobs = os.cpu_count() or 1
            describe_dataset(open_dataset(drive), missing, folder, config=config, jobs=jobs)
        for name in kind.descriptors:
            runs[kind.name, name] = DescriptorRun.load(run_path(folder, source, name))
    return runs


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="put the table into the docs")
    parser.add_argument("--seeds", nargs="+", type=int, default=SEEDS)
    arguments = parser.parse_args()
    towns = [describe_town(seed) for seed in arguments.seeds]
    keys = ((clouds, name, clouds) for clouds, name in towns[0])
    text = compare_towns("all_round_color", arguments.seeds, towns, keys)
    print(text)
    if arguments.write:
        write_between(PAGE, "all round", text)


if __name__ == "__main__":
    main()
