# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The socket that the service listens on, and its life from the start to a signal."""

import signal
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from types import FrameType
from typing import Any

import uvicorn
from fastapi import FastAPI

from fusionslam.errors import ConfigError, listening
from fusionslam.service.config import ServiceConfig
from fusionslam.service.connections import Connection, allow_connections
from fusionslam.service.keys import ApiKeys
from fusionslam.service.state import is_local

_GRACE_S = 10
"""Time to finish what is worked on after a signal."""
_BACKLOG = 512


def check_exposure(config: ServiceConfig, keys: ApiKeys, *, without_keys: bool) -> None:
    """Refuse to be reached from other machines without keys, unless that is wanted.

    Raises:
        ConfigError: code "no-keys".
    """
    if not keys and not without_keys and not is_local(config.host):
        raise ConfigError(
            f"{config.host} can be reached from other machines: expected API keys",
            code="no-keys",
            fields=(config.host,),
        )


def listen(config: ServiceConfig) -> socket.socket:
    """Return a socket that listens.

    Raises:
        ConfigError: the port is in use (code "port-in-use") or not allowed ("no-port"), or there
            is no such host ("no-host").
    """
    host, port = config.host, config.port
    with listening("the service", host, port):
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        return socket.create_server(address[:2], family=family, backlog=_BACKLOG)


def url_of(listener: socket.socket) -> str:
    """Return the address of a listening socket for a browser."""
    host, port = listener.getsockname()[:2]
    return f"http://{f'[{host}]' if ':' in host else host}:{port}"


def serve(app: FastAPI, listener: socket.socket, config: ServiceConfig | None = None) -> None:
    """Answer requests until SIGINT or SIGTERM; what is worked on then is finished.

    Args:
        app: of ``create_app``.
        listener: of ``listen``.
        config: limits of connections; None for the defaults.
    """
    config = config or ServiceConfig()
    allow_connections(config.max_connections)
    http: Any = partial(Connection, config)
    settings = uvicorn.Config(
        app,
        http=http,
        ws="none",
        proxy_headers=config.behind_proxy,
        log_level="error",
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=_GRACE_S,
        lifespan="on",
    )
    with _ending():
        uvicorn.Server(settings).run(sockets=[listener])


@contextmanager
def _ending() -> Iterator[None]:
    """Leave the block at once on a signal: uvicorn sends itself those that it has handled."""
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [(number, signal.signal(number, _leave)) for number in numbers]
    try:
        yield
    except _Ended:
        pass
    finally:
        for number, handler in before:
            signal.signal(number, handler)


class _Ended(BaseException):
    """A signal said to end."""


def _leave(number: int, frame: FrameType | None) -> None:
    raise _Ended
