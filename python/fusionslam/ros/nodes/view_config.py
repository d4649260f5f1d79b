# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What the nodes that recognise places by clouds have in common."""

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
from fusionslam.views.recognisers import RECOGNISERS, RENAMED, ViewMatcherConfig
from fusionslam.views.visual_templates import VisualTemplatesConfig


class ViewsConfig(CommonConfig):
    """How places are recognised; lv_builder and lv_matching need the same."""

    source: str = option("alignment", "what recognises places, as fusionslam ratslam --views")
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
            raise ValueError(explain_choice(name, RECOGNISERS, RENAMED))
        return name


def source_of(config: ViewsConfig) -> ViewSource:
    """A new source of views as configured."""
    options = SourceOptions(
        views=config.views, descriptors=config.descriptors, templates=config.visual_templates
    )
    return build_view_source(config.source, options)


def matcher_of(source: ViewSource) -> ViewMatcher | None:
    """What compares clouds; None where images are compared."""
    return source.matcher if isinstance(source, MatcherSource) else None


EMPTY = (
    "the cloud is empty: does the scanner see anything, and does ~fusion of data_fusion keep it?"
)
"""What to say of a cloud without points."""


def cloud_of(scan: Scan) -> Cloud:
    """The points that returned, with their colours. Raises DataError where they have none."""
    if scan.colors is None:
        raise DataError(
            "the cloud has no colours (a point field rgb), which places are recognised by: remap "
            "its topic to the coloured clouds of data_fusion"
        )
    valid = np.isfinite(scan.points).all(axis=1)
    if valid.all():
        return Cloud(scan.points, scan.colors)
    return Cloud(scan.points[valid], scan.colors[valid])
