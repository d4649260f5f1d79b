# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Stored indexes: whole, cut, changed, in the wrong place, and how work on them is interrupted."""

import fcntl
import itertools
import os
import re
import signal
import stat
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from arrays import SECOND, filled
from fusionslam import DataError, DescriptorIndex, nearest
from refusals import refuses
from rows import rows

VERSION_OFFSET = 8
"""Where the version stands in the file: after eight bytes of magic."""


def test_a_saved_index_continues_where_it_was(stored: Path) -> None:
    index, loaded = filled(), DescriptorIndex.load(str(stored))
    assert (len(loaded), loaded.dimension) == (20, 7)
    assert (loaded.window, loaded.window_seconds) == (2, 1.5)
    rng = np.random.default_rng(4)
    for number in range(20, 30):
        row, stamp_ns = rng.normal(size=7).astype(np.float32), number * SECOND
        found = [one.query(row, k=5, stamp_ns=stamp_ns) for one in (index, loaded)]
        assert [part.tobytes() for part in found[0]] == [part.tobytes() for part in found[1]]
        assert [one.add(row, stamp_ns=stamp_ns) for one in (index, loaded)] == [number, number]
    for number in range(30):
        assert np.array_equal(index.descriptor(number), loaded.descriptor(number))


def test_saving_twice_gives_the_same_bytes_and_leaves_nothing_else(stored: Path) -> None:
    first = stored.read_bytes()
    filled().save(str(stored))
    assert stored.read_bytes() == first
    assert os.listdir(stored.parent) == ["places.index"]


def test_an_empty_index_can_be_saved(tmp_path: Path) -> None:
    DescriptorIndex(5, window=3).save(str(tmp_path / "empty.index"))
    loaded = DescriptorIndex.load(str(tmp_path / "empty.index"))
    assert (len(loaded), loaded.dimension, loaded.window) == (0, 5, 3)


@pytest.fixture
def stored(tmp_path: Path) -> Path:
    path = tmp_path / "places.index"
    filled().save(str(path))
    return path


def refusal(path: Path) -> str:
    """The message with which a file is refused; it begins with the path and is one line."""
    with pytest.raises(DataError) as error:
        DescriptorIndex.load(str(path))
    message = str(error.value)
    assert message.startswith(f"{path}: ") and "\n" not in message
    return message


def test_an_index_of_another_version_is_refused(stored: Path) -> None:
    content = bytearray(stored.read_bytes())
    struct.pack_into("<I", content, VERSION_OFFSET, 3)
    stored.write_bytes(content)
    assert re.search(r"\b3\b.*\b1\b.*\b2\b", refusal(stored))


def test_bytes_at_the_end_are_noticed(stored: Path) -> None:
    content = stored.read_bytes()
    for count in (1, 36):
        stored.write_bytes(content + bytes(count))
        assert re.search(rf"\b{count} byte", refusal(stored))


def test_crafted_descriptors_that_are_not_finite_are_refused(stored: Path) -> None:
    content = bytearray(stored.read_bytes())
    struct.pack_into("<f", content, len(content) - 12, float("nan"))
    checksum = 0xCBF29CE484222325
    for byte in content[:-8]:
        checksum = (checksum ^ byte) * 0x100000001B3 % 2**64
    struct.pack_into("<Q", content, len(content) - 8, checksum)
    stored.write_bytes(content)
    assert "19" in refusal(stored)


