# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Send log messages to ROS and the console, even if no log file can be written."""

import logging
import os
from pathlib import Path

from fusionslam.errors import DataError
from fusionslam.ros.runtime.problem_log import ProblemLog
from fusionslam.storage.files import make_folder

_NO_FOLDER = os.path.join(os.devnull, "none")


class ToRosout(logging.Handler):
    """Passes log records to rosout; warnings of the library only once for each cause.

    Attributes:
        problems: the node's problem log, once there is a node.
    """

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.problems: ProblemLog | None = None

    def emit(self, record: logging.LogRecord) -> None:
        """Pass on a record."""
        import rospy

        if record.levelno < logging.WARNING:
            rospy.loginfo("%s", self.format(record))
            return
        if self.problems is not None and not record.name.startswith(__package__):
            # ``cause`` distinguishes problems that are logged with the same template.
            cause = getattr(record, "cause", (str(record.msg),))
            name = record.name.removeprefix("fusionslam.")
            self.problems.add(name, record.getMessage(), *cause)
            return
        say = rospy.logwarn if record.levelno == logging.WARNING else rospy.logerr
        say("%s", self.format(record))


def init_node(name: str, arguments: list[str] | None = None) -> None:
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
