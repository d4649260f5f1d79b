# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Progress callbacks: their types, and how they are called."""

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

T = TypeVar("T")

Progress = Callable[[int, int], None]
"""Called with the number of items done and the total."""

Step = Callable[[str, int, int], None]
"""Called with the name of a step, the number of items done and the total."""


def label_progress(step: Step | None, label: str) -> Progress:
    """Return a callback that reports to ``step`` under a name; without ``step`` it does nothing."""
    return (lambda done, total: None) if step is None else lambda *count: step(label, *count)


def reported(items: Iterable[T], progress: Progress | None, total: int) -> Iterator[T]:
    """Yield the items, and report each of ``total`` once whoever takes them is done with it."""
    for done, item in enumerate(items, start=1):
        yield item
        if progress is not None:
            progress(done, total)
