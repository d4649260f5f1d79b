# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Listen to a robot as the nodes would, without publishing anything."""

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import rospy

from fusionslam.datasets.bags.reader import RawMessage
from fusionslam.errors import DataError, one_line
from fusionslam.ros.check.master import read_graph
from fusionslam.ros.check.observed_topics import ObservedTopic, choose
from fusionslam.ros.check.trial_fusion import TrialFusion
from fusionslam.ros.messages.types import CLOUD, IMAGES, deserialized
from fusionslam.ros.runtime.message_queue import SECOND_PUBLISHER, Arrival, Inbox
from fusionslam.ros.runtime.rospy_node import BUFFER_BYTES
from fusionslam.sensors.messages import CameraInfo, FrameTransforms, Message

Progress = Callable[[str, int, int], None]

TRANSFORMS = ("/tf", "/tf_static")
"""The topics of TF, which are roles as well."""
_LARGE = (CLOUD, *IMAGES)
_LOOK_S = 0.2
_POLL_S = 0.05


class TopicListener:
    """Listens to the topics of the nodes, or to the best guess for a missing topic.

    Args:
        asked: topics of the nodes by role, and the remapped names of /tf and /tf_static; rospy
            itself must know no remappings, or it would remap the guesses.
        trial: receives the messages.

    Attributes:
        graph: the latest answer of the master.
        choices: chosen topics by role.
        heard: observed topics by role, for roles with a topic.

    Raises:
        FusionSlamError: the master does not answer.
    """

    def __init__(self, asked: Mapping[str, str], trial: TrialFusion) -> None:
        self.heard: dict[str, ObservedTopic] = {}
        self._asked = {role: topic for role, topic in asked.items() if role not in TRANSFORMS}
        self._trial = trial
        common = trial.config.node
        self._by_arrival = common.stamps == "arrival"
        self._inbox = Inbox(common.queue, common.only_one)
        self._subscribers: dict[str, Any] = {}
        # Subscribe before anyone publishes: a bag sends its static transforms once, at its start.
        for role in TRANSFORMS:
            self._subscribe(role, asked[role])
        self._subscribe_new()

    def listen(self, seconds: float, progress: Progress) -> None:
        """Wait up to ``seconds`` for the first sensor, then listen for ``seconds``.

        Raises as the constructor.
        """
        self._poll_until("waiting", seconds, progress, self._has_messages)
        if self._has_messages():
            self._poll_until("listening", seconds, progress, rospy.is_shutdown)
        self._subscribe_new()
        for subscriber in self._subscribers.values():
            subscriber.unregister()
        self._trial.end()

    def _has_messages(self) -> bool:
        return any(heard.count for heard in self.heard.values())

    def _poll_until(
        self, what: str, seconds: float, progress: Progress, done: Callable[[], bool]
    ) -> None:
        begin = looked = time.monotonic()
        while (since := time.monotonic() - begin) < seconds and not done():
            progress(what, int(since), round(seconds))
            arrival = self._inbox.get(_POLL_S)
            if arrival is not None:
                self._process(arrival)
            if time.monotonic() - looked > _LOOK_S:
                self._subscribe_new()
                looked = time.monotonic()
        progress(what, round(seconds), round(seconds))

    def _subscribe_new(self) -> None:
        """Subscribe to topics that have appeared since."""
        self.graph = read_graph()
        self.choices = choose(self.graph.topics, self.graph.publishers, self._asked)
        for role, choice in self.choices.items():
            present = self.heard.get(role)
            # Keep what was heard of topics that have ended meanwhile.
            if choice.topic and (present is None or present.topic != choice.topic):
                self.heard[role] = ObservedTopic(choice.topic, self.graph.topics[choice.topic].type)
                self._subscribe(role, choice.topic)

    def _subscribe(self, role: str, topic: str) -> None:
        if role in self._subscribers:
            self._subscribers[role].unregister()
        self._subscribers[role] = rospy.Subscriber(
            topic,
            rospy.AnyMsg,
            self._queue,
            callback_args=(role, topic),
            buff_size=BUFFER_BYTES,
            tcp_nodelay=True,
        )

    def _queue(self, message: Any, place: tuple[str, str]) -> None:
        """Note the arrival time in a thread of rospy; leave the rest to the main thread."""
        role, topic = place
        about, now_ns = message._connection_header, rospy.Time.now().to_nsec()
        is_tf = role in TRANSFORMS
        # The role of a transform topic tells whether it is static, even if it was remapped.
        raw = RawMessage(role if is_tf else topic, about["type"], now_ns, message)
        # Like the nodes, listen only to the first of two publishers.
        dropped = self._inbox.put(
            Arrival(role, raw, time.monotonic()), None if is_tf else about["callerid"]
        )
        if dropped != SECOND_PUBLISHER and not is_tf:
            header = deserialized(message, "std_msgs/Header")
            self.heard[role].series.add(replace(raw, content=SimpleNamespace(header=header)))

    def _process(self, arrival: Arrival) -> None:
        """Read a message; images and clouds only until a first cloud was fused."""
        role, raw = arrival.topic, arrival.message
        if raw.type in _LARGE and self._trial.first is not None:
            return
        value = self._value(role, raw)
        if value is not None:
            self._trial.take(role, value, raw.time_ns)

    def _value(self, role: str, raw: RawMessage) -> Message | None:
        """Convert a message, with the stamp in force; None if the nodes would refuse it."""
        try:
            value = replace(raw, content=deserialized(raw.content, raw.type)).value()
        except DataError as error:
            refuse = self._trial.links.refuse if role in TRANSFORMS else self.heard[role].refuse
            refuse(one_line(error))
            return None
        if isinstance(value, FrameTransforms):
            return value
        self.heard[role].value = value
        if self._by_arrival:
            return replace(value, stamp_ns=raw.time_ns)
        return value if value.stamp_ns or isinstance(value, CameraInfo) else None
