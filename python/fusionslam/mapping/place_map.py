# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A map that lasts: keyframes, loops and poses in one file, extended by each drive."""

import logging
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import wraps
from typing import Any, Concatenate, NamedTuple, NoReturn, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from fusionslam._core import voxel_downsample
from fusionslam.config import merged
from fusionslam.descriptors import DescriptorConfig, find_descriptor
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.fusion import FusionConfig, frame_from_points, fuse
from fusionslam.help_texts import counted
from fusionslam.loop_closure.config import LoopConfig
from fusionslam.loop_closure.detector import LoopDetector, Observation
from fusionslam.loop_closure.loop import Rejected
from fusionslam.loop_closure.memory import FrameMemory, Vectors
from fusionslam.loop_closure.verification import StoredFrame
from fusionslam.mapping.clouds import FileClouds, pack_cloud, unpack_cloud
from fusionslam.mapping.config import MapConfig, odometry_covariance, step_covariance
from fusionslam.mapping.edge import Edge, check_pose
from fusionslam.mapping.grids import (
    GridConfig,
    HeightGrid,
    OccupancyGrid,
    PlacedCloud,
    draw_heights,
    draw_occupancy,
)
from fusionslam.mapping.localization import Localization, Localizer, Sight
from fusionslam.mapping.map_file import MapFile, StoredCloud, StoredKeyframe
from fusionslam.mapping.map_merging import (
    Merge,
    check_mergeable,
    find_loops_between,
    judge_merge,
)
from fusionslam.mapping.pose_graph import PoseGraph, Solution
from fusionslam.registration import PreparedCloud, Refusal, RegistrationConfig, register
from fusionslam.sensors.frame import Cloud, Frame
from fusionslam.storage.arrays import Floats, Floats32, Integers, Matrix
from fusionslam.storage.files import PathLike
from fusionslam.storage.progress import Progress

logger = logging.getLogger(__name__)

_COMPARED = ("descriptor", "descriptors", "fusion", "registration")
_STATES = ("believed", "refused", "pending")
_P = ParamSpec("_P")
_T = TypeVar("_T")


def _one_at_a_time(
    method: Callable[Concatenate["PlaceMap", _P], _T],
) -> Callable[Concatenate["PlaceMap", _P], _T]:
    """Let one thread at a time into a map."""

    @wraps(method)
    def alone(self: "PlaceMap", /, *args: _P.args, **kwargs: _P.kwargs) -> _T:
        with self._lock:
            return method(self, *args, **kwargs)

    return alone


_WINDOW = 20
"""Keyframes that are no candidates: odometry is still good."""


class MapStep(NamedTuple):
    """What a map made of a frame.

    Attributes:
        keyframe: its number; None if the frame is too near the last keyframe.
        loops: edges that the keyframe closes loops by, as solved.
        refused: candidates that are no loop, and why.
        pose: float64 (4, 4), map_from_robot.
        why: what is unusual about the frame, such as "jump"; None if nothing is.
    """

    keyframe: int | None
    loops: tuple[Edge, ...]
    refused: tuple[Rejected, ...]
    pose: Matrix
    why: Refusal | None = None


@dataclass(frozen=True)
class Session:
    """A drive on a map.

    Attributes:
        name: of the session.
        keyframes: number of them.
        parts: numbers of the parts of the map that they belong to; poses of different parts have
            nothing to do with each other.
    """

    name: str
    keyframes: int
    parts: tuple[int, ...]


@dataclass(frozen=True)
class _Config:
    """All that keyframes of one map share."""

    descriptor: str
    loops: LoopConfig
    describe: DescriptorConfig
    fusion: FusionConfig
    registration: RegistrationConfig
    map: MapConfig

    def dump(self) -> dict[str, Any]:
        return {
            "descriptor": self.descriptor,
            "loop_closure": self.loops.model_dump(),
            "descriptors": self.describe.model_dump(),
            "fusion": self.fusion.model_dump(),
            "registration": self.registration.model_dump(),
            "mapping": self.map.model_dump(),
        }

    @classmethod
    def load(cls, values: Mapping[str, Any]) -> "_Config":
        return cls(
            str(values["descriptor"]),
            merged(LoopConfig(), values["loop_closure"], "loop_closure."),
            merged(DescriptorConfig(), values["descriptors"], "descriptors."),
            merged(FusionConfig(), values["fusion"], "fusion."),
            merged(RegistrationConfig(), values["registration"], "registration."),
            merged(MapConfig(), values["mapping"], "mapping."),
        )


