# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Parallel work with results in order."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")


def in_order(
    pool: ThreadPoolExecutor, work: Callable[[int], T], items: Iterable[int], ahead: int
) -> Iterator[T]:
    """Yield the results of ``work`` in the order of the items, with at most ``ahead`` in flight."""
    rest, begun = iter(items), deque[Future[T]]()
    for item in rest:
        begun.append(pool.submit(work, item))
        if len(begun) == ahead:
            yield begun.popleft().result()
    while begun:
        yield begun.popleft().result()
