# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How much memory an index takes, and how work on it is interrupted."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from arrays import filled
from fusionslam import DescriptorIndex, nearest

MEMORY_PROGRAM = """
import sys
import numpy as np
import fusionslam

def kibibytes(name):
    with open("/proc/self/status") as lines:
        return next(int(line.split()[1]) for line in lines if line.startswith(name))

path, rows, columns = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
row = np.ones(columns, np.float32)
fusionslam.DescriptorIndex(columns).query(row)  # loads what is loaded once
before = kibibytes("VmRSS")
if path:
    index = fusionslam.DescriptorIndex.load(path)
else:
    index = fusionslam.DescriptorIndex(columns)
    for _ in range(rows):
        index.add(row)
    index.save("saved.index")
assert len(index) == rows
print((kibibytes("VmHWM") - before) * 1024 / (4 * rows * columns))
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="tells no peak of memory")
def test_filling_saving_and_loading_an_index_takes_little_more_than_its_size(
    tmp_path: Path,
) -> None:
    for path in ("", "saved.index"):
        run = subprocess.run(
            [sys.executable, "-c", MEMORY_PROGRAM, path, "260000", "192"],
            capture_output=True,
            text=True,
            cwd=tmp_path,
            check=True,
        )
        assert 1 <= float(run.stdout) <= 1.05


class Stop(Exception):
    """Raised by a signal handler."""


@pytest.fixture
def alarms() -> Iterator[Callable[[Callable[[], None]], None]]:
    """Calls what it is given again and again, 10 ms after the last call."""
    before = signal.getsignal(signal.SIGALRM)

    def start(handler: Callable[[], None]) -> None:
        def ring(*_: object) -> None:
            handler()
            # Not on its own: a busy machine would call within the call.
            signal.setitimer(signal.ITIMER_REAL, 0.01)

        signal.signal(signal.SIGALRM, ring)
        signal.setitimer(signal.ITIMER_REAL, 0.01)

    yield start
    signal.setitimer(signal.ITIMER_REAL, 0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("threads", [1, 2])
def test_a_long_batch_can_be_interrupted(
    alarms: Callable[[Callable[[], None]], None], threads: int
) -> None:
    table = np.random.default_rng(8).normal(size=(40_000, 128)).astype(np.float32)
    calls: list[None] = []

    def third_time() -> None:  # once would also be possible after the call
        calls.append(None)
        if len(calls) == 3:
            raise Stop

    alarms(third_time)
    with pytest.raises(Stop):
        nearest(table, table, threads=threads)


def test_a_signal_handler_may_read_the_index_that_is_in_use_but_not_change_it(
    alarms: Callable[[Callable[[], None]], None], tmp_path: Path
) -> None:
    index = DescriptorIndex(1000)
    row = np.ones(1000, np.float32)
    for _ in range(5000):
        index.add(row)
    refused = []

    def use() -> None:
        assert index.query(row)[0].tolist() == [0]
        try:
            index.add(row)  # between the calls
        except RuntimeError as error:
            refused.append(str(error))

    alarms(use)
    for _ in range(100):
        index.save(tmp_path / "places.index")
        if refused:
            break
    signal.setitimer(signal.ITIMER_REAL, 0)
    assert refused and "signal handler" in refused[0]
    assert len(DescriptorIndex.load(tmp_path / "places.index")) >= 5000


def test_an_interrupted_save_leaves_the_old_file_as_it_was(
    alarms: Callable[[Callable[[], None]], None], tmp_path: Path
) -> None:
    path = tmp_path / "places.index"
    filled().save(path)
    before = path.read_bytes()
    index = DescriptorIndex(1000)
    for _ in range(20_000):
        index.add(np.ones(1000, np.float32))
    calls: list[None] = []

    def second_time() -> None:
        calls.append(None)
        if len(calls) == 2:
            raise Stop

    alarms(second_time)
    with pytest.raises(Stop):
        index.save(path)
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["places.index"]
