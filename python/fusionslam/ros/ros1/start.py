# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Entry points of the ROS package's executables."""

import logging
import os
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from fusionslam.errors import ConfigError, FusionSlamError
from fusionslam.ros.nodes import node_class
from fusionslam.ros.ros1.environment import need_ros
from fusionslam.ros.ros1.logs import init_node, to_rosout
from fusionslam.ros.runtime.log_handler import RosHandler
from fusionslam.ros.runtime.node import Node
from fusionslam.ros.runtime.runner import NodeRunner

_WRONG, _INTERRUPTED = 2, 130


def start(name: str, arguments: list[str] | None = None) -> None:
    """Run a node until ROS shuts down.

    Args:
        name: one of ``NODES``.
        arguments: as on a command line: remappings (``odom:=/wheels/odom``) and private parameters
            (``_fusion/voxel:=0.05``); None for those of this process.

    Raises:
        SystemExit: 2 if the node cannot start, 130 if it is interrupted while starting.
    """
    _exit_on_errors(name, lambda: _run(name, sys.argv if arguments is None else [name, *arguments]))


def start_player() -> None:
    """Play a bag to the nodes of the launch file that started this process."""

    def play() -> None:
        from fusionslam.ros.ros1.bag_player import play_bag

        _init("bag_player")
        _off_main_thread(play_bag)

    _exit_on_errors("bag_player", play)


def _exit_on_errors(name: str, action: Callable[[], None]) -> None:
    try:
        need_ros()
        action()
    except FusionSlamError as error:
        _end(_WRONG, f"error: {name}: {error}")
    except KeyboardInterrupt:
        _end(_INTERRUPTED, f"{name}: interrupted")


def _run(name: str, arguments: list[str]) -> None:
    kind = node_class(name)
    _init(kind.name, arguments)
    _off_main_thread(lambda: _serve(kind, arguments))


def _serve(kind: type[Node[Any]], arguments: list[str]) -> None:
    """Make a node and run it until ROS shuts down."""
    import rospy

    handler = RosHandler(to_rosout)
    logging.getLogger("fusionslam").addHandler(handler)
    logging.getLogger("fusionslam.ros").setLevel(logging.INFO)
    from fusionslam.ros.ros1.transport import Ros1Transport

    try:
        node = NodeRunner(kind, Ros1Transport())
    except (OSError, rospy.ROSException) as error:  # while reading parameters from the master
        raise _no_start(error) from error
    except ConfigError:
        _forget_parameters(arguments)
        raise
    handler.problems = node.problems
    heard = ", ".join(rospy.resolve_name(topic) for topic in node.inputs)
    rospy.loginfo("%s is ready: it listens to %s", kind.name, heard)
    node.run()


def _off_main_thread(action: Callable[[], None]) -> None:
    # rospy's handler of SIGINT runs in the main thread, between any two of its steps, and takes
    # locks that publishing holds: a node that publishes there may hang at Ctrl-C.
    with ThreadPoolExecutor(1) as pool:
        pool.submit(action).result()


def _init(name: str, arguments: list[str] | None = None) -> None:
    import rospy

    try:
        init_node(name, arguments)
    except (OSError, ValueError, rospy.ROSException) as error:
        raise _no_start(error) from error
    except (TypeError, OverflowError) as error:  # while sending parameters to the server
        raise ConfigError(
            f"ROS cannot store a parameter of the command line ({error}); null is the text "
            "\"'null'\""
        ) from error


def _no_start(error: Exception) -> BaseException:
    """Return the exception for a failed start: an interrupt, or the reason."""
    import rospy

    if rospy.is_shutdown():
        return KeyboardInterrupt()
    master = os.environ.get("ROS_MASTER_URI", "unset")
    where = f"; ROS_MASTER_URI is {master}" if isinstance(error, OSError) else ""
    return FusionSlamError(f"ROS does not start: {' '.join(str(error).split())}{where}")


def _forget_parameters(arguments: list[str]) -> None:
    """Delete refused parameters from the server, where they would spoil the next start too."""
    import rospy

    for given in rospy.client.load_command_line_node_params(arguments):
        name = given
        rospy.delete_param(f"~{name}")
        while (name := name.rpartition("/")[0]) and rospy.get_param(f"~{name}", None) == {}:
            rospy.delete_param(f"~{name}")


def _end(code: int, message: str) -> None:
    print(message, file=sys.stderr)
    raise SystemExit(code)
