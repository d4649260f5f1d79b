# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How near is the same place, how far are others? A Markdown table from real KITTI scans.

    python benchmarks/kitti_pairs.py [DATA]

DATA is the folder of test data (default: $FUSIONSLAM_TEST_DATA, else ../shared/data). Frames 94
and 95, and 198 and 199, of sequence 00 are neighbours; 720 and 1500 of sequence 08 see one place
in opposite directions, 3.6 m apart. These scans have no camera images: c-M2DP and CSHOT get the
reflectance as a grey colour.
"""

import os
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import fusionslam

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
    folder = data_folder() / "kitti" / "sequences"
    scans = {name: read(folder, name) for place in PLACES.values() for name in place}
    print("| descriptor | " + " | ".join(heading(place) for place in PAIRS) + " |")
    print("|---" * (len(PAIRS) + 1) + "|")
    for name, describe in descriptors(next(iter(scans.values()))).items():
        vectors = {scan: describe(cloud) for scan, cloud in scans.items()}
        print(f"| {name} | " + " | ".join(cell(vectors, place) for place in PAIRS) + " |")
    print("\nEach cell: distance of the pair; median and least distance to scans of other places.")


def data_folder() -> Path:
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    given = sys.argv[1] if len(sys.argv) > 1 else os.environ.get("FUSIONSLAM_TEST_DATA", default)
    folder = Path(given)
    if not (folder / "kitti").is_dir():
        sys.exit(f"{folder} holds no kitti/: name the folder of test data")
    return folder


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
