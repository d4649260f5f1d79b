# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Libraries that bring another OpenCV, OpenMP or BLAS into the process change no result."""

import subprocess
import sys
from functools import cache
from importlib.util import find_spec

import pytest

COMPUTE = """
import hashlib
import numpy as np
import fusionslam
from fusionslam import fusion
rng = np.random.default_rng(5)
points = rng.uniform([-20, -20, -2], [20, 20, 3], (2000, 3)).astype(np.float32)
points[:1000, 2] = -1.7 + rng.normal(0, 0.02, 1000)
colors = rng.integers(0, 256, (2000, 3), dtype=np.uint8)
right = rng.integers(0, 256, (64, 128, 3), dtype=np.uint8)
results = [
    fusionslam.cm2dp(points, colors),
    fusionslam.cshot(points, colors, normal_radius=0.8),
    fusion.stereo_disparity(np.roll(right, 5, axis=1), right),
    *fusion.remove_ground_plane(points),
]
assert np.count_nonzero(results[2]) > 1000 and len(results[3]) < 1900
digest = hashlib.sha256(b"".join(np.ascontiguousarray(r).tobytes() for r in results)).hexdigest()
print(digest)
"""


@cache
def digest_after(*imports: str) -> str:
    """The digest of results of a process that imports these first, in this order."""
    program = "\n".join([f"import {name}" for name in imports] + [COMPUTE])
    command = [sys.executable, "-c", program]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


@pytest.mark.slow
@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("library", ["cv2", "torch"])
def test_results_stay_the_same_beside_another_library(library: str, first: bool) -> None:
    if find_spec(library) is None:
        pytest.skip(f"no {library} here")
    names = (library, "fusionslam._core")
    assert digest_after(*(names if first else names[::-1])) == digest_after()
