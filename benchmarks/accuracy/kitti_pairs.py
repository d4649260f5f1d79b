# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How near is the same place, how far are others? A Markdown table from real KITTI scans.

    python -m benchmarks.accuracy.kitti_pairs [--write]

Needs the test data, which FUSIONSLAM_TEST_DATA names. Frames 94
and 95, and 198 and 199, of sequence 00 are neighbours; 720 and 1500 of sequence 08 see one place
in opposite directions, 3.6 m apart. These scans have no camera images: c-M2DP and CSHOT get the
reflectance as a grey colour.
"""

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import fusionslam
from benchmarks.accuracy.data import ROOT, data_folder
from benchmarks.accuracy.markdown import table, write_between

PAGE = ROOT / "docs" / "results" / "checks.md"
Vector = NDArray[np.float32]
Describe = Callable[[fusionslam.Cloud], Vector]

PLACES = {
    "00 start": ("00/000000", "00/000001"),
    "00 at 94": ("00/000094", "00/000095"),
    "00 at 198": ("00/000198", "00/000199"),
    "08 at 720": ("08/000720", "08/001500"),
}
PAIRS = ("00 at 94", "00 at 198", "08 at 720")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="put the table into the docs")
    arguments = parser.parse_args()
    text = pairs_table(data_folder())
    print(text)
    if arguments.write:
        write_between(PAGE, "pairs", text)


def pairs_table(data: Path) -> str:
    """Distances of the pairs for every descriptor and preset."""
    folder = data / "kitti" / "sequences"
    scans = {name: read(folder, name) for place in PLACES.values() for name in place}
    rows = []
    for name, describe in descriptors(next(iter(scans.values()))).items():
        vectors = {scan: describe(cloud) for scan, cloud in scans.items()}
        rows.append([name, *(cell(vectors, place) for place in PAIRS)])
    text = table(["descriptor", *map(heading, PAIRS)], rows)
    return f"{text}\n\nEach cell: distance of the pair; median and least distance to other places."


def read(folder: Path, name: str) -> fusionslam.Cloud:
    sequence, number = name.split("/")
    values = np.fromfile(folder / sequence / "velodyne" / f"{number}.bin", np.float32)
    values = values.reshape(-1, 4)
    grey = np.rint(values[:, 3:] * 255).clip(0, 255).astype(np.uint8)
    return fusionslam.Cloud(values[:, :3].copy(), np.repeat(grey, 3, axis=1))


def descriptors(first: fusionslam.Cloud) -> dict[str, Describe]:
    """By name; the radius for normals is that of the first scan, as in a sequence."""
    kinds: dict[str, Describe] = {}
    for preset in ("robust", "paper", "author"):
        for name in ("m2dp", "cm2dp"):
            kinds[f"{name} {preset}"] = of(name, fusionslam.DescriptorConfig(preset=preset))
    radius = 5 * fusionslam.cloud_resolution(first.points)
    for name in ("shot", "cshot"):
        kinds[name] = of(name, fusionslam.DescriptorConfig(normal_radius=radius))
    return kinds


def of(name: str, config: fusionslam.DescriptorConfig) -> Describe:
    return lambda cloud: fusionslam.describe(cloud, name, config)


def heading(place: str) -> str:
    sequence = place[:2]
    first, second = (int(scan.split("/")[1]) for scan in PLACES[place])
    return f"{sequence}: {first} / {second}"


def cell(vectors: dict[str, Vector], place: str) -> str:
    first, second = PLACES[place]
    same = float(np.linalg.norm(vectors[first] - vectors[second]))
    others = [
        float(np.linalg.norm(vectors[scan] - vectors[other]))
        for scan in PLACES[place]
        for other in vectors
        if other not in PLACES[place]
    ]
    return f"{same:.3f} ({np.median(others):.3f}, {min(others):.3f})"


if __name__ == "__main__":
    main()
