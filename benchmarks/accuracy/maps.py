# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Are our maps like those that another program made of the same worlds? A Markdown table.

    python -m benchmarks.accuracy.maps [--write]

Shares are of the cells that both maps have, if not said otherwise. A cell is off the borders if it
is occupied in one map, and neither it nor one beside it in the other. Worlds of the test data are
left out where FUSIONSLAM_TEST_DATA does not name them: without it there is no row.
"""

import argparse
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from benchmarks.accuracy.data import ROOT, world_files
from benchmarks.accuracy.markdown import table, write_between
from fusionslam.sim.motion.occupancy import OccupancyMap, occupancy_of
from fusionslam.sim.scene import Scene
from fusionslam.sim.world import World
from fusionslam.sim.worlds import load_world

PAGE = ROOT / "docs" / "guides" / "motion.md"
MAPS = ["world", "scenes", "occupied or not, agrees", "reachable, too", "of all their cells"]
MAPS += ["beyond ours", "only theirs, off borders", "only ours, off borders"]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class Overlay:
    """A map laid over another, on the cells of the other.

    Attributes:
        occupied, reachable: of the first map, bool (rows, columns), False beyond it.
        inside: which cells the first map has.
        agree: cells that are the same in both maps.
    """

    occupied: Bools
    reachable: Bools
    inside: Bools
    agree: Bools


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="put the table into the docs")
    arguments = parser.parse_args()
    text = maps_table()
    print(text)
    if arguments.write:
        write_between(PAGE, "maps", text)


def maps_table() -> str:
    """Our map of each world beside the one that came with it."""
    rows = []
    for name, path in world_files().items():
        world = load_world(path)
        both = (world.collision, world.visual)
        rows.append([name, "collision only", *agreement(world, world.collision)])
        rows.append([name, "collision and visual", *agreement(world, *both)])
    return table(MAPS, rows)


def overlay(made: OccupancyMap, given: OccupancyMap) -> Overlay:
    row, column, inside = made.cells(*given.centres(*np.indices(given.occupied.shape)))
    occupied = made.occupied[row, column] & inside
    reachable = made.reachable[row, column] & inside
    agree = (occupied == given.occupied) & (reachable == given.reachable)
    return Overlay(occupied, reachable, inside, agree)


def agreement(world: World, *scenes: Scene) -> list[str]:
    """Cells of the table: the map of these scenes beside the world's own."""
    given = world.map
    assert given is not None
    over = overlay(occupancy_of(*scenes), given)
    inside = over.inside
    shares = [
        (over.occupied == given.occupied)[inside].mean(),
        over.agree[inside].mean(),
        over.agree.mean(),
        1 - inside.mean(),
        off_borders(given.occupied, over.occupied)[inside].mean(),
        off_borders(over.occupied, given.occupied)[inside].mean(),
    ]
    return [f"{100 * share:.1f} %" for share in shares]


def off_borders(one: Bools, other: Bools) -> Bools:
    """Cells occupied in one map that are not even beside such a cell of the other."""
    alone: Bools = one & ~ndimage.binary_dilation(other, np.ones((3, 3)))
    return alone


if __name__ == "__main__":
    main()
