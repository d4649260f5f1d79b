# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Entry points of the ROS package's executables."""

import logging
import os
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from fusionslam.base.files import make_folder
from fusionslam.errors import ConfigError, DataError, FusionSlamError
from fusionslam.ros.nodes import node_class
from fusionslam.ros.ros1.environment import need_ros
from fusionslam.ros.runtime.node import Node
from fusionslam.ros.runtime.problem_log import RosHandler
from fusionslam.ros.runtime.runner import NodeRunner, exit_on_errors

_NO_FOLDER = os.path.join(os.devnull, "none")


def start(name: str, arguments: list[str] | None = None) -> None:
    """Run a node until ROS shuts down.

    Args:
        name: one of ``NODES``.
        arguments: as on a command line: remappings (``odom:=/wheels/odom``) and private parameters
            (``_fusion/voxel:=0.05``); None for those of this process.

    Raises:
        SystemExit: 2 if the node cannot start, 130 if it is interrupted while starting.
    """
    with exit_on_errors(name):
        need_ros()
        kind, given = node_class(name), sys.argv if arguments is None else [name, *arguments]
        _init(kind.name, given)
        _off_main_thread(lambda: _serve(kind, given))


def start_player() -> None:
    """Play a bag to the nodes of the launch file that started this process."""
    with exit_on_errors("bag_player"):
        need_ros()
        from fusionslam.ros.ros1.bag_player import play_bag

        _init("bag_player")
        _off_main_thread(play_bag)


def _serve(kind: type[Node[Any]], arguments: list[str]) -> None:
    """Make a node and run it until ROS shuts down."""
    import rospy

    handler = RosHandler(_to_rosout)
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
        _init_node(name, arguments)
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


def _to_rosout(level: int, text: str) -> None:
    """Log a text to rosout."""
    import rospy

    if level < logging.WARNING:
        rospy.loginfo("%s", text)
    else:
        (rospy.logwarn if level == logging.WARNING else rospy.logerr)("%s", text)


def _init_node(name: str, arguments: list[str] | None = None) -> None:
    """Initialise a node as rospy does, even if no log file can be written.

    rospy alone would then end, or log nothing more.

    Args:
        arguments: as on a command line; None for those of this process.
    """
    import rospkg
    import rospy
    from rosgraph.roslogging import RosStreamHandler

    # On a full disk, do not print a traceback for each line logged.
    logging.raiseExceptions = False
    folder = Path(rospkg.get_log_dir())
    try:
        with make_folder(folder):
            pass
    except DataError:
        # With this folder rospy does without log files.
        os.environ["ROS_LOG_DIR"] = _NO_FOLDER
    rospy.init_node(name, argv=arguments)
    console = logging.getLogger("rosout")
    if not any(isinstance(each, RosStreamHandler) for each in console.handlers):
        console.addHandler(RosStreamHandler())
        console.setLevel(logging.INFO)
        rospy.logwarn("no log files: nothing can be written to %s; set ROS_LOG_DIR", folder)
