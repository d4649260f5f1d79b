# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The descriptor index against NumPy brute force, and its file against what befalls files."""

import os
import signal
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from fusionslam import ConfigError, DataError, DescriptorIndex, ShapeError, nearest, nearest_causal

SECOND = 1_000_000_000
VERSION_OFFSET = 8
"""Where the version stands in the file: after eight bytes of magic."""


def brute_force(
    rows: NDArray[np.float32], query: NDArray[np.float32], allowed: NDArray[np.bool_], k: int
) -> tuple[list[int], list[float]]:
    """The k nearest allowed rows, ties to the lowest number."""
    distances = np.linalg.norm(rows.astype(np.float64) - query.astype(np.float64), axis=1)
    order = [int(i) for i in np.argsort(distances, kind="stable") if allowed[i]][:k]
    return order, [float(np.float32(distances[i])) for i in order]


@st.composite
def tables(draw: st.DrawFn) -> NDArray[np.float32]:
    """Tables with many equal distances (few whole values) or with none (normal values)."""
    rows, columns = draw(st.integers(1, 25)), draw(st.integers(1, 9))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    if draw(st.booleans()):
        return rng.integers(-1, 2, (rows, columns)).astype(np.float32)
    return rng.normal(size=(rows, columns)).astype(np.float32)


@settings(max_examples=150, deadline=None)
@given(table=tables(), window=st.integers(0, 30), k=st.integers(1, 30))
def test_the_neighbours_are_those_of_numpy_with_a_window_in_frames(
    table: NDArray[np.float32], window: int, k: int
) -> None:
    index = DescriptorIndex(table.shape[1], window=window)
    for number, row in enumerate(table):
        indices, distances = index.query(row, k=k)
        allowed = np.arange(number) < number - window
        expected = brute_force(table[:number], row, allowed, k)
        assert indices.tolist() == expected[0]
        assert distances == pytest.approx(expected[1], rel=1e-6)
        assert index.add(row) == number
    assert len(index) == len(table)


