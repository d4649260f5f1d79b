# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Parallel work with results in order."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

S = TypeVar("S")
T = TypeVar("T")


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    # macOS has no CPU affinity.
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_order(
    pool: ThreadPoolExecutor, work: Callable[[S], T], items: Iterable[S], ahead: int
) -> Iterator[T]:
    """Yield the results of ``work`` in the order of the items, with at most ``ahead`` in flight."""
    rest, begun = iter(items), deque[Future[T]]()
    for item in rest:
        begun.append(pool.submit(work, item))
        if len(begun) == ahead:
            yield begun.popleft().result()
    while begun:
        yield begun.popleft().result()


@contextmanager
def ordered_results(
    work: Callable[[S], T], items: Iterable[S], jobs: int, *, ahead: int | None = None
) -> Iterator[Iterator[T]]:
    """Yield an iterator over the results of ``work`` in the order of the items.

    After an error or an interruption, items that no thread works on yet are dropped.

    Args:
        work: called in threads.
        items: arguments of ``work``.
        jobs: number of threads, at least 1.
        ahead: most items in work or waiting to be taken; None for four per thread, so that no
            thread idles.
    """
    jobs = max(jobs, 1)
    with ThreadPoolExecutor(jobs) as pool:
        try:
            yield in_order(pool, work, items, ahead or 4 * jobs)
        except BaseException:
            pool.shutdown(wait=True, cancel_futures=True)
            raise
