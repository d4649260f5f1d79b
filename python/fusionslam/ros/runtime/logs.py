# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What is logged reaches ROS and the console, whatever can be written."""

import logging
import os
from pathlib import Path

from fusionslam.errors import DataError
from fusionslam.ros.runtime.problem_log import ProblemLog
from fusionslam.storage.files import made_folder

_NO_FOLDER = os.path.join(os.devnull, "none")


class ToRosout(logging.Handler):
    """What is logged goes where ROS collects it; what the library warns of, once for each cause.

    Attributes:
        problems: those of the node, once there is one.
    """

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.problems: ProblemLog | None = None

    def emit(self, record: logging.LogRecord) -> None:
        """Pass a record on."""
        import rospy

        if record.levelno < logging.WARNING:
            rospy.loginfo("%s", self.format(record))
            return
        if self.problems is not None and not record.name.startswith(__package__):
            # Loggers that report several problems with one template tell them apart by ``cause``.
            cause = getattr(record, "cause", (str(record.msg),))
            name = record.name.removeprefix("fusionslam.")
            self.problems.add(name, record.getMessage(), *cause)
            return
        say = rospy.logwarn if record.levelno == logging.WARNING else rospy.logerr
        say("%s", self.format(record))


def init_node(name: str, arguments: list[str] | None = None) -> None:
    """As rospy's, also where no log file can be written: rospy ends there, or says nothing more.

    Args:
        arguments: as on a command line; None for those of this process.
    """
    import rospkg
    import rospy
    from rosgraph.roslogging import RosStreamHandler

    # A disk that is full is no reason for a traceback with each line that is logged.
    logging.raiseExceptions = False
    folder = Path(rospkg.get_log_dir())
    try:
        with made_folder(folder):
            pass
    except DataError:
        # There rospy does without files.
        os.environ["ROS_LOG_DIR"] = _NO_FOLDER
    rospy.init_node(name, argv=arguments)
    console = logging.getLogger("rosout")
    if not any(isinstance(each, RosStreamHandler) for each in console.handlers):
        console.addHandler(RosStreamHandler())
        console.setLevel(logging.INFO)
        rospy.logwarn("no log files, as nothing can be written to %s: set ROS_LOG_DIR", folder)
