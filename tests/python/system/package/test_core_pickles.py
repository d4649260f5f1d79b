# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Everything of the core that holds data can be sent to another process."""

import copy
import multiprocessing
import pickle
from collections.abc import Callable
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import pytest

from arrays import SECOND, filled
from clouds import scan_blocks
from fusionslam import _core
from fusionslam.errors import FusionSlamError
from rows import rows
from scenes import many_scenes, place
from streets import at

CLOUD = place(1)
SCENE = _core.build_scene(CLOUD.points, CLOUD.colors)
OTHER = _core.build_scene(place(1, visit=1).points, place(1, visit=1).colors)
QUERY = np.arange(7, dtype=np.float32)
CONFIGS = sorted(name for name in vars(_core) if name.endswith("Config"))


def scene_index() -> Any:
    index = _core.SceneIndex(_core.SimilarityConfig(preset="paper"))
    for scene in many_scenes(9, 5):
        index.add(scene)
    return index


def alignment_index() -> Any:
    index = _core.AlignmentIndex(_core.AlignmentConfig(candidates=3))
    for scene in (SCENE, OTHER, *many_scenes(2, 3)):
        index.add(scene)
    return index


def sheet() -> Any:
    cells = _core.PoseSheet(9)
    cells.inject(2.5, 3, 4, 0.7)
    cells.settle(1e-5)
    return cells


def experience_map() -> Any:
    graph = _core.ExperienceMap(_core.ExperienceMapConfig(sigmas=2.0, initial_heading=5.0))
    graph.apply(1, 0, 0, 0.0, (0.0, 0.0))
    for node in range(8):
        graph.on_odometry(1.0, 0.7, 1.0)
        graph.apply(1, node, node + 1, 0.0, (0.0, 0.0))
    graph.check(2, 8, 2, 0.0, (3.0, 0.0))
    graph.apply(2, 8, 0, 0.0, (0.1, 0.0))
    return graph


def odometry_tree() -> Any:
    tree = _core.OdometryTree()
    for _ in range(2):
        parent = tree.add_root(np.eye(4))
        for _ in range(9):
            step = np.array([[0, -1, 0, 2], [1, 0, 0, 1], [0, 0, 1, 0], [0, 0, 0, 1.0]])
            parent = tree.add(parent, step, np.eye(6) * 0.01)
    return tree


def surface_cloud() -> Any:
    return _core.SurfaceCloud(scan_blocks(at(0, 0, 0), 1, 500), neighbors=8)


def cloud_values(cloud: Any) -> Any:
    """Its state, and what it is for."""
    points, neighbors = cloud.__getstate__()
    moved = _core.refine_pose(cloud, surface_cloud(), at(0.2, 0.1, 2))
    return points.tobytes(), neighbors, len(cloud), moved.target_from_source.tobytes()


def alignment_values(alignment: Any) -> Any:
    names = ("x", "y", "yaw", "probability", "evidence")
    return [alignment.information.tobytes(), *(getattr(alignment, name) for name in names)]


def changed_config(name: str) -> Any:
    """A configuration whose numbers are half their defaults, where that is allowed."""
    kind = getattr(_core, name)
    return kind(
        **{
            option["name"]: option["default"] / 2
            for option in kind.options()
            if option["kind"] == "float" and option["minimum"] <= option["default"] / 2
        }
    )


