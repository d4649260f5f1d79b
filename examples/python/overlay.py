# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Draws a scan over its image, coloured by depth: a look that tells whether a calibration fits.

python overlay.py DATA FRAME overlay.png
"""

import sys

import numpy as np
from matplotlib.figure import Figure

import fusionslam


def main(data: str, number: str, output: str) -> None:
    frame = fusionslam.open_dataset(data, sensors=["points", "left"], gaps="skip")[int(number)]
    assert frame.points is not None  # asked for by sensors=
    image, camera = frame.images["left"], frame.cameras["left"]
    height, width = image.shape[:2]
    depth = fusionslam.depth_image(
        frame.points, camera.projection_from_points, width=width, height=height
    )
    rows, columns = np.nonzero(depth)

    figure = Figure((width / 100, height / 100), dpi=100)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.imshow(image, cmap="gray")
    axes.scatter(columns, rows, c=np.log(depth[rows, columns]), s=1.5, cmap="turbo_r", linewidths=0)
    axes.set_axis_off()
    figure.savefig(output)
    print(
        f"{len(rows)} of {len(frame.points)} points, depth {depth[depth > 0].min():.1f} m and more"
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
