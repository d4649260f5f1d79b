# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""One flipped bit anywhere in a stored file is refused, or the file loads equal data.

FUSIONSLAM_FLIPS is the number of bits tried in each file; "all" tries every bit of the first 400
bytes, of all headers of members and arrays, and of the central directory, and 3,000 others.
"""

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fusionslam.errors import DataError
from fuzz.bit_flips import FORMATS, flip_bits, flipped, random_bits
from rows import rows

TRIED = os.environ.get("FUSIONSLAM_FLIPS", "4")


def bits(whole: bytes) -> Iterator[int]:
    """Positions of the bits to flip."""
    if TRIED != "all":
        yield from random_bits(int(TRIED))(whole)
        return
    rng = np.random.default_rng(3)
    count = 8 * len(whole)
    spans = [(0, 400)] + [
        (match.start(), match.start() + 200)
        for match in re.finditer(rb"PK\x01\x02|PK\x03\x04|PK\x05\x06|\x93NUMPY", whole)
    ]
    chosen = {bit for begin, end in spans for bit in range(8 * begin, min(8 * end, count))}
    yield from sorted(chosen | set(rng.integers(0, count, 3000).tolist()))


@rows("name", FORMATS)
def test_a_flipped_bit_is_refused_or_changes_nothing(name: str, tmp_path: Path) -> None:
    found = flip_bits(FORMATS[name], tmp_path, bits)
    print(f"{name}: {found.tried} bits flipped, {found.refused} refused")
    assert not found.silent
    assert found.refused > found.tried / 4


def test_a_flipped_bit_of_a_checkpoint_is_refused_or_changes_nothing(tmp_path: Path) -> None:
    torch = pytest.importorskip("torch")
    from fusionslam.learning.training_loop import OptimiserConfig, _Run

    class Little:
        network = torch.nn.Linear(3, 2)

    def run() -> Any:
        return _Run(Little(), OptimiserConfig(), "{}")

    path, again, first = tmp_path / "checkpoint.pt", tmp_path / "again", run()
    first.task.network(torch.ones(1, 3)).sum().backward()
    first.optimiser.step()
    first.save(path, [{"epoch": 1.0}], [0.5])
    whole = path.read_bytes()
    for bit in bits(whole):
        path.write_bytes(flipped(whole, bit))
        other = run()
        try:
            loaded = other.resume(path)
        except DataError:
            continue
        other.save(again, *loaded)
        assert again.read_bytes() == whole
