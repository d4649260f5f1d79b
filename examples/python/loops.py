# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Prints the places that a drive comes back to: python loops.py kitti/sequences/06

Each loop is proven by registration unless a threshold is given.
"""

import argparse
import sys
from collections import Counter

import numpy as np

import fusionslam


def main() -> None:
    """Go through the frames in order, as a robot meets them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("dataset", help="folder of a recording")
    parser.add_argument("--threshold", type=float, help="largest distance of a loop, unproven")
    arguments = parser.parse_args()

    dataset = fusionslam.open_dataset(arguments.dataset)
    detector = fusionslam.LoopDetector("cm2dp", candidates=10, threshold=arguments.threshold)
    loops, reasons = 0, Counter[str]()
    for frame in dataset:
        loop = detector.add(frame)
        if loop:
            loops += 1
            print(f"frame {loop.query} is at the place of frame {loop.match} ({_how(loop)})")
        reasons.update(each.code for each in detector.rejected)
    print(f"{dataset.name}: {len(dataset)} frames, {loops} loops")
    for code, count in reasons.most_common():
        print(f"{count} candidates rejected: {code}")


def _how(loop: fusionslam.Loop) -> str:
    if loop.match_from_query is None:  # not verified
        return f"{loop.distance:.3f}"
    metres = float(np.linalg.norm(loop.match_from_query[:3, 3]))
    return f"{metres:.2f} m from it, probability {loop.probability:.3f}"


if __name__ == "__main__":
    try:
        main()
    except fusionslam.FusionSlamError as error:
        sys.exit(f"loops.py: {error}")
