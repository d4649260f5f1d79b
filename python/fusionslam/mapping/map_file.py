# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What the file of a map holds: sessions, keyframes, clouds, vectors, edges, poses.

docs/reference/map_file.md describes the tables.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from operator import index
from typing import Any, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats, Floats32, Integers, Matrix
from fusionslam.errors import ConfigError, DataError
from fusionslam.geometry.globe import MapOrigin
from fusionslam.geometry.rigid import is_rigid
from fusionslam.mapping.edge import Edge, Kind, State, check_covariance
from fusionslam.mapping.map_database import MapDatabase
from fusionslam.mapping.map_settings import check_session_name
from fusionslam.mapping.satellites import Position
from fusionslam.registration.result import Refusal

_FULL_BLOCK = 60_000
"""Bytes of vectors in a block: it fills a page."""
_FORGOTTEN = "forgotten sessions"
_FIXES, ORIGINS, _REASON = "fixes of", "origins", "reason"


class StoredKeyframe(NamedTuple):
    """A keyframe without its clouds.

    Attributes:
        id: its number.
        session: number of its session.
        frame: number of the recording's frame.
        stamp_ns: time stamp; 0 if unknown.
        odometry: float64 (4, 4), odom_from_cloud.
        robot_from_cloud: float64 (4, 4).
    """

    id: int
    session: int
    frame: int
    stamp_ns: int
    odometry: Matrix
    robot_from_cloud: Matrix


class StoredFrames(NamedTuple):
    """Frames that are no keyframes, between a keyframe and the next one of its session.

    Attributes:
        numbers: int64 (n), of the recording's frames.
        stamps_ns: int64 (n), time stamps; 0 if unknown.
        motions: float64 (n, 6), poses of the robot by odometry, seen from the robot at the
            keyframe, as small motions.
    """

    numbers: Integers
    stamps_ns: Integers
    motions: Floats


class StoredCloud(NamedTuple):
    """The clouds of a keyframe, packed.

    Attributes:
        evidence: ``PreparedCloud.to_bytes``.
        image: bits of its images from above; None if it has none.
        ground_level: height of the ground in the cloud's frame, metres.
        points: ``pack_cloud`` of the coloured cloud.
    """

    evidence: bytes
    image: bytes | None
    ground_level: float
    points: bytes


