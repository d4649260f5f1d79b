# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How long a node takes: the latest durations and their quantiles."""

import time
from collections import deque

import numpy as np

_KEPT = 1000


class Stopwatch:
    """How long messages took that something was published of: from arrival until it was done."""

    def __init__(self) -> None:
        self._seconds: deque[float] = deque(maxlen=_KEPT)
        self._has_published = False

    def start(self) -> None:
        """Work on a message begins."""
        self._has_published = False

    def published(self) -> None:
        """Something was published."""
        self._has_published = True

    def stop(self, arrived_s: float) -> None:
        """It is done; what was published came of a message that arrived then (monotonic clock)."""
        if self._has_published:
            self._seconds.append(time.monotonic() - arrived_s)

    def quantile_ms(self, share: float) -> float | None:
        """Milliseconds that this share of the last 1,000 did not exceed; None before the first."""
        return 1e3 * float(np.quantile(self._seconds, share)) if self._seconds else None
