# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a run found as tables of words, for the screen and for the page."""

from collections.abc import Sequence
from dataclasses import dataclass

from benchmarks.speed.cases import Result, Verdict
from benchmarks.speed.curves import OURS, Curve
from benchmarks.speed.memory import MOST_BYTES_A_POINT, MOST_INDEX, Memory
from benchmarks.speed.run import Run
from benchmarks.speed.settings import REASONS
from benchmarks.speed.timing import Times

LINEAR = 1.1
"""Largest exponent that counts as linear."""


@dataclass(frozen=True)
class Table:
    """Words in rows."""

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]


def tables(run: Run) -> list[Table]:
    """All tables of a run that have rows."""
    made = [
        bounds(run),
        _times(run.results),
        _curves(run.curves),
        _memories(run.memories),
    ]
    return [table for table in made if table.rows]


def milliseconds(seconds: float) -> str:
    """Three digits."""
    value = 1e3 * seconds
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def size(count: int) -> str:
    """As 2k or 1M."""
    for unit, word in ((10**6, "M"), (10**3, "k")):
        if count >= unit:
            return f"{count / unit:g}{word}"
    return str(count)


def bounds(run: Run) -> Table:
    """What was to be reached and what was; nothing of a quick run, whose figures mean nothing."""
    rows = [_verdict(result, result.verdict) for result in run.results if result.verdict]
    if not run.quick:
        rows += [_linear(c) for c in run.curves if c.who == OURS and "M2DP" in c.work]
        rows += [_memory_bound(memory) for memory in run.memories if memory.who == OURS]
    return Table("Bounds", ["what", "peer", "bound", "measured", "met"], rows)


def _verdict(result: Result, verdict: Verdict) -> list[str]:
    met = _met(verdict.met, result.reason)
    return [result.what, result.peer, verdict.words, f"{verdict.figure:.3g}", met]


def _linear(curve: Curve) -> list[str]:
    what = f"{curve.work}, exponent of the cost"
    met = _met(curve.exponent <= LINEAR, REASONS.get(what, ""))
    return [what, "", f"<= {LINEAR}", f"{curve.exponent:.2f}", met]


def _memory_bound(memory: Memory) -> list[str]:
    if memory.is_index:
        what = f"index of {size(memory.sizes[-1])} x 192, peak memory by raw size"
        figure, bound = memory.by_raw_size, MOST_INDEX
    else:
        what = f"{memory.work}, further bytes for each further point"
        figure, bound = memory.slope, MOST_BYTES_A_POINT
    met = _met(figure <= bound, REASONS.get(what, ""))
    return [what, "", f"<= {bound:g}", f"{figure:.3g}", met]


def _met(met: bool, reason: str = "") -> str:
    return "met" if met else f"not met: {reason or 'no reason is known yet'}"


def _times(results: Sequence[Result]) -> Table:
    header = ["what", "peer", "pairs", "ours, ms", "peer, ms", "ratio", "same answer"]
    return Table("Times: minimum / median / p95", header, [_row(result) for result in results])


def _row(result: Result) -> list[str]:
    if result.comparison is None:
        return [result.what, result.peer, "", "", "", "", f"WRONG: {result.wrong}"]
    times = result.comparison
    ratio = times.ratio
    return [
        result.what + (f" ({result.detail})" if result.detail else ""),
        result.peer,
        str(times.ours.repetitions),
        _three(times.ours),
        _three(times.peer) if times.peer else "",
        f"{ratio.value:.3g} ({ratio.low:.3g} to {ratio.high:.3g})" if ratio else "",
        result.agreement,
    ]


def _three(times: Times) -> str:
    return " / ".join(milliseconds(value) for value in (times.minimum, times.median, times.p95))


def _curves(curves: Sequence[Curve]) -> Table:
    rows = []
    for curve in curves:
        pairs = zip(curve.sizes, curve.seconds, strict=True)
        cells = ", ".join(f"{size(n)}: {milliseconds(s)}" for n, s in pairs)
        stopped = f"; {curve.stopped}" if curve.stopped else ""
        rows.append([curve.work, curve.who, f"{curve.exponent:.2f}", cells + stopped])
    return Table("Cost by size", ["what", "who", "exponent", "least, ms"], rows)


def _memories(memories: Sequence[Memory]) -> Table:
    rows = []
    for memory in memories:
        pairs = zip(memory.sizes, memory.bytes, strict=True)
        cells = ", ".join(f"{size(n)}: {b / 2**20:.1f}" for n, b in pairs)
        each = f"{memory.slope:.1f} B a point"
        if memory.is_index:
            each = f"{memory.by_raw_size:.3f} x raw size"
        rows.append([memory.work, memory.who, cells, each])
    return Table("Peak memory", ["what", "who", "on top of the input, MiB", "growth"], rows)
