# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Do two maps of one place become one, and those of two places not? A Markdown table.

python -m benchmarks.accuracy.map_merges            # both parts of a recording
python -m benchmarks.accuracy.map_merges 1 2        # and both drives through these towns
python -m benchmarks.accuracy.map_merges --write    # and put the table into the docs

The recordings need the test data, which FUSIONSLAM_TEST_DATA names. Maps are those of
``benchmarks.accuracy.room_maps`` and ``place_maps``, in the cache. The second drive through a town
takes about a minute and a half of processor time.
"""

import argparse
import shutil
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from textwrap import fill
from typing import NamedTuple

import numpy as np

from benchmarks.accuracy.data import WORLDS
from benchmarks.accuracy.mapped_drives import MappedDrive
from benchmarks.accuracy.markdown import table, write_between
from benchmarks.accuracy.place_maps import PAGE, SecondDrive, Town, another_seed
from benchmarks.accuracy.pose_graphs import ate
from benchmarks.accuracy.room_maps import PART, map_part
from fusionslam.base.arrays import Floats
from fusionslam.base.cache import cache_folder
from fusionslam.mapping.map_merging import Merge
from fusionslam.mapping.place_map import PlaceMap

BOUND = 1.3
"""ATE of both drives on one map, by that of the better one alone."""


class Joint(NamedTuple):
    """What merging two maps made.

    Attributes:
        merge: which loops are between them.
        poses: float64 (n, 4, 4), map_from_robot of the keyframes of both; None if it was refused.
        seconds: of processor time.
    """

    merge: Merge
    poses: Floats | None
    seconds: float


def join(one: MappedDrive, other: MappedDrive) -> Joint:
    """Merge two maps; their files stay as they are."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(shutil.copy(one.path, folder))
        with PlaceMap.open(path) as site:
            started = time.process_time()
            merge = site.merge(other.path)
            seconds = time.process_time() - started
            if merge.reason is not None:
                return Joint(merge, None, seconds)
            tracks = [site.trajectory(drive.session)[1] for drive in (one, other)]
            return Joint(merge, np.concatenate(tracks), seconds)


def row(name: str, first: MappedDrive, second: MappedDrive, foreign: MappedDrive) -> list[str]:
    """Merge both maps of a place, and the first one with that of another place."""
    alone = [ate(drive.poses, drive.true_keyframes) for drive in (first, second)]
    joint, apart = join(first, second), join(first, foreign)
    together = ["refused", ""]
    if joint.poses is not None:
        true = np.concatenate([first.true_keyframes, second.true_keyframes])
        error = ate(joint.poses, true)
        together = [f"{error:.3f}", f"{error / min(alone):.2f}"]
    return [
        *(name, *(f"{value:.3f}" for value in alone), *together),
        *(str(len(joint.merge.believed)), str(len(joint.merge.refused)), f"{joint.seconds:.0f}"),
        str(len(apart.merge.believed) + len(apart.merge.refused)),
        "yes" if apart.merge.reason is None else "no",
    ]


def recorded_row(folder: Path) -> list[str]:
    """The row of a recording: its first part and what follows."""
    name, other = WORLDS
    first = map_part(name, folder)
    rest, foreign = (map_part(each, folder, like=first) for each in (name, other))
    return row(f"recorded {name}", first, rest, foreign)


def town_rows(seeds: Sequence[int], folder: Path) -> list[list[str]]:
    """Rows of towns: first and second drive."""
    second = {seed: SecondDrive(seed, folder) for seed in {*seeds, *map(another_seed, seeds)}}
    return [
        row(f"town {seed}", Town(seed, folder), second[seed], second[another_seed(seed)])
        for seed in seeds
    ]


def merges_text(seeds: Sequence[int]) -> str:
    towns = "; of towns, the first and the second drive" if seeds else ""
    return fill(
        f"Two maps of one place, which are merged: the first {100 * PART:g} % of a recording and "
        f"the rest, with the same lengths of registration{towns}. Then the first map is merged "
        "with the second one of another place, which should be refused. "
        "ATE of the keyframes of both maps, aligned by one motion; the bound is "
        f"{BOUND:g} times that of the better map alone. Seconds are of processor time.",
        100,
    )


def merges_table(rows: Sequence[Sequence[str]]) -> str:
    """What is joined, and how well it fits."""
    head = ["place", "ATE of the first map, m", "of the second, m", "of both, m"]
    head += ["times the better one", "loops believed", "refused", "s to merge"]
    head += ["loops with another place", "merged"]
    return table(head, rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seeds", nargs="*", type=int)
    parser.add_argument("--write", action="store_true", help="put the table into the docs")
    arguments = parser.parse_args()
    folders = {name: cache_folder() / name for name in ("room-maps", "place-maps")}
    for folder in folders.values():
        folder.mkdir(parents=True, exist_ok=True)
    rows = [recorded_row(folders["room-maps"])]
    rows += town_rows(arguments.seeds, folders["place-maps"])
    text = f"{merges_text(arguments.seeds)}\n\n{merges_table(rows)}"
    print(text)
    if arguments.write:
        write_between(PAGE, "merges", text)


if __name__ == "__main__":
    main()
