# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The roles of a robot's topics for the nodes, and the choice of a topic for each."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from fusionslam.datasets.bags.reader import Topic
from fusionslam.datasets.bags.topics import INFO_ROLES, ROLES, candidates
from fusionslam.fusion import SENSORS_OF
from fusionslam.ros.nodes import NODES
from fusionslam.ros.nodes.frame_node import IMU_TOPIC, LEFT, ODOM, RIGHT, SCANS
from fusionslam.ros.nodes.lv_dataset_creator import TRUTH

INPUTS = {
    "points": SCANS,
    "left": LEFT[0],
    "camera_info": LEFT[1],
    "right": RIGHT[0],
    "right_camera_info": RIGHT[1],
    "odometry": ODOM,
    "truth": TRUTH,
    "imu": IMU_TOPIC,
}
"""The nodes' topic name for each role."""
TF_TOPICS = ("/tf", "/tf_static")
INPUT_TOPICS = (*INPUTS.values(), *TF_TOPICS)
"""The nodes' names of all topics that they may listen to."""
LAUNCH_ARGUMENTS = {
    "points": "scan",
    "left": "image",
    "camera_info": "camera_info",
    "odometry": "odom",
    "truth": "truth",
    "imu": "imu",
}
"""The launch files' argument for each role."""
_OF_MOTION = ("odometry", "truth", "imu")
_RARE = ("imu",)
"""Few robots have them, and none needs them: they are no choice where nobody publishes one."""


def expand_launch_argument(argument: str) -> str:
    """Translate a topic as launch files take it, "scan:=/points", to the remapping they make."""
    name, _, topic = argument.partition(":=")
    names = {short: INPUTS[role] for role, short in LAUNCH_ARGUMENTS.items()}
    return f"{names.get(name, name)}:={topic}"


def needed_roles(source: str) -> Sequence[str]:
    """Return the roles that a source of clouds needs: sensors, each camera with its CameraInfo."""
    roles = ((sensor, INFO_ROLES.get(sensor)) for sensor in SENSORS_OF[source])
    return [role for pair in roles for role in pair if role is not None]


def roles_of(source: str) -> Sequence[str]:
    """Return all roles that nodes may listen to with this source of clouds."""
    return (*needed_roles(source), *_OF_MOTION)


@dataclass(frozen=True)
class Choice:
    """The topic chosen for a role.

    Attributes:
        role: the role for the nodes.
        asked: the topic that the nodes listen to as started.
        topic: the chosen topic: the one asked for, else the best guess; empty if there is none.
        others: further topics that would fit, best first.
    """

    role: str
    asked: str
    topic: str
    others: Sequence[str] = ()

    @property
    def is_guess(self) -> bool:
        """Whether the topic is a guess, for which the nodes need a remapping."""
        return bool(self.topic) and self.topic != self.asked

    @property
    def remapping(self) -> str:
        """The remapping that gives the nodes this topic."""
        return f"{INPUTS[self.role]}:={self.topic}"


def choose(
    topics: Mapping[str, Topic], publishers: Mapping[str, Sequence[str]], asked: Mapping[str, str]
) -> dict[str, Choice]:
    """Choose a topic for each role, guessing if the one asked for is missing.

    An IMU is left out if there is none.

    Args:
        topics: all published topics.
        publishers: nodes by topic; topics of our own nodes are not sensors.
        asked: the topics that the nodes listen to, by role.
    """
    makers = {
        name: {node.rpartition("/")[2] for node in publishers.get(name, ())} for name in topics
    }
    free = {n: topic for n, topic in topics.items() if not makers[n] or makers[n] - {*NODES}}
    chosen = {
        role: name
        for role, name in asked.items()
        if name in topics and topics[name].type in ROLES[role]
    }
    found = {}
    for role, name in asked.items():
        fitting = [chosen[role]] if role in chosen else candidates(free, role, chosen)
        taken = [other for key, other in chosen.items() if key != role]
        fitting = [each for each in fitting if each not in taken]
        if role in _RARE and not fitting and name not in topics:
            continue
        if fitting:
            chosen[role] = fitting[0]
        found[role] = Choice(role, name, next(iter(fitting), ""), tuple(fitting[1:]))
    return found
