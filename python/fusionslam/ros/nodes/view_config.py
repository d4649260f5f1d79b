# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Shared parts of the nodes that recognise places by clouds."""

import numpy as np
from pydantic import field_validator

from fusionslam.config import explain_choice, option
from fusionslam.descriptors import DescriptorConfig
from fusionslam.errors import DataError
from fusionslam.ratslam.view_sources import (
    MatcherSource,
    SourceOptions,
    ViewSource,
    build_view_source,
)
from fusionslam.ros.runtime.config import CommonConfig
from fusionslam.sensors.frame import Cloud
from fusionslam.sensors.messages import Scan
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.recognisers import RECOGNISERS, ViewMatcherConfig
from fusionslam.views.visual_templates import VisualTemplatesConfig


class ViewsConfig(CommonConfig):
    """How places are recognised; lv_builder and lv_matching must agree on it."""

    source: str = option("alignment", "recogniser of places, as fusionslam ratslam --views")
    views: ViewMatcherConfig = option(
        ViewMatcherConfig(threads=0), "how views of clouds are compared"
    )
    descriptors: DescriptorConfig = option(DescriptorConfig(), "clouds to vectors")
    visual_templates: VisualTemplatesConfig = option(
        VisualTemplatesConfig(), "source visual_templates: how images are compared"
    )

    @field_validator("source")
    @classmethod
    def _check_source(cls, name: str) -> str:
        if name not in RECOGNISERS:
            raise ValueError(explain_choice(name, RECOGNISERS))
        return name


def source_of(config: ViewsConfig) -> ViewSource:
    """Return a new source of views as configured."""
    options = SourceOptions(
        views=config.views, descriptors=config.descriptors, templates=config.visual_templates
    )
    return build_view_source(config.source, options)


def matcher_of(source: ViewSource) -> ViewMatcher | None:
    """Return the matcher of clouds; None if the source compares images."""
    return source.matcher if isinstance(source, MatcherSource) else None


EMPTY = (
    "the cloud is empty: does the scanner see anything, and does ~fusion of data_fusion remove it?"
)
"""Message about a cloud without points."""


def cloud_of(scan: Scan) -> Cloud:
    """Return the valid points with their colours. Raises DataError if they have no colours."""
    if scan.colors is None:
        raise DataError(
            "the cloud has no colours (a point field rgb), by which places are recognised: remap "
            "its topic to the coloured clouds of data_fusion",
            code="no-colours",
        )
    valid = np.isfinite(scan.points).all(axis=1)
    if valid.all():
        return Cloud(scan.points, scan.colors, scan.intensities)
    intensities = None if scan.intensities is None else scan.intensities[valid]
    return Cloud(scan.points[valid], scan.colors[valid], intensities)
