# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Fits the default thresholds of loops on simulated towns, and measures them on other towns.

python -m benchmarks.accuracy.loop_thresholds            # towns from the cache, recorded if missing
python -m benchmarks.accuracy.loop_thresholds --write    # and store the thresholds and the table
python -m benchmarks.accuracy.loop_thresholds -d shot ... # of these alone; the others stay

A threshold is the largest one at which 95 % of the loops are right in each fitted town: towns
differ so much that one fitted to all of them together is wrong in some. Where no threshold is, it
lies below the nearest match of a town, which is false: such a descriptor finds hardly anything
until it is given another threshold. Recording and describing a town takes about five minutes of
processor time.
"""

import argparse
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill

import numpy as np
import yaml
from numpy.typing import NDArray

from benchmarks.accuracy.data import data_folder
from benchmarks.accuracy.markdown import read_rows, table, write_between
from benchmarks.accuracy.presets import CLOUDS, ROOT, mean_and_range, record_towns
from fusionslam import FusionConfig, PipelineConfig, describe_dataset
from fusionslam.base.cache import cache_folder
from fusionslam.datasets import open_dataset
from fusionslam.descriptors import DESCRIPTORS
from fusionslam.evaluation import DescriptorRun, PrecisionRecall, evaluate, precision_recall
from fusionslam.loop_closure import default_threshold
from fusionslam.pipelines.compare_descriptors import TARGET_PRECISION
from fusionslam.pipelines.results import run_path

PAGE = ROOT / "docs" / "stages" / "loop_closure.md"
THRESHOLDS = ROOT / "python" / "fusionslam" / "loop_closure" / "thresholds.yaml"
FITTED = (101, 102, 103, 104, 105, 106)
REPORTED = (1, 2, 3, 5, 7, 11)
NAMES = tuple(
    f"{kind.name}:{preset}" if preset else kind.name
    for kind in DESCRIPTORS.values()
    for preset in kind.presets or (None,)
)
SOURCES: Mapping[str, Sequence[str]] = {
    "lidar": NAMES,
    "stereo": [name for name in NAMES if "shot" not in name],
    "cloud": [name for name in NAMES if name.startswith(("m2dp", "scan_context", "bev_spectrum"))],
}
"""Descriptors by source. The full circle has no colours; SHOT is slow for dense clouds."""

# Fitted on two towns. What is missing here has the threshold of LiDAR-camera clouds: coloured
# clouds as they are were usually fused from them, and stereo clouds are farther apart.
_OTHERS = {("cloud", "shot"): 0.052}

Runs = Mapping[tuple[str, str], PrecisionRecall]


@dataclass(frozen=True)
class Accepted:
    """What a threshold accepts on one drive: number of loops, share that is right, recall."""

    loops: int
    precision: float
    recall: float


def describe_town(
    seed: int, folder: Path, wanted: Sequence[str]
) -> dict[tuple[str, str], DescriptorRun]:
    """Describe a town's drive by every source and wanted descriptor; ``folder`` keeps the runs."""
    runs = {}
    for source, possible in SOURCES.items():
        names = [name for name in possible if name in wanted]
        missing = [name for name in names if not run_path(folder, source, name).exists()]
        if missing:
            config = PipelineConfig(fusion=FusionConfig.model_validate({"source": source}))
            jobs = os.cpu_count() or 1
            (drive,) = record_towns([seed])
            describe_dataset(open_dataset(drive), missing, folder, config=config, jobs=jobs)
        for name in names:
            runs[source, name] = DescriptorRun.load(run_path(folder, source, name))
    return runs


def judge_town(seed: int, folder: Path, wanted: Sequence[str]) -> Runs:
    """Evaluate every source and wanted descriptor on a town's drive; ``folder`` keeps the runs."""
    return {
        key: evaluate(run, protocols=["revisit"]).curves["revisit"]
        for key, run in describe_town(seed, folder, wanted).items()
    }


def fit(curves: Sequence[PrecisionRecall]) -> float:
    """Return the largest threshold that is right in each of some towns, rounded down."""
    limits = [
        0.99 * curve.distances.min() if limit is None else limit
        for curve in curves
        for limit in [curve.threshold_at(TARGET_PRECISION)]
    ]
    return float(np.floor(min(limits) * 1000) / 1000)


def accept(curve: PrecisionRecall, threshold: float) -> Accepted:
    """Count the loops at a threshold; the precision of none is NaN."""
    accepted = curve.accepted(threshold)
    right = int((accepted & curve.correct).sum())
    loops = int(accepted.sum())
    precision = right / loops if loops else float("nan")
    return Accepted(loops, precision, right / curve.n_revisits)


