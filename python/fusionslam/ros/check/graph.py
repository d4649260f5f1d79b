# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What the check asks a middleware for: the robot's graph, a node that listens, and its words."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from fusionslam.datasets.bags.reader import Topic
from fusionslam.ros.runtime.transport import Transport

CLOCK = "/clock"


@dataclass(frozen=True)
class Graph:
    """The topics of a robot at one time.

    Attributes:
        where: which graph it is: the address of the master, or domain and middleware.
        topics: published topics by name; each counts as one message.
        publishers: the nodes that publish each topic; one with two publishers is there twice.
        sim_time: whether nodes are to take the time from /clock.
        reliable: whether all publishers of a topic resend lost messages, by topic; empty in ROS 1,
            where all do.
        foreign: publishers whose definition of the type is not the one here, by topic.
    """

    where: str
    topics: Mapping[str, Topic]
    publishers: Mapping[str, Sequence[str]]
    sim_time: bool
    reliable: Mapping[str, bool] = field(default_factory=dict)
    foreign: Mapping[str, Sequence[str]] = field(default_factory=dict)


@dataclass(frozen=True)
class Advice:
    """What users of ROS 1 are told otherwise than those of ROS 2.

    Attributes:
        graph: name of what knows all topics.
        parameter: how to give a node a parameter, from name (with slashes) and value.
        remapping: how to give a node a remapping.
        no_topics: what to do if there are no topics; empty where that is no more than no sensors.
        no_clock: what to do if simulated time does not run.
        show_bag: how RViz shows a bag with old stamps.
        calibrate: how to calibrate a camera.
        publish: how to publish a transform between {parent} and {child}.
        bag_transforms: how to hear the static transforms of a bag; empty if they always come.
        several: what nodes do with messages of several publishers of a topic.
        silent: why nothing may arrive on a topic.
        unreachable: what to do if the address of a publisher is wrong.
        launch: the command that starts one of the launch files.
    """

    graph: str
    parameter: Callable[[str, object], str]
    remapping: Callable[[str], str]
    no_topics: str
    no_clock: str
    show_bag: str
    calibrate: str
    publish: str
    bag_transforms: str
    several: str
    silent: str
    unreachable: str
    launch: Callable[[str], Sequence[str]]


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot as a middleware shows it to a node that only listens.

    Attributes:
        advice: of this middleware.
        transport: the node, which knows no remappings: they would change guessed topics as well.
        parameters: of data_fusion as given, nested by name.
        topics: full names after the remappings, by the nodes' names of their inputs.
        remappings: as given, NAME:=TOPIC.
        options: the other arguments as given.
        read_graph: returns the present graph; raises FusionSlamError if nobody knows it.
        silent_nodes: returns which of some nodes cannot be reached, with their addresses.
    """

    advice: Advice
    transport: Transport
    parameters: Mapping[str, Any]
    topics: Mapping[str, str]
    remappings: Sequence[str]
    options: Sequence[str]
    read_graph: Callable[[], Graph]
    silent_nodes: Callable[[Sequence[str]], Mapping[str, str]]
