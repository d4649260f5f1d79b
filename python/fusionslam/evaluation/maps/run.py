# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``RatSlamRun``: a complete run of RatSLAM as arrays, to be judged and drawn."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.archive import check_types, load_archive, save_archive
from fusionslam.base.arrays import Floats, Integers
from fusionslam.base.files import PathLike
from fusionslam.base.texts import counted
from fusionslam.errors import DataError, ShapeError
from fusionslam.geometry.se2 import compose

Activity = NDArray[np.float32]

LINK = np.dtype(
    [
        ("source", np.int64),
        ("target", np.int64),
        ("distance", np.float64),
        ("heading", np.float64),
        ("facing", np.float64),
        ("duration", np.float64),
        ("sd_m", np.float64),
        ("sd_rad", np.float64),
    ]
)
"""A link: ids; distance in metres; direction of travel and rotation, radians relative to the
source's heading; duration in seconds; standard deviations of the translation (each axis, metres)
and of the rotation (radians), by which relaxation weighs the link."""

FORMAT = "fusionslam.ratslam_run.1"
REFUSED = np.dtype(
    [
        ("stamp_ns", np.int64),
        ("source", np.int64),
        ("target", np.int64),
        ("error_m", np.float64),
        ("error_rad", np.float64),
        ("allowed_m", np.float64),
        ("allowed_rad", np.float64),
    ]
)
"""A refused loop: time, nodes, misfit, and the misfit that was allowed."""

NO_NODE = -1
"""Node id of steps before the first node."""

