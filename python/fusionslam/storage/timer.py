# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What the parts of a step take; nothing but reports depends on it."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal

Part = Literal["view", "cells", "map"]


class Stopwatch:
    """Adds up the time that each part of a step takes."""

    def __init__(self) -> None:
        self._spent: dict[Part, float] = {"view": 0.0, "cells": 0.0, "map": 0.0}

    @contextmanager
    def of(self, part: Part) -> Iterator[None]:
        """Counts what happens inside for a part."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self._spent[part] += time.perf_counter() - start

    @property
    def seconds(self) -> tuple[float, float, float]:
        """What looking, the cells and the map took."""
        return self._spent["view"], self._spent["cells"], self._spent["map"]
