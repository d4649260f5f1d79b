# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""data_fusion with cameras all round: their topics, and clouds that all of them colour."""

import pytest

from camera_rings import RING, ring_events
from fusionslam.errors import ConfigError
from fusionslam.ros.nodes.data_fusion import DataFusionConfig
from fusionslam.ros.runtime.config import from_parameters
from ros_master import lacking
from rows import rows

if lacking:
    pytest.skip(lacking, allow_module_level=True)

from ros_node import Desk

FURTHER = [name for name in RING if name != "left"]


def topic_of(name: str) -> str:
    _, camera, *kind = name.split("/")
    if camera not in RING:
        return {"points": "velodyne_points"}.get(camera, name)
    folder = "rgb" if camera == "left" else camera
    return f"camera/{folder}/{'image_raw' if kind == ['image'] else 'camera_info'}"


def test_four_cameras_colour_whole_clouds() -> None:
    desk = Desk("data_fusion", cameras=FURTHER, fusion={"frame": "scan", "ground": "none"})
    wanted = {each.topic for each in desk.node.inputs}
    assert {topic_of(f"/{name}/image") for name in RING} <= wanted
    for event in ring_events():
        desk.give(topic_of(event.topic), event.message)
    desk.node.idle()
    clouds = desk.outlet.of("rgb_cloud")
    assert len(clouds) == 6 and {cloud.width * cloud.height for cloud in clouds} == {2000}


@rows("name", ["left", "rgb", "a b", "points"])
def test_names_that_are_no_further_cameras_are_refused(name: str) -> None:
    with pytest.raises(ConfigError):
        from_parameters(DataFusionConfig(), {"cameras": [name]})
