# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of live robots, in processes of their own."""

import json
import subprocess
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from bags import write_bag
from benchmarks.ros.world import RosWorld
from fusionslam.sensors.messages import Event

REMAPPINGS = (
    "velodyne_points:=/points",
    "camera/rgb/image_raw:=/camera/image",
    "camera/rgb/camera_info:=/camera/camera_info",
)
"""Those for the topics of ``bags.drive``."""
AS_LAUNCHED = ("scan:=/points", "image:=/camera/image", "camera_info:=/camera/camera_info")
_SCRIPT = """
import json, sys
from fusionslam.ros.check.robot import check_robot
from fusionslam.ros.{}.robot import connect
found = check_robot(connect, sys.argv[2:], float(sys.argv[1]), lambda *step: None)
print(json.dumps({{
    "works": found.works,
    "problems": {{each.what: each.code for each in found.findings if not each.fine}},
    "rows": dict(found.overview.rows),
    "again": found.again,
    "launch": found.launch,
    "nodes": found.nodes,
}}))
"""


@dataclass(frozen=True)
class Result:
    """Codes of problems by what was checked, rows of the overview, advice."""

    works: bool
    problems: dict[str, str]
    rows: dict[str, str]
    again: list[str]
    launch: list[str]
    nodes: list[str]


def check_live(
    world: RosWorld, python: str, adapter: str, *arguments: str, seconds: float
) -> Result:
    """What the check finds with a Python and ``ros1`` or ``ros2``."""
    done = subprocess.run(
        [python, "-c", _SCRIPT.format(adapter), str(seconds), *arguments],
        env=world.environment,
        cwd=world.folder,
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert not done.returncode, done.stderr
    return Result(**json.loads(done.stdout))


def new_bag(world: RosWorld, events: Iterable[Event], images: str = "raw") -> Path:
    """A bag of these events, in the place of the last one."""
    bag = world.folder / "drive.bag"
    bag.unlink(missing_ok=True)
    return write_bag(bag, events, images=images)