# What makes an object, and what it must have in common with its copy.
OBJECTS: dict[str, tuple[Callable[[], Any], Callable[[Any], Any]]] = {
    "DescriptorIndex": (
        filled,
        lambda index: (
            [index.descriptor(i).tolist() for i in range(len(index))],
            [found.tolist() for found in index.query(QUERY, k=9, stamp_ns=18 * SECOND)],
            (index.window, index.window_seconds),
        ),
    ),
    "SceneIndex": (
        scene_index,
        lambda index: (index.similarities(many_scenes(9, 5)[4]).tolist(), repr(index.config)),
    ),
    "AlignmentIndex": (
        alignment_index,
        lambda index: (
            [(number, *alignment_values(found)) for number, found in index.query(SCENE)],
            repr(index.config),
        ),
    ),
    "Alignment": (lambda: _core.align_scenes(SCENE, OTHER), alignment_values),
    "PoseSheet": (sheet, lambda cells: cells.activity.tolist()),
    "ExperienceMap": (
        experience_map,
        lambda graph: {name: values.tobytes() for name, values in graph.state().items()},
    ),
    "OdometryTree": (
        odometry_tree,
        lambda tree: (tree.poses.tolist(), tree.drift(2, 9).tolist(), tree.roots.tolist()),
    ),
    "SurfaceCloud": (surface_cloud, cloud_values),
    "Refinement": (
        lambda: _core.refine_pose(surface_cloud(), surface_cloud(), at(0.1, 0, 1)),
        lambda found: [
            *(getattr(found, name).tobytes() for name in ("target_from_source", "information")),
            *(getattr(found, name) for name in ("error", "inliers", "iterations", "converged")),
        ],
    ),
    "Scene": (lambda: SCENE, lambda scene: scene.to_json()),
    "RangeImage": (lambda: SCENE.image, lambda image: image.cells.tobytes()),
    "ActionKind": (lambda: _core.ActionKind.CREATE_EDGE, lambda kind: kind),
    **{name: (partial(changed_config, name), repr) for name in CONFIGS},
}


def test_every_class_of_the_core_is_tried() -> None:
    classes = {name for name, value in vars(_core).items() if isinstance(value, type)}
    assert classes == set(OBJECTS)


@rows("name", OBJECTS)
def test_an_object_comes_back_as_it_was(name: str) -> None:
    make, values_of = OBJECTS[name]
    original = make()
    expected = values_of(original)
    for protocol in range(2, pickle.HIGHEST_PROTOCOL + 1):
        assert values_of(pickle.loads(pickle.dumps(original, protocol))) == expected
    assert values_of(copy.deepcopy(original)) == expected


def test_an_index_works_in_another_process() -> None:
    index = filled()
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        (indices, distances) = pool.apply(index.query, (QUERY,), {"stamp_ns": 19 * SECOND})
    expected = index.query(QUERY, stamp_ns=19 * SECOND)
    assert (indices[0], distances[0]) == (expected[0][0], expected[1][0])


WRONG: list[Any] = [None, 7, "x", b"", b"x" * 100, (), (1,), [1, 2], {}, {"a": 1}, (None,) * 2]
WRONG += [(None,) * 3, (None,) * 5, (9, np.ones(3)), (9, "x"), (9, np.full(36 * 81, np.nan))]
WRONG += [(1e9, 2.0, 3.0, np.nan, [0.0] * 12), (0.0, 0.0, 0.0, 0.5, [0.0] * 11), (2**40, b"")]
WITH_STATES = [
    name for name in OBJECTS if "__setstate__" in vars(getattr(_core, name)) and name != "Scene"
]


@rows("name, number", product(WITH_STATES, range(len(WRONG))))
def test_a_wrong_state_is_a_typed_error(name: str, number: int) -> None:
    kind = getattr(_core, name)
    fresh = kind.__new__(kind)
    with pytest.raises(FusionSlamError):
        fresh.__setstate__(WRONG[number])


def test_states_whose_parts_do_not_fit_are_refused() -> None:
    config, ends, values = scene_index().__getstate__()
    spoilt, weightless, near = values.copy(), values.copy(), values.copy()
    spoilt[3], weightless[-1], near[-1 - int(ends[-1])] = np.nan, 0, 2
    for state in [
        (config, ends[:-1], values),
        (config, ends[::-1].copy(), values),
        (config, ends, values[:-1]),
        *[(config, ends, changed) for changed in (spoilt, weightless, near)],
        (config, ends + 2**60, values),
        (_core.AlignmentConfig(), ends, values),
    ]:
        index = _core.SceneIndex.__new__(_core.SceneIndex)
        with pytest.raises(FusionSlamError):
            index.__setstate__(state)
    options = _core.M2dpConfig().__getstate__()
    for changed in ({**options, "more": 1}, dict(list(options.items())[1:])):
        fresh = _core.M2dpConfig.__new__(_core.M2dpConfig)
        with pytest.raises(FusionSlamError):
            fresh.__setstate__(changed)
