# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""One flipped bit anywhere in a stored file is refused, or the file loads equal data.

FUSIONSLAM_FLIPS is the number of bits tried in each file; "all" tries every bit of the first 400
bytes, of all headers of members and arrays, and of the central directory, and 3,000 others.
"""

import os
import pickle
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fusionslam.datasets.range_recording import RangeRecording
from fusionslam.errors import DataError
from fusionslam.pipelines import describe
from fusionslam.pipelines.recording import Recording
from fusionslam.pipelines.results import Work
from fusionslam.pipelines.tuning import Generation, TuningState
from fusionslam.report.views.previews import load_previews, save_previews
from fusionslam.views.matcher import ViewMatcher
from fuzz.stored_formats import FORMATS as FUZZED
from fuzz.stored_formats import Format, _matcher
from rows import rows
from scenes import LAPS, write_recording

TRIED = os.environ.get("FUSIONSLAM_FLIPS", "4")


def write_again(value: Any, path: Path) -> None:
    """For what saves itself elsewhere: all that it is."""
    path.write_bytes(pickle.dumps(value if isinstance(value, dict | list) else vars(value)))


def write_chunk(path: Path) -> None:
    vectors = {"m2dp": np.ones(8, np.float32)}
    done = [describe._Described(k, vectors, 9, {"load": 0.1}) for k in range(3)]
    describe._save_chunk(path, [*done, describe._Described(3, reason="empty")])


def load_tuning(path: Path) -> list[Any]:
    state = TuningState(path)
    state.begin({"seed": 1})
    return [vars(each) for each in state.generations]


def write_tuning(path: Path) -> None:
    state, rng = TuningState(path), np.random.default_rng(5)
    state.begin({"seed": 1})
    state.add(Generation(rng.random((4, 3)), rng.random(4)))


def write_work(path: Path) -> None:
    Work(recording=Recording("a.bag"), dataset="a", configs={"lidar": {"a": 1}}).save(path.parent)
    path.write_bytes(path.with_name("run.json").read_bytes())


def load_work(path: Path) -> Work | None:
    path.with_name("run.json").write_bytes(path.read_bytes())
    return Work.load(path.parent)


FORMATS: dict[str, Format] = FUZZED | {
    "view_matcher_m2dp": Format(_matcher(method="m2dp"), ViewMatcher.load),
    "view_matcher_shot": Format(_matcher(method="shot"), ViewMatcher.load),
    "recording": Format(
        lambda path: write_recording(path, LAPS[:4]), RangeRecording.open, again=write_again
    ),
    "chunk": Format(write_chunk, describe._load_chunk, again=write_again),
    "tuning": Format(write_tuning, load_tuning, again=write_again),
    "previews": Format(
        lambda path: save_previews(path, {1: b"one", 2: b"two"}), load_previews, again=write_again
    ),
    "run.json": Format(write_work, load_work, again=write_again),
}


def content(form: Format, path: Path) -> bytes:
    again = path.with_name("again")
    form.again(form.read(path), again)
    return again.read_bytes()


def bits(whole: bytes) -> Iterator[int]:
    """Positions of the bits to flip."""
    rng = np.random.default_rng(3)
    count = 8 * len(whole)
    if TRIED != "all":
        yield from rng.integers(0, min(count, 8 * 400), int(TRIED) // 2).tolist()
        yield from rng.integers(0, count, int(TRIED) // 2).tolist()
        return
    spans = [(0, 400)] + [
        (match.start(), match.start() + 200)
        for match in re.finditer(rb"PK\x01\x02|PK\x03\x04|PK\x05\x06|\x93NUMPY", whole)
    ]
    chosen = {bit for begin, end in spans for bit in range(8 * begin, min(8 * end, count))}
    yield from sorted(chosen | set(rng.integers(0, count, 3000).tolist()))


def flipped(whole: bytes) -> Iterator[tuple[int, bytes]]:
    for bit in bits(whole):
        damaged = bytearray(whole)
        damaged[bit // 8] ^= 1 << bit % 8
        yield bit, bytes(damaged)


@rows("name", FORMATS)
def test_a_flipped_bit_is_refused_or_changes_nothing(name: str, tmp_path: Path) -> None:
    form, path = FORMATS[name], tmp_path / "file.npz"
    form.write(path)
    whole, expected = path.read_bytes(), content(form, path)
    refused = tried = 0
    for bit, damaged in flipped(whole):
        path.write_bytes(damaged)
        tried += 1
        try:
            found = content(form, path)
        except DataError:
            refused += 1
        else:
            assert found == expected, f"bit {bit} of {8 * len(whole)}"
    print(f"{name}: {tried} bits flipped, {refused} refused")
    assert refused > tried / 4


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
    for _, damaged in flipped(whole):
        path.write_bytes(damaged)
        other = run()
        try:
            loaded = other.resume(path)
        except DataError:
            continue
        other.save(again, *loaded)
        assert again.read_bytes() == whole
