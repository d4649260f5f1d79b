# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Check on the first frame whether a recording or a robot's messages can be fused."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from fusionslam.datasets.base import CloudDataset
from fusionslam.errors import FusionSlamError, one_line
from fusionslam.fusion import FusionConfig, fuse

if TYPE_CHECKING:
    from fusionslam.datasets.base import Dataset
    from fusionslam.sensors.frame import Frame


@dataclass(frozen=True)
class FirstCloud:
    """The outcome of fusing a first frame.

    Attributes:
        status: "possible"; "doubtful" where the cloud has no points; "not possible"; or "not
            needed" where the recording holds coloured clouds.
        points: number of points of the cloud, with those of the ground.
        above: number of points that are left without the ground.
        problem: what is wrong; empty if fusing is possible or not needed.
        detail: description of the data, for people, if nothing is wrong.
    """

    status: Literal["possible", "doubtful", "not possible", "not needed"]
    points: int = 0
    above: int = 0
    problem: str = ""
    detail: str = ""

    def __str__(self) -> str:
        return f"{self.status}: {self.problem or self.detail}"


def first_cloud(dataset: "Dataset") -> FirstCloud:
    """Fuse the first frame and return the outcome, or why it cannot be fused."""
    if isinstance(dataset, CloudDataset):
        return FirstCloud("not needed", detail="the clouds have their colours")
    if dataset.sensors == ("points",) or (dataset.has_points and not dataset.cameras):
        return _only_scans(dataset)
    is_pair = dataset.has_stereo and not (dataset.has_points and dataset.cameras)
    if not is_pair and not dataset.has_points:
        return FirstCloud("not possible", problem="no scans and no pairs of images")
    config = FusionConfig(source="stereo" if is_pair else "lidar")
    try:
        return try_frame(dataset[0], config)
    except FusionSlamError as error:
        return FirstCloud("not possible", problem=one_line(error))


def _only_scans(dataset: "Dataset") -> FirstCloud:
    """Tell whether scans without calibrated images have colours of their own."""
    try:
        colors = dataset[0].colors
    except FusionSlamError as error:
        return FirstCloud("not possible", problem=one_line(error))
    if colors is not None:
        return FirstCloud("not needed", detail="the scans have their colours (source cloud)")
    lacking = "images" if dataset.sensors == ("points",) else "calibration"
    return FirstCloud(
        "not possible",
        problem=f"no {lacking} to colour the scans with: commands take them without colours "
        "(source cloud)",
    )


def try_frames(frames: "Iterable[Frame]", config: FusionConfig) -> FirstCloud | None:
    """Fuse frames until one has points; return the last outcome, or None without frames."""
    outcome = None
    for frame in frames:
        try:
            outcome = try_frame(frame, config)
        except FusionSlamError as error:
            outcome = FirstCloud("not possible", problem=one_line(error))
        if outcome.points:
            break
    return outcome


def try_frame(frame: "Frame", config: FusionConfig) -> FirstCloud:
    """Fuse a frame and return the outcome. Raises as ``fuse``."""
    count = len(fuse(frame, config.model_copy(update={"ground": "none"})))
    above = len(fuse(frame, config)) if count and config.ground != "none" else count
    first = "first stereo pair" if config.source == "stereo" else "first scan"
    if count:
        colored = " get a colour (calib-check says if it is theirs)"
        colored = colored if config.source == "lidar" else ""
        return FirstCloud(
            "possible", count, above, detail=f"{count} points of the {first}{colored}"
        )
    problem = {
        "lidar": f"no point of the {first} falls into its image",
        "stereo": f"the images of the {first} have nothing in common",
        "cloud": f"the {first} has no points",
    }
    return FirstCloud("doubtful", problem=problem[config.source])
