# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Makes a map: python ratslam.py nodes.csv [drive.bag]

Without a bag, odometry and place ids are the program's own; with one, its frames are looked at.
"""

import argparse
import math
import sys

import numpy as np

import fusionslam
from fusionslam.ratslam import MatcherSource, Motion, RatSlam, Sighting


def own_places() -> RatSlam:
    """Three rounds of a square of 4 m; odometry turns 3 % too far; every half metre is a place."""
    slam = RatSlam()
    for step in range(3 * 160):
        stamp_ns = step * 100_000_000
        corner = step % 40 == 0 and step > 0
        slam.step(Motion(stamp_ns, v=1.0, w=1.03 * math.pi / 2 / 0.1 if corner else 0.0))
        if step % 5 == 2:
            slam.step(Sighting(stamp_ns, view_id=step % 160 // 5))
    return slam


def places_of(path: str) -> RatSlam:
    """What a bag's frames show is recognised by laying scans over each other."""
    slam = RatSlam(views=MatcherSource())
    for frame in fusionslam.open_dataset(path):
        print(slam.step(frame).why)
    return slam


def main() -> None:
    """Make a map, and write x, y and heading of its nodes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("nodes", help="the file to write")
    parser.add_argument("bag", nargs="?", help="scans and odometry")
    arguments = parser.parse_args()

    slam = places_of(arguments.bag) if arguments.bag else own_places()
    nodes = slam.map.nodes
    try:
        np.savetxt(arguments.nodes, nodes, delimiter=",", header="x,y,heading", comments="")
    except OSError as error:
        sys.exit(f"ratslam.py: cannot write {arguments.nodes}: {error.strerror or error}")
    print(f"{len(nodes)} nodes, {len(slam.map.links)} links")


if __name__ == "__main__":
    try:
        main()
    except fusionslam.FusionSlamError as error:
        sys.exit(f"ratslam.py: {error}")
