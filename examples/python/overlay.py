# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Draws a scan over its image, coloured by depth: a look that tells whether a calibration fits.

python overlay.py DATA FRAME overlay.png
"""

import sys

import fusionslam
from fusionslam.calibration.overlay import draw_overlay


def main(data: str, number: str, output: str) -> None:
    frame = fusionslam.open_dataset(data, sensors=["points", "left"], gaps="skip")[int(number)]
    assert frame.points is not None  # asked for by sensors=
    depth = draw_overlay(output, frame.points, frame.images["left"], frame.cameras["left"])
    seen = depth[depth > 0]
    print(f"{len(seen)} of {len(frame.points)} points, depth {seen.min():.1f} m and more")


if __name__ == "__main__":
    main(*sys.argv[1:])