@settings(max_examples=150, deadline=None)
@given(
    table=tables(),
    window=st.integers(0, 5),
    window_seconds=st.sampled_from([0.0, 0.5, 2.0, 7.25]),
    k=st.integers(1, 5),
    data=st.data(),
)
def test_the_neighbours_are_those_of_numpy_with_a_window_in_seconds(
    table: NDArray[np.float32], window: int, window_seconds: float, k: int, data: st.DataObject
) -> None:
    steps = data.draw(
        st.lists(
            st.sampled_from([0, 1, SECOND // 4, SECOND // 2, 3 * SECOND]),
            min_size=len(table),
            max_size=len(table),
        )
    )
    stamps = np.cumsum(steps, dtype=np.int64) + 1_700_000_000 * SECOND
    index = DescriptorIndex(table.shape[1], window=window, window_seconds=window_seconds)
    for number, row in enumerate(table):
        stamp = int(stamps[number])
        allowed = np.arange(number) < number - window
        if window_seconds:
            allowed &= stamp - stamps[:number] > round(window_seconds * SECOND)
        indices, distances = index.query(row, k=k, stamp_ns=stamp)
        expected = brute_force(table[:number], row, allowed, k)
        assert indices.tolist() == expected[0]
        assert distances == pytest.approx(expected[1], rel=1e-6)
        index.add(row, stamp_ns=stamp)


@settings(max_examples=150, deadline=None)
@given(table=tables(), window=st.integers(0, 30), k=st.integers(1, 6))
def test_a_batch_of_queries_is_what_an_online_run_would_find(
    table: NDArray[np.float32], window: int, k: int
) -> None:
    indices, distances = nearest_causal(table, window=window, k=k)
    assert indices.shape == distances.shape == (len(table), k)
    assert indices.dtype == np.int64 and distances.dtype == np.float32
    for number, row in enumerate(table):
        allowed = np.arange(number) < number - window
        expected = brute_force(table[:number], row, allowed, k)
        found = len(expected[0])
        assert indices[number].tolist() == expected[0] + [-1] * (k - found)
        assert distances[number, :found] == pytest.approx(expected[1], rel=1e-6)
        assert np.isinf(distances[number, found:]).all()


HARD_TABLES: dict[str, Callable[[np.random.Generator, tuple[int, int]], NDArray[np.float64]]] = {
    "normal": lambda rng, shape: rng.normal(size=shape),
    "near ties": lambda rng, shape: 1 + 1e-7 * rng.integers(0, 3, shape),
    "far from the origin": lambda rng, shape: 1e6 + rng.normal(size=shape),
    "denormals": lambda rng, shape: 1e-42 * rng.normal(size=shape),
    "squares beyond float32": lambda rng, shape: 1e30 * rng.normal(size=shape),
}


@pytest.mark.parametrize("kind", HARD_TABLES)
@pytest.mark.parametrize("columns", [1, 7, 192, 575, 576])
def test_one_query_and_a_batch_find_the_neighbours_of_numpy(kind: str, columns: int) -> None:
    table = HARD_TABLES[kind](np.random.default_rng(7), (300, columns)).astype(np.float32)
    queries = np.ascontiguousarray(table[::-7]) * np.float32(1.01)
    index = DescriptorIndex(columns)
    for row in table:
        index.add(row)
    batch = nearest(queries, table, k=5)
    assert batch[0].shape == batch[1].shape == (len(queries), 5)
    assert batch[0].dtype == np.int64 and batch[1].dtype == np.float32
    for number, query in enumerate(queries):
        squares = np.sum((table.astype(np.float64) - query.astype(np.float64)) ** 2, axis=1)
        indices, distances = index.query(query, k=5)
        assert np.array_equal(indices, batch[0][number])
        assert distances.tobytes() == batch[1][number].tobytes()
        # NumPy adds in another order, so that ties may fall the other way in the last digits.
        assert np.allclose(squares[indices], np.sort(squares)[:5], rtol=1e-13, atol=0)
        assert distances == pytest.approx(np.sqrt(squares[indices]), rel=1e-6, abs=1e-45)


def test_a_batch_of_other_length_is_refused() -> None:
    with pytest.raises(ShapeError, match="queries have 3 columns, descriptors have 4"):
        nearest(np.zeros((2, 3), np.float32), np.zeros((2, 4), np.float32))


def test_descriptors_whose_distances_would_overflow_are_refused() -> None:
    index = DescriptorIndex(2)
    with pytest.raises(DataError, match="descriptor 0 is too long"):
        index.add(np.array([3e38, -3e38], np.float32))
    with pytest.raises(DataError, match="descriptor 1 is too long"):
        nearest_causal(np.array([[0, 0], [3e38, 0]], np.float32), window=0)
    assert len(index) == 0


def test_the_neighbours_are_those_of_scikit_learn() -> None:
    from sklearn.neighbors import NearestNeighbors

    rng = np.random.default_rng(1)
    table, query = rng.normal(size=(500, 192)).astype("f4"), rng.normal(size=192).astype("f4")
    index = DescriptorIndex(192)
    for row in table:
        index.add(row)
    expected = NearestNeighbors(n_neighbors=10, algorithm="brute").fit(table).kneighbors([query])
    indices, distances = index.query(query, k=10)
    assert np.array_equal(indices, expected[1][0])
    assert distances == pytest.approx(expected[0][0], rel=1e-5)


def test_one_or_two_threads_give_the_same_bytes() -> None:
    table = np.random.default_rng(2).normal(size=(400, 64)).astype(np.float32)
    results = {
        tuple(part.tobytes() for part in nearest_causal(table, window=9, k=3, threads=threads))
        for threads in (1, 1, 2, 2, 0)
    }
    assert len(results) == 1


def filled(count: int = 20, dimension: int = 7) -> DescriptorIndex:
    rng = np.random.default_rng(3)
    index = DescriptorIndex(dimension, window=2, window_seconds=1.5)
    for number in range(count):
        index.add(rng.normal(size=dimension).astype(np.float32), stamp_ns=number * SECOND)
    return index


# What an index refuses


def test_an_empty_index_answers_with_nothing() -> None:
    indices, distances = DescriptorIndex(4).query(np.zeros(4, np.float32), k=3)
    assert indices.shape == distances.shape == (0,)
    assert indices.dtype == np.int64 and distances.dtype == np.float32


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_descriptor_that_is_not_finite_is_refused_and_not_added(value: float) -> None:
    index = filled()
    spoilt = np.zeros(7, np.float32)
    spoilt[3] = value
    for call in (index.add, lambda row: index.query(row, stamp_ns=0)):
        with pytest.raises(DataError, match="descriptor 20 is not finite at position 3"):
            call(spoilt)
    assert len(index) == 20
    with pytest.raises(DataError, match="descriptor 1 is not finite"):
        nearest_causal(np.stack([np.zeros(7, np.float32), spoilt]), window=0)


def test_a_descriptor_of_another_length_is_refused_and_not_added() -> None:
    index = filled()
    for call in (index.add, lambda row: index.query(row, stamp_ns=0)):
        with pytest.raises(ShapeError, match="descriptor has 8 values, this index holds 7"):
            call(np.zeros(8, np.float32))
    assert len(index) == 20


def test_a_window_in_seconds_needs_a_stamp() -> None:
    with pytest.raises(ConfigError, match="stamp_ns is missing"):
        filled().query(np.zeros(7, np.float32))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"dimension": 0}, "dimension is 0"),
        ({"dimension": -3}, "dimension is -3"),
        ({"dimension": 4, "window": -1}, "window is -1"),
        ({"dimension": 4, "window_seconds": -0.5}, "window_seconds is -0.5"),
        ({"dimension": 4, "window_seconds": float("nan")}, "window_seconds is nan"),
    ],
)
def test_options_out_of_range_are_refused(options: dict[str, float], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        DescriptorIndex(**options)


def test_k_must_be_positive_and_an_index_within_range() -> None:
    index = filled()
    for k in (0, -1):
        with pytest.raises(ConfigError, match=f"k is {k}"):
            index.query(np.zeros(7, np.float32), k=k, stamp_ns=0)
        with pytest.raises(ConfigError, match=f"k is {k}"):
            nearest_causal(np.zeros((3, 7), np.float32), window=0, k=k)
    with pytest.raises(ShapeError, match="descriptor 20 of 20"):
        index.descriptor(20)


def test_a_k_beyond_all_bounds_is_refused_and_does_not_crash() -> None:
    program = (
        "import numpy as np, fusionslam\n"
        "try: fusionslam.nearest_causal(np.zeros((4, 3), 'f4'), window=0, k=2**62)\n"
        "except (fusionslam.ConfigError, MemoryError): print('refused')"
    )
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (run.returncode, run.stdout.strip()) == (0, "refused")


# The file


def test_a_saved_index_continues_where_it_was(tmp_path: Path) -> None:
    index = filled()
    index.save(str(tmp_path / "places.index"))
    loaded = DescriptorIndex.load(str(tmp_path / "places.index"))
    assert (len(loaded), loaded.dimension) == (20, 7)
    assert (loaded.window, loaded.window_seconds) == (2, 1.5)
    rng = np.random.default_rng(4)
    for number in range(20, 30):
        row = rng.normal(size=7).astype(np.float32)
        for a, b in zip(
            index.query(row, k=5, stamp_ns=number * SECOND),
            loaded.query(row, k=5, stamp_ns=number * SECOND),
            strict=True,
        ):
            assert a.tobytes() == b.tobytes()
        assert index.add(row, stamp_ns=number * SECOND) == number
        assert loaded.add(row, stamp_ns=number * SECOND) == number
    for number in range(30):
        assert np.array_equal(index.descriptor(number), loaded.descriptor(number))


def test_saving_twice_gives_the_same_bytes_and_leaves_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "places.index"
    filled().save(str(path))
    first = path.read_bytes()
    filled().save(str(path))
    assert path.read_bytes() == first
    assert os.listdir(tmp_path) == ["places.index"]


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
    (version,) = struct.unpack_from("<I", content, VERSION_OFFSET)
    struct.pack_into("<I", content, VERSION_OFFSET, version + 1)
    stored.write_bytes(content)
    assert f"version {version + 1}, this program reads version {version}" in refusal(stored)


def test_an_index_cut_anywhere_is_refused(stored: Path) -> None:
    content = stored.read_bytes()
    for size in (0, 1, 7, 40, len(content) // 2, len(content) - 36, len(content) - 1):
        stored.write_bytes(content[:size])
        assert "cut off?" in refusal(stored)


def test_a_changed_byte_anywhere_is_noticed(stored: Path) -> None:
    content = stored.read_bytes()
    for place in range(0, len(content), 5):
        changed = bytearray(content)
        changed[place] ^= 0x10
        stored.write_bytes(changed)
        refusal(stored)


def test_bytes_at_the_end_are_noticed(stored: Path) -> None:
    content = stored.read_bytes()
    for count in (1, 36):
        stored.write_bytes(content + bytes(count))
        message = refusal(stored)
        assert f"{count} bytes longer than the 20 descriptors of length 7" in message
        assert "cut off" not in message


def test_a_file_that_is_no_index_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("I am no index, but long enough to be one. " * 5)
    assert "not a fusionslam descriptor index" in refusal(path)


def test_a_path_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    assert "cannot be read" in refusal(tmp_path / "nowhere.index")
    refusal(tmp_path)


@pytest.mark.parametrize("place", ["missing/places.index", "file/places.index", "folder"])
def test_a_path_that_cannot_be_written_is_named_and_nothing_is_left(
    tmp_path: Path, place: str
) -> None:
    (tmp_path / "file").write_text("not a folder")
    (tmp_path / "folder").mkdir()
    with pytest.raises(DataError, match="cannot be written") as error:
        filled().save(str(tmp_path / place))
    assert str(error.value).startswith(f"{tmp_path / place}: ")
    assert sorted(os.listdir(tmp_path)) == ["file", "folder"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission_is_named(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(DataError, match="cannot be written: Permission denied"):
        filled().save(str(tmp_path / "places.index"))


def test_a_failed_save_leaves_the_old_file_as_it_was(stored: Path) -> None:
    before = stored.read_bytes()
    blocker = stored.with_name(f"{stored.name}.{os.getpid()}.tmp")
    blocker.mkdir()  # where the temporary file would be written
    try:
        filled(5).save(str(stored))
    except DataError:
        assert stored.read_bytes() == before
    else:
        assert len(DescriptorIndex.load(str(stored))) == 5


def test_an_index_may_be_shared_by_threads_that_add_and_query() -> None:
    rows = np.random.default_rng(5).normal(size=(4000, 64)).astype(np.float32)
    index = DescriptorIndex(64)
    index.add(rows[0])

    def ask(_: int) -> None:
        while len(index) < len(rows):
            found, distances = index.query(rows[0])
            assert found[0] == 0 and distances[0] == 0

    with ThreadPoolExecutor(3) as pool:
        askers = pool.map(ask, range(2))
        for row in rows[1:]:
            index.add(row)
        list(askers)
    assert len(index) == len(rows)


def test_a_window_in_seconds_needs_the_stamp_of_what_is_added() -> None:
    index = DescriptorIndex(3, window_seconds=5.0)
    with pytest.raises(ConfigError, match="stamp_ns is missing"):
        index.add(np.ones(3, np.float32))
    assert len(index) == 0


def test_threads_may_save_to_one_path_at_a_time(tmp_path: Path) -> None:
    index = DescriptorIndex(64)
    for row in np.random.default_rng(6).normal(size=(500, 64)).astype(np.float32):
        index.add(row)
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda _: index.save(tmp_path / "places.index"), range(40)))
    assert len(DescriptorIndex.load(tmp_path / "places.index")) == 500
    assert [path.name for path in tmp_path.iterdir()] == ["places.index"]


# Memory and interrupts

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
    """Calls what it is given every 10 ms."""
    before = signal.getsignal(signal.SIGALRM)

    def start(handler: Callable[[], None]) -> None:
        signal.signal(signal.SIGALRM, lambda *_: handler())
        signal.setitimer(signal.ITIMER_REAL, 0.01, 0.01)

    yield start
    signal.setitimer(signal.ITIMER_REAL, 0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("threads", [1, 2])
def test_a_long_batch_can_be_interrupted(
    alarms: Callable[[Callable[[], None]], None], threads: int
) -> None:
    table = np.random.default_rng(8).normal(size=(40_000, 128)).astype(np.float32)
    calls = []

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
    calls = []

    def second_time() -> None:
        calls.append(None)
        if len(calls) == 2:
            raise Stop

    alarms(second_time)
    with pytest.raises(Stop):
        index.save(path)
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["places.index"]
