# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How much memory an index takes, and how work on it is interrupted."""

import itertools
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from arrays import filled
from fusionslam import DescriptorIndex, nearest
from rows import rows

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
def test_an_index_takes_little_more_memory_than_its_size(tmp_path: Path) -> None:
    for path in ("", "saved.index"):  # rows are a little fewer than a power of two
        command = [sys.executable, "-c", MEMORY_PROGRAM, path, "130000", "192"]
        run = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=True)
        assert 1 <= float(run.stdout) <= 1.05


class Stop(Exception):
    """Raised by a signal handler."""


@contextmanager
def signals_within_calls(handler: Callable[[], None]) -> Iterator[None]:
    """Call a handler again and again, but only within calls into the core.

    The signals are sent by another thread. It needs the GIL, which this one releases only there.
    """
    go, ended, busy = threading.Event(), threading.Event(), threading.Lock()

    def handle(*_: object) -> None:
        if busy.acquire(blocking=False):  # else it is a call of the handler that was interrupted
            try:
                handler()
            finally:
                busy.release()

    def send() -> None:
        go.wait()
        while not ended.is_set():
            signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGALRM)
            ended.wait(0.001)

    before, interval = signal.signal(signal.SIGALRM, handle), sys.getswitchinterval()
    thread = threading.Thread(target=send)
    thread.start()
    sys.setswitchinterval(1000)
    try:
        go.set()
        yield
    finally:
        ended.set()
        sys.setswitchinterval(interval)
        thread.join()
        signal.signal(signal.SIGALRM, before)


def stop_once() -> Callable[[], None]:
    """A handler that raises ``Stop`` when it is called first."""
    calls = itertools.count()

    def stop() -> None:
        if next(calls) == 0:
            raise Stop

    return stop


ATTEMPTS = 100_000
"""More than enough, though a busy machine may let the other thread wait for long."""


def full_index(count: int) -> DescriptorIndex:
    index, row = DescriptorIndex(1000), np.ones(1000, np.float32)
    for _ in range(count):
        index.add(row)
    return index


@rows("threads", [1, 2])
def test_a_long_batch_can_be_interrupted(threads: int) -> None:
    table = np.random.default_rng(8).normal(size=(20_000, 128)).astype(np.float32)
    with pytest.raises(Stop), signals_within_calls(stop_once()):
        for _ in range(ATTEMPTS):
            nearest(table, table, threads=threads)


def test_a_signal_handler_may_read_the_index_but_not_change_it(tmp_path: Path) -> None:
    index, row = full_index(5000), np.ones(1000, np.float32)
    refused = []

    def use() -> None:
        assert index.query(row)[0].tolist() == [0]
        try:
            index.add(row)  # between the calls
        except RuntimeError as error:
            refused.append(error)

    with signals_within_calls(use):
        for _ in range(ATTEMPTS):
            index.save(tmp_path / "places.index")
            if refused:
                break
    assert refused
    assert len(DescriptorIndex.load(tmp_path / "places.index")) >= 5000


def test_an_interrupted_save_leaves_the_old_file_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "places.index"
    filled().save(path)
    stored = [path.read_bytes()]
    index = full_index(20_000)
    saves = itertools.count()
    with pytest.raises(Stop), signals_within_calls(stop_once()):
        while next(saves) < ATTEMPTS:
            index.save(path)
    if next(saves) > 1:
        index.save(tmp_path / "whole.index")
        stored = [(tmp_path / "whole.index").read_bytes()]
        (tmp_path / "whole.index").unlink()
    assert path.read_bytes() == stored[0]
    assert os.listdir(tmp_path) == ["places.index"]
