# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Prints the places that a drive comes back to: python loops.py kitti/sequences/06"""

import argparse
import sys

import fusionslam


def main() -> None:
    """Go through the frames in order, as a robot meets them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("dataset", help="folder of a recording")
    parser.add_argument("--threshold", type=float, help="largest distance of a loop")
    arguments = parser.parse_args()

    dataset = fusionslam.open_dataset(arguments.dataset)
    detector = fusionslam.LoopDetector("cm2dp", threshold=arguments.threshold)
    loops = 0
    for frame in dataset:
        loop = detector.add(frame)
        if loop:
            loops += 1
            print(f"frame {loop.query} is at the place of frame {loop.match} ({loop.distance:.3f})")
    print(f"{dataset.name}: {len(dataset)} frames, {loops} loops")


if __name__ == "__main__":
    try:
        main()
    except fusionslam.FusionSlamError as error:
        sys.exit(f"loops.py: {error}")
