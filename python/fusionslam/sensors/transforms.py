# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A tree of static and moving transforms between a robot's frames (ROS's TF).

Foote 2013, "tf: The transform library". Between two samples, positions are interpolated linearly
and rotations at constant angular velocity.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fusionslam.base.arrays import Matrix
from fusionslam.config import nearest_name
from fusionslam.errors import DataError, ShapeError
from fusionslam.geometry.rigid import is_rigid
from fusionslam.geometry.se3 import exp, inverse, log
from fusionslam.sensors.messages import NANOSECONDS, FrameTransform, as_nanoseconds, as_stamp

_WIDEST_NS = NANOSECONDS // 4
"""Between samples farther apart a robot may have done anything."""


class TransformError(DataError):
    """A transform is not known; the message names frames and times.

    Attributes:
        may_come: whether later messages may provide it.
    """

    def __init__(
        self, message: str, *, may_come: bool, code: str, fields: Sequence[str] = ()
    ) -> None:
        super().__init__(message, code=code, fields=fields)
        self.may_come = may_come


@dataclass(eq=False)
class _Link:
    """Pose of a frame in its parent: one static matrix, or samples by ascending stamp."""

    parent: str
    static: Matrix | None = None
    stamps: list[int] = field(default_factory=list)
    samples: list[Matrix] = field(default_factory=list)

    def put(self, stamp_ns: int, matrix: Matrix) -> None:
        """Add a sample; the same stamp again replaces it."""
        place = bisect_left(self.stamps, stamp_ns)
        if place < len(self.stamps) and self.stamps[place] == stamp_ns:
            self.samples[place] = matrix
        else:
            self.stamps.insert(place, stamp_ns)
            self.samples.insert(place, matrix)

    def forget_before(self, stamp_ns: int) -> None:
        """Drop older samples, but always keep two."""
        count = min(bisect_left(self.stamps, stamp_ns), len(self.stamps) - 2)
        if count > 0:
            del self.stamps[:count], self.samples[:count]

    def at(self, stamp_ns: int) -> Matrix:
        """parent_from_child, interpolated, or extrapolated from the outermost two samples."""
        if self.static is not None:
            return self.static
        if len(self.stamps) == 1:
            return self.samples[0]
        after = min(max(bisect_left(self.stamps, stamp_ns), 1), len(self.stamps) - 1)
        before = after - 1
        span = self.stamps[after] - self.stamps[before]
        share = (stamp_ns - self.stamps[before]) / span
        return _between(self.samples[before], self.samples[after], share)

    def at_all(self, stamps_ns: NDArray[np.int64]) -> Matrix:
        """parent_from_child at several times, (K, 4, 4), moving along arcs between samples."""
        if self.static is not None or len(self.stamps) == 1:
            return np.broadcast_to(self.at(0), (len(stamps_ns), 4, 4))
        last = len(self.stamps) - 1
        after = [min(max(bisect_left(self.stamps, each), 1), last) for each in stamps_ns.tolist()]
        stamps = np.array([[self.stamps[row - 1], self.stamps[row]] for row in after])
        shares = (stamps_ns - stamps[:, 0]) / (stamps[:, 1] - stamps[:, 0])
        samples = np.array([[self.samples[row - 1], self.samples[row]] for row in after])
        steps = log(inverse(samples[:, 0]) @ samples[:, 1])
        return np.asarray(samples[:, 0] @ exp(shares[:, None] * steps))


