# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A robot with ROS 1, for ``fusionslam ros check``."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress

from fusionslam.errors import ConfigError
from fusionslam.ros.check.graph import ROS1, Robot
from fusionslam.ros.ros1.environment import need_ros
from fusionslam.ros.ros1.master import read_graph, silent_nodes
from fusionslam.ros.topic_choice import INPUT_TOPICS, expand_launch_argument

_NAME = "fusionslam_check"


@contextmanager
def connect(arguments: Sequence[str]) -> Iterator[Robot]:
    """Make a node that listens to a robot. Only once per process: rospy allows no more.

    Args:
        arguments: remappings and parameters (_fusion/source:=stereo) as data_fusion takes them,
            or topics as launch files do (scan:=/points).

    Raises:
        FusionSlamError: ROS is missing, or no master answers.
        ConfigError: a malformed argument.
    """
    if wrong := [argument for argument in arguments if ":=" not in argument]:
        raise ConfigError(
            f"{wrong[0]!r} is no remapping, expected NAME:=TOPIC", code="no-remapping"
        )
    need_ros()
    read_graph()  # fails without a master; rospy would wait for ever
    import rospy

    options = [argument for argument in arguments if argument.startswith("_")]
    remappings = [expand_launch_argument(each) for each in arguments if each not in options]
    try:
        rospy.init_node(_NAME, argv=[_NAME, *options], anonymous=True, disable_signals=True)
        yield _robot(remappings, options)
    except rospy.ROSInitException as error:
        raise ConfigError(f"{' '.join(options)}: {error}") from error
    finally:
        # Our parameters leave the server, our node the master.
        with suppress(OSError, rospy.ROSException):  # the master is gone
            if rospy.has_param("~"):
                rospy.delete_param("~")
        rospy.signal_shutdown("checked")


def _robot(remappings: Sequence[str], options: Sequence[str]) -> Robot:
    from rosgraph.names import load_mappings, resolve_name

    from fusionslam.ros.ros1.transport import Ros1Transport

    transport = Ros1Transport()
    mappings = {
        resolve_name(name, transport.name): resolve_name(topic, transport.name)
        for name, topic in load_mappings(remappings).items()
    }
    return Robot(
        advice=ROS1,
        transport=transport,
        parameters=transport.parameters,
        topics={name: resolve_name(name, transport.name, mappings) for name in INPUT_TOPICS},
        remappings=remappings,
        options=options,
        read_graph=read_graph,
        silent_nodes=silent_nodes,
    )
