# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Measure how long the parts of some work take."""

import time
from collections import defaultdict, deque
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

import numpy as np

_MOST = 1000


class Stopwatch:
    """Keeps the latest 1,000 durations of each named part."""

    def __init__(self) -> None:
        self._spent: dict[str, deque[float]] = defaultdict(partial(deque, maxlen=_MOST))

    @contextmanager
    def measure(self, part: str) -> Iterator[None]:
        """Add the time of the block to a part."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.add(part, time.perf_counter() - start)

    def add(self, part: str, seconds: float) -> None:
        """Add a duration to a part."""
        self._spent[part].append(seconds)

    def total(self, part: str) -> float:
        """Return the seconds spent on a part; 0 if it was not measured."""
        return sum(self._spent[part])

    def quantile(self, part: str, share: float) -> float | None:
        """Return a quantile of the durations in seconds; None if there are none."""
        return float(np.quantile(self._spent[part], share)) if self._spent[part] else None
