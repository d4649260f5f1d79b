# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Pairs of real KITTI scans of one place, beside scans of other places, for every descriptor."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

import fusionslam
from benchmarks.accuracy.kitti_pairs import PAIRS, PLACES, Vector, heading
from benchmarks.accuracy.markdown import table
from fusionslam import Cloud, DescriptorConfig, DescriptorIndex
from fusionslam.descriptors import find_descriptor, for_preset, for_sequence
from fusionslam.errors import FusionSlamError


def pairs_table(data: Path, names: Sequence[str]) -> str:
    """Distance of each pair as a share of the least distance to a scan of another place.

    Descriptors that need colours get the reflectance as a grey colour.
    """
    scans = {
        name: read_scan(data / "kitti" / "sequences", name)
        for place in PLACES.values()
        for name in place
    }
    first = next(iter(scans.values()))
    rows, left = [], []
    for name in names:
        config = for_sequence(for_preset(DescriptorConfig(), name), [name], first)
        try:
            vectors = {
                scan: fusionslam.describe(cloud, name, config) for scan, cloud in scans.items()
            }
        except FusionSlamError as error:
            left.append(f"`{name}`: {error}")
            continue
        distance = distance_by(find_descriptor(name).metric)
        rows.append([f"`{name}`", *(share(vectors, place, distance) for place in PAIRS)])
    text = table(["descriptor", *map(heading, PAIRS)], rows)
    text += (
        "\n\nEach cell: the distance of the pair as a share of the least distance of either scan "
        "to one\nof another place; below 1 the place is recognised (bold)."
    )
    return text + (f"\n\nLeft out: {'; '.join(left)}." if left else "")


def read_scan(folder: Path, name: str) -> Cloud:
    """A scan, "00/000094", with its reflectance as intensity and as grey."""
    sequence, number = name.split("/")
    values = np.fromfile(folder / sequence / "velodyne" / f"{number}.bin", np.float32)
    values = values.reshape(-1, 4)
    grey = np.rint(values[:, 3:] * 255).clip(0, 255).astype(np.uint8)
    return Cloud(values[:, :3].copy(), np.repeat(grey, 3, axis=1), values[:, 3].copy())


def distance_by(metric: str) -> Callable[[Vector, Vector], float]:
    """Return the distance of two descriptors that an index of this metric finds."""

    def distance(one: Vector, other: Vector) -> float:
        index = DescriptorIndex(len(one), metric=metric)
        index.add(one)
        found = index.query(other, k=1)[1]
        return float(found[0]) if len(found) else float("inf")

    return distance


def share(
    vectors: dict[str, Vector], place: str, distance: Callable[[Vector, Vector], float]
) -> str:
    """Format the distance of a pair over the least one to other places; bold below 1."""
    first, second = PLACES[place]
    same = distance(vectors[first], vectors[second])
    others = [
        distance(vectors[scan], vectors[other])
        for scan in PLACES[place]
        for other in vectors
        if other not in PLACES[place]
    ]
    ratio = same / min(others) if min(others) > 0 else float("inf")
    text = f"{ratio:.2f}"
    return f"**{text}**" if ratio < 1 else text
