# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A second stage that compares mean colours, and matchers that ask it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.config import merged
from fusionslam.sensors.frame import Cloud
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.recognisers import ViewMatcherConfig
from fusionslam.views.two_stage_comparison import TwoStageComparison
from object_places import place

Row = NDArray[np.float32]


class MeanColor:
    """Agrees where the mean colours are near; counts how often it is asked."""

    digest = "mean color"

    def __init__(self) -> None:
        self.asked = 0

    def features(self, cloud: Cloud) -> Row:
        assert cloud.colors is not None
        return np.asarray(cloud.colors.mean(axis=0), np.float32)

    def probability(self, current: Row, stored: Row) -> float:
        self.asked += 1
        return float(np.abs(current - stored).max() < 8)


def painted(number: int, visit: int, shade: int) -> Cloud:
    """A place whose objects look alike to the first stage but for their colour."""
    cloud = place(number, visit)
    return Cloud(cloud.points, np.full_like(cloud.points, shade, dtype=np.uint8))


SHAPE_ONLY: dict[str, Any] = {"method": "objects", "similarity": {"color_weight": 0.0}}


def two_stages(second: MeanColor, **more: Any) -> ViewMatcher:
    config = merged(ViewMatcherConfig(), {**SHAPE_ONLY, "threshold": 0.75})
    first = ViewMatcher(config).comparison
    both = TwoStageComparison(first, second, **{"threshold": 0.5, "start": 0.75, **more})
    return ViewMatcher(config, comparison=both)
