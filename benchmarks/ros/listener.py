# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A process that listens to topics of ROS and keeps every message: run by ``world``.

Answers each line of its input with the number of messages so far, reports of nodes not counted;
"keep PATH" by writing all of them there before, as a pickled list of (topic, type, bytes, seconds).
"""

import pickle
import sys
import threading
import time
from pathlib import Path
from typing import Any

from fusionslam.ros.ros1.environment import need_ros


def main(topics: list[str]) -> None:
    """Listen until the input ends."""
    need_ros()
    import rospy

    kept: list[tuple[str, str, bytes, float]] = []
    lock = threading.Lock()

    def take(message: Any, topic: str) -> None:
        now = time.monotonic()
        with lock:
            kept.append((topic, message._connection_header["type"], message._buff, now))

    rospy.init_node("listener", anonymous=True, disable_signals=True)
    for topic in topics:
        rospy.Subscriber(topic, rospy.AnyMsg, take, callback_args=topic, buff_size=1 << 24)
    print("ready", flush=True)
    for line in sys.stdin:
        command, _, path = line.strip().partition(" ")
        with lock:
            if command == "keep":
                Path(path).write_bytes(pickle.dumps(kept))
            print(sum(topic != "/diagnostics" for topic, *_ in kept), flush=True)
    rospy.signal_shutdown("done")


if __name__ == "__main__":
    main(sys.argv[1:])
