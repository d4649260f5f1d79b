# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""One ``ViewMatcher`` in several threads: no id is given twice and the bound holds."""

import io
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from fusionslam.config import merged
from fusionslam.views.match import ViewMatch
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.recognisers import ViewMatcherConfig
from scenes import MeanColor, place, two_stages

THREADS, BOUND = 3, 4
METHODS: list[dict[str, Any]] = [
    {"method": "alignment"},
    {"method": "objects"},
    {"method": "cm2dp", "max_distance": 0.24},
    {"method": "objects", "policy": "several", "store_below": 1.0, "threshold": 0.2},
]


@pytest.fixture
def eager_switches() -> Iterator[None]:
    """Let threads take turns as often as possible."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


def in_threads(work: Callable[[int], list[ViewMatch]]) -> list[ViewMatch]:
    """What the same work gives in several threads that begin together."""
    barrier, found, failed = threading.Barrier(THREADS), [], []

    def begin(number: int) -> None:
        barrier.wait()
        try:
            found.append(work(number))
        except BaseException as error:
            failed.append(error)

    threads = [threading.Thread(target=begin, args=(number,)) for number in range(THREADS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if failed:
        raise failed[0]
    return [match for matches in found for match in matches]


def check(one: ViewMatcher, matches: list[ViewMatch]) -> None:
    new = sorted(match.id for match in matches if match.is_new)
    assert new == list(range(one.stats.new))
    assert one.stats.processed == len(matches)
    assert one.stats.matched + one.stats.new == len(matches)
    assert len(one) == len(one.comparison) == one.stats.stored <= BOUND


@pytest.mark.usefixtures("eager_switches")
@pytest.mark.parametrize("values", METHODS, ids=["alignment", "objects", "cm2dp", "several"])
def test_a_matcher_that_forgets_serves_several_threads(values: dict[str, Any]) -> None:
    one = ViewMatcher(merged(ViewMatcherConfig(), {**values, "max_views": BOUND}))
    views = [one.view(place(number)) for number in range(8)]
    order = [np.random.default_rng(seed).integers(0, len(views), 60) for seed in range(THREADS)]
    matches = in_threads(lambda number: [one.process(views[k]) for k in order[number]])
    check(one, matches)
    assert one.stats.dropped > BOUND
    again = ViewMatcher.load(_saved(one))
    assert again.stats == one.stats and again.process(views[0]) == one.process(views[0])


@pytest.mark.usefixtures("eager_switches")
def test_two_stages_serve_several_threads() -> None:
    one = two_stages(MeanColor())
    one.config = one.config.model_copy(update={"max_views": BOUND})
    clouds = [place(number) for number in range(8)]
    check(one, in_threads(lambda _: [one.process(cloud) for cloud in clouds * 2]))


@pytest.mark.usefixtures("eager_switches")
def test_a_matcher_is_saved_between_two_scans() -> None:
    one = ViewMatcher(ViewMatcherConfig(method="objects", max_views=BOUND))
    views = [one.view(place(number)) for number in range(8)]

    def work(number: int) -> list[ViewMatch]:
        if number:
            return [one.process(views[k % 8]) for k in range(100)]
        for _ in range(20):
            again = ViewMatcher.load(_saved(one))
            assert len(again) == again.stats.stored
            assert again.stats.matched + again.stats.new == again.stats.processed
        return []

    check(one, in_threads(work))


def _saved(one: ViewMatcher) -> io.BytesIO:
    stream = io.BytesIO()
    one.save(stream)
    stream.seek(0)
    return stream