def test_an_index_cut_or_changed_anywhere_is_refused(stored: Path) -> None:
    content = stored.read_bytes()
    size = len(content)
    contents = [content[:cut] for cut in (0, 1, 7, 40, size // 2, size - 36, size - 1)]
    for place in range(0, size, 11):
        changed = bytearray(content)
        changed[place] ^= 0x10
        contents.append(bytes(changed))
    contents.append(b"I am no index, but long enough to be one. " * 5)
    for wrong in contents:
        stored.write_bytes(wrong)
        refusal(stored)


def test_a_path_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    paths = [tmp_path / "nowhere.index", tmp_path]
    for path in (*paths, *map(Path, ("/dev/zero", "/dev/null", "/dev/tty"))):  # no endless reading
        refusal(path)


@rows("place", ["missing/places.index", "file/places.index", "folder"])
def test_a_path_that_cannot_be_written_is_named(tmp_path: Path, place: str) -> None:
    (tmp_path / "file").write_text("not a folder")
    (tmp_path / "folder").mkdir()
    with refuses("cannot-write", str(tmp_path / place)):
        filled().save(str(tmp_path / place))
    assert sorted(os.listdir(tmp_path)) == ["file", "folder"]


def test_a_path_that_is_no_unicode_is_named(tmp_path: Path) -> None:
    path = os.fsdecode(bytes(tmp_path / "gel") + b"\xf6scht" + b"/places.index")
    refusal(Path(path))
    with refuses("cannot-write", path):
        filled().save(path)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission_is_named(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(DataError, match="Permission denied"):
        filled().save(str(tmp_path / "places.index"))


def test_a_failed_save_leaves_the_old_file_as_it_was(stored: Path) -> None:
    before = stored.read_bytes()
    # Where no file may grow beyond 100 bytes.
    code = (
        "import resource, signal, sys, fusionslam; signal.signal(signal.SIGXFSZ, signal.SIG_IGN);"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100));"
        "fusionslam.DescriptorIndex.load(sys.argv[1]).save(sys.argv[1])"
    )
    done = subprocess.run([sys.executable, "-c", code, stored], capture_output=True, text=True)
    assert "DataError" in done.stderr and str(stored) in done.stderr
    assert stored.read_bytes() == before
    assert os.listdir(stored.parent) == [stored.name]


def test_a_new_file_obeys_the_umask_and_an_old_one_keeps_its_mode(tmp_path: Path) -> None:
    path = tmp_path / "places.index"
    for mask, mode in ((0o077, 0o600), (0o027, 0o640), (0o000, 0o666)):
        before = os.umask(mask)
        try:
            filled().save(path)
        finally:
            os.umask(before)
        assert stat.S_IMODE(path.stat().st_mode) == mode
        path.unlink()
    for mode in (0o600, 0o644, 0o4755):
        filled().save(path)
        path.chmod(mode)
        filled(5).save(path)
        assert stat.S_IMODE(path.stat().st_mode) == mode
        assert len(DescriptorIndex.load(path)) == 5


def test_a_symbolic_link_is_written_through(tmp_path: Path) -> None:
    data = tmp_path / "data"
    data.mkdir()
    filled().save(data / "real.index")
    (tmp_path / "second").symlink_to("data/real.index")
    (tmp_path / "first").symlink_to(tmp_path / "second")
    (tmp_path / "dangling").symlink_to("data/new.index")
    filled(5).save(tmp_path / "first")
    filled(6).save(tmp_path / "dangling")
    assert len(DescriptorIndex.load(data / "real.index")) == 5
    assert len(DescriptorIndex.load(data / "new.index")) == 6
    assert sorted(os.listdir(data)) == ["new.index", "real.index"]
    assert all((tmp_path / name).is_symlink() for name in ("first", "second", "dangling"))
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(DataError):
        filled().save(tmp_path / "loop")


def leave_temporary(path: Path, name: str = "abc_1234") -> Path:
    """What a writer that was killed leaves behind."""
    left = path.with_name(f".{path.name}.{name}")
    left.write_bytes(b"half an index")
    return left


def test_what_killed_writers_left_goes_with_the_next_save(stored: Path) -> None:
    left = [leave_temporary(stored), leave_temporary(stored, "zzzzzzzz")]
    others = [
        leave_temporary(stored.with_name("other.index")),
        *(leave_temporary(stored, name) for name in ("too_long_", "UPPER_12")),
    ]
    filled(5).save(stored)
    assert not any(path.exists() for path in left)
    assert all(path.exists() for path in others)


def test_what_another_writer_holds_stays_for_a_day(stored: Path) -> None:
    held = leave_temporary(stored)
    with held.open("rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        filled(5).save(stored)
        assert held.exists()
        yesterday = time.time() - 25 * 3600
        os.utime(held, (yesterday, yesterday))
        filled(5).save(stored)
        assert not held.exists()


def test_nothing_but_files_is_taken_for_a_leftover(stored: Path, tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.write_text("mine")
    link, folder = (stored.with_name(f".{stored.name}.{name}") for name in ("abcdefgh", "a" * 8))
    link.symlink_to(victim)
    folder.mkdir()
    filled(5).save(stored)
    assert link.is_symlink() and folder.is_dir() and victim.read_text() == "mine"


KILLED = """
import sys, numpy, fusionslam
index = fusionslam.DescriptorIndex(1000)
for _ in range(2000):
    index.add(numpy.ones(1000, numpy.float32))
print(flush=True)
while True:
    index.save(sys.argv[1])
"""


def test_killed_writers_leave_a_whole_file_and_nothing_that_grows(stored: Path) -> None:
    names: set[str] = set()
    command = [sys.executable, "-c", KILLED, stored]
    for _ in range(3):
        with subprocess.Popen(command, stdout=subprocess.PIPE) as writer:
            assert writer.stdout is not None
            writer.stdout.readline()
            while not (left := set(os.listdir(stored.parent)) - {stored.name} - names):
                assert writer.poll() is None
            writer.kill()
        names |= left
        assert len(DescriptorIndex.load(stored)) in (20, 2000)
        assert len(os.listdir(stored.parent)) <= 2
    assert len(names) >= 3  # no name twice
    assert all(re.fullmatch(rf"\.{stored.name}\.[a-z0-9_]{{8}}", name) for name in names)
    filled().save(stored)
    assert os.listdir(stored.parent) == [stored.name]


@rows("make", [os.mkfifo, os.mkdir])
def test_what_is_no_file_is_left_alone(tmp_path: Path, make: Callable[[Path], None]) -> None:
    path = tmp_path / "special"
    make(path)
    refusal(path)
    with refuses("cannot-write"):
        filled().save(path)
    assert os.listdir(tmp_path) == ["special"] and not path.is_file()


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
