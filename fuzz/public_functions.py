# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Public functions and classes with hostile arguments.

Each call starts from valid arguments, of which one or two become hostile. It must be refused with
one of the package's errors or TypeError (arguments of another type), or give no NaN.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import fusionslam
import maps
import scenes
from arrays import COLORS, DESCRIPTORS, IMAGE, LEFT, POINTS, PROJECTION, RIGHT_PROJECTION
from fusionslam import evaluation, ratslam, registration, views
from fusionslam._core import PoseSheet
from fusionslam.errors import FusionSlamError
from fusionslam.geometry.rigid import fit_rigid
from fusionslam.sensors.messages import FrameTransform
from fuzz.hostile_values import GENERATE, driven_by_bytes, hostile, random_bytes
from fuzz.target import Target, check_numbers

SECOND = 10**9
CLOUD = scenes.place(0)
POINTS_OF = {"points": POINTS}
COLORED = {"points": POINTS, "colors": COLORS}
DESCRIBE = {"preset": "robust", "threads": 1}
MATRIX = np.eye(4)
PLACES = np.array([[0.0, 0, 0], [9, 0, 0], [0, 0, 0]] * 2)
SECONDS = np.arange(6) * 5.0
Arguments = Mapping[str, Any]


def _scene() -> views.Scene:
    return views.build_scene(CLOUD.points, CLOUD.colors)


SCENE = _scene()
CAMERA = fusionslam.Camera(PROJECTION, size=(64, 48))


def _estimate_normals(points: Any, **given: Any) -> Any:
    # Takes points times neighbours, who may be all others: minutes that Ctrl-C ends, no hang.
    few = points[:1000] if isinstance(points, np.ndarray) and points.ndim else points
    return fusionslam.estimate_normals(few, **given)


