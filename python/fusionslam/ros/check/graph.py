# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What the check asks a middleware for: the robot's graph, a node that listens, and its words."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from fusionslam.datasets.bags.reader import Topic
from fusionslam.ros.runtime.node import Transport

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


ROS1 = Advice(
    graph="master",
    parameter=lambda name, value: f"_{name}:={value}",
    remapping=lambda remapping: remapping,
    no_topics="",
    no_clock=(
        "start the simulator or rosbag play --clock; on a real robot rosparam set use_sim_time "
        "false, and restart all nodes"
    ),
    show_bag="RViz needs rosparam set use_sim_time true before rosbag play --clock",
    calibrate="calibrate the camera (rosrun camera_calibration), its driver then publishes it",
    publish=(
        "start robot_state_publisher with the robot's URDF, or rosrun tf2_ros "
        "static_transform_publisher X Y Z YAW PITCH ROLL {parent} {child}"
    ),
    bag_transforms=(
        "a bag sends /tf_static once, at its start: start this first, then rosbag play; on a "
        "robot, "
    ),
    several="nodes hear one of them alone",
    silent="is the sensor connected, is a bag paused or over?",
    unreachable=(
        "set ROS_IP where it runs to an address that is known here; if it crashed, rosnode cleanup"
    ),
    launch=lambda file: ["fusionslam", "ros", "launch", file],
)

ROS2 = Advice(
    graph="graph",
    parameter=lambda name, value: f"-p {name.replace('/', '.')}:={value}",
    remapping=lambda remapping: f"-r {remapping}",
    no_topics=(
        "start the robot, with the same ROS_DOMAIN_ID and RMW_IMPLEMENTATION as here; if it is "
        "another machine, in the same network with multicast, and on both "
        "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET (the default) or ROS_STATIC_PEERS"
    ),
    no_clock=(
        "start the simulator, or fusionslam ros2 play or ros2 bag play --clock; on a real robot "
        "leave use_sim_time out"
    ),
    show_bag="RViz needs --ros-args -p use_sim_time:=true",
    calibrate=(
        "calibrate the camera (ros2 run camera_calibration cameracalibrator), its driver then "
        "publishes it"
    ),
    publish=(
        "start robot_state_publisher with the robot's URDF, or ros2 run tf2_ros "
        "static_transform_publisher --x X --y Y --z Z --yaw YAW --pitch PITCH --roll ROLL "
        "--frame-id {parent} --child-frame-id {child}"
    ),
    bag_transforms="",
    several="nodes mix the messages of all",
    silent=("is the sensor connected, is a bag paused or over, does a firewall hold back UDP?"),
    unreachable="",
    launch=lambda file: ["ros2", "launch", "fusionslam_ros2", f"{file}.launch.py"],
)


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
