# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Measure a node's latency: the latest durations and their quantiles."""

import time
from collections import deque

import numpy as np

_KEPT = 1000


class Stopwatch:
    """Latencies of messages that led to a publication, from arrival until processed."""

    def __init__(self) -> None:
        self._seconds: deque[float] = deque(maxlen=_KEPT)
        self._has_published = False

    def start(self) -> None:
        """Begin to process a message."""
        self._has_published = False

    def published(self) -> None:
        """Note that something was published."""
        self._has_published = True

    def stop(self, arrived_s: float) -> None:
        """Finish a message that arrived at ``arrived_s`` (monotonic clock)."""
        if self._has_published:
            self._seconds.append(time.monotonic() - arrived_s)

    def quantile_ms(self, share: float) -> float | None:
        """Return a quantile of the last 1,000 durations in milliseconds; None if there are none."""
        return 1e3 * float(np.quantile(self._seconds, share)) if self._seconds else None