FUNCTIONS: dict[str, tuple[Callable[..., Any], Arguments]] = {
    "m2dp": (fusionslam.m2dp, POINTS_OF | DESCRIBE),
    "m2dp_signature": (fusionslam.m2dp_signature, POINTS_OF | DESCRIBE),
    "cm2dp": (fusionslam.cm2dp, COLORED | DESCRIBE | {"color_space": "rgb"}),
    "cm2dp_signature": (fusionslam.cm2dp_signature, COLORED | DESCRIBE | {"color_space": "lab"}),
    "shot": (fusionslam.shot, POINTS_OF | {"normal_radius": 2.0, "threads": 1}),
    "cshot": (fusionslam.cshot, COLORED | {"normal_radius": 2.0, "threads": 1}),
    "shot_at_centroid": (
        fusionslam.shot_at_centroid,
        {
            "points": POINTS,
            "normals": np.tile([[0, 0, 1]], (400, 1)).astype(np.float32),
            "threads": 1,
        },
    ),
    "scan_context": (fusionslam.scan_context, POINTS_OF | {"height": 2.0}),
    "cscan_context": (fusionslam.cscan_context, COLORED | {"height": 2.0}),
    "bev_spectrum": (fusionslam.bev_spectrum, POINTS_OF | {"height": 2.0}),
    "compare_scan_contexts": (
        fusionslam.compare_scan_contexts,
        {"query": np.ones(120, np.float32), "match": np.ones(120, np.float32)},
    ),
    "cloud_resolution": (fusionslam.cloud_resolution, POINTS_OF),
    "estimate_normals": (_estimate_normals, POINTS_OF | {"radius": 5.0, "threads": 1}),
    "first_singular_vectors": (
        fusionslam.first_singular_vectors,
        {"matrix": np.arange(12, dtype=np.float32).reshape(3, 4)},
    ),
    "colorize": (
        fusionslam.colorize,
        {"points": POINTS, "image": IMAGE, "projection": PROJECTION, "interpolation": "nearest"},
    ),
    "colorize_all_round": (
        fusionslam.colorize_all_round,
        {
            "points": POINTS,
            "images": [IMAGE, IMAGE],
            "projections": [PROJECTION, PROJECTION],
            "balance": True,
            "interpolation": "nearest",
        },
    ),
    "depth_image": (
        fusionslam.depth_image,
        {"points": POINTS, "projection": PROJECTION, "width": 64, "height": 48},
    ),
    "above_height": (fusionslam.above_height, POINTS_OF | {"height": 1.0, "up": "z"}),
    "remove_ground_plane": (fusionslam.remove_ground_plane, POINTS_OF | {"up": "z"}),
    "remove_ground_segments": (fusionslam.remove_ground_segments, POINTS_OF | {"up": "z"}),
    "voxel_downsample": (fusionslam.voxel_downsample, COLORED | {"size": 2.0}),
    "drop_invalid": (fusionslam.drop_invalid, POINTS_OF),
    "stereo_disparity": (fusionslam.stereo_disparity, {"left": LEFT, "right": LEFT}),
    "cloud_from_disparity": (
        fusionslam.cloud_from_disparity,
        {
            "disparity": np.full((48, 64), 4, np.float32),
            "image": IMAGE,
            "left_projection": PROJECTION,
            "right_projection": RIGHT_PROJECTION,
        },
    ),
    "demosaic": (fusionslam.demosaic, {"image": LEFT, "pattern": "rggb"}),
    "rectify_image": (
        fusionslam.rectify_image,
        {
            "image": IMAGE,
            "camera_matrix": PROJECTION[:, :3],
            "distortion": np.zeros(5),
            "model": "plumb_bob",
            "rectification": np.eye(3),
            "projection": PROJECTION,
            "size": (64, 48),
        },
    ),
    "nearest": (
        fusionslam.nearest,
        {"queries": DESCRIPTORS, "descriptors": DESCRIPTORS, "k": 2, "threads": 1},
    ),
    "nearest_causal": (
        fusionslam.nearest_causal,
        {"descriptors": DESCRIPTORS, "window": 2, "k": 2, "threads": 1},
    ),
    "describe": (fusionslam.describe, {"cloud": CLOUD, "name": "cm2dp"}),
    "build_scene": (views.build_scene, {"points": CLOUD.points, "colors": CLOUD.colors}),
    "scene_similarity": (
        views.scene_similarity,
        {"current": SCENE, "stored": SCENE, "preset": "robust"},
    ),
    "nearest_ranges": (registration.nearest_ranges, POINTS_OF | {"step": 2.0}),
    "count_overlap": (
        registration.count_overlap,
        {
            "points": POINTS,
            "other": POINTS,
            "other_ranges": registration.nearest_ranges(POINTS),
            "other_from_points": MATRIX,
            "distance": 0.5,
        },
    ),
    "register": (registration.register, {"source": POINTS, "target": POINTS}),
    "register from a guess": (
        registration.register,
        {"source": POINTS, "target": POINTS, "guess": MATRIX},
    ),
    "register on a floor": (
        partial(registration.register, config=registration.RegistrationConfig(method="planar")),
        {"source": CLOUD, "target": CLOUD, "guess": MATRIX},
    ),
    "align_scenes": (views.align_scenes, {"current": SCENE, "stored": SCENE}),
    "dbscan": (views.dbscan, COLORED | {"eps": 1.0, "min_points": 3, "color_scale": 0.01}),
    "ciede2000": (views.ciede2000, {"a": (1.0, 2.0, 3.0), "b": np.array([4.0, 5.0, 6.0])}),
    "color_difference": (
        views.color_difference,
        {"a": (1.0, 2.0, 3.0), "b": np.array([4.0, 5.0, 6.0]), "kind": "cie76"},
    ),
    "Scene": (views.Scene, {"objects": np.array(SCENE.objects)}),
    "RangeImage": (
        views.RangeImage,
        {
            "cells": np.array(SCENE.image.cells),
            "azimuth_step": 1.0,
            "elevation_step": 1.0,
            "sensor": (0.0, 0.0, 0.0),
        },
    ),
    "precision_recall": (
        evaluation.precision_recall,
        {"descriptors": DESCRIPTORS, "positions": np.tile(PLACES, (5, 1)), "window": 2},
    ),
    "evaluate_matches": (
        evaluation.find_matches,
        {"descriptors": DESCRIPTORS, "window": 2},
    ),
    "judge_views": (
        lambda **given: str(evaluation.judge_views(**given)),  # NaN marks what has no distance
        {"ids": np.arange(6), "poses": PLACES, "stamps": SECONDS, "rule": "paper"},
    ),
    "judge_map": (evaluation.judge_map, {"run": maps.square_run()}),
    "pose_errors": (evaluation.pose_errors, {"poses": PLACES, "truth": PLACES[::-1].copy()}),
    "fit_rigid": (fit_rigid, {"poses": PLACES, "truth": PLACES[::-1].copy()}),
    "Camera": (fusionslam.Camera, {"projection": PROJECTION, "rectified_from_points": MATRIX}),
    "fuse": (
        lambda points, image, colors, projection, pose, source: fusionslam.fuse(
            fusionslam.Frame(
                points=points,
                colors=colors,
                images={"left": image},
                cameras={"left": fusionslam.Camera(projection)},
                robot_from_points=pose,
            ),
            fusionslam.FusionConfig(source=source),
        ),
        {
            "points": POINTS,
            "image": IMAGE,
            "colors": COLORS,
            "projection": PROJECTION,
            "pose": MATRIX,
            "source": "lidar",
        },
    ),
    "VisualOdometry": (lambda image: ratslam.VisualOdometry().process(image, 0), {"image": IMAGE}),
}


@dataclass(frozen=True)
class Machine:
    """An object whose methods are called one after the other.

    Attributes:
        make: makes it; ``arguments`` are its valid arguments.
        methods: valid arguments of each method.
    """

    make: Callable[..., Any]
    arguments: Arguments
    methods: Mapping[str, Arguments]


