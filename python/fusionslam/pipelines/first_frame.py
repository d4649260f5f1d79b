# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Whether a recording or a robot's messages can be fused, tried on the first frame."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from fusionslam.errors import FusionSlamError
from fusionslam.fusion import FusionConfig, fuse

if TYPE_CHECKING:
    from fusionslam.datasets.base import Dataset
    from fusionslam.sensors.frame import Frame
from fusionslam.errors import one_line


@dataclass(frozen=True)
class FirstCloud:
    """What came of fusing a first frame: the number of points, and that in words."""

    points: int
    words: str


def first_cloud(dataset: "Dataset") -> str:
    """What fusing the first frame gives, in words, or why it cannot be fused."""
    if dataset.sensors == ("points",):
        return "not possible: no images to colour the scans with"
    is_pair = dataset.has_stereo and not (dataset.has_points and dataset.cameras)
    if not is_pair and not dataset.has_points:
        return "not possible: no scans and no pairs of images"
    config = FusionConfig(source="stereo" if is_pair else "lidar")
    try:
        return try_frame(dataset[0], config).words
    except FusionSlamError as error:
        return f"not possible: {one_line(error)}"


def try_frame(frame: "Frame", config: FusionConfig) -> FirstCloud:
    """What fusing a frame gives. Raises as ``fuse``."""
    count = len(fuse(frame, config))
    first = "first stereo pair" if config.source == "stereo" else "first scan"
    if count:
        colored = " get a colour" if config.source == "lidar" else ""
        return FirstCloud(count, f"possible: {count} points of the {first}{colored}")
    why = {
        "lidar": f"no point of the {first} falls into its image",
        "stereo": f"the images of the {first} have nothing in common",
        "cloud": f"the {first} has no points",
    }
    return FirstCloud(0, f"doubtful: {why[config.source]}")
