# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Arrays that must be copied where there is no memory for the copy."""

import json
import subprocess
import sys

import pytest

from project import SUPPORT

# Arrays of one repeated number take no memory; their copies would take 6 GB and more.
PROGRAM = """
import json, resource, sys
import numpy as np
sys.path[:0] = json.loads(sys.argv[1])
import arrays, fusionslam
from fusionslam import _core, views

COUNT = 500_000_000
INDEX = fusionslam.DescriptorIndex(8)
SCENE = views.Scene(np.zeros(0, views.build_scene(arrays.POINTS, arrays.COLORS).objects.dtype))
SHEET = _core.PoseSheet(7)
MAP = _core.ExperienceMap(_core.ExperienceMapConfig())
CELLS = SCENE.image.cells
NORMALS = np.tile(np.float32([0, 0, 1]), (400, 1))


def repeated(value, *shape):
    return np.broadcast_to(value, shape)


points, colors = repeated(np.float64(1), COUNT, 3), repeated(np.uint8(1), 12 * COUNT, 3)
image, table = repeated(np.uint8(1), 100_000, 60_000, 3), repeated(np.float32(1), COUNT, 8)
row, disparity = repeated(np.float32(1), 8 * COUNT), repeated(np.float32(1), 60_000, 100_000)
scene_rows = repeated(np.zeros((), SCENE.objects.dtype), COUNT)
cell_rows = repeated(np.zeros((), CELLS.dtype), 4 * COUNT)
state = {**MAP.state(), "nodes": repeated(np.float64(1), COUNT, 3)}
calls = {
    **{f"points of {name}": (call, points) for name, call in arrays.POINT_CALLS.items()},
    **{f"colors of {name}": (call, colors) for name, call in arrays.COLOR_CALLS.items()},
    **{f"image of {name}": (call, image) for name, call in arrays.IMAGE_CALLS.items()},
    "points of shot_at_centroid": (lambda given: _core.shot_at_centroid(given, NORMALS), points),
    "normals": (lambda given: _core.shot_at_centroid(arrays.POINTS, given), points),
    "points of segments": (fusionslam.remove_ground_segments, points),
    "points of dbscan": (lambda given: views.dbscan(given, eps=1, min_points=2), points),
    "points of build_scene": (lambda given: views.build_scene(given, arrays.COLORS), points),
    "demosaic": (lambda given: fusionslam.demosaic(given, "rggb"), image[..., 0]),
    "rectify_image": (
        lambda given: fusionslam.rectify_image(
            given, camera_matrix=np.eye(3), distortion=[], model="none",
            rectification=np.eye(3), projection=np.eye(3, 4), size=(60_000, 100_000)
        ),
        image,
    ),
    "distortion": (
        lambda given: fusionslam.rectify_image(
            arrays.IMAGE, camera_matrix=np.eye(3), distortion=given, model="plumb_bob",
            rectification=np.eye(3), projection=np.eye(3, 4), size=(64, 48)
        ),
        row,
    ),
    "disparity": (
        lambda given: fusionslam.cloud_from_disparity(
            given, arrays.IMAGE, arrays.PROJECTION, arrays.RIGHT_PROJECTION
        ),
        disparity,
    ),
    "add": (INDEX.add, row),
    "query": (INDEX.query, row),
    "nearest": (lambda given: fusionslam.nearest(given, arrays.DESCRIPTORS), table),
    "nearest_causal": (lambda given: fusionslam.nearest_causal(given, window=0), table),
    "first_singular_vectors": (fusionslam.first_singular_vectors, table),
    "Scene": (views.Scene, scene_rows),
    "RangeImage": (lambda given: _core.RangeImage(given, 1, 1, (0, 0, 0)), cell_rows),
    "assign": (SHEET.assign, row),
    "restore": (MAP.restore, state),
}
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + 300_000_000,) * 2)
raised = {}
for name, (call, given) in calls.items():
    try:
        call(given)
        raised[name] = "nothing"
    except BaseException as error:
        raised[name] = type(error).__name__
print(json.dumps(raised))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_no_memory_for_a_copy_is_a_memory_error_in_every_function_that_takes_arrays() -> None:
    support = str(SUPPORT)
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, json.dumps([support])], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    raised = json.loads(done.stdout)
    assert len(raised) > 35
    assert {name: kind for name, kind in raised.items() if kind != "MemoryError"} == {}
