# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Relative poses of clouds: found without a first guess, judged by what both clouds show."""

from fusionslam._core import count_overlap, nearest_ranges
from fusionslam.registration.birds_eye import Hypothesis, SearchImage
from fusionslam.registration.clouds import PreparedCloud
from fusionslam.registration.colors import ColorDifference
from fusionslam.registration.config import RegistrationConfig
from fusionslam.registration.pose_estimation import compare_images, register, search_poses
from fusionslam.registration.result import Refusal, Registration
from fusionslam.registration.scale import fit_lengths, has_lengths, measure_reach, without_lengths

__all__ = [
    "ColorDifference",
    "Hypothesis",
    "PreparedCloud",
    "Refusal",
    "Registration",
    "RegistrationConfig",
    "SearchImage",
    "compare_images",
    "count_overlap",
    "fit_lengths",
    "has_lengths",
    "measure_reach",
    "nearest_ranges",
    "register",
    "search_poses",
    "without_lengths",
]