def thresholds_yaml(fitted: Mapping[tuple[str, str], float]) -> str:
    """Format the thresholds as the package reads them; those not fitted stay as they are."""
    stored = yaml.safe_load(THRESHOLDS.read_text(encoding="utf-8"))
    lines = [
        "# SPDX-FileCopyrightText: 2026 The fusionslam authors",
        "# SPDX-License-Identifier: Apache-2.0",
        "# Largest descriptor distance of a loop, by source, descriptor and preset. Written by",
        "# python -m benchmarks.accuracy.loop_thresholds --write",
    ]
    for source in SOURCES:
        lines.append(f"{source}:")
        for name in NAMES:
            known = _OTHERS.get((source, name), fitted.get(("lidar", name)))
            value = fitted.get((source, name), stored[source].get(name) if known is None else known)
            if value is not None:
                lines.append(f'  "{name}": {value:.3f}')
    return "\n".join(lines) + "\n"


def accuracy_table(fitted: Mapping[tuple[str, str], float], towns: Sequence[Runs]) -> str:
    """One row per source, descriptor and preset: what its threshold accepts in each town.

    Rows of the page whose descriptor was not fitted stay as they are.
    """
    stored = read_rows(PAGE, "thresholds")
    rows = []
    for source, name in ((source, name) for source, names in SOURCES.items() for name in names):
        if (source, name) not in fitted:
            rows += [row for row in stored if row[:2] == [CLOUDS[source], f"`{name}`"]]
            continue
        threshold = fitted[source, name]
        found = [accept(town[source, name], threshold) for town in towns]
        loops = np.array([each.loops for each in found], np.float64)
        right = sum(each.loops * each.precision for each in found if each.loops)
        shares = [each.precision for each in found if each.loops]
        together = f"{right / loops.sum():.2f}" if loops.any() else "none found"
        worst = f" ({min(shares):.2f} to {max(shares):.2f})" if shares else ""
        rows.append(
            [
                CLOUDS[source],
                f"`{name}`",
                f"{threshold:.3f}",
                f"{loops.mean():.1f} ({loops.min():.0f} to {loops.max():.0f})",
                together + worst,
                mean_and_range(np.array([each.recall for each in found])),
            ]
        )
    header = ["clouds", "descriptor", "threshold", "loops", "right", "recall"]
    return table(header, rows)


def judge_kitti(threshold: float) -> str:
    """One sentence on real data: the descriptors of KITTI 06 that the c-M2DP author stored."""
    data = data_folder()
    rows = np.load(data / "descriptors" / "kitti06_lidar_camera_m2dp.npy")
    poses = np.loadtxt(data / "kitti" / "poses" / "06.txt").reshape(-1, 3, 4)
    curve = precision_recall(rows, poses[:, :, 3])
    found = accept(curve, threshold)
    right, recall = f"{found.precision:.0%}", f"{found.recall:.0%}"
    return (
        f"On KITTI 06, of which the author of c-M2DP stored the descriptors (LiDAR-camera, "
        f"`m2dp:author`), the threshold of the towns, {threshold:.3f}, accepts {found.loops} "
        f"loops, {right} of them right, {recall} of {curve.n_revisits} revisits; "
        f"{TARGET_PRECISION:.0%} are right up to {curve.threshold_at(TARGET_PRECISION):.3f}."
    )


def revisits_of(towns: Sequence[Runs]) -> NDArray[np.float64]:
    """Number of revisits of each town."""
    return np.array([next(iter(town.values())).n_revisits for town in towns], np.float64)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("-d", "--descriptors", nargs="+", choices=NAMES, default=NAMES)
    parser.add_argument("--runs", type=Path, default=cache_folder() / "loop-thresholds")
    arguments = parser.parse_args()

    def judge(seeds: Sequence[int]) -> list[Runs]:
        wanted, runs = arguments.descriptors, arguments.runs
        return [judge_town(seed, runs / str(seed), wanted) for seed in seeds]

    fitting = judge(FITTED)
    fitted = {
        (source, name): fit([town[source, name] for town in fitting]) for source, name in fitting[0]
    }
    towns = judge(REPORTED)
    shown = accuracy_table(fitted, towns)
    about = fill(
        f"`python -m benchmarks.accuracy.loop_thresholds`: thresholds fitted on the towns of seeds "
        f"{', '.join(map(str, FITTED))}, measured on those of seeds "
        f"{', '.join(map(str, REPORTED))}, 350 frames and "
        f"{revisits_of(towns).mean():.0f} revisits each on average; protocol revisit, 10 m, 50 "
        "frames. Mean (lowest to highest) over the towns; right: over all loops (lowest to highest "
        "of the towns with loops).",
        100,
    )
    on_kitti = fitted.get(("lidar", "m2dp:author"), default_threshold("m2dp:author"))
    about += f"\n\n{fill(judge_kitti(on_kitti), 100)}"
    print(f"{about}\n\n{shown}\n\n{thresholds_yaml(fitted)}")
    if arguments.write:
        THRESHOLDS.write_text(thresholds_yaml(fitted), encoding="utf-8")
        write_between(PAGE, "thresholds", f"{about}\n\n{shown}")


if __name__ == "__main__":
    main()
