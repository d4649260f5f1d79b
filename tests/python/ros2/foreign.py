# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A process with plain rclpy and no code of fusionslam: writes down what topics carry.

    python foreign.py FILE TOPIC...

FILE gets pickled tuples (topic, type, type hash, CDR bytes) in order of arrival, until SIGINT.
"""

import pickle
import signal
import sys
from contextlib import suppress
from importlib import import_module

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.qos import QoSProfile


def main() -> None:
    """Subscribe to each topic once it has a publisher, as this one offers it."""
    path, *topics = sys.argv[1:]
    rclpy.init()
    node = rclpy.create_node("foreign")
    subscriptions = {}
    with open(path, "wb") as file:

        def look() -> None:
            for topic in topics:
                found = node.get_publishers_info_by_topic(topic)
                if topic in subscriptions or not found:
                    continue
                offered = found[0]
                package, _, name = offered.topic_type.split("/")
                kind = getattr(import_module(f"{package}.msg"), name)
                quality = QoSProfile(
                    depth=1000,
                    reliability=offered.qos_profile.reliability,
                    durability=offered.qos_profile.durability,
                )
                about = topic, offered.topic_type, str(offered.topic_type_hash)

                def take(data: bytes, about: tuple[str, str, str] = about) -> None:
                    pickle.dump((*about, data), file)
                    file.flush()

                made = node.create_subscription(kind, topic, take, quality, raw=True)
                subscriptions[topic] = made

        look()
        node.create_timer(0.05, look)
        signal.signal(signal.SIGINT, lambda *_: rclpy.try_shutdown())
        with suppress(ExternalShutdownException):
            rclpy.spin(node)


if __name__ == "__main__":
    main()
