# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Peak memory, each measurement in a process of its own.

python -m benchmarks.speed.memory WHAT CLOUD.npz|ROWS    # prints bytes; the benchmark runs this
"""

import ctypes
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
INDEX_WIDTH = 192
DESCRIPTORS = {
    "M2DP": "fusionslam",
    "c-M2DP": "fusionslam",
    "SHOT": "fusionslam",
    "CSHOT": "fusionslam",
    "c-M2DP word by word": "paper",
    "CSHOT by PCL": "PCL",
}
"""What is measured with clouds, and by whom."""
INDICES = {"index": "fusionslam", "index by FAISS": "FAISS"}
"""What is measured with rows added one by one, and by whom."""
MOST_BYTES_A_POINT = 16
"""What "a few bytes a point" is taken to be: about a coloured point's own size."""
MOST_INDEX = 1.05
"""Bound of an index's memory, by the raw size of its descriptors."""
_BLOCK = 1000  # rows made at a time, so that what fills an index hardly counts


@dataclass(frozen=True)
class Memory:
    """Growth of the peak of resident memory while one call runs, by size.

    Attributes:
        work: what is done.
        who: "fusionslam" or the peer.
        sizes: points, or rows of an index.
        bytes: on top of what was there with the input loaded.
    """

    work: str
    who: str
    sizes: Sequence[int]
    bytes: Sequence[int]

    @property
    def is_index(self) -> bool:
        """Whether sizes are rows of an index."""
        return self.work in INDICES

    @property
    def by_raw_size(self) -> float:
        """Of the largest index: its memory by the size of its descriptors."""
        return self.bytes[-1] / (self.sizes[-1] * INDEX_WIDTH * 4)

    @property
    def slope(self) -> float:
        """Further bytes for each further point, from the smallest size to the largest."""
        return (self.bytes[-1] - self.bytes[0]) / (self.sizes[-1] - self.sizes[0])


def growth(work: str, argument: str | Path) -> int:
    """Bytes that one call takes at most, measured in a new process."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.speed.memory", work, str(argument)],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise RuntimeError(f"measuring the memory of {work} failed:\n{done.stderr}")
    return int(done.stdout)


def _calls() -> dict[str, Callable[[Any, Any], object]]:
    import fusionslam

    def paper(points: Any, colors: Any) -> object:
        from benchmarks.speed.peers import native

        return native.paper_cm2dp(points, colors)

    def pcl(points: Any, colors: Any) -> object:
        from benchmarks.speed.peers import native

        cloud = native.PclCloud(points, colors)
        radius = 5 * fusionslam.cloud_resolution(points)
        return native.pcl_cshot(native.PclSurface(cloud, radius=radius))

    return {
        "M2DP": lambda points, _: fusionslam.m2dp(points),
        "c-M2DP": fusionslam.cm2dp,
        "SHOT": lambda points, _: fusionslam.shot(points),
        "CSHOT": fusionslam.cshot,
        "c-M2DP word by word": paper,
        "CSHOT by PCL": pcl,
    }


def _index(rows: int) -> object:
    import fusionslam

    index = fusionslam.DescriptorIndex(INDEX_WIDTH)
    for block in _blocks(rows):
        for row in block:
            index.add(row)
    return index


def _faiss(rows: int) -> object:
    import faiss

    index = faiss.IndexFlatL2(INDEX_WIDTH)
    for block in _blocks(rows):
        index.add(block)
    return index


def _blocks(rows: int) -> Any:
    block = np.random.default_rng(0).random((_BLOCK, INDEX_WIDTH), dtype=np.float32)
    return (block[: min(_BLOCK, rows - start)] for start in range(0, rows, _BLOCK))


def _measured(call: Callable[[], object]) -> int:
    """Growth of the high-water mark, reset before where the kernel lets us."""
    ctypes.CDLL("libc.so.6").malloc_trim(0)
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    before = _high_water()
    kept = call()
    after = _high_water()
    del kept
    return after - before


def _high_water() -> int:
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    found = next(line for line in lines if line.startswith("VmHWM:"))
    return int(found.split()[1]) * 1024


def _main(work: str, argument: str) -> None:
    indices = {"index": _index, "index by FAISS": _faiss}
    if work in indices:
        indices[work](_BLOCK)  # what is loaded once, libraries above all, is there before
        print(_measured(lambda: indices[work](int(argument))))
        return
    call = _calls()[work]
    with np.load(argument) as stored:
        points, colors = stored["points"], stored["colors"]
    step = max(len(points) // 500, 1)
    call(np.ascontiguousarray(points[::step]), np.ascontiguousarray(colors[::step]))
    print(_measured(lambda: call(points, colors)))


if __name__ == "__main__":
    _main(*sys.argv[1:])