class TransformTree:
    """All transforms of a robot; gives the transform between any two frames at any time.

    Args:
        history_s: how long moving transforms are kept, in seconds before the newest of the same
            frame; None keeps all, as for recordings.
        extrapolation_s: how far beyond the first or last sample of a moving frame a lookup may
            lie, in seconds; the outermost motion is extrapolated.
    """

    def __init__(self, *, history_s: float | None = 10.0, extrapolation_s: float = 0.0) -> None:
        self._history = None if history_s is None else as_nanoseconds("history_s", history_s)
        self._tolerance = as_nanoseconds("extrapolation_s", extrapolation_s)
        self._links: dict[str, _Link] = {}

    @property
    def frames(self) -> list[str]:
        """Names of all frames, sorted."""
        return sorted({*self._links, *(link.parent for link in self._links.values())})

    def add(self, transform: FrameTransform) -> None:
        """Add a transform. If a frame is both moving and static, the moving ones count.

        Raises:
            ShapeError: no FrameTransform.
            DataError: the matrix is not a rigid transform, the stamp no whole number, or the frame
                would become its own ancestor or already has another parent. The tree stays as it
                was.
        """
        if not isinstance(transform, FrameTransform):
            found = type(transform).__name__
            raise ShapeError(f"transform: expected a FrameTransform, got {found}")
        parent, child = _name(transform.parent), _name(transform.child)
        matrix = _rigid(transform.parent_from_child, parent, child)
        stamp_ns = None if transform.static else as_stamp(transform.stamp_ns)
        link = self._links.get(child)
        if link is None:
            way = [child, parent, *self._ancestors(parent)]
            if child in way[1:]:
                loop = way[: way.index(child, 1) + 1]
                message = f"transforms form a loop: {' -> '.join(loop)}"
                raise DataError(message, code="frame-loop", fields=loop)
            link = self._links[child] = _Link(parent)
        elif link.parent != parent:
            message = f"frame '{child}' has two parents, '{link.parent}' and '{parent}'"
            raise DataError(message, code="two-parents", fields=(child, link.parent, parent))
        if stamp_ns is not None:
            link.static = None
            link.put(stamp_ns, matrix)
            if self._history is not None:
                link.forget_before(link.stamps[-1] - self._history)
        elif not link.stamps:
            link.static = matrix

    def forget_moving(self) -> None:
        """Drop all samples of moving frames after the clock jumped back."""
        self._links = {
            child: link for child, link in self._links.items() if link.static is not None
        }

    def forget_after(self, stamp_ns: int) -> None:
        """Drop samples of moving frames later than a stamp, to which the clock jumped back."""
        for link in self._links.values():
            count = bisect_right(link.stamps, stamp_ns)
            del link.stamps[count:], link.samples[count:]
        self._links = {
            child: link
            for child, link in self._links.items()
            if link.static is not None or link.stamps
        }

    def newest(self, child: str) -> int | None:
        """Stamp of the last sample of a moving frame; None if there is none."""
        link = self._links.get(_name(child))
        return link.stamps[-1] if link and link.stamps else None

    def lookup(self, target: str, source: str, stamp_ns: int) -> Matrix:
        """float64 (4, 4), target_from_source at a time.

        Raises:
            TransformError: a frame is unknown, the frames are not connected, or a frame on the
                path has no samples around that time.
        """
        if _name(target) == _name(source):  # needs no transform, as of sensors in one frame
            return np.eye(4)
        stamp_ns, (up, down) = as_stamp(stamp_ns), self._ways(target, source)
        target_from_top = np.linalg.inv(self._climb(down, stamp_ns))
        return np.asarray(target_from_top @ self._climb(up, stamp_ns), dtype=np.float64)

    def lookup_all(self, target: str, source: str, stamps_ns: NDArray[np.int64]) -> Matrix:
        """float64 (K, 4, 4), target_from_source at several times, none of them extrapolated.

        Between samples frames move along arcs, at constant velocity in their own axes.

        Raises:
            TransformError: as ``lookup``; or the samples around a time are more than 0.25 s apart
                (code "gap").
        """
        result: Matrix = np.broadcast_to(np.eye(4), (len(stamps_ns), 4, 4))
        if _name(target) == _name(source):
            return result
        up, down = self._ways(target, source)
        for child in [*up, *down]:
            for stamp_ns in (int(stamps_ns.min()), int(stamps_ns.max())):
                self._check_time(child, self._links[child], stamp_ns, tolerance=0)
            self._check_gaps(child, self._links[child], stamps_ns)
        for child in up:
            result = self._links[child].at_all(stamps_ns) @ result
        below: Matrix = np.eye(4)
        for child in down:
            below = self._links[child].at_all(stamps_ns) @ below
        return np.asarray(np.linalg.inv(below) @ result, dtype=np.float64)

    def chain(self, target: str, source: str) -> list[str]:
        """The frames on the path from target to source, both included.

        Raises:
            TransformError: a frame is unknown, or the frames are not connected.
        """
        up, down = self._ways(target, source)
        top = self._links[up[-1]].parent if up else source
        return [*down, _name(top), *reversed(up)]

    def root(self, frame: str) -> str:
        """Root of the tree that contains a frame."""
        name = _name(frame)
        return [name, *self._ancestors(name)][-1]

    def draw(self) -> str:
        """Text of all trees, one frame per line, children indented below their parents."""
        roots = [name for name in self.frames if name not in self._links]
        return "\n".join(line for root in roots for line in self._branch(root, ""))

    def _ancestors(self, name: str) -> Iterator[str]:
        while link := self._links.get(name):
            name = link.parent
            yield name

    def _ways(self, target: str, source: str) -> tuple[list[str], list[str]]:
        """Frames from source and from target up to below their nearest common ancestor."""
        ups, downs = (
            [name, *self._ancestors(name)] for name in map(self._resolve, (source, target))
        )
        common = next((name for name in ups if name in downs), None)
        if common is None:
            raise TransformError(
                f"no transform links '{target}' and '{source}'; the trees are\n{self.draw()}",
                may_come=True,
                code="frames-not-linked",
                fields=(target, source),
            )
        return ups[: ups.index(common)], downs[: downs.index(common)]

    def _resolve(self, name: str) -> str:
        frames, bare = self.frames, _name(name)
        if bare in frames:
            return bare
        near = nearest_name(bare, frames)
        hint = f"did you mean {near!r}? " if near else ""
        known = ", ".join(frames) or "none"
        raise TransformError(
            f"no frame '{bare}'; {hint}known: {known}",
            may_come=True,
            code="no-frame",
            fields=(bare,),
        )

    def _climb(self, way: list[str], stamp_ns: int) -> Matrix:
        """ancestor_from_frame, for the frames from the lowest to the one below the ancestor."""
        matrix = np.eye(4)
        for child in way:
            link = self._links[child]
            self._check_time(child, link, stamp_ns, self._tolerance)
            matrix = link.at(stamp_ns) @ matrix
        return matrix

    def _check_time(self, child: str, link: _Link, stamp_ns: int, tolerance: int) -> None:
        if link.static is not None:
            return
        first, last = link.stamps[0], link.stamps[-1]
        early, late = first - stamp_ns, stamp_ns - last
        if max(early, late) <= tolerance:
            return
        off = f"{_seconds(early)} s earlier" if early > 0 else f"{_seconds(late)} s later"
        raise TransformError(
            f"'{child}' in '{link.parent}' is known from {_seconds(first)} s to {_seconds(last)} s,"
            f" needed at {_seconds(stamp_ns)} s, {off}",
            may_come=late > 0,
            code="too-late" if late > 0 else "too-early",
            fields=(link.parent, child),
        )

    def widest(self, target: str, source: str, stamps_ns: NDArray[np.int64]) -> int:
        """Longest time between samples around some times on the way between frames, nanoseconds."""
        up, down = self._ways(target, source)
        links = [self._links[child] for child in (*up, *down)]
        return max((self._widest_of(link, stamps_ns) for link in links), default=0)

    def _widest_of(self, link: _Link, stamps_ns: NDArray[np.int64]) -> int:
        first = max(bisect_right(link.stamps, int(stamps_ns.min())) - 1, 0)
        last = bisect_left(link.stamps, int(stamps_ns.max())) + 1
        return max(np.diff(link.stamps[first:last]).tolist(), default=0)

    def _check_gaps(self, child: str, link: _Link, stamps_ns: NDArray[np.int64]) -> None:
        gap_ns = self._widest_of(link, stamps_ns)
        if gap_ns > _WIDEST_NS:
            raise TransformError(
                f"'{child}' in '{link.parent}' is not known for {_seconds(gap_ns)} s around "
                f"{_seconds(int(stamps_ns.min()))} s, expected samples at most "
                f"{_seconds(_WIDEST_NS)} s apart",
                may_come=False,
                code="gap",
                fields=(link.parent, child),
            )

    def _branch(self, name: str, indent: str) -> Iterator[str]:
        link = self._links.get(name)
        kind = "" if link is None else " (moving)" if link.static is None else " (static)"
        yield f"{indent}{name}{kind}"
        for child in sorted(child for child, link in self._links.items() if link.parent == name):
            yield from self._branch(child, indent + "  ")