class PlaceMap:
    """A map of places in one file (.fsmap): sessions, keyframes, loops and poses.

    Each ``add`` is a transaction: what it returned is on the disk. One process at a time may add;
    others may read. Threads may share one. ``open`` makes one; ``with`` closes it.

    A reader sees the map as it was when it was opened. If another process forgets a session
    meanwhile, methods that need clouds raise DataError (code "changed"): open it again.

    Poses are map_from_robot: the first robot pose of the map is its origin. A session that no loop
    joins with the others is a part of its own, with its first pose as origin.
    """

    def __init__(self, file: MapFile, session: str | None, config: _Config) -> None:
        self._lock = threading.RLock()
        self._file, self._session_name, self._config = file, session, config
        self._localizer: Localizer | None = None
        self._last_odometry: Matrix | None = None
        self._load()

    @classmethod
    def open(
        cls,
        path: PathLike,
        session: str | None = None,
        *,
        read_only: bool = False,
        descriptor: str = "cm2dp",
        loops: LoopConfig | None = None,
        describe: DescriptorConfig | None = None,
        fusion: FusionConfig | None = None,
        registration: RegistrationConfig | None = None,
        config: MapConfig | None = None,
    ) -> "PlaceMap":
        """Open a map, or make one.

        Args:
            path: of the file.
            session: name of the drive that ``add`` extends, begun or gone on with; None if nothing
                is added.
            read_only: whether nothing may be changed; another process may add meanwhile.
            descriptor, loops, describe, fusion, registration, config: of a new map, as of
                ``LoopDetector``. A map that exists has its own.

        Raises:
            DataError: the file is no map (code "other-format"), damaged ("damaged"), of a later
                version ("newer-version"), of an earlier one and opened read-only
                ("older-version"), changed by another process ("locked"), missing ("not-found"),
                or it cannot be read ("cannot-read") or written ("cannot-write").
            ConfigError: a session's name that is empty or not printable (code "session-name"), or
                a configuration that is none of a new map; no file is made.
            FusionSlamError: the extra ``map`` is not installed (code "missing-extra").
        """
        if session is not None:
            _check_name(session)
        file = MapFile(path, read_only=read_only)
        try:
            stored = file.setting("config")
            if stored is None:
                made = _Config(
                    descriptor,
                    loops or LoopConfig(window=_WINDOW),
                    describe or DescriptorConfig(),
                    fusion or FusionConfig(),
                    registration or RegistrationConfig(),
                    config or MapConfig(),
                )
            else:
                with file.decoding():
                    made = _Config.load(stored)
            made = replace(made, loops=merged(made.loops, {"max_frames": 0, "verify": True}))
            return cls(file, session, made)
        except BaseException:
            file.close(failed=True)
            raise

    def __reduce__(self) -> NoReturn:
        raise TypeError(
            f"{self!r} is an open file and cannot be pickled: open it read-only in each process"
        )

    def __enter__(self) -> "PlaceMap":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __len__(self) -> int:
        """Number of keyframes."""
        return len(self._keyframes)

    def __repr__(self) -> str:
        count = len(self._sessions)
        return f"PlaceMap({str(self._file.path)!r}, {len(self)} keyframes of {count} sessions)"

    @_one_at_a_time
    def close(self) -> None:
        """Close the file."""
        self._file.close()

    @property
    @_one_at_a_time
    def sessions(self) -> tuple[Session, ...]:
        """The drives, in the order in which they began."""
        return tuple(
            Session(
                name,
                sum(each.session == number for each in self._keyframes),
                tuple(sorted({int(self._parts[row]) for row in self._rows_of(number)})),
            )
            for name, number in self._sessions.items()
        )

    @property
    @_one_at_a_time
    def edges(self) -> tuple[Edge, ...]:
        """Odometry and loops between keyframes, whose numbers are their nodes."""
        return tuple(self._edges.values())

    @property
    @_one_at_a_time
    def loops(self) -> tuple[Edge, ...]:
        """Loops between keyframes, believed, refused or pending.

        Steps that were measured by the clouds of both keyframes, too, are none.
        """
        return tuple(
            edge
            for edge in self._edges.values()
            if edge.kind != "odometry" and not self._is_step(edge)
        )

    @property
    def fusion(self) -> FusionConfig:
        """How frames are fused into the map's clouds."""
        return self._config.fusion

    @_one_at_a_time
    def describe(self) -> str:
        """Say what is in the map, a line for each session."""
        loops = self.loops
        count = {state: sum(each.state == state for each in loops) for state in _STATES}
        size = self._file.path.stat().st_size / 1e6
        lines = [
            f"{each.name}: {counted(each.keyframes, 'keyframe')}"
            + (f" in {len(each.parts)} parts" if len(each.parts) > 1 else "")
            for each in self.sessions
        ]
        parts = len(set(self._parts))
        lines.append(
            f"{counted(len(self), 'keyframe')} in {counted(parts, 'part')}, "
            f"{counted(len(loops), 'loop')}: {count['believed']} believed, "
            f"{count['refused']} refused, {count['pending']} pending; {size:.1f} MB"
        )
        return "\n".join(lines)

    @_one_at_a_time
    def check_recording(self, name: str) -> None:
        """Bind the open session to a recording, by its name.

        Raises:
            ConfigError: the session is that of another one (code "other-recording").
        """
        self._check_session()
        key = f"recording of {self._session_name}"
        known = self._file.setting(key)
        if known is None:
            with self._file.transaction():
                self._file.store_setting(key, name)
        elif known != name:
            raise ConfigError(
                f"session {self._session_name!r} of {self._file.path} is that of {known}, not of "
                f"{name}: expected a session of its own (--session NAME)",
                code="other-recording",
                fields=("session", str(self._session_name)),
            )

    @property
    def reason(self) -> Refusal | None:
        """What was wrong with the map as a whole when a loop was found last, as of ``Solution``.

        None if nothing was, or no loop was found since the map was opened.
        """
        return self._reason

    @property
    @_one_at_a_time
    def last_frame(self) -> int | None:
        """Number of the session's last frame that is a keyframe; None if it has none."""
        mine = [each.frame for each in self._keyframes if each.session == self._session]
        return max(mine, default=None)

    @_one_at_a_time
    def add(
        self,
        frame: Frame,
        *,
        odometry: Matrix | None = None,
    ) -> MapStep:
        """Add a frame to the session if it is far enough from the last keyframe.

        Args:
            frame: with points, and odometry unless it is given.
            odometry: float64 (4, 4), odom_from_robot; None for the frame's.

        Returns:
            What became of it.

        Raises:
            DataError: a frame without odometry (code "no-odometry"), odometry that is no rigid
                motion ("not-a-rotation", "not-finite"), a frame that cannot be described, or the
                file cannot be written; nothing has changed then.
            ConfigError: the map was opened without a session, or read-only.
        """
        self._check_session()
        _check_frame(frame)
        robot = self._odometry_of(frame, odometry)
        robot_from_cloud = _robot_from_cloud(frame, self._config.fusion)
        reason = self._check_jump(robot)
        self._last_odometry = robot
        last = self._last_row()
        if last is not None and reason is None and not self._is_far(robot, last):
            return MapStep(None, (), (), self._predict(robot, last))
        seen = self._detector.observe(
            frame, stamp_ns=frame.stamp_ns, odometry=robot @ robot_from_cloud
        )
        try:
            return self._add_keyframe(frame, seen, robot_from_cloud, reason)
        except BaseException:
            self._load()  # what is in memory follows the file
            raise

    @_one_at_a_time
    def localize(
        self,
        frame_or_cloud: Frame | Cloud,
        *,
        odometry: Matrix | None = None,
        stamp_ns: int | None = None,
    ) -> Localization:
        """Find a robot on the map from what it sees, without any guess.

        Of a robot that goes on asking, poses of the last seconds confirm each other by odometry.
        The map does not change.

        Args:
            frame_or_cloud: of the robot; a cloud is in the frame of the map's clouds, and the
                result map_from_cloud.
            odometry: float64 (4, 4), odom_from_robot; None for the frame's, if it has any.
            stamp_ns: time; None for the frame's.

        Raises:
            DataError: a cloud that cannot be described, or a map without keyframes (code "empty").
        """
        if not len(self):
            raise DataError(f"{self._file.path}: the map has no keyframes", code="empty")
        mount = np.eye(4)
        if isinstance(frame_or_cloud, Frame):
            mount = _robot_from_cloud(frame_or_cloud, self._config.fusion)
            stamp_ns = frame_or_cloud.stamp_ns if stamp_ns is None else stamp_ns
            odometry = frame_or_cloud.odometry if odometry is None else odometry
        moved = None if odometry is None else check_pose("odometry", odometry) @ mount
        seen = self._detector.observe(frame_or_cloud, stamp_ns=stamp_ns, odometry=moved)
        assert seen.evidence is not None
        if self._localizer is None:
            self._localizer = Localizer(_Keyframes(self), self._config.loops)
        sight = Sight(seen.evidence.cloud, self.nearest_keyframes(seen.vectors), moved, stamp_ns)
        found = self._localizer.localize(sight)
        if found.map_from_robot is None:
            return found
        return replace(found, map_from_robot=found.map_from_robot @ np.linalg.inv(mount))

    @_one_at_a_time
    def merge(self, other: PathLike, *, progress: Progress | None = None) -> Merge:
        """Take in the sessions of another map, if three loops between both agree.

        Else nothing changes, and the result says why. ``forget`` of its sessions undoes it. The
        other map stays as it is.

        Args:
            other: file of the other map.
            progress: called with (keyframes compared, total).

        Raises:
            ConfigError: the maps were made with different configurations (code
                "other-configuration"), have a session of one name ("same-session"), or this one is
                read-only.
            DataError: the other file is no map, or this one cannot be written; nothing has changed.
        """
        self._check_writable()
        with PlaceMap.open(other, read_only=True) as second:
            check_mergeable(self, second)
            between = find_loops_between(self, second, progress)
            merge = judge_merge(self, second, between)
            if merge.reason is None:
                with self._file.transaction():
                    self._copy_from(second, between)
        if merge.reason is None:
            self._load()
            self.solve()
        return merge

    def _copy_from(self, other: "PlaceMap", between: Sequence[Edge]) -> None:
        """Write another map's keyframes and edges into the file, under new numbers."""
        sessions = {
            number: self._file.add_session(name) for name, number in other._sessions.items()
        }
        first = len(self._detector)
        renamed = {number: first + row for row, number in enumerate(other.numbers)}
        vectors = other.vectors
        for row, keyframe in enumerate(other._keyframes):
            copied = keyframe._replace(id=renamed[keyframe.id], session=sessions[keyframe.session])
            own = {name: rows[row] for name, (_, rows) in vectors.items()}
            self._file.add_keyframe(copied, other.stored_cloud(keyframe.id), own)
        edges = [replace(edge, a=renamed[edge.a], b=renamed[edge.b]) for edge in other.edges]
        edges += [replace(edge, b=renamed[edge.b]) for edge in between]
        for offset, edge in enumerate(edges):
            self._file.store_edge(replace(edge, number=self._next_edge(offset)))

    @property
    def comparable(self) -> dict[str, Any]:
        """What maps must have in common for their keyframes to be compared."""
        values = self._config.dump()
        return {key: values[key] for key in _COMPARED}

    @property
    def loop_config(self) -> LoopConfig:
        """Which candidates are tried and accepted."""
        return self._config.loops

    @property
    def registration(self) -> RegistrationConfig:
        """How clouds were prepared."""
        return self._config.registration

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the sessions, in the order in which they began."""
        return tuple(self._sessions)

    @property
    def numbers(self) -> list[int]:
        """Numbers of the keyframes, ascending."""
        return [each.id for each in self._keyframes]

    @property
    def vectors(self) -> dict[str, tuple[Integers, Floats32]]:
        """Numbers of the keyframes, and their vectors, float32 (n, D), by descriptor."""
        return self._file.vectors()

    def mount(self, keyframe: int) -> Matrix:
        """Return robot_from_cloud of a keyframe."""
        return self._keyframes[self._row[keyframe]].robot_from_cloud

    def stored_cloud(self, keyframe: int) -> StoredCloud:
        """Return the packed clouds of a keyframe."""
        return self._file.cloud(keyframe)

    def stored_frame(self, keyframe: int) -> StoredFrame:
        """Return a keyframe as the verification of loops takes it."""
        return self._memory_of_all.frame(keyframe)

    def nearest_keyframes(self, vectors: Vectors) -> dict[int, float]:
        """Return the nearest keyframes of each descriptor, and their distances, all sessions'."""
        found: dict[int, float] = {}
        k = self._config.loops.candidates
        for pairs in self._memory_of_all.query(vectors, k, None).values():
            found |= {match: far for match, far in pairs if match not in found}
        return found

    @_one_at_a_time
    def forget_motion(self) -> None:
        """Localise without regard to what was localised before, as after the robot was carried."""
        if self._localizer is not None:
            self._localizer.forget()

    @_one_at_a_time
    def forget(self, session: str) -> None:
        """Delete a session: its keyframes, and their loops. If it is open, it begins anew.

        Raises:
            ConfigError: there is no such session, or the map is read-only.
        """
        self._check_writable()
        number = self._find_session(session)
        with self._file.transaction():
            self._file.forget_session(number)
        self._load()
        self.solve()

    @_one_at_a_time
    def trajectory(self, session: str) -> tuple[NDArray[np.int64], Floats]:
        """Return stamps, int64 (n,), and map_from_robot, float64 (n, 4, 4), of a session.

        Raises:
            ConfigError: there is no such session.
        """
        rows = self._rows_of(self._find_session(session))
        keyframes = [self._keyframes[row] for row in rows]
        stamps = np.array([each.stamp_ns for each in keyframes], np.int64)
        poses = [
            self._poses[row] @ np.linalg.inv(each.robot_from_cloud)
            for row, each in zip(rows, keyframes, strict=True)
        ]
        return stamps, np.array(poses, np.float64).reshape(-1, 4, 4)

    @_one_at_a_time
    def odometry(self, session: str) -> Floats:
        """Return odom_from_robot, float64 (n, 4, 4), of a session's keyframes.

        Raises:
            ConfigError: there is no such session.
        """
        rows = self._rows_of(self._find_session(session))
        poses = [
            each.odometry @ np.linalg.inv(each.robot_from_cloud)
            for each in (self._keyframes[row] for row in rows)
        ]
        return np.array(poses, np.float64).reshape(-1, 4, 4)

    @_one_at_a_time
    def frames(self, session: str) -> Integers:
        """Return the numbers, int64 (n,), of a session's frames that are keyframes.

        Raises:
            ConfigError: there is no such session.
        """
        rows = self._rows_of(self._find_session(session))
        return np.array([self._keyframes[row].frame for row in rows], np.int64)

    @_one_at_a_time
    def keyframes(self, session: str) -> Integers:
        """Return the numbers, int64 (n,), of a session's keyframes, as edges have them.

        Raises:
            ConfigError: there is no such session.
        """
        rows = self._rows_of(self._find_session(session))
        return np.array([self._keyframes[row].id for row in rows], np.int64)

    @property
    def config(self) -> dict[str, Any]:
        """Everything that the map was made with, by section of the configuration."""
        return self._config.dump()

    @property
    @_one_at_a_time
    def positions(self) -> dict[int, Floats]:
        """Where the clouds of keyframes were taken, float64 (3,), by number, each in its part."""
        return {
            each.id: pose[:3, 3] for each, pose in zip(self._keyframes, self._poses, strict=True)
        }

    @_one_at_a_time
    def cloud(self, voxel: float = 0.1) -> Cloud:
        """Return the map's coloured cloud: one point for each voxel, of the map's first part."""
        points: list[NDArray[np.float32]] = []
        colors: list[NDArray[np.uint8]] = []
        for row in self._first_part():
            cloud = unpack_cloud(self._file.cloud(self._keyframes[row].id).points)
            pose = self._poses[row]
            placed = cloud.points @ pose[:3, :3].T + pose[:3, 3]
            points.append(placed.astype(np.float32))
            if cloud.colors is not None:
                colors.append(cloud.colors)
        if not points:
            return Cloud(np.empty((0, 3), np.float32), None)
        whole = np.concatenate(points)
        shades = np.concatenate(colors) if len(colors) == len(points) else None
        kept, kept_colors, _ = voxel_downsample(whole, shades, size=voxel)
        return Cloud(kept, None if shades is None else kept_colors)

    @_one_at_a_time
    def grid(self, resolution: float = 0.05, config: GridConfig | None = None) -> OccupancyGrid:
        """Draw where a robot can drive, on the map's first part; see ``draw_occupancy``."""
        config = merged(config or GridConfig(), {"resolution": resolution})
        return draw_occupancy(self._placed_clouds(), self._positions(), config)

    @_one_at_a_time
    def heights(self, resolution: float = 0.2, config: GridConfig | None = None) -> HeightGrid:
        """Draw how high the map's first part is; see ``draw_heights``."""
        config = merged(config or GridConfig(), {"resolution": resolution})
        return draw_heights(self._placed_clouds(), self._positions(), config)

    @_one_at_a_time
    def check(self) -> list[str]:
        """Return what is damaged in the file; nothing if it is whole."""
        problems = self._file.check()
        for keyframe in self._keyframes:
            try:
                unpack_cloud(self._file.cloud(keyframe.id).points)
                self._kept[keyframe.id].packed()
            except DataError as error:
                if error.code == "changed":
                    raise
                problems.append(f"keyframe {keyframe.id}: {error}")
        return problems

    # What follows keeps memory and file alike.

    def _load(self) -> None:
        """Take everything from the file."""
        file = self._file
        with file.reading():
            stored = file.setting("config")
            self._sessions = file.sessions()
            self._keyframes = file.keyframes()
            vectors = file.vectors()
            self._edges = {edge.number: edge for edge in file.edges()}
            solution = file.solution()
        if stored is not None:
            with file.decoding():
                self._config = _Config.load(stored)
        is_new = stored is None and not self._keyframes  # the caller's configuration may be wrong
        with nullcontext() if is_new else file.decoding():
            self._build(vectors, solution)

    def _build(
        self,
        vectors: Mapping[str, tuple[Integers, Any]],
        solution: tuple[Integers, Floats, Integers] | None,
    ) -> None:
        """Make of what was read what is kept in memory."""
        self._row = {each.id: row for row, each in enumerate(self._keyframes)}
        self._odometry = {each.id: each.odometry for each in self._keyframes}
        self._session = self._sessions.get(self._session_name or "", -1)
        self._last_odometry = None
        if (row := self._last_row()) is not None:
            last = self._keyframes[row]
            self._last_odometry = last.odometry @ np.linalg.inv(last.robot_from_cloud)
        self._kept = FileClouds(self._file, self._odometry)
        self._detector = self._new_detector(vectors)
        self._everywhere: FrameMemory | None = None
        self._graph = self._new_graph()
        self._place(solution)
        self._localizer = None
        self._reason: Refusal | None = None

    def _new_detector(self, vectors: Mapping[str, tuple[Integers, Any]]) -> LoopDetector:
        config = self._config
        detector = LoopDetector(
            config.descriptor,
            config=config.loops,
            describe=config.describe,
            fusion=config.fusion,
            registration=config.registration,
        )
        numbers = np.array([each.id for each in self._keyframes], np.int64)
        for name in {config.descriptor, *vectors}:
            known = vectors[name][0] if name in vectors else numbers[:0]
            if not np.array_equal(known, numbers):
                raise DataError(
                    f"{self._file.path} is damaged: vectors of {name} of {len(known)} keyframes "
                    f"of {len(numbers)}",
                    code="damaged",
                    fields=(str(self._file.path),),
                )
        stamps = np.array([each.stamp_ns for each in self._keyframes], np.int64)
        detector.resume(self._kept, {n: rows for n, (_, rows) in vectors.items()}, numbers, stamps)
        return detector

    def _new_graph(self) -> PoseGraph:
        graph = PoseGraph()
        for keyframe in self._keyframes:
            graph.add_node(keyframe.robot_from_cloud)
        self._graph_numbers: list[int] = []
        for edge in self._edges.values():
            self._connect(graph, edge)
        return graph

    def _connect(self, graph: PoseGraph, edge: Edge) -> None:
        a, b = self._row[edge.a], self._row[edge.b]
        graph.add_edge(a, b, edge.pose, edge.covariance, edge.kind)
        self._graph_numbers.append(edge.number)

    def _place(self, solution: tuple[Integers, Floats, Integers] | None) -> None:
        """Take poses of the last solution, and those of newer keyframes by odometry."""
        self._poses: list[Matrix] = []
        self._parts: list[int] = []
        if solution is not None:
            numbers, poses, parts = solution
            ids = np.array([each.id for each in self._keyframes[: len(numbers)]], np.int64)
            if np.array_equal(ids, numbers):
                self._poses, self._parts = [*poses], parts.tolist()
        before = {edge.b: edge for edge in self._edges.values() if edge.kind == "odometry"}
        for keyframe in self._keyframes[len(self._poses) :]:
            self._append_pose(keyframe, before.get(keyframe.id))

    def _append_pose(self, keyframe: StoredKeyframe, step: Edge | None) -> None:
        if step is None:
            self._poses.append(keyframe.robot_from_cloud)
            self._parts.append(keyframe.id)
        else:
            row = self._row[step.a]
            self._poses.append(self._poses[row] @ step.pose)
            self._parts.append(self._parts[row])

    def _add_keyframe(
        self, frame: Frame, seen: Observation, mount: Matrix, reason: Refusal | None
    ) -> MapStep:
        last = self._last_row()
        number = len(self._detector)
        loop = self._detector.add_observation(seen)
        if number not in self._detector.frames:
            raise DataError(
                f"frame {frame.number} has nothing that {self._config.descriptor} describes"
            )
        assert seen.evidence is not None and seen.evidence.odometry is not None
        stamp_ns = seen.stamp_ns or 0
        keyframe = StoredKeyframe(
            number, self._session, frame.number, stamp_ns, seen.evidence.odometry, mount
        )
        cloud = pack_cloud(fuse(frame, self._config.fusion), self._config.map.voxel)
        edges = []
        if last is not None and reason is None:
            before = self._keyframes[last]
            edges.append(self._odometry_edge(before, keyframe))
            edges += self._register_neighbor(before, keyframe, seen.evidence.cloud, edges[0].pose)
        if loop is not None and loop.match_from_query is not None:
            edges.append(
                Edge(
                    self._next_edge(len(edges)),
                    "loop" if self._is_own(loop.match) else "merge",
                    loop.match,
                    number,
                    loop.match_from_query,
                    np.asarray(loop.covariance),
                    "pending",
                )
            )
        self._keyframes.append(keyframe)
        self._row[number] = len(self._keyframes) - 1
        self._odometry[number] = keyframe.odometry
        self._graph.add_node(mount)
        self._append_pose(keyframe, edges[0] if edges and edges[0].kind == "odometry" else None)
        for edge in edges:
            self._edges[edge.number] = edge
            self._connect(self._graph, edge)
        changed = self._solve() if loop is not None else []
        ground = seen.evidence.cloud.ground_level
        with self._file.transaction():
            if self._file.setting("config") is None or len(self._keyframes) == 1:
                self._store_config()
            if self._session not in self._sessions.values():
                self._begin_session()
                keyframe = keyframe._replace(session=self._session)
                self._keyframes[-1] = keyframe
            stored = self._kept.take(number, cloud, ground)
            self._file.add_keyframe(keyframe, stored, seen.vectors)
            for edge in {edge.number: edge for edge in [*edges, *changed]}.values():
                self._file.store_edge(self._edges[edge.number])
            if loop is not None:
                self._store_solution()
        self._kept.written()
        self._add_everywhere(number, seen)
        closed = (self._edges[edges[-1].number],) if loop is not None and edges else ()
        pose = self._poses[-1] @ np.linalg.inv(mount)
        return MapStep(number, closed, tuple(self._detector.rejected), pose, reason)

    def _begin_session(self) -> None:
        assert self._session_name is not None
        self._session = self._file.add_session(self._session_name)
        self._sessions[self._session_name] = self._session

    def _store_config(self) -> None:
        """The first keyframe fixes lengths of registration and the radius of normals."""
        self._config = replace(
            self._config,
            describe=self._detector.describe_config,
            registration=self._detector.registration_config,
        )
        self._file.store_setting("config", self._config.dump())

    def _odometry_edge(self, before: StoredKeyframe, after: StoredKeyframe) -> Edge:
        step = np.linalg.inv(before.odometry) @ after.odometry
        covariance = odometry_covariance(step, self._config.map)
        return Edge(
            self._next_edge(0), "odometry", before.id, after.id, step, covariance, "believed"
        )

    def _register_neighbor(
        self, before: StoredKeyframe, after: StoredKeyframe, cloud: PreparedCloud, step: Matrix
    ) -> list[Edge]:
        """Measure the step from the last keyframe by both clouds, too, if they fit.

        Loops alone cannot tell odometry's scale.
        """
        stored = self._detector.stored_frame(before.id).unpack()
        found = register(cloud, stored, step, search=False)
        if found.target_from_source is None or found.covariance is None:
            return []
        pose, covariance = found.target_from_source, found.covariance
        if cloud.scene is None:
            covariance = step_covariance(covariance, cloud.config, self._config.map)
        number = self._next_edge(1)
        return [Edge(number, "loop", before.id, after.id, pose, covariance, "pending")]

    def _next_edge(self, offset: int) -> int:
        return max(self._edges, default=-1) + 1 + offset

    def _is_step(self, edge: Edge) -> bool:
        a, b = self._row[edge.a], self._row[edge.b]
        return b - a == 1 and self._keyframes[a].session == self._keyframes[b].session

    def _is_own(self, keyframe: int) -> bool:
        return self._keyframes[self._row[keyframe]].session == self._session

    def _solve(self) -> list[Edge]:
        """Solve the graph; return the edges whose state has changed."""
        solution = self._graph.solve()
        if solution.reason is not None and self._reason is None:
            logger.warning("%s", solution.reason)
        self._reason = solution.reason
        self.forget_motion()  # its poses are those of the former solution
        self._poses = [*solution.poses]
        self._parts = [self._keyframes[int(node)].id for node in solution.parts]
        return self._take_states(solution)

    def _take_states(self, solution: Solution) -> list[Edge]:
        changed = []
        for edge in (*solution.believed, *solution.refused, *solution.pending):
            number = self._graph_numbers[edge.number]
            known = self._edges[number]
            if known.state == edge.state and known.reason == edge.reason:
                continue
            self._edges[number] = replace(known, state=edge.state, reason=edge.reason)
            changed.append(self._edges[number])
        return changed

    def _store_solution(self) -> None:
        numbers = np.array([each.id for each in self._keyframes], np.int64)
        self._file.store_solution(numbers, np.array(self._poses), np.array(self._parts, np.int64))

    @_one_at_a_time
    def solve(self) -> None:
        """Solve the graph of the map anew and store the poses, as at the end of a drive.

        ``add`` solves it at each loop only: until then, steps measured by clouds do not count.
        """
        self._check_writable()
        if not len(self):
            return
        changed = self._solve()
        with self._file.transaction():
            for edge in changed:
                self._file.store_edge(edge)
            self._store_solution()

    @property
    def _memory_of_all(self) -> FrameMemory:
        """All keyframes, the newest ones included."""
        if self._everywhere is None:
            self._everywhere = self._new_memory()
        return self._everywhere

    def _new_memory(self) -> FrameMemory:
        """Vectors of all keyframes without a window."""
        vectors = self._file.vectors()
        own = self._config.descriptor
        names = [own, *(name for name in vectors if name != own)]
        metrics = {name: find_descriptor(name.split(",")[0]).metric for name in names}
        loops = merged(self._config.loops, {"window": 0, "window_seconds": 0.0})
        memory = FrameMemory(metrics, loops, self._config.registration, self._kept)
        numbers = np.array([each.id for each in self._keyframes], np.int64)
        rows = {name: vectors[name][1] for name in names}
        memory.resume(rows, numbers, np.zeros(len(numbers), np.int64))
        return memory

    def _add_everywhere(self, number: int, seen: Observation) -> None:
        if self._everywhere is not None:
            self._everywhere.add(number, seen.vectors, seen.stamp_ns, np.inf, None)

    def _odometry_of(self, frame: Frame, odometry: Matrix | None) -> Matrix:
        pose = frame.odometry if odometry is None else odometry
        if pose is None:
            raise DataError(
                f"frame {frame.number} has no odometry, which a map needs: record it, or take "
                "that of its scans (fusionslam odometry)",
                code="no-odometry",
                fields=(str(frame.number),),
            )
        return check_pose("odometry", pose)

    def _check_jump(self, robot: Matrix) -> Refusal | None:
        if self._last_odometry is None:
            return None
        step = float(np.linalg.norm(robot[:3, 3] - self._last_odometry[:3, 3]))
        if step <= self._config.map.max_step:
            return None
        text = (
            f"odometry jumped by {step:.1f} m, more than {self._config.map.max_step:g}: the map "
            "goes on in a part of its own until loops join it"
        )
        logger.warning("%s", text)
        return Refusal("jump", step, text)

    def _is_far(self, robot: Matrix, row: int) -> bool:
        from scipy.spatial.transform import Rotation

        last = self._keyframes[row]
        moved = np.linalg.inv(last.odometry @ np.linalg.inv(last.robot_from_cloud)) @ robot
        turn = np.degrees(Rotation.from_matrix(moved[:3, :3]).magnitude())
        distance = self._config.map.keyframe_distance
        if distance is None:
            distance = 4 * self._detector.registration_config.voxel
        return bool(
            np.linalg.norm(moved[:3, 3]) >= distance or turn >= self._config.map.keyframe_turn
        )

    def _predict(self, robot: Matrix, row: int) -> Matrix:
        """map_from_robot by the last keyframe and odometry since."""
        last = self._keyframes[row]
        mount = np.linalg.inv(last.robot_from_cloud)
        moved = np.linalg.inv(last.odometry @ mount) @ robot
        pose: Matrix = self._poses[row] @ mount @ moved
        return pose

    def _last_row(self) -> int | None:
        """The session's last keyframe."""
        rows = self._rows_of(self._session)
        return rows[-1] if rows else None

    def _rows_of(self, session: int) -> list[int]:
        return [row for row, each in enumerate(self._keyframes) if each.session == session]

    def _first_part(self) -> list[int]:
        """Rows of the keyframes in the part of the map that began first."""
        return [row for row, part in enumerate(self._parts) if part == self._parts[0]]

    def _positions(self) -> Floats:
        places = [self._poses[row][:2, 3] for row in self._first_part()]
        return np.array(places, np.float64).reshape(-1, 2)

    def _placed_clouds(self) -> Iterator[PlacedCloud]:
        for row in self._first_part():
            stored = self._file.cloud(self._keyframes[row].id)
            cloud = unpack_cloud(stored.points)
            yield PlacedCloud(cloud.points, self._poses[row], stored.ground_level)

    def _find_session(self, name: str) -> int:
        if name not in self._sessions:
            raise ConfigError(
                f"there is no session {name!r}: expected one of {', '.join(self._sessions)}",
                code="choice",
                fields=("session", name),
            )
        return self._sessions[name]

    def _check_session(self) -> None:
        self._check_writable()
        if not self._session_name:
            raise ConfigError(
                "the map was opened without a session: expected PlaceMap.open(path, session=NAME)",
                code="choice",
                fields=("session",),
            )

    def _check_writable(self) -> None:
        if self._file.read_only:
            raise ConfigError(
                f"{self._file.path} was opened read-only: nothing can be changed",
                code="read-only",
                fields=(str(self._file.path),),
            )


