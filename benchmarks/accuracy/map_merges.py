# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Do two maps of one town become one, and those of two towns not? A Markdown table.

python -m benchmarks.accuracy.map_merges            # towns that nothing was fitted to
python -m benchmarks.accuracy.map_merges 1 2        # these towns
python -m benchmarks.accuracy.map_merges --write    # and put the table into the docs

Maps of the first drives are those of ``benchmarks.accuracy.place_maps``. Those of the second drives
take about a minute and a half of processor time a town, a merge half a minute.
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

from benchmarks.accuracy.mapped_drives import MappedDrive
from benchmarks.accuracy.markdown import table, write_between
from benchmarks.accuracy.place_maps import PAGE, SEEDS, SecondDrive, Town, another_seed
from benchmarks.accuracy.pose_graphs import ate
from fusionslam.mapping.map_merging import Merge
from fusionslam.mapping.place_map import PlaceMap
from fusionslam.storage.arrays import Floats
from fusionslam.storage.cache import cache_folder

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


def row(seed: int, another: int, folder: Path) -> list[str]:
    """Merge both maps of a town, and the first one with the second of another town."""
    first, second = Town(seed, folder), SecondDrive(seed, folder)
    alone = [ate(drive.poses, drive.true_keyframes) for drive in (first, second)]
    joint, foreign = join(first, second), join(first, SecondDrive(another, folder))
    together = ["refused", ""]
    if joint.poses is not None:
        true = np.concatenate([first.true_keyframes, second.true_keyframes])
        error = ate(joint.poses, true)
        together = [f"{error:.3f}", f"{error / min(alone):.2f}"]
    return [
        *(str(seed), *(f"{value:.3f}" for value in alone), *together),
        *(str(len(joint.merge.believed)), str(len(joint.merge.refused)), f"{joint.seconds:.0f}"),
        str(len(foreign.merge.believed) + len(foreign.merge.refused)),
        "yes" if foreign.merge.reason is None else "no",
    ]


def merges_text() -> str:
    return fill(
        "The two drives through a town as two maps, which are merged, and the first drive's map "
        "with that of the second drive through another town. ATE of the keyframes of both drives, "
        f"aligned by one motion; the bound is {BOUND:g} times that of the better drive alone. "
        "Seconds are of processor time.",
        100,
    )


def merges_table(seeds: Sequence[int], folder: Path) -> str:
    """What is joined, and how well it fits."""
    head = ["town", "ATE of the first drive, m", "of the second, m", "of both, m"]
    head += ["times the better one", "loops believed", "refused", "s to merge"]
    head += ["loops with another town", "merged"]
    others = [*seeds[1:], *seeds[:1]] if len(seeds) > 1 else [another_seed(seed) for seed in seeds]
    return table(head, [row(*pair, folder) for pair in zip(seeds, others, strict=True)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seeds", nargs="*", type=int, default=SEEDS)
    parser.add_argument("--write", action="store_true", help="put the table into the docs")
    arguments = parser.parse_args()
    folder = cache_folder() / "place-maps"
    folder.mkdir(parents=True, exist_ok=True)
    text = f"{merges_text()}\n\n{merges_table(arguments.seeds or SEEDS, folder)}"
    print(text)
    if arguments.write:
        write_between(PAGE, "merges", text)


if __name__ == "__main__":
    main()
