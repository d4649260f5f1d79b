# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Whether a recording can be fused, tried on its first frame."""

from typing import TYPE_CHECKING

from fusionslam.errors import FusionSlamError
from fusionslam.fusion import FusionConfig, fuse

if TYPE_CHECKING:
    from fusionslam.datasets.base import Dataset


def first_cloud(dataset: "Dataset") -> str:
    """What fusing the first frame gives, in words, or why it cannot be fused."""
    if dataset.sensors == ("points",):
        return "not possible: no images to colour the scans with"
    is_pair = dataset.has_stereo and not (dataset.has_points and dataset.cameras)
    if not is_pair and not dataset.has_points:
        return "not possible: no scans and no pairs of images"
    try:
        count = len(fuse(dataset[0], FusionConfig(source="stereo" if is_pair else "lidar")))
    except FusionSlamError as error:
        return f"not possible: {one_line(error)}"
    first = "first stereo pair" if is_pair else "first scan"
    if not count and is_pair:
        return f"doubtful: the images of the {first} have nothing in common"
    if not count:
        return f"doubtful: no point of the {first} falls into its image"
    return f"possible: {count} points of the {first}" + " get a colour" * (not is_pair)


def one_line(error: Exception) -> str:
    """A message of several lines in one."""
    return "; ".join(line.strip() for line in str(error).splitlines())
