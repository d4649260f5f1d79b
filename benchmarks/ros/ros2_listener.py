# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Keeps the messages of the topics that are its arguments; of plain rclpy, without fusionslam.

It says "ready" once it spins. Then each line of its input gets a line of answer: "count" the
number of messages without reports, "keep FILE" and all of them are pickled there as (topic, type,
CDR bytes, seconds) in order of arrival, "hash TOPIC" the type hash that its publisher gives.
"""

import pickle
import sys
import threading
import time
from contextlib import suppress
from importlib import import_module
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.qos import QoSProfile

REPORTS = "/diagnostics"


class Ears:
    """Subscribes to each topic once it has a publisher, as this one offers it."""

    def __init__(self, node: Any, topics: list[str]) -> None:
        self.node, self.topics = node, topics
        self.kept: list[tuple[str, str, bytes, float]] = []
        self.hashes: dict[str, str] = {}
        node.create_timer(0.05, self.look)

    def look(self) -> None:
        """Subscribe to what has a publisher now."""
        for topic in set(self.topics) - set(self.hashes):
            for offered in self.node.get_publishers_info_by_topic(topic)[:1]:
                package, _, name = offered.topic_type.split("/")
                self.hashes[topic] = str(offered.topic_type_hash)
                self.node.create_subscription(
                    getattr(import_module(f"{package}.msg"), name),
                    topic,
                    self.taker(topic, offered.topic_type),
                    QoSProfile(
                        depth=5000,
                        reliability=offered.qos_profile.reliability,
                        durability=offered.qos_profile.durability,
                    ),
                    raw=True,
                )

    def taker(self, topic: str, kind: str) -> Any:
        """Return what keeps the messages of a topic."""
        return lambda data: self.kept.append((topic, kind, data, time.monotonic()))


def spin(node: Any) -> None:
    """Take what comes until the end."""
    with suppress(ExternalShutdownException):
        rclpy.spin(node)


def main() -> None:
    """Answer until the input ends."""
    rclpy.init()
    ears = Ears(rclpy.create_node("listener"), sys.argv[1:])
    spinning = threading.Thread(target=spin, args=[ears.node])
    spinning.start()
    print("ready", flush=True)
    for line in sys.stdin:
        word, _, what = line.strip().partition(" ")
        kept = list(ears.kept)
        if word == "count":
            print(sum(topic != REPORTS for topic, *_ in kept), flush=True)
        elif word == "hash":
            print(ears.hashes.get(what, ""), flush=True)
        else:
            with open(what, "wb") as file:
                pickle.dump(kept, file)
            print("done", flush=True)
    rclpy.try_shutdown()
    spinning.join()


if __name__ == "__main__":
    main()
