# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How long describing and colouring take: python -m benchmarks.descriptor_times [--write].

Every descriptor of a scan of KITTI, whole and by one thread, and the colouring of a scan of the
simulated car by its four cameras. The scan is of the test data, which FUSIONSLAM_TEST_DATA names.
With --write the table goes into docs/stages/descriptors.md. Nothing else should run meanwhile.
"""

import argparse
import time
from collections.abc import Callable
from functools import partial

import numpy as np

from benchmarks.accuracy.all_round_color import record_ring
from benchmarks.accuracy.data import ROOT, data_folder
from benchmarks.accuracy.markdown import table, write_between
from fusionslam import DescriptorConfig, colorize_all_round
from fusionslam.base.cache import cache_folder
from fusionslam.datasets import open_dataset, read_cloud
from fusionslam.descriptors import DESCRIPTORS, describe
from fusionslam.sensors.frame import Cloud

PAGE = ROOT / "docs" / "stages" / "descriptors.md"
SCAN = "kitti/object/training/velodyne/000000.bin"
TOWN, FRAME = 1, 10
_ROUNDS = 15
_SLOW_MS = 200.0
_FEW = 3
"""Rounds of what is slow."""


def main() -> None:
    """Time all and print, or write, the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    found = "\n\n".join([describing(), coloring()])
    print(found)
    if arguments.write:
        write_between(PAGE, "times", found)


def describing() -> str:
    """Return the table of descriptors."""
    scan = read_cloud(data_folder() / SCAN)
    colors = np.random.default_rng(0).integers(0, 256, scan.points.shape, np.uint8)
    cloud = Cloud(scan.points, colors, scan.intensities)
    config = DescriptorConfig(normal_radius=0.5, threads=1)
    rows = [[f"`{name}`", *_times(partial(describe, cloud, name, config))] for name in DESCRIPTORS]
    return table([f"{len(cloud):,} points", "median [ms]", "least [ms]"], rows)


def coloring() -> str:
    """Return the table of colouring by four cameras."""
    drive = record_ring(TOWN, cache_folder() / f"town-{TOWN}-four-cameras")
    frame = open_dataset(drive)[FRAME]
    points, images = frame.points, [*frame.images.values()]
    assert points is not None
    projections = [frame.cameras[name].projection_from_points for name in frame.images]
    times = _times(lambda: colorize_all_round(points, images, projections))
    head = [f"{len(points):,} points, {len(images)} images", "median [ms]", "least [ms]"]
    return table(head, [["`colorize_all_round`", *times]])


def _times(work: Callable[[], object]) -> list[str]:
    milliseconds: list[float] = []
    while len(milliseconds) < (_FEW if max(milliseconds, default=0) > _SLOW_MS else _ROUNDS):
        began = time.perf_counter()
        work()
        milliseconds.append(1e3 * (time.perf_counter() - began))
    return [f"{np.median(milliseconds):.1f}", f"{min(milliseconds):.1f}"]


if __name__ == "__main__":
    main()
