# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A viewer of Foxglove's protocol, which reads messages by the schemas that the server sends."""

import base64
import json
import struct
import time
from contextlib import ExitStack
from typing import Any, Self

import numpy as np
import pytest

PROTOCOL = "foxglove.sdk.v1"
_MESSAGE = 1
_HANGS_S = 300.0


class Viewer:
    """A connection to a server: its name, its channels, and the messages of those subscribed to."""

    def __init__(self, url: str) -> None:
        client = pytest.importorskip("websockets.sync.client", reason="websockets is not installed")
        self._open = ExitStack()
        self.line = self._open.enter_context(
            client.connect(url, subprotocols=[PROTOCOL], max_size=None)
        )
        self.name = json.loads(self.line.recv(timeout=_HANGS_S))["name"]
        found = json.loads(self.line.recv(timeout=_HANGS_S))
        assert found["op"] == "advertise"
        self.channels = {each["topic"]: each for each in found["channels"]}
        self._shown = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._open.close()

    def subscribe(self, *topics: str) -> None:
        """Ask for topics; the number of a subscription is that of its channel."""
        numbers = [self.channels[topic]["id"] for topic in topics]
        wanted = [{"id": number, "channelId": number} for number in numbers]
        self.line.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

    def follow(self, server: Any, *topics: str) -> None:
        """Ask a server of this process for topics, and wait until it gave their last messages.

        It gives them once more to all viewers, so it must not do so between later ones, of which
        ``receive_shown`` then knows how many there are.
        """
        told, give, show = set[str](), server.on_subscribe, server.show

        def count(topic: str, stamp_ns: int, message: Any) -> None:
            self._shown += topic in topics
            show(topic, stamp_ns, message)

        def tell(client: Any, channel: Any) -> None:
            give(client, channel)
            told.add(channel.topic)

        server.on_subscribe = tell
        self.subscribe(*topics)
        while not (told.issuperset(topics) and all(map(server.is_wanted, topics))):
            time.sleep(0.001)
        server.on_subscribe, server.show = give, count

    def receive(self) -> tuple[str, int, Any]:
        """Topic, time and content of the next message."""
        while True:
            data = self.line.recv(timeout=_HANGS_S)
            if isinstance(data, bytes) and data[0] == _MESSAGE:
                number, time_ns = struct.unpack_from("<IQ", data, 1)
                (topic,) = (t for t, each in self.channels.items() if each["id"] == number)
                return topic, time_ns, self._read(topic, data[13:])

    def receive_shown(self) -> dict[str, list[Any]]:
        """By topic: all messages that the server showed since ``follow``; it must be open still."""
        found: dict[str, list[Any]] = {}
        for _ in range(self._shown):
            topic, _, message = self.receive()
            found.setdefault(topic, []).append(message)
        return found

    def receive_rest(self) -> dict[str, list[Any]]:
        """All messages by topic until the server closes the connection."""
        closed = pytest.importorskip("websockets.exceptions").ConnectionClosed
        found: dict[str, list[Any]] = {}
        try:
            while True:
                topic, _, message = self.receive()
                found.setdefault(topic, []).append(message)
        except closed:
            return found

    def _read(self, topic: str, data: bytes) -> Any:
        if self.channels[topic]["encoding"] == "json":
            return json.loads(data)
        descriptors = pytest.importorskip("google.protobuf.descriptor_pb2")
        factory = pytest.importorskip("google.protobuf.message_factory")
        schema = base64.b64decode(self.channels[topic]["schema"])
        kinds = factory.GetMessages(descriptors.FileDescriptorSet.FromString(schema).file)
        return kinds[self.channels[topic]["schemaName"]].FromString(data)


def cloud_of(message: Any) -> tuple[np.ndarray, np.ndarray]:
    """Points and colours of a PointCloud, by its own description of its fields."""
    kinds = {7: "f4", 1: "u1"}
    fields = {each.name: (kinds[each.type], each.offset) for each in message.fields}
    layout = np.dtype(
        {
            "names": list(fields),
            "formats": [kind for kind, _ in fields.values()],
            "offsets": [offset for _, offset in fields.values()],
            "itemsize": message.point_stride,
        }
    )
    rows = np.frombuffer(message.data, layout)
    points = np.stack([rows[name] for name in "xyz"], axis=1)
    return points, np.stack([rows[name] for name in ("red", "green", "blue")], axis=1)
