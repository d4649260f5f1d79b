# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Measures the time of the parts of a step, for reports only."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal

Part = Literal["view", "cells", "map"]


class Stopwatch:
    """Adds up the time spent in each part of a step."""

    def __init__(self) -> None:
        self._spent: dict[Part, float] = {"view": 0.0, "cells": 0.0, "map": 0.0}

    @contextmanager
    def of(self, part: Part) -> Iterator[None]:
        """Add the time of the block to a part."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self._spent[part] += time.perf_counter() - start

    @property
    def seconds(self) -> tuple[float, float, float]:
        """Seconds spent on the view, the pose cells and the map."""
        return self._spent["view"], self._spent["cells"], self._spent["map"]
