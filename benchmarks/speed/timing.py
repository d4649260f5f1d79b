# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Timing two programs alternately, and the arithmetic on what comes out."""

import gc
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Call = Callable[[], object]
Timer = Callable[[], float]
"""Does the work once and says how many seconds it took."""


@dataclass(frozen=True)
class Limits:
    """How long to repeat.

    Attributes:
        seconds: no further pair is begun after this time ...
        least: ... unless there are fewer pairs than this.
        most: pairs at most.
    """

    seconds: float
    least: int
    most: int


@dataclass(frozen=True)
class Times:
    """What repetitions of one call took, in seconds."""

    minimum: float
    median: float
    p95: float
    repetitions: int

    @classmethod
    def of(cls, samples: Sequence[float]) -> "Times":
        """Of at least one repetition."""
        return cls(
            float(np.min(samples)),
            float(np.median(samples)),
            float(np.percentile(samples, 95)),
            len(samples),
        )


@dataclass(frozen=True)
class Ratio:
    """How many times longer the peer takes.

    Attributes:
        value: ratio of the medians.
        low, high: 10th and 90th percentile of the ratios of the single pairs.
    """

    value: float
    low: float
    high: float

    @classmethod
    def of(
        cls, ours: Sequence[float], peer: Sequence[float], work: tuple[float, float] = (1, 1)
    ) -> "Ratio":
        """Of paired repetitions; ``work`` is how much of it ours and the peer do in one."""
        scale = work[0] / work[1]
        pairs = np.asarray(peer) / np.asarray(ours) * scale
        low, high = np.percentile(pairs, [10, 90])
        return cls(float(np.median(peer) / np.median(ours) * scale), float(low), float(high))


@dataclass(frozen=True)
class Comparison:
    """The times of ours and, unless there is none, of the peer."""

    ours: Times
    peer: Times | None = None
    ratio: Ratio | None = None


def timer(call: Callable[..., object], *arguments: Any, **options: Any) -> Timer:
    """Times one call with these arguments."""

    def measure() -> float:
        begin = time.perf_counter()
        call(*arguments, **options)
        return time.perf_counter() - begin

    return measure


def fresh_timer(call: Callable[[Any], object], array: NDArray[Any]) -> Timer:
    """Times one call with a copy made just before, as in use, where the input was just computed."""

    def measure() -> float:
        copy = array.copy()
        begin = time.perf_counter()
        call(copy)
        return time.perf_counter() - begin

    return measure


def alternate(ours: Timer, peer: Timer, limits: Limits) -> tuple[list[float], list[float]]:
    """Ours, peer, ours, peer, ... after one pair that does not count."""
    samples: tuple[list[float], list[float]] = ([], [])
    with _quiet_collector():
        ours(), peer()
        end = time.perf_counter() + limits.seconds
        while len(samples[0]) < limits.least or (
            len(samples[0]) < limits.most and time.perf_counter() < end
        ):
            samples[0].append(ours())
            samples[1].append(peer())
    return samples


def compare(
    ours: Timer, peer: Timer | None, limits: Limits, work: tuple[float, float] = (1, 1)
) -> Comparison:
    """Times of both and their ratio; of ours alone where there is no peer."""
    if peer is None:
        samples, _ = alternate(ours, lambda: 0.0, limits)
        return Comparison(Times.of(samples))
    mine, theirs = alternate(ours, peer, limits)
    return Comparison(Times.of(mine), Times.of(theirs), Ratio.of(mine, theirs, work))


def exponent(sizes: Sequence[int], seconds: Sequence[float]) -> float:
    """b of the best fit of cost = a * size ** b, by least squares of the logarithms.

    Only sizes within a factor of 25 of the largest count, so that what every call costs whatever
    its size does not pass for good scaling. NaN for fewer than two of them.
    """
    upper = [(n, s) for n, s in zip(sizes, seconds, strict=True) if 25 * n >= max(sizes)]
    if len(upper) < 2:
        return float("nan")
    x, y = np.log(np.array(upper, np.float64)).T
    return float(np.polyfit(x, y, 1)[0])


@contextmanager
def _quiet_collector() -> Iterator[None]:
    """No garbage collection in the middle of a measurement."""
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
