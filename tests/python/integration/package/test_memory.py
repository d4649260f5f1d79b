# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Memory between blocks in use is given back."""

import os
import platform
from pathlib import Path

import pytest

from fusionslam.base.machine import release_memory


def resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="needs glibc")
def test_memory_between_blocks_in_use_is_given_back() -> None:
    blocks = [bytes([k % 255 + 1]) * 100_000 for k in range(2000)]
    kept = blocks[::20]
    blocks.clear()
    before = resident_mb()
    release_memory()
    assert before - resident_mb() > 100
    assert len(kept) == 100
