# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Ends processes while daemon threads are in functions of the core.

python -m fuzz.exits COUNT
"""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import fusionslam
from fusionslam import registration, views
from fuzz import PROJECT

STATUS = 3
_rng = np.random.default_rng(0)
_wide: Any = _rng.normal(size=(3000, 3))  # float64, which numpy converts without the GIL
_points, _colors = _wide.astype(np.float32), _rng.integers(0, 255, (3000, 3), np.uint8)
_rows = _rng.normal(size=(300, 64)).astype(np.float32)
_image, _projection = np.zeros((480, 640, 3), np.uint8), np.eye(3, 4)
_index, _left = fusionslam.DescriptorIndex(64), np.zeros((48, 64), np.uint8)
Work = Callable[[], object]
WORKS: Sequence[Work] = [
    lambda: fusionslam.m2dp(_points),
    lambda: fusionslam.m2dp(_wide, threads=1),
    lambda: fusionslam.scan_context(_points, height=2.0),
    lambda: fusionslam.estimate_normals(_points, radius=0.2, threads=2),
    lambda: fusionslam.voxel_downsample(_wide, _colors, size=0.5),
    lambda: fusionslam.colorize(_points, _image, _projection),
    lambda: fusionslam.stereo_disparity(_left, _left),
    lambda: fusionslam.nearest(_rows, _rows, k=2),
    lambda: (_index.add(_rows[0]), _index.query(_rows[1], k=1)),
    lambda: views.build_scene(_points, _colors),
    lambda: registration.nearest_ranges(_points),
    lambda: registration.count_overlap(
        _points, _points, registration.nearest_ranges(_points), np.eye(4), distance=0.5
    ),
    lambda: fusionslam.cm2dp(_points, _colors),
    lambda: fusionslam.shot_at_centroid(_points, _points),
    lambda: fusionslam.cloud_resolution(_points),
    lambda: fusionslam.drop_invalid(_points),
    lambda: fusionslam.demosaic(_image[..., 0], "rggb"),
    lambda: fusionslam.first_singular_vectors(np.abs(_rows)),
    lambda: fusionslam.nearest_causal(_rows, window=0),
    lambda: views.dbscan(_points, eps=0.2, min_points=5),
]
"""One call of each kind of function of the core."""


def exit_in_the_core(count: int) -> list[int]:
    """End so many processes, each with two of the works in threads; return those that went wrong.

    They are forked from a new process, which has none of this one's threads.
    """
    program = [sys.executable, "-m", "fuzz.exits", str(count)]
    ended = subprocess.run(program, cwd=PROJECT, capture_output=True, text=True, check=True)
    return [int(number) for number in ended.stdout.split()]


def _end_in(works: Sequence[Work]) -> None:
    def repeat(work: Work) -> None:
        while True:
            work()

    for work in works:
        threading.Thread(target=repeat, args=(work,), daemon=True).start()
    time.sleep(0.004)
    sys.exit(STATUS)


def _main(count: int) -> None:
    for number in range(count):
        child = os.fork()
        if not child:
            first = 2 * number % len(WORKS)
            _end_in(WORKS[first : first + 2])
        if os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) != STATUS:
            print(number, flush=True)


if __name__ == "__main__":
    _main(int(sys.argv[1]))
