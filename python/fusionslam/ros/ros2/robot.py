# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A robot with ROS 2, for ``fusionslam ros2 check``."""

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import pairwise

from fusionslam.errors import ConfigError
from fusionslam.ros.check.graph import ROS2, Robot
from fusionslam.ros.ros2.environment import need_ros2
from fusionslam.ros.ros2.start import ros2_node, with_dots
from fusionslam.ros.topic_choice import INPUT_TOPICS, expand_launch_argument

_FLAG = "--ros-args"
_REMAP = ("-r", "--remap")


@contextmanager
def connect(arguments: Sequence[str]) -> Iterator[Robot]:
    """Make a node that listens to a robot.

    Args:
        arguments: for ROS as data_fusion takes them, with or without --ros-args and -r, or topics
            as launch files do (scan:=/points).

    Raises:
        FusionSlamError: ROS is missing.
        ConfigError: a malformed argument, or a parameter that data_fusion does not know.
    """
    need_ros2()
    from fusionslam.ros.ros2.graph import read_graph
    from fusionslam.ros.ros2.parameters import given_parameters
    from fusionslam.ros.ros2.transport import Ros2Transport

    remappings, options = _split(arguments)
    flags = [flag for remapping in remappings for flag in ("-r", remapping)]
    # Parameters and remappings may be for a node of this name only.
    with ros2_node("data_fusion", [_FLAG, *options, *flags]) as node:
        parameters = given_parameters(node)
        topics = {name: node.resolve_topic_name(name) for name in INPUT_TOPICS}
    with ros2_node("fusionslam_check", [_FLAG, *options]) as node:
        transport = Ros2Transport(node, threading.Event())
        try:
            yield Robot(
                advice=ROS2,
                transport=transport,
                parameters=parameters,
                topics=topics,
                remappings=remappings,
                options=options,
                read_graph=partial(read_graph, node),
                silent_nodes=lambda nodes: {},
            )
        except ConfigError as error:
            raise ConfigError(
                with_dots(str(error)), code=error.code, fields=error.fields
            ) from error
        finally:
            transport.close()


def _split(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return remappings, and the other arguments for ROS."""
    remappings, options = list[str](), list[str]()
    for before, argument in pairwise(("", *arguments)):
        is_value = before.startswith("-") and before not in (_FLAG, "--", *_REMAP)
        if argument in (_FLAG, "--", *_REMAP):
            continue
        if is_value or argument.startswith("-"):
            options.append(argument)
        elif argument.startswith("_") and not argument.startswith("__"):
            raise ConfigError(
                f"{argument!r} is a parameter of ROS 1; ROS 2 takes -p NAME:=VALUE with dots in "
                "its name",
                code="no-ros-argument",
            )
        elif ":=" not in argument:
            raise ConfigError(
                f"{argument!r} is no remapping, expected NAME:=TOPIC", code="no-remapping"
            )
        else:
            remappings.append(expand_launch_argument(argument))
    return remappings, options