class MapFile(MapDatabase):
    """What a map's file holds, read and written.

    Raises:
        DataError: clouds and vectors are read after another process deleted a session (code
            "changed").
    """

    _forgotten: Any = None

    def check_writable(self) -> None:
        """Raise ConfigError for a map that was opened read-only."""
        if self.read_only:
            raise ConfigError(
                f"{self.path} was opened read-only: nothing can be changed",
                code="read-only",
                fields=(str(self.path),),
            )

    def setting(self, name: str) -> Any:
        """Return a value that was stored; None if there is none."""
        values = dict(self._table("setting"))
        with self.decoding():
            return json.loads(values[name]) if name in values else None

    def store_setting(self, name: str, value: Any) -> None:
        """Store a value, which JSON can hold."""
        self._store("setting", name, json.dumps(value))

    def numbered_settings(self, name: str) -> dict[int, Any]:
        """Return values whose names are this one and a number, in the order of the numbers."""
        with self.decoding():
            found = {
                int(key.removeprefix(f"{name} ")): json.loads(value)
                for key, value in self._table("setting")
                if key.startswith(f"{name} ")
            }
        return dict(sorted(found.items()))

    def delete_setting(self, name: str) -> None:
        """Delete a value."""
        self._delete("setting", "name = ?", name)

    def sessions(self) -> dict[str, int]:
        """Return the numbers of the sessions by name, in the order in which they began."""
        rows = self._table("session", "ORDER BY id")
        with self.decoding():
            for _, name in rows:
                check_session_name(name)
            return {name: number for number, name in rows}

    def add_session(self, name: str) -> int:
        """Add a session; return its number."""
        number = max(self.sessions().values(), default=0) + 1
        self._store("session", number, name)
        return number

    def forget_session(self, number: int) -> None:
        """Delete a session with its keyframes and their edges."""
        gone = {each.id for each in self.keyframes() if each.session == number}
        for descriptor, first, keyframes, rows in self._table("vector"):
            numbers = np.frombuffer(keyframes, np.int64)
            keep = ~np.isin(numbers, [*gone])
            if keep.all():
                continue
            self._delete("vector", "descriptor = ? AND first = ?", descriptor, first)
            if keep.any():
                kept = np.frombuffer(rows, np.float32).reshape(len(numbers), -1)[keep]
                self._put_block(descriptor, numbers[keep], kept)
        names = [name for name, each in self.sessions().items() if each == number]
        for name in names:
            for kind in ("recording of", _FIXES):
                self.delete_setting(f"{kind} {name}")
        self.delete_setting(ORIGINS)
        own = "IN (SELECT id FROM keyframe WHERE session = ?)"
        self._delete("solution", "TRUE")
        self._delete("edge", f"a {own} OR b {own}", number, number)
        for table in ("cloud", "frame"):
            self._delete(table, f"keyframe {own}", number)
        self._delete("keyframe", "session = ?", number)
        self._delete("session", "id = ?", number)
        self.store_setting(_FORGOTTEN, (self.setting(_FORGOTTEN) or 0) + 1)

    def keyframes(self) -> list[StoredKeyframe]:
        """Return all keyframes, by number."""
        rows = self._table("keyframe", "ORDER BY id")
        self._forgotten = self.setting(_FORGOTTEN)
        with self.decoding():
            return [
                StoredKeyframe(
                    number,
                    index(session),
                    index(frame),
                    index(stamp),
                    _pose(odometry),
                    _pose(mount),
                )
                for number, session, frame, stamp, odometry, mount in rows
            ]

    def add_keyframe(
        self, keyframe: StoredKeyframe, cloud: StoredCloud, vectors: Mapping[str, Floats32]
    ) -> None:
        """Add a keyframe with all that is known of it."""
        poses = keyframe.odometry.tobytes(), keyframe.robot_from_cloud.tobytes()
        self._store("keyframe", *map(int, keyframe[:4]), *poses)
        self._store("cloud", keyframe.id, *cloud)
        for descriptor, vector in vectors.items():
            self._append_vector(descriptor, keyframe.id, vector)

    def add_frames(self, keyframe: int, first: int, frames: StoredFrames) -> None:
        """Add frames after a keyframe, of which the file has so many already (``first``)."""
        columns = zip(frames, (np.int64, np.int64, np.float64), strict=True)
        self._store("frame", keyframe, first, *(v.astype(kind).tobytes() for v, kind in columns))

    def frames_after(self, keyframe: int) -> StoredFrames:
        """Return the frames between a keyframe and the next one of its session."""
        rows = self._rows("frame", "WHERE keyframe = ? ORDER BY first", keyframe)
        self._check_forgotten()
        with self.decoding():
            numbers, stamps, motions = (b"".join(row[k] for row in rows) for k in (2, 3, 4))
            frames = StoredFrames(
                np.frombuffer(numbers, np.int64),
                np.frombuffer(stamps, np.int64),
                np.frombuffer(motions).reshape(-1, 6).copy(),
            )
            if len({len(each) for each in frames}) > 1 or not np.isfinite(frames.motions).all():
                raise ValueError(f"frames after keyframe {keyframe}: expected as many finite poses")
            return frames

    def cloud(self, keyframe: int) -> StoredCloud:
        """Return the clouds of a keyframe."""
        rows = self._rows("cloud", "WHERE keyframe = ?", keyframe)
        self._check_forgotten()
        if not rows:
            raise self._damaged(f"keyframe {keyframe} has no cloud")
        _, evidence, image, level, points = rows[0]
        with self.decoding():
            bits = None if image is None else bytes(memoryview(image))
            return StoredCloud(
                bytes(memoryview(evidence)), bits, _finite(level), bytes(memoryview(points))
            )

    def vectors(self) -> dict[str, tuple[Integers, Floats32]]:
        """Return the numbers of keyframes, and their vectors, float32 (n, D), by descriptor."""
        blocks: dict[str, list[tuple[Integers, Floats32]]] = {}
        stored = self._table("vector", "ORDER BY descriptor, first")
        self._check_forgotten()
        with self.decoding():
            for name, _, keyframes, rows in stored:
                numbers = np.frombuffer(keyframes, np.int64)
                values = np.frombuffer(rows, np.float32).reshape(len(numbers), -1)
                blocks.setdefault(name, []).append((numbers, values))
            return {
                name: (
                    np.concatenate([numbers for numbers, _ in parts]),
                    np.concatenate([rows for _, rows in parts]),
                )
                for name, parts in blocks.items()
            }

    def edges(self) -> list[Edge]:
        """Return all edges, by number; their nodes are keyframes."""
        rows = self._table("edge", "ORDER BY id")
        with self.decoding():
            return [
                Edge(
                    number,
                    _one_of(kind, Kind),
                    index(a),
                    index(b),
                    _pose(pose),
                    check_covariance("covariance", np.frombuffer(covariance).reshape(6, 6)),
                    _one_of(state, State),
                    None if code is None else Refusal(_text(code), _finite(value), _text(text)),
                )
                for number, kind, a, b, pose, covariance, state, code, value, text in rows
            ]

    def store_edge(self, edge: Edge) -> None:
        """Add an edge, or replace the one of its number."""
        reason = (None, None, None)
        if edge.reason is not None:
            reason = (edge.reason.code, float(edge.reason.number), edge.reason.text)  # type: ignore[assignment]
        ends = edge.number, edge.kind, edge.a, edge.b
        values = edge.pose.tobytes(), edge.covariance.tobytes(), edge.state
        self._store("edge", *ends, *values, *reason)

    def delete_edge(self, number: int) -> None:
        """Delete an edge."""
        self._delete("edge", "id = ?", number)

    def solution_row(self) -> tuple[Any, ...] | None:
        """Return the last solution as it is stored; None if there is none."""
        rows = self._table("solution")
        return rows[0] if rows else None

    def restore_solution(self, row: tuple[Any, ...] | None) -> None:
        """Store what ``solution_row`` returned."""
        if row is None:
            self._delete("solution", "TRUE")
        else:
            self._store("solution", *row)

    def solution(self) -> tuple[Integers, Floats, Integers] | None:
        """Return keyframes, poses, float64 (n, 4, 4), and parts, as the graph was solved last."""
        rows = self._table("solution")
        if not rows:
            return None
        with self.decoding():
            numbers, parts = (np.frombuffer(rows[0][k], np.int64) for k in (1, 3))
            poses = np.tile(np.eye(4), (len(numbers), 1, 1))
            poses[:, :3] = np.frombuffer(rows[0][2]).reshape(-1, 3, 4)
            if len(parts) != len(numbers) or not np.isfinite(poses).all():
                raise ValueError("the solution is not that of its keyframes")
            return numbers, poses, parts

    def store_solution(self, keyframes: Integers, poses: Floats, parts: Integers) -> None:
        """Store where the solved graph has the keyframes."""
        self._store(
            "solution",
            0,
            keyframes.astype(np.int64).tobytes(),
            poses[:, :3].astype(np.float64).tobytes(),
            parts.astype(np.int64).tobytes(),
        )

    def positions(self) -> list[Position]:
        """Return the positions that satellites tell, by session and time; nodes are keyframes."""
        values = dict(self._table("setting"))
        with self.decoding():
            rows = [json.loads(values.get(f"{_FIXES} {name}", "[]")) for name in self.sessions()]
            numbers = np.array([row for each in rows for row in each], np.float64).reshape(-1, 16)
            if not np.isfinite(numbers).all():
                raise ValueError("a fix is not finite")
            return [
                Position(int(row[0]), row[1:4], row[4:7], row[7:].reshape(3, 3)) for row in numbers
            ]

    def store_positions(self, session: str, positions: Sequence[Position]) -> None:
        """Store the positions of a session that satellites tell, instead of those it had."""
        self.store_setting(f"{_FIXES} {session}", _encode(positions))

    def has_positions(self, session: str, positions: Sequence[Position]) -> bool:
        """Whether these are the positions of a session."""
        return bool(self.setting(f"{_FIXES} {session}") == _encode(positions))

    def origins(self) -> dict[int, MapOrigin]:
        """Return where on the globe parts of the map are, by their numbers."""
        stored = self.setting(ORIGINS)
        with self.decoding():
            return {int(part): MapOrigin(**origin) for part, origin in (stored or {}).items()}

    def store_origins(self, origins: Mapping[int, MapOrigin]) -> None:
        """Store where on the globe parts of the map are."""
        self.store_setting(ORIGINS, {part: at.model_dump() for part, at in origins.items()})

    def reason(self) -> Refusal | None:
        """Return what was wrong with the graph as a whole when it was solved last."""
        stored = self.setting(_REASON)
        with self.decoding():
            if stored is None:
                return None
            return Refusal(_text(stored["code"]), _finite(stored["number"]), _text(stored["text"]))

    def store_reason(self, reason: Refusal | None) -> None:
        """Store what is wrong with the graph as a whole."""
        self.store_setting(_REASON, None if reason is None else asdict(reason))

    def _append_vector(self, descriptor: str, keyframe: int, vector: Floats32) -> None:
        newest = "WHERE descriptor = ? ORDER BY first DESC LIMIT 1"
        for _, first, keyframes, stored in self._rows("vector", newest, descriptor):
            if len(stored) + vector.nbytes <= _FULL_BLOCK:
                numbers = np.append(np.frombuffer(keyframes, np.int64), keyframe)
                rows = np.frombuffer(stored, np.float32).reshape(-1, len(vector))
                self._put_block(descriptor, numbers, np.vstack([rows, vector]), first=first)
                return
        self._put_block(descriptor, np.array([keyframe]), vector[None])

    def _check_forgotten(self) -> None:
        """Raise DataError if another process deleted keyframes that this one has read.

        Their numbers may be those of new ones by now.
        """
        if not self.read_only:
            return
        rows = self._rows("setting", "WHERE name = ?", _FORGOTTEN)  # others may be long
        with self.decoding():
            forgotten = json.loads(rows[0][1]) if rows else None
        if forgotten != self._forgotten:
            raise DataError(
                f"{self.path} was changed: a session was forgotten since the map was opened; open "
                "it again",
                code="changed",
                fields=(str(self.path),),
            )

    def _put_block(
        self, descriptor: str, numbers: NDArray[Any], rows: Floats32, first: int | None = None
    ) -> None:
        self._store(
            "vector",
            descriptor,
            int(numbers[0]) if first is None else first,
            numbers.astype(np.int64).tobytes(),
            np.ascontiguousarray(rows, np.float32).tobytes(),
        )


def _encode(positions: Sequence[Position]) -> list[list[float]]:
    return [
        [each.node, *each.arm.tolist(), *each.place.tolist(), *each.covariance.ravel().tolist()]
        for each in positions
    ]


def _pose(data: bytes) -> Matrix:
    matrix: Matrix = np.frombuffer(data).reshape(4, 4).copy()
    if not is_rigid(matrix):
        raise ValueError(f"a pose is no rotation and translation: {matrix.tolist()}")
    return matrix


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"a text is {type(value).__name__}")
    return value


def _finite(value: Any) -> float:
    if not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"a number is {value!r}")
    return float(value)


def _one_of(value: Any, choices: Any) -> Any:
    if value not in get_args(choices):
        raise ValueError(f"{value!r}: expected {', '.join(get_args(choices))}")
    return value