_PER_STEP: Mapping[str, tuple[type, tuple[int, ...]]] = {
    "stamps_ns": (np.int64, ()),
    "is_view": (np.bool_, ()),
    "view_ids": (np.int64, ()),
    "poses": (np.float64, (3,)),
    "dead_reckoning": (np.float64, (3,)),
    "node_ids": (np.int64, ()),
    "offsets": (np.float64, (3,)),
    "actions": (np.int64, (3,)),
    "cells": (np.float64, (3,)),
    "step_seconds": (np.float64, (3,)),
}
_PER_NODE: Mapping[str, tuple[type, tuple[int, ...]]] = {
    "nodes": (np.float64, (3,)),
    "node_stamps_ns": (np.int64, ()),
    "node_views": (np.int64, ()),
}
_PER_VIEW = ("activity_th", "activity_x", "activity_y")
_ARRAYS = (*_PER_STEP, *_PER_NODE, *_PER_VIEW, "links", "refused", "truth")


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class RatSlamRun:
    """A run, step by step: n steps (odometry and views), m of them views, k final nodes.

    Frames: poses are in the map frame, which starts where the robot starts, at the heading that
    the map is configured with. Ground truth is in the world frame.

    Attributes:
        name: name of the drive.
        views: source of the view ids, as text for users.
        odometry: source of the odometry, as text for users.
        preset: preset of the pose cells and the map.
        config: values of the configuration.
        stamps_ns: int64 (n), not decreasing.
        is_view: bool (n), steps with a view.
        view_ids: int64 (n), the view that was recognised or created; -1 for none.
        poses: float64 (n, 3), x, y in metres and heading in radians on the map at that time.
        dead_reckoning: float64 (n, 3), the same by odometry alone.
        node_ids: int64 (n), the node where the robot was last; -1 before the first node.
        offsets: float64 (n, 3), the pose in that node's frame; the map pose before the first node.
        actions: int64 (n, 3), kind (``ActionKind``), source, target.
        cells: float64 (n, 3), the pose decoded from the pose cells: x, y, th in cells.
        truth: float64 (n, 3), the true pose, NaN in steps where it is unknown; None without
            ground truth.
        step_seconds: float64 (n, 3), time spent on the view, the pose cells and the map.
        why: a sentence for each view step, in order.
        notes: other events, such as gaps in the odometry, in order.
        nodes: float64 (k, 3), final x, y and heading.
        node_stamps_ns: int64 (k), time at which each was made.
        node_views: int64 (k), the view it was made from.
        links: of dtype ``LINK``, in order of creation.
        refused: of dtype ``REFUSED``, loops that did not fit.
        activity_th, activity_x, activity_y: float32 (m, 36), (m, size), (m, size), the cells'
            activity summed over the other axes, at each view step.
    """

    name: str
    views: str
    odometry: str
    preset: str
    config: Mapping[str, Any] = field(default_factory=dict)
    stamps_ns: Integers
    is_view: NDArray[np.bool_]
    view_ids: Integers
    poses: Floats
    dead_reckoning: Floats
    node_ids: Integers
    offsets: Floats
    actions: Integers
    cells: Floats
    step_seconds: Floats
    truth: Floats | None = None
    why: Sequence[str] = ()
    notes: Sequence[str] = ()
    nodes: Floats
    node_stamps_ns: Integers
    node_views: Integers
    links: NDArray[np.void]
    refused: NDArray[np.void]
    activity_th: Activity
    activity_x: Activity
    activity_y: Activity

    def __post_init__(self) -> None:
        for name in (*_ARRAYS, "why"):
            value = getattr(self, name)
            if not (np.ndim(value) or (value is None and name == "truth")):
                raise ShapeError(f"{name}: {type(value).__name__}, expected an array")
        steps, nodes = len(self.stamps_ns), len(self.nodes)
        for wanted, count in ((_PER_STEP, steps), (_PER_NODE, nodes)):
            for name, (kind, shape) in wanted.items():
                _check(name, getattr(self, name), np.dtype(kind), (count, *shape))
        if self.truth is not None:
            _check("truth", self.truth, np.dtype(np.float64), (steps, 3))
        _check("links", self.links, LINK, (len(self.links),))
        _check("refused", self.refused, REFUSED, (len(self.refused),))
        views = int(np.count_nonzero(self.is_view))
        for name in _PER_VIEW:
            array = getattr(self, name)
            _check(name, array, np.dtype(np.float32), (views, *array.shape[1:2]))
        if len(self.why) != views:
            raise ShapeError(f"why: {len(self.why)} sentences, expected {views}: one a view")
        _check_ids("a step", self.node_ids, NO_NODE, nodes)
        for end in ("source", "target"):
            _check_ids("a link", self.links[end], 0, nodes)

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def steps_at(self, stamps_ns: Integers) -> Integers:
        """int64, the last step at exactly each of these stamps; -1 where there is none."""
        found = np.searchsorted(self.stamps_ns, stamps_ns, side="right") - 1
        there = self.stamps_ns[found] if len(self) else found
        return np.where((found >= 0) & (there == stamps_ns), found, -1)

    def __repr__(self) -> str:
        """One line, without the arrays of thousands of rows."""
        sizes = {"step": len(self), "node": len(self.nodes), "link": len(self.links)}
        counts = ", ".join(counted(size, noun) for noun, size in sizes.items())
        return f"<RatSlamRun {self.name}: {counts}>"

    @property
    def seconds(self) -> Floats:
        """float64 (n), time of each step since the first one."""
        return (self.stamps_ns - self.stamps_ns[:1]) / 1e9

    @property
    def final_poses(self) -> Floats:
        """float64 (n, 3): pose of each step on the final map.

        This is the final pose of the node where the robot was last, composed with ``offsets``.
        """
        return place_on_map(self.nodes, self.node_ids, self.offsets)

    def save(self, target: PathLike | BinaryIO) -> None:
        """Write one .npz to a path, whole or not at all, or to a stream.

        Raises:
            DataError: the file cannot be written.
        """
        texts = [one.name for one in fields(self) if one.name not in _ARRAYS]
        about = {name: getattr(self, name) for name in texts}
        about |= {"config": dict(self.config), "why": list(self.why), "notes": list(self.notes)}
        arrays = {name: getattr(self, name) for name in _ARRAYS}
        save_archive(target, FORMAT, about, arrays, compress=True)

    @classmethod
    def load(cls, source: PathLike | BinaryIO) -> "RatSlamRun":
        """Read what ``save`` wrote, from a path or a stream.

        Raises:
            DataError: the file is missing, truncated, of another version or of another kind; the
                message names it.
        """
        with load_archive(source, FORMAT, "a stored RatSLAM run") as (about, arrays):
            kept = {name: array for name, array in arrays.items() if name in _ARRAYS}
            return check_types(cls(**{**about, **kept}))


def place_on_map(nodes: Floats, ids: Integers, offsets: Floats) -> Floats:
    """Transform poses from their nodes' frames to the map frame.

    Args:
        nodes: float64 (k, 3), x, y in metres, heading in radians.
        ids: int64 (n), the node of each pose; -1 for the origin of the map.
        offsets: float64 (n, 3), the poses in the frames of their nodes.

    Returns:
        float64 (n, 3), headings in (-pi, pi].
    """
    origin = np.concatenate([nodes, np.zeros((1, 3))])[ids]
    return compose(origin, offsets)


def _check_ids(what: str, ids: Integers, first: int, count: int) -> None:
    wrong = ids[(ids < first) | (ids >= count)]
    if wrong.size:
        raise DataError(f"{what} names node {wrong[0]} of {count}")


def _check(name: str, array: Any, kind: np.dtype[Any], shape: tuple[int, ...]) -> None:
    if not isinstance(array, np.ndarray) or array.dtype != kind or array.shape != shape:
        found = f"{getattr(array, 'dtype', type(array).__name__)} {np.shape(array)}"
        raise ShapeError(f"{name}: {found}, expected {kind} {shape}")
