# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A client of HTTP/1.1 that costs little, as it shares the machine with the server it measures."""

import asyncio
from contextlib import suppress
from typing import Self

_CLOSED = 0
"""Status of a request whose connection was closed without an answer."""


class Connection:
    """A connection that is opened again when the server has closed it.

    Args:
        host, port: of the server.
    """

    def __init__(self, host: str, port: int) -> None:
        self._address = host, port
        self._reader: asyncio.StreamReader | None = None
        self._writer: asyncio.StreamWriter | None = None

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        self._close()

    async def send(self, request: bytes, *, is_whole: bool = True) -> tuple[int, bytes]:
        """Send a request and return status and body of its answer.

        Args:
            request: head and body.
            is_whole: whether all of the body is sent; else the connection cannot be used again.
        """
        for _ in range(2):  # a connection that idled may be closed
            fresh = self._writer is None
            try:
                return await self._exchange(request, is_whole)
            except (ConnectionError, asyncio.IncompleteReadError):
                self._close()
                if fresh:
                    break
        return _CLOSED, b""

    async def _exchange(self, request: bytes, is_whole: bool) -> tuple[int, bytes]:
        if self._writer is None:
            self._reader, self._writer = await asyncio.open_connection(*self._address)
        assert self._reader is not None
        self._writer.write(request)
        with suppress(ConnectionError):  # the answer may be there already
            await self._writer.drain()
        head = (await self._reader.readuntil(b"\r\n\r\n")).lower()
        fields = dict(line.split(b": ", 1) for line in head.split(b"\r\n")[1:-2])
        length = int(fields.get(b"content-length", b"-1"))
        body = await (self._reader.readexactly(length) if length >= 0 else self._reader.read())
        if not is_whole or fields.get(b"connection") == b"close":
            self._close()
        return int(head.split(b" ", 2)[1]), body

    def _close(self) -> None:
        if self._writer is not None:
            self._writer.close()
        self._reader = self._writer = None


def request_of(
    method: str,
    path: str,
    body: bytes = b"",
    *,
    key: str | None = None,
    stated: int | None = None,
    kind: str = "application/octet-stream",
) -> bytes:
    """Return a request as it is sent.

    Args:
        method, path, body: of it.
        key: API key.
        stated: length that the head states; None for the body's own.
        kind: content type of the body.
    """
    lines = [f"{method} {path} HTTP/1.1", "Host: 127.0.0.1", f"Content-Type: {kind}"]
    lines += [f"Content-Length: {len(body) if stated is None else stated}"]
    lines += [f"Authorization: Bearer {key}"] if key else []
    return "\r\n".join([*lines, "", ""]).encode() + body


def chunked_of(path: str, part: bytes, count: int, key: str) -> bytes:
    """Return a POST whose length is not stated: so many times a part."""
    head = f"POST {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nAuthorization: Bearer {key}\r\n"
    chunk = b"%x\r\n%b\r\n" % (len(part), part)
    return head.encode() + b"Transfer-Encoding: chunked\r\n\r\n" + chunk * count + b"0\r\n\r\n"