def _name(frame: str) -> str:
    """Remove the leading slash that ROS once put before frame names."""
    if not isinstance(frame, str):
        raise DataError(f"frame {frame!r}: expected a name", code="no-name", fields=(str(frame),))
    return frame.removeprefix("/")


def _rigid(value: Matrix, parent: str, child: str) -> Matrix:
    with suppress(TypeError, ValueError):  # text, rows of different lengths
        matrix = np.asarray(value, dtype=np.float64)
        if matrix.shape == (4, 4) and is_rigid(matrix):
            return matrix
    raise DataError(
        f"transform of '{child}' in '{parent}' is no rotation and translation, finite and 4x4: "
        f"{np.asarray(value, dtype=object).tolist()}",
        code="no-transform",
        fields=(parent, child),
    )


def _between(first: Matrix, second: Matrix, share: float) -> Matrix:
    """Interpolate from the first (share 0) to the second (share 1), or beyond."""
    start = Rotation.from_matrix(first[:3, :3])
    turn = (start.inv() * Rotation.from_matrix(second[:3, :3])).as_rotvec()
    matrix = np.eye(4)
    matrix[:3, :3] = (start * Rotation.from_rotvec(share * turn)).as_matrix()
    matrix[:3, 3] = (1 - share) * first[:3, 3] + share * second[:3, 3]
    return matrix


def _seconds(stamp_ns: int) -> str:
    return f"{stamp_ns / NANOSECONDS:.3f}"
