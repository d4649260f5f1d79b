# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``FoxgloveServer``: shows clouds, images, maps and numbers in Foxglove, over a WebSocket.

with FoxgloveServer({"cloud": "PointCloud", "views": ("id", "node")}) as server:
    server.show("cloud", scan.stamp_ns, cloud_message(scan))
    server.show("views", scan.stamp_ns, {"id": 3, "node": 7})
"""

import ipaddress
import logging
import socket
import time
from collections.abc import Mapping
from typing import Any, Self

from fusionslam.errors import ConfigError, listening
from fusionslam.report.live import HOST, PORT
from fusionslam.report.live.foxglove_sdk import channels, foxglove

logger = logging.getLogger(__name__)

Schema = str | tuple[str, ...]
"""Of a topic: a name, such as "PointCloud", or the names of numbers for a plot."""

_LAST_PORT = 65535
_ANNOUNCE_S = 0.02
"""Shortest time between two announcements of the time."""
_LAST_S = 0.3
"""For the last messages to leave: the SDK drops what waits when it stops, and tells of none."""
_WAITING = 100
"""Messages that wait for a slow viewer, which misses the oldest: clouds have a megabyte each."""


class FoxgloveServer:
    """Publishes messages to the viewers that connect; each gets the last one of a topic at once.

    Args:
        topics: schemas by name.
        host: name or address to listen on; others than this machine's own can be reached, and read,
            from outside.
        port: to listen on; 0 for any that is free.
        name: shown in the viewer.

    Attributes:
        port: that it listens on.
        url: for the viewer.

    Raises:
        ConfigError: the port is in use ("port-in-use"), or cannot be had; no such host ("no-host").
    """

    def __init__(
        self,
        topics: Mapping[str, Schema],
        host: str = HOST,
        port: int = PORT,
        name: str = "fusionslam",
    ) -> None:
        # Kept: channels are not offered any more once it is gone.
        self._context = foxglove.Context()
        self._channels = {
            topic: _make_channel(topic, kind, self._context) for topic, kind in topics.items()
        }
        self._last: dict[str, tuple[int, Any]] = {}
        self._announced = 0.0
        self._server = _start(
            host,
            port,
            name=name,
            context=self._context,
            server_listener=self,
            capabilities=[foxglove.Capability.Time],
            message_backlog_size=_WAITING,
        )
        self.port = self._server.port
        self.url = f"ws://{f'[{host}]' if ':' in host else host}:{self.port}"
        addresses = {str(info[4][0]).split("%")[0] for info in socket.getaddrinfo(host, None)}
        if not all(ipaddress.ip_address(each).is_loopback for each in addresses):
            logger.warning(
                "the live view listens on %s: anyone who reaches port %d of this machine can read "
                "all that it shows; %s keeps it on this machine",
                host,
                self.port,
                HOST,
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def is_wanted(self, topic: str) -> bool:
        """Tell whether a viewer shows a topic."""
        return bool(self._channels[topic].has_sinks())

    def show(self, topic: str, stamp_ns: int, message: Any) -> None:
        """Publish a message of the topic's schema, or numbers by name."""
        stamp_ns = max(stamp_ns, 0)
        self._last[topic] = stamp_ns, message
        # Viewers show the time of the stamps, not that of the wall clock. The SDK disconnects those
        # that it has to tell more than they can take.
        now = time.monotonic()
        if now - self._announced >= _ANNOUNCE_S:
            self._announced = now
            self._server.broadcast_time(stamp_ns)
        self._channels[topic].log(message, log_time=stamp_ns)

    def close(self) -> None:
        """Disconnect the viewers and free the port. May be called twice."""
        if any(map(self.is_wanted, self._channels)):
            time.sleep(_LAST_S)
        self._server.stop()

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """Send the last message again when a viewer begins to show a topic; called by the SDK.

        To all viewers: the SDK does not tell which of its sinks a client is.
        """
        if channel.topic in self._last:
            stamp_ns, message = self._last[channel.topic]
            self._channels[channel.topic].log(message, log_time=stamp_ns)

    def on_unsubscribe(self, client: Any, channel: Any) -> None:
        """Do nothing; called by the SDK."""


def _make_channel(topic: str, kind: Schema, context: Any) -> Any:
    if isinstance(kind, str):
        return getattr(channels, f"{kind}Channel")(topic, context=context)
    numbers = {name: {"type": "number"} for name in kind}
    schema = {"type": "object", "title": topic.replace("/", "_"), "properties": numbers}
    return foxglove.Channel(topic, schema=schema, context=context)


def _start(host: str, port: int, **more: Any) -> Any:
    fields = (host, str(port))
    if not 0 <= port <= _LAST_PORT:
        raise ConfigError(
            f"port is {port}, expected 0 to {_LAST_PORT}", code="no-port", fields=fields
        )
    try:
        return foxglove.start_server(host=host, port=port, **more)
    except RuntimeError as error:  # the SDK has words only
        with listening("the live view", host, port):
            for family, _, _, _, address in socket.getaddrinfo(host, port, type=socket.SOCK_STREAM):
                socket.create_server(address[:2], family=family).close()
        problem = f"the live view cannot listen on port {port} of {host!r}: {error}"
        raise ConfigError(problem, code="no-server", fields=fields) from error
