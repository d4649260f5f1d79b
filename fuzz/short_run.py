# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A short run of a target in this process, without Atheris: for the tests."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fuzz import PROJECT
from fuzz.target import Target

# Inputs that were findings once, a folder a target; each must stay an acceptable answer.
FORMER_FINDINGS = PROJECT / "tests" / "data" / "fuzz"


def short_run(target: Target, inputs: int, seed: int = 0) -> int:
    """Process former findings, seeds and damaged seeds; returns how many inputs were tried.

    Raises:
        Exception: a finding.
    """
    tried = 0
    for data in _inputs(target, inputs, seed):
        tried += target.process(data) is not None
    return tried


def former_findings(target: str) -> list[Path]:
    """Files of earlier findings of a target."""
    return sorted((FORMER_FINDINGS / target.replace("/", "-")).glob("*"))


def _inputs(target: Target, count: int, seed: int) -> Iterator[bytes]:
    yield from (path.read_bytes() for path in former_findings(target.name))
    seeds = target.seeds()
    yield from seeds[:count]
    rng = np.random.default_rng(seed)
    for number in range(count - len(seeds)):
        yield _damage(seeds[number % len(seeds)], rng)


def _damage(data: bytes, rng: np.random.Generator) -> bytes:
    """Flip bits, overwrite bytes, cut out or repeat a piece, or cut the end off."""
    damaged = bytearray(data)
    for _ in range(rng.integers(1, 4)):
        if not damaged:
            break
        start = int(rng.integers(len(damaged)))
        piece = slice(start, start + int(rng.integers(1, 9)))
        match rng.integers(5):
            case 0:
                damaged[start] ^= 1 << int(rng.integers(8))
            case 1:
                damaged[piece] = rng.bytes(len(damaged[piece]))
            case 2:
                del damaged[piece]
            case 3:
                damaged[start:start] = damaged[piece]
            case _:
                del damaged[start:]
    return bytes(damaged)
