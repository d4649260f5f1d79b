# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A process ends with its own status while daemon threads are in the core."""

import subprocess
import sys

import pytest

PROGRAM = """
import os, sys, threading, time
import numpy as np
import fusionslam
from fusionslam import registration, views

rng = np.random.default_rng(0)
wide = rng.normal(size=(3000, 3))  # float64, which numpy converts without the GIL
points, colors = wide.astype(np.float32), rng.integers(0, 255, (3000, 3), np.uint8)
rows = rng.normal(size=(300, 64)).astype(np.float32)
image, projection = np.zeros((480, 640, 3), np.uint8), np.eye(3, 4)
index, left = fusionslam.DescriptorIndex(64), np.zeros((48, 64), np.uint8)
WORKS = [
    lambda: fusionslam.m2dp(points),
    lambda: fusionslam.m2dp(wide, threads=1),
    lambda: fusionslam.scan_context(points, height=2.0),
    lambda: fusionslam.estimate_normals(points, radius=0.2, threads=2),
    lambda: fusionslam.voxel_downsample(wide, colors, size=0.5),
    lambda: fusionslam.colorize(points, image, projection),
    lambda: fusionslam.stereo_disparity(left, left),
    lambda: fusionslam.nearest(rows, rows, k=2),
    lambda: (index.add(rows[0]), index.query(rows[1], k=1)),
    lambda: views.build_scene(points, colors),
    lambda: registration.nearest_ranges(points),
    lambda: registration.count_overlap(
        points, points, registration.nearest_ranges(points), np.eye(4), 0.5
    ),
]


def end(works):
    for work in works:
        loop = lambda work=work: [work() for _ in iter(int, 1)]
        threading.Thread(target=loop, daemon=True).start()
    time.sleep(0.004)
    sys.exit(3)


statuses = []
for number in range(int(sys.argv[1])):
    child = os.fork()
    if not child:
        first = 2 * number % len(WORKS)
        end(WORKS[first : first + 2])
    statuses.append(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
print(*[number for number, status in enumerate(statuses) if status != 3])
"""


def check_exits(count: int) -> None:
    program = [sys.executable, "-c", PROGRAM, str(count)]
    ended = subprocess.run(program, capture_output=True, text=True, check=True, timeout=600)
    assert ended.stdout.split() == [], ended.stderr


def test_daemon_threads_in_the_core_leave_a_process_its_own_status() -> None:
    check_exits(6)


@pytest.mark.nightly
def test_daemon_threads_in_the_core_leave_five_hundred_processes_their_own_status() -> None:
    check_exits(504)
