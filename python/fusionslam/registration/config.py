# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Configuration of registration."""

from typing import Literal

from fusionslam.config import Section, option


class RegistrationConfig(Section):
    """How clouds are registered. The defaults suit full-circle scans outdoors."""

    method: Literal["global", "planar"] = option(
        "global", "global: whatever the pose; planar: nearby views of a robot on a floor"
    )
    voxel: float = option(0.5, "voxels in which clouds are refined and compared", unit="m", gt=0)
    search_cell: float = option(
        2.0,
        "cells, 64 x 64, of the images from above in which a pose is searched with gravity",
        unit="m",
        ge=0.01,
    )
    search_voxel: float = option(
        1.0, "voxels of the search by features, without gravity", unit="m", ge=0.01, le=1.0
    )
    guess_distance: float = option(
        3.0, "farthest neighbours when the refinement starts from a guess", unit="m", gt=0
    )
    distance: float = option(1.0, "farthest neighbours of the refinement", unit="m", gt=0)
    iterations: int = option(30, "steps of the refinement", ge=1, le=1000)
    gravity: bool | Literal["auto"] = option(
        "auto",
        "poses that tilt are refused, and ground is no overlap; auto: clouds are levelled first, "
        "by the ground they show or odometry; true: z points up in them; false: nobody knows",
    )
    local_map: float | None = option(
        None,
        "clouds along this much of odometry are joined and registered as one; 0 is single clouds; "
        "none joins narrow and sparse ones, as the first cloud tells, unless lengths are given",
        unit="m",
        ge=0,
        le=1000,
    )
    max_tilt: float = option(8.0, "largest tilt against each other", unit="deg", ge=0, le=180)
    ground_height: float = option(
        0.5, "points up to this much above the ground do not count as overlap", unit="m", gt=0
    )
    overlap_distance: float = option(
        0.5, "points with a neighbour this near overlap", unit="m", gt=0, le=100
    )
    view_step: float = option(
        1.0, "directions in which is stored how far a sensor saw", unit="deg", ge=0.1, le=30
    )
    min_overlap: float = option(0.3, "poses with less overlap are refused", ge=0, le=1)
    position_sd: float = option(
        0.05, "floor of the stated standard deviation of positions", unit="m", ge=0
    )
    angle_sd: float = option(
        0.3, "floor of the stated standard deviation of angles", unit="deg", ge=0
    )
    degenerate_ratio: float = option(
        10.0, "a direction is degenerate if the next holds this many times as firmly", gt=1
    )
    degenerate_sd: float = option(
        10.0, "standard deviation stated along degenerate directions", unit="m", gt=0
    )
    min_probability: float | None = option(
        None, "less probable poses are refused; none is 0.5, 0.96 for planar", ge=0, le=1
    )
    floor_height_sd: float = option(0.05, "planar: stated standard deviation of z", unit="m", gt=0)
    floor_tilt_sd: float = option(
        1.0, "planar: stated standard deviation of roll and pitch", unit="deg", gt=0
    )
