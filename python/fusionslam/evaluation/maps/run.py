# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``RatSlamRun``: everything that a run of RatSLAM did, as arrays; what is judged and drawn."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from fusionslam.errors import DataError, ShapeError
from fusionslam.geometry.se2 import compose
from fusionslam.storage.archive import load_archive, save_archive
from fusionslam.storage.arrays import Floats, Integers
from fusionslam.storage.files import PathLike

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
"""A link: ids; metres; direction of the way and rotation, radians from the source's heading;
seconds; deviations of the way (each axis) and of the rotation that relaxation weighs it by, metres
and radians."""

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
"""A loop that was refused: when, between which nodes, by how much it did not fit, and how much
would have been allowed."""

NO_NODE = -1
"""Node of a step before the first node."""

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
    """A run, step by step: n steps (odometry and views), m of them views, k nodes in the end.

    Frames: poses are on the map; the map's frame begins where the robot began, at the heading that
    the map is configured with. Truth is in the world's frame.

    Attributes:
        name: of what was driven.
        views: what recognised places, for people.
        odometry: what told the way, for people.
        preset: of the cells and the map.
        config: values of the configuration.
        stamps_ns: int64 (n), increasing or equal.
        is_view: bool (n), whether something was looked at in this step.
        view_ids: int64 (n), the view that was recognised or is new; -1 for none.
        poses: float64 (n, 3), x, y in metres and heading in radians on the map as it was then.
        dead_reckoning: float64 (n, 3), the same by odometry alone.
        node_ids: int64 (n), the node that the robot was at last; -1 before the first one.
        offsets: float64 (n, 3), the pose in the frame of that node; before the first one: the pose.
        actions: int64 (n, 3), kind (``ActionKind``), source, target.
        cells: float64 (n, 3), the decoded pose of the cells: x, y, th in cells.
        truth: float64 (n, 3), the true pose, NaN in steps of which nobody knows it; None where
            nobody knows any.
        step_seconds: float64 (n, 3), what looking, the cells and the map took.
        why: a sentence for each view step, in order.
        notes: what else happened, such as gaps in odometry, in order.
        nodes: float64 (k, 3), x, y, heading, in the end.
        node_stamps_ns: int64 (k), when each was made.
        node_views: int64 (k), the view it was made of.
        links: of dtype ``LINK``, in the order of their making.
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

    def __repr__(self) -> str:
        """In a line: arrays of thousands of rows are no help."""
        counts = f"{len(self)} steps, {len(self.nodes)} nodes, {len(self.links)} links"
        return f"<RatSlamRun {self.name}: {counts}>"

    @property
    def seconds(self) -> Floats:
        """float64 (n), time of each step since the first one."""
        return (self.stamps_ns - self.stamps_ns[:1]) / 1e9

    @property
    def final_poses(self) -> Floats:
        """float64 (n, 3): where each step lies on the map as it is in the end.

        The node that the robot was at last, and from there the way as it was seen then.
        """
        return placed(self.nodes, self.node_ids, self.offsets)

    def save(self, target: PathLike | BinaryIO) -> None:
        """Write one .npz to a path, whole or not at all, or to a stream.

        Raises:
            DataError: the file cannot be written.
        """
        about = {name: getattr(self, name) for name in _texts()}
        about |= {"config": dict(self.config), "why": list(self.why), "notes": list(self.notes)}
        arrays = {name: getattr(self, name) for name in _ARRAYS}
        save_archive(target, FORMAT, about, arrays, compress=True)

    @classmethod
    def load(cls, source: PathLike | BinaryIO) -> "RatSlamRun":
        """Read what ``save`` wrote, from a path or a stream.

        Raises:
            DataError: the file is missing, cut short, of another version or something else; the
                message names it.
        """
        with load_archive(source, FORMAT, "a stored RatSLAM run") as (about, arrays):
            kept = {name: array for name, array in arrays.items() if name in _ARRAYS}
            return cls(**{**about, **kept})


def placed(nodes: Floats, ids: Integers, offsets: Floats) -> Floats:
    """Poses seen from nodes, on the map.

    Args:
        nodes: float64 (k, 3), x, y in metres, heading in radians.
        ids: int64 (n), of the node each pose is seen from; -1 for the origin of the map.
        offsets: float64 (n, 3), the poses in the frame of their node.

    Returns:
        float64 (n, 3), headings in (-pi, pi].
    """
    origin = np.concatenate([nodes, np.zeros((1, 3))])[ids]
    return compose(origin, offsets)


def _texts() -> list[str]:
    return [one.name for one in fields(RatSlamRun) if one.name not in _ARRAYS]


def _check_ids(what: str, ids: Integers, first: int, count: int) -> None:
    wrong = ids[(ids < first) | (ids >= count)]
    if wrong.size:
        raise DataError(f"{what} names node {wrong[0]} of {count}")


def _check(name: str, array: Any, kind: np.dtype[Any], shape: tuple[int, ...]) -> None:
    if not isinstance(array, np.ndarray) or array.dtype != kind or array.shape != shape:
        found = f"{getattr(array, 'dtype', type(array).__name__)} {np.shape(array)}"
        raise ShapeError(f"{name}: {found}, expected {kind} {shape}")
