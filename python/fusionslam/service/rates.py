# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How many requests a client may send."""

import math
import time

from limits import RateLimitItemPerMinute
from limits.storage import MemoryStorage
from limits.strategies import SlidingWindowCounterRateLimiter

from fusionslam.service.problems import RequestError


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
