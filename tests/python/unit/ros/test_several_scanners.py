# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""data_fusion with several scanners: their topics, merged clouds, and what is missing."""

from typing import Any

import numpy as np
import pytest

import bags
from fusionslam.errors import ConfigError
from fusionslam.ros.nodes.data_fusion import DataFusionConfig
from fusionslam.ros.runtime.config import from_parameters
from fusionslam.sensors.messages import FrameTransforms, Scan
from ros_master import lacking
from rows import rows

if lacking:
    pytest.skip(lacking, allow_module_level=True)

from ros_node import Desk

LINKS = FrameTransforms(
    transforms=(
        bags.static("base", "velodyne", bags.translation(0.3)),
        bags.static("base", "rear", bags.translation(-0.5)),
    )
)


def start() -> Desk:
    fusion = {"source": "cloud", "frame": "scan", "ground": "none"}
    desk = Desk("data_fusion", scanners=["rear"], fusion=fusion)
    desk.give("/tf_static", LINKS)
    return desk


def scan(frame: str, k: int) -> Scan:
    points = np.array([[4, 1, 0], [4, -1, 0], [4, 0, 1]], np.float32)
    return Scan(stamp_ns=bags.START + k * 10**8, frame_id=frame, points=points)


def clouds(desk: Desk) -> list[Any]:
    desk.node.idle()
    return desk.outlet.of("rgb_cloud")


def test_clouds_hold_the_points_of_both_scanners() -> None:
    desk = start()
    assert "rear_points" in {each.topic for each in desk.node.inputs}
    for k in range(5):
        desk.give("velodyne_points", scan("velodyne", k))
        desk.give("rear_points", scan("rear", k))
    found = clouds(desk)
    assert [cloud.width * cloud.height for cloud in found] == [6] * 5
    assert desk.node.report()["frames"] == 5 and "without rear_points" not in desk.node.report()


def test_scans_without_a_partner_are_published_alone_and_counted() -> None:
    desk = start()
    for k in range(5):
        desk.give("velodyne_points", scan("velodyne", k))
        if k != 2:
            desk.give("rear_points", scan("rear", k))
    sizes = [cloud.width * cloud.height for cloud in clouds(desk)]
    assert sizes == [6, 6, 3, 6, 6] and desk.node.report()["without rear_points"] == 1


@rows("name", ["velodyne", "a b", ""])
def test_names_that_are_no_further_scanners_are_refused(name: str) -> None:
    with pytest.raises(ConfigError):
        from_parameters(DataFusionConfig(), {"scanners": [name]})
    with pytest.raises(ConfigError):
        from_parameters(DataFusionConfig(), {"scanners": ["rear", "rear"]})