MACHINES: dict[str, Machine] = {
    "DescriptorIndex": Machine(
        fusionslam.DescriptorIndex,
        {"dimension": 8, "window": 2, "window_seconds": 0.0},
        {
            "add": {"descriptor": DESCRIPTORS[0], "stamp_ns": SECOND},
            "query": {"descriptor": DESCRIPTORS[1], "k": 2, "stamp_ns": 5 * SECOND},
            "descriptor": {"index": 0},
        },
    ),
    "LoopDetector": Machine(
        fusionslam.LoopDetector,
        {"descriptor": "cm2dp", "threshold": 0.2, "window": 1, "verify": False},
        {
            "add": {"frame_or_cloud": CLOUD, "stamp_ns": SECOND},
            "add_descriptor": {
                "descriptor": np.zeros(576, np.float32),
                "stamp_ns": SECOND,
            },
            "candidates": {"k": 2},
        },
    ),
    "ViewMatcher": Machine(
        lambda method, threshold, max_views: views.ViewMatcher(
            views.ViewMatcherConfig(method=method, threshold=threshold, max_views=max_views)
        ),
        {"method": "objects", "threshold": 0.5, "max_views": 3},
        {"process": {"item": CLOUD}, "view": {"item": CLOUD}},
    ),
    "RatSlam": Machine(
        ratslam.RatSlam,
        {"preset": "robust"},
        {"step": {"event": ratslam.Motion(SECOND, 0.5, 0.1)}},
    ),
    "RatSlam sightings": Machine(
        ratslam.RatSlam,
        {"preset": "robust"},
        {"step": {"event": ratslam.Sighting(SECOND, 0)}},
    ),
    "ExperienceMap": Machine(
        ratslam.ExperienceMap,
        {},
        {
            "on_odometry": {"v": 0.5, "w": 0.1, "dt": 0.1},
            "relax": {},
        },
    ),
    "PoseSheet": Machine(
        PoseSheet,
        {"size": 9},
        {
            "inject": {"x": 1.0, "y": 1.0, "th": 1.0, "energy": 1.0},
            "settle": {"global_inhibition": 0.001},
            "decode": {},
            "assign": {"activity": np.ones((36, 9, 9))},
            "move": {"x": np.ones(36), "y": np.ones(36), "layers": 1.0},
        },
    ),
    "Synchronizer": Machine(
        lambda **given: fusionslam.Synchronizer(fusionslam.SyncConfig(**given)),
        {},
        {"add": {"sensor": "points", "stamp_ns": SECOND, "item": 1}, "flush": {}},
    ),
    "TransformTree": Machine(
        fusionslam.TransformTree,
        {"history_s": 10.0},
        {
            "add": {
                "transform": FrameTransform(
                    stamp_ns=SECOND, parent="a", child="b", parent_from_child=MATRIX
                )
            },
            "lookup": {"target": "a", "source": "b", "stamp_ns": SECOND},
            "root": {"frame": "a"},
        },
    ),
}


def public_function_targets() -> Iterator[Target]:
    """One target for each function and class."""
    for name, (function, arguments) in FUNCTIONS.items():
        yield Target(f"functions/{name}", random_bytes, _Call(function, arguments), 512)
    for name, machine in MACHINES.items():
        yield Target(f"classes/{name}", random_bytes, _Calls(machine), 1024)


@st.composite
def _spoiled(draw: st.DrawFn, arguments: Arguments) -> dict[str, Any]:
    """Arguments of which up to two are hostile."""
    given = dict(arguments)
    for _ in range(draw(st.integers(0, 2)) if arguments else 0):
        name = draw(st.sampled_from(sorted(arguments)))
        given[name] = draw(hostile(arguments[name]))
    return given


def _answers(action: Callable[[], Any]) -> tuple[bool, Any]:
    """Whether the call was accepted, and its result."""
    try:
        result = action()
    except (FusionSlamError, TypeError, MemoryError):
        return False, None
    check_numbers(result)
    return True, result


class _Call:
    """One function."""

    def __init__(self, function: Callable[..., Any], arguments: Arguments) -> None:
        self.accepted: bool | None = None

        @GENERATE
        @given(_spoiled(arguments))
        def call(given: dict[str, Any]) -> None:
            self.accepted, _ = _answers(partial(function, **given))

        self._run = driven_by_bytes(call)

    def __call__(self, data: bytes) -> bool | None:
        self.accepted = None
        self._run(data)
        return self.accepted


class _Calls(_Call):
    """Up to eight methods of one object."""

    def __init__(self, machine: Machine) -> None:
        @GENERATE
        @given(st.data())
        def call(data: st.DataObject) -> None:
            made, value = _answers(partial(machine.make, **data.draw(_spoiled(machine.arguments))))
            answers = []
            for _ in range(data.draw(st.integers(1, 8)) if made else 0):
                name = data.draw(st.sampled_from(sorted(machine.methods)))
                options = data.draw(_spoiled(machine.methods[name]))
                answers.append(_answers(partial(getattr(value, name), **options))[0])
            self.accepted = any(answers)

        self._run = driven_by_bytes(call)
