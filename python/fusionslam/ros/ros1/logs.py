# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Log to rosout and the console, even if no log file can be written."""

import logging
import os
from pathlib import Path

from fusionslam.errors import DataError
from fusionslam.storage.files import make_folder

_NO_FOLDER = os.path.join(os.devnull, "none")


def to_rosout(level: int, text: str) -> None:
    """Log a text to rosout."""
    import rospy

    if level < logging.WARNING:
        rospy.loginfo("%s", text)
    else:
        (rospy.logwarn if level == logging.WARNING else rospy.logerr)("%s", text)


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
