# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Listens to a robot as the nodes would, without publishing anything."""

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import rospy

from fusionslam.datasets.bags.reader import RawMessage
from fusionslam.errors import DataError
from fusionslam.messages import CameraInfo, FrameTransforms, Message
from fusionslam.ros.graph import look_at_master
from fusionslam.ros.heard import Heard, choose
from fusionslam.ros.inbox import Arrival, Inbox
from fusionslam.ros.message_types import CLOUD, IMAGES, deserialized
from fusionslam.ros.shell import BUFFER_BYTES
from fusionslam.ros.trial import Trial

Progress = Callable[[str, int, int], None]

_TF = ("/tf", "/tf_static")
_LARGE = (CLOUD, *IMAGES)
_LOOK_S = 0.2
_POLL_S = 0.05


class Ears:
    """Listens to the topics of the nodes, or to the best guess where one is not there.

    Args:
        asked: topics of the nodes by role, as remapped.
        trial: takes what arrives.

    Attributes:
        graph: what the master knew when it was asked last.
        choices: by role.
        heard: by role, where there is a topic.

    Raises:
        FusionSlamError: the master does not answer.
    """

    def __init__(self, asked: Mapping[str, str], trial: Trial) -> None:
        self.heard: dict[str, Heard] = {}
        self._asked, self._trial = asked, trial
        common = trial.config.node
        self._by_arrival = common.stamps == "arrival"
        self._inbox = Inbox(common.queue, common.only_one)
        self._subscribers: dict[str, Any] = {}
        # Before anybody publishes them: a bag tells its static transforms once, at its start.
        for topic in _TF:
            self._subscribe(topic, topic)
        self._look()

    def listen(self, seconds: float, progress: Progress) -> None:
        """Wait so long for the first sensor, then listen so long. Raises as the constructor."""
        self._until("waiting", seconds, progress, self._any)
        if self._any():
            self._until("listening", seconds, progress, rospy.is_shutdown)
        self._look()
        for subscriber in self._subscribers.values():
            subscriber.unregister()
        self._trial.end()

    def _any(self) -> bool:
        return any(heard.count for heard in self.heard.values())

    def _until(
        self, what: str, seconds: float, progress: Progress, done: Callable[[], bool]
    ) -> None:
        begin = looked = time.monotonic()
        while (since := time.monotonic() - begin) < seconds and not done():
            progress(what, int(since), round(seconds))
            arrival = self._inbox.get(_POLL_S)
            if arrival is not None:
                self._work_off(arrival)
            if time.monotonic() - looked > _LOOK_S:
                self._look()
                looked = time.monotonic()
        progress(what, round(seconds), round(seconds))

    def _look(self) -> None:
        """Listen to what was not there before."""
        self.graph = look_at_master()
        self.choices = choose(self.graph.topics, self.graph.publishers, self._asked)
        for role, choice in self.choices.items():
            present = self.heard.get(role)
            # What ended meanwhile was heard all the same.
            if choice.topic and (present is None or present.topic != choice.topic):
                self.heard[role] = Heard(choice.topic, self.graph.topics[choice.topic].type)
                self._subscribe(role, choice.topic)

    def _subscribe(self, role: str, topic: str) -> None:
        if role in self._subscribers:
            self._subscribers[role].unregister()
        self._subscribers[role] = rospy.Subscriber(
            topic,
            rospy.AnyMsg,
            self._arrived,
            callback_args=(role, topic),
            buff_size=BUFFER_BYTES,
            tcp_nodelay=True,
        )

    def _arrived(self, message: Any, place: tuple[str, str]) -> None:
        """In a thread of rospy: note when it came, and leave the rest to the main thread."""
        role, topic = place
        about, now_ns = message._connection_header, rospy.Time.now().to_nsec()
        raw = RawMessage(topic, about["type"], now_ns, message)
        if role not in _TF:
            header = deserialized(message, "std_msgs/Header")
            self.heard[role].series.add(replace(raw, content=SimpleNamespace(header=header)))
        sender = None if role in _TF else about["callerid"]
        self._inbox.put(Arrival(role, raw, time.monotonic()), sender)

    def _work_off(self, arrival: Arrival) -> None:
        """Read a message, of images and clouds only those until a first cloud came of them."""
        role, raw = arrival.topic, arrival.message
        if raw.type in _LARGE and self._trial.first is not None:
            return
        value = self._value(role, raw)
        if value is not None:
            self._trial.take(role, value, raw.time_ns)

    def _value(self, role: str, raw: RawMessage) -> Message | None:
        """What a message says, with the stamp that counts; None if the nodes would refuse it."""
        try:
            whole = replace(raw, content=deserialized(raw.content, raw.type))
            if role in _TF:
                return whole.value()
        except DataError:
            return None
        value = self.heard[role].read(whole)
        if value is None or isinstance(value, FrameTransforms):
            return None
        if self._by_arrival:
            return replace(value, stamp_ns=raw.time_ns)
        return value if value.stamp_ns or isinstance(value, CameraInfo) else None
