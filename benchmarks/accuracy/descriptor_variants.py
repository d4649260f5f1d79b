# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Compares descriptors of upright clouds, and M2DP about its axes and about the vertical.

python -m benchmarks.accuracy.descriptor_variants            # five towns that nothing was fitted to
python -m benchmarks.accuracy.descriptor_variants --write    # and put the table into the docs

Towns are recorded, and descriptors computed, where benchmarks.accuracy.loop_thresholds did not.
"""

import argparse

from benchmarks.accuracy.loop_thresholds import SOURCES, describe_town
from benchmarks.accuracy.markdown import write_between
from benchmarks.accuracy.presets import CLOUDS, PAGE
from benchmarks.accuracy.towns import compare_towns
from fusionslam.base.cache import cache_folder

SEEDS = (1, 2, 3, 5, 7)
VARIANTS = (
    *("scan_context", "cscan_context", "bev_spectrum"),
    *("m2dp:robust", "m2dp:upright", "cm2dp:robust", "cm2dp:upright"),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    folder = cache_folder() / "loop-thresholds"
    towns = [describe_town(seed, folder / str(seed), VARIANTS) for seed in SEEDS]
    keys = (
        (source, name, CLOUDS[source])
        for source in SOURCES
        for name in VARIANTS
        if (source, name) in towns[0]
    )
    text = compare_towns("descriptor_variants", SEEDS, towns, keys)
    print(text)
    if arguments.write:
        write_between(PAGE, "variants", text)


if __name__ == "__main__":
    main()
