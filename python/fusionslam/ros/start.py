# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Where the executables of the ROS package start."""

import logging
import sys
from collections.abc import Callable

from fusionslam.errors import FusionSlamError
from fusionslam.ros.complaints import Complaints
from fusionslam.ros.environment import need_ros
from fusionslam.ros.nodes import node_class

_WRONG, _INTERRUPTED = 2, 130


def start(name: str, arguments: list[str] | None = None) -> None:
    """Run a node until ROS shuts down.

    Args:
        name: one of ``NODES``.
        arguments: as on a command line: remappings (``odom:=/wheels/odom``) and private parameters
            (``_fusion/voxel:=0.05``); None for those of this process.

    Raises:
        SystemExit: 2 if it cannot start, 130 if it is interrupted before it could.
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
    # A disk that is full is no reason for a traceback with each line that is logged.
    logging.raiseExceptions = False
    try:
        need_ros()
        action()
    except FusionSlamError as error:
        _end(_WRONG, f"error: {name}: {error}")
    except KeyboardInterrupt:
        _end(_INTERRUPTED, f"{name}: interrupted")


def _run(name: str, arguments: list[str]) -> None:
    import rospy

    kind = node_class(name)
    try:
        rospy.init_node(kind.name, argv=arguments)
        to_rosout = _ToRosout()
        logging.getLogger("fusionslam").addHandler(to_rosout)
        from fusionslam.ros.shell import Shell

        shell = Shell(kind)
    except (FusionSlamError, KeyboardInterrupt):
        raise
    except Exception as error:
        if rospy.is_shutdown():
            raise KeyboardInterrupt from error
        raise
    to_rosout.complaints = shell.complaints
    rospy.loginfo("%s is ready", kind.name)
    shell.run()


def _end(code: int, message: str) -> None:
    print(message, file=sys.stderr)
    raise SystemExit(code)


class _ToRosout(logging.Handler):
    """What is logged goes where ROS collects it; what the library warns of, once for each cause.

    Attributes:
        complaints: those of the node, once there is one.
    """

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.complaints: Complaints | None = None

    def emit(self, record: logging.LogRecord) -> None:
        """Pass a record on."""
        import rospy

        if self.complaints is not None and not record.name.startswith(__package__):
            self.complaints.add(record.name.removeprefix("fusionslam."), record.getMessage())
            return
        say = rospy.logwarn if record.levelno == logging.WARNING else rospy.logerr
        say("%s", self.format(record))
