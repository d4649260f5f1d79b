# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Work on several items at a time, results in their order."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")


def in_order(
    pool: ThreadPoolExecutor, work: Callable[[int], T], items: Iterable[int], ahead: int
) -> Iterator[T]:
    """The results of work on each item, in order, of which at most ``ahead`` are begun."""
    rest, begun = iter(items), deque[Future[T]]()
    for item in rest:
        begun.append(pool.submit(work, item))
        if len(begun) == ahead:
            yield begun.popleft().result()
    while begun:
        yield begun.popleft().result()
