# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What all routes of one application share, who may use them, and how often."""

import ipaddress
import math
import re
import time
from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends, Request
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer
from limits import RateLimitItemPerMinute
from limits.storage import MemoryStorage
from limits.strategies import SlidingWindowCounterRateLimiter

from fusionslam.service.batches import QueryBatches
from fusionslam.service.config import ServiceConfig
from fusionslam.service.keys import ApiKeys
from fusionslam.service.metrics import Metrics
from fusionslam.service.places import PlaceCount, ServedPlaces
from fusionslam.service.problems import RequestError
from fusionslam.service.workers import Room, Workers


class Rates:
    """Counts the requests of each client in the last minute.

    Args:
        most: requests a minute; 0 is no limit.
    """

    def __init__(self, most: int) -> None:
        self._limit = RateLimitItemPerMinute(most) if most else None
        # Two counters a client, whatever it sends; they go with their minute.
        self._counters = SlidingWindowCounterRateLimiter(MemoryStorage())

    def count(self, client: str) -> None:
        """Count a request.

        Raises:
            RequestError: 429, too many; the header says when to try again.
        """
        if self._limit is None or self._counters.hit(self._limit, client):
            return
        reset = self._counters.get_window_stats(self._limit, client).reset_time
        seconds = max(1, math.ceil(reset - time.time()))
        raise RequestError(
            429,
            f"more than {self._limit.amount} requests a minute; try again in {seconds} s",
            code="too-many-requests",
            fields=(str(self._limit.amount),),
            headers={"Retry-After": str(seconds)},
        )


@dataclass(frozen=True)
class State:
    """What the routes of one application share.

    Attributes:
        workers: search, and read what is small.
        describers: describe clouds and prove where they are, which takes far longer: searches and
            other clients go before them.
        waiting: room of requests that are worked on or wait for it, their bodies received.
        bodies: room of requests with a body, until they are answered.
    """

    config: ServiceConfig
    places: ServedPlaces
    keys: ApiKeys
    rates: Rates
    workers: Workers
    describers: Workers
    waiting: Room
    bodies: Room
    batches: QueryBatches
    metrics: Metrics
    count: PlaceCount


async def state_of(request: Request) -> State:
    """Return what the routes of the application share."""
    state: State = request.app.state.shared
    return state


Shared = Annotated[State, Depends(state_of)]
_HOST = re.compile(r"(?P<name>\[[0-9a-fA-F:.]+\]|[0-9a-zA-Z.-]+)(:[0-9]{1,5})?", re.ASCII)
_BEARER = HTTPBearer(auto_error=False, description="An API key, if the service has keys.")


async def admit(
    request: Request,
    state: Shared,
    given: Annotated[HTTPAuthorizationCredentials | None, Depends(_BEARER)],
) -> str:
    """Let a request in, before its body is read; return who the client is: key or address.

    Raises:
        RequestError: 401, no or a wrong key; 429, too many requests; 421, a service without keys
            is addressed by the name of another machine.
    """
    address = request.client.host if request.client else ""
    if not state.keys:
        _check_name(request, state.config)
        state.rates.count(address)
        return address
    name = state.keys.find(given.credentials) if given else None
    # Those who guess are counted by address, so that they do not use up anybody's requests.
    state.rates.count(f"refused {address}" if name is None else name)
    if name is None:
        raise RequestError(
            401,
            "expected Authorization: Bearer and an API key" if given is None else "a wrong API key",
            code="no-key" if given is None else "wrong-key",
            headers={"WWW-Authenticate": "Bearer"},
        )
    return name


def _check_name(request: Request, config: ServiceConfig) -> None:
    """Refuse what a web page of elsewhere sends to this machine under its own name."""
    given = request.headers.get("host", "")
    found = _HOST.fullmatch(given)  # Starlette takes the server's own name for one it cannot read
    is_known = found is not None and is_local(found["name"].strip("[]"))
    if is_local(config.host) and not is_known:
        message = f"this service answers as localhost, not as {given!r}, unless it has API keys"
        raise RequestError(421, message, code="wrong-host", fields=(given,))


async def check_framing(request: Request) -> None:
    """Refuse a body of two lengths: a proxy may have read it by the other one.

    Raises:
        RequestError: 400.
    """
    both = {"content-length", "transfer-encoding"}
    if both <= {*request.headers.keys()}:
        raise RequestError(
            400,
            "expected Content-Length or Transfer-Encoding, not both",
            code="two-lengths",
            fields=tuple(sorted(both)),
            headers={"Connection": "close"},
        )


def is_local(host: str) -> bool:
    """Whether a name or an address is of this machine and cannot be reached from others."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


ADMITTED = Depends(admit)
Client = Annotated[str, ADMITTED]
