# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""One ``ViewMatcher`` in several threads: no id is given twice and the bound holds."""

import io
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from fusionslam.views.match import ViewMatch
from fusionslam.views.matcher import ViewMatcher
from rows import rows
from scenes import MeanColor, matcher, place, two_stages

THREADS, BOUND = 3, 4
METHODS: list[dict[str, Any]] = [
    {"method": "alignment"},
    {"method": "objects"},
    {"method": "cm2dp", "max_distance": 0.24},
    {"method": "objects", "policy": "several", "store_below": 1.0, "threshold": 0.2},
]


@pytest.fixture(autouse=True)
def eager_switches() -> Iterator[None]:
    """Let threads take turns as often as possible."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


def in_threads(work: Callable[[int], list[ViewMatch]]) -> list[ViewMatch]:
    """What the same work gives in several threads that begin together."""
    barrier = threading.Barrier(THREADS)

    def begin(number: int) -> list[ViewMatch]:
        barrier.wait()
        return work(number)

    with ThreadPoolExecutor(THREADS) as pool:
        return [match for matches in pool.map(begin, range(THREADS)) for match in matches]


def check(one: ViewMatcher, matches: list[ViewMatch]) -> None:
    new = sorted(match.id for match in matches if match.is_new)
    assert new == list(range(one.stats.new))
    assert one.stats.processed == len(matches)
    assert one.stats.matched + one.stats.new == len(matches)
    assert len(one) == len(one.comparison) == one.stats.stored <= BOUND


def reload(one: ViewMatcher) -> ViewMatcher:
    stream = io.BytesIO()
    one.save(stream)
    stream.seek(0)
    return ViewMatcher.load(stream)


@rows("values", METHODS)
def test_a_matcher_that_forgets_serves_several_threads(values: dict[str, Any]) -> None:
    one = matcher(**values, max_views=BOUND)
    views = [one.view(place(number)) for number in range(8)]
    order = [np.random.default_rng(seed).integers(0, len(views), 30) for seed in range(THREADS)]
    check(one, in_threads(lambda number: [one.process(views[k]) for k in order[number]]))
    assert one.stats.dropped > BOUND
    again = reload(one)
    assert again.stats == one.stats and again.process(views[0]) == one.process(views[0])


def test_two_stages_serve_several_threads() -> None:
    one = two_stages(MeanColor())
    one.config = one.config.model_copy(update={"max_views": BOUND})
    clouds = [place(number) for number in range(8)]
    check(one, in_threads(lambda _: [one.process(cloud) for cloud in clouds * 2]))


def test_a_matcher_is_saved_between_two_scans() -> None:
    one = matcher(method="objects", max_views=BOUND)
    views = [one.view(place(number)) for number in range(8)]

    def work(number: int) -> list[ViewMatch]:
        if number:
            return [one.process(views[k % 8]) for k in range(60)]
        for _ in range(10):
            again = reload(one)
            assert len(again) == again.stats.stored
            assert again.stats.matched + again.stats.new == again.stats.processed
        return []

    check(one, in_threads(work))