class _Keyframes:
    """What localisation asks a map for."""

    def __init__(self, site: PlaceMap) -> None:
        self._site = site

    def stored(self, number: int) -> StoredFrame:
        return self._site.stored_frame(number)

    def map_from_cloud(self, number: int) -> Matrix:
        return self._site._poses[self._site._row[number]]

    def part(self, number: int) -> int:
        return self._site._parts[self._site._row[number]]

    def near(self, place: Matrix, radius: float, keyframe: int) -> Sequence[int]:
        site = self._site
        parts = np.array(site._parts)
        positions = np.array(site._poses)[:, :3, 3]
        apart = np.linalg.norm(positions - place[:3, 3], axis=1)
        apart[parts != parts[site._row[keyframe]]] = np.inf
        order = np.argsort(apart, kind="stable")
        return [site._keyframes[row].id for row in order if apart[row] <= radius]


def _check_name(session: str) -> None:
    if not isinstance(session, str) or not session.strip() or not session.isprintable():
        raise ConfigError(
            f"session is {session!r}: expected a name of printable characters",
            code="session-name",
            fields=("session", repr(session)),
        )


def _check_frame(frame: Frame) -> None:
    if not isinstance(frame, Frame):
        raise ShapeError(f"expected a Frame, got {type(frame).__name__}")
    if not isinstance(frame.number, int | np.integer) or not 0 <= frame.number < 2**63:
        raise DataError(
            f"a frame has number {frame.number!r}: expected an integer from 0 on",
            code="frame-number",
            fields=(repr(frame.number),),
        )


def _robot_from_cloud(frame: Frame, config: FusionConfig) -> Matrix:
    robot_from_points = np.eye(4) if frame.robot_from_points is None else frame.robot_from_points
    pose: Matrix = robot_from_points @ np.linalg.inv(frame_from_points(frame, config.frame))
    return pose
