# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Where the executables of the ROS package start."""

import logging
import sys
from collections.abc import Callable

from fusionslam.errors import FusionSlamError
from fusionslam.ros.environment import need_ros
from fusionslam.ros.nodes import node_class

_WRONG = 2


def start(name: str, arguments: list[str] | None = None) -> None:
    """Run a node until ROS shuts down.

    Args:
        name: one of ``NODES``.
        arguments: as on a command line: remappings (``odom:=/wheels/odom``) and private parameters
            (``_fusion/voxel:=0.05``); None for those of this process.
    """
    _guarded(name, lambda: _run(name, sys.argv if arguments is None else [name, *arguments]))


def start_player() -> None:
    """Play a bag to the nodes of the launch file that this process is part of."""

    def play() -> None:
        import rospy

        from fusionslam.ros.bag_player import play_bag

        rospy.init_node("bag_player")
        play_bag()

    _guarded("bag_player", play)


def _guarded(name: str, action: Callable[[], None]) -> None:
    try:
        need_ros()
        action()
    except FusionSlamError as error:
        print(f"error: {name}: {error}", file=sys.stderr)
        raise SystemExit(_WRONG) from error


def _run(name: str, arguments: list[str]) -> None:
    import rospy

    kind = node_class(name)
    rospy.init_node(kind.name, argv=arguments)
    logging.getLogger("fusionslam").addHandler(_ToRosout())
    from fusionslam.ros.shell import Shell

    try:
        shell = Shell(kind)
    except FusionSlamError as error:
        rospy.logfatal("%s", error)
        rospy.signal_shutdown("wrong parameters")
        raise
    rospy.loginfo("%s is ready", kind.name)
    shell.run()


class _ToRosout(logging.Handler):
    """What the library logs goes where ROS collects it."""

    def emit(self, record: logging.LogRecord) -> None:
        """Pass a record on."""
        import rospy

        levels = {logging.WARNING: rospy.logwarn, logging.ERROR: rospy.logerr}
        if record.levelno >= logging.WARNING:
            levels.get(record.levelno, rospy.logerr)("%s", self.format(record))
