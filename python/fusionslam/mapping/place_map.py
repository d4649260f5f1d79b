# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A map that lasts: keyframes, loops and poses in one file, extended by each drive."""

import logging
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import replace
from functools import lru_cache, wraps
from pathlib import Path
from typing import Any, Concatenate, NoReturn, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Floats, Integers, Matrix
from fusionslam.base.files import PathLike
from fusionslam.base.progress import Progress
from fusionslam.config import merged
from fusionslam.descriptors import DescriptorConfig
from fusionslam.errors import ConfigError, DataError
from fusionslam.fusion import FusionConfig
from fusionslam.geometry.se3 import carry_covariance
from fusionslam.loop_closure.config import LoopConfig
from fusionslam.loop_closure.local_maps import RecentFrames, join_clouds
from fusionslam.mapping.clouds import FileClouds, unpack_cloud
from fusionslam.mapping.config import MapConfig
from fusionslam.mapping.corrections import Corrections, forget_corrections
from fusionslam.mapping.edge import Edge, check_pose
from fusionslam.mapping.grids import (
    GridConfig,
    HeightGrid,
    OccupancyGrid,
    PlacedCloud,
    draw_heights,
    draw_occupancy,
)
from fusionslam.mapping.localization import Localization, Localizer
from fusionslam.mapping.map_content import MapContent, Session, robot_poses
from fusionslam.mapping.map_file import MapFile, StoredKeyframe
from fusionslam.mapping.map_merging import (
    Merge,
    check_mergeable,
    copy_sessions,
    find_loops_between,
    judge_merge,
    vectors_as_of,
)
from fusionslam.mapping.map_settings import MapSettings, check_session_name
from fusionslam.mapping.map_writer import MapStep, MapWriter, resume_detector
from fusionslam.mapping.sweeps import SolvedSweeps, measure_anew
from fusionslam.registration import Refusal, RegistrationConfig
from fusionslam.sensors.frame import Cloud, Frame
from fusionslam.sensors.scan_motion import ScanMotion

logger = logging.getLogger(__name__)

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


DEFAULT_DESCRIPTOR = "cm2dp"
"""The descriptor of a new map."""
_WINDOW = 20  # keyframes that are no candidates: odometry is still good


@checked
class PlaceMap:
    """A map of places in one file (.fsmap): sessions, keyframes, loops and poses.

    Each ``add`` is a transaction: what it returned is on the disk. One process at a time may add;
    others may read. Threads may share one. ``open`` makes one; ``with`` closes it.

    A reader sees the map as it was when it was opened. If another process forgets a session
    meanwhile, methods that need clouds raise DataError (code "changed"): open it again.

    Poses are map_from_robot: the first robot pose of the map is its origin. A session that no loop
    joins with the others is a part of its own, with its first pose as origin.

    Attributes:
        file: what is on the disk.
        session: name of the drive that ``add`` extends; None if there is none.
        content: sessions, keyframes, edges and poses, as they are in memory.
        detector: what finds keyframes, and has their clouds and vectors.
    """

    def __init__(self, file: MapFile, session: str | None, settings: MapSettings) -> None:
        self._lock = threading.RLock()
        self.file, self.session, self._given = file, session, settings
        self._sight, self._recent = ScanMotion(), RecentFrames()  # of scans that are localised
        self._load()

    @classmethod
    def open(
        cls,
        path: PathLike,
        session: str | None = None,
        *,
        read_only: bool = False,
        descriptor: str | None = None,
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
                is added, to a map that exists.
            read_only: whether nothing may be changed; another process may add meanwhile.
            descriptor, loops, describe, fusion, registration, config: of a new map, as of
                ``LoopDetector``; the descriptor by default "cm2dp". A map that exists has its own:
                a warning names what differs.

        Raises:
            DataError: the file is no map (code "other-format"), damaged ("damaged"), of a later
                version ("newer-version") or an earlier one ("older-version"), changed by another
                process ("locked"), missing ("not-found"), beside the log of another file
                ("other-log"), without changes that a process acknowledged before it was killed
                ("lost-changes"), or it cannot be read ("cannot-read") or written ("cannot-write").
            ConfigError: a session's name that is empty, not printable or longer than 200 bytes
                (code "session-name"), or a configuration that is none of a new map; no file is
                made.
            FusionSlamError: the extra ``map`` is not installed (code "missing-extra").
        """
        if session is not None:
            check_session_name(session)
        elif not os.path.exists(path):  # False for names that cannot be, too
            raise DataError(
                f"{path}: no such map; one is made where a session is named",
                code="not-found",
                fields=(str(path),),
            )
        file = MapFile(path, read_only=read_only)
        try:
            stored = file.setting("config")
            if stored is None:
                made = MapSettings(
                    descriptor or DEFAULT_DESCRIPTOR,
                    loops or LoopConfig(window=_WINDOW),
                    describe or DescriptorConfig(),
                    fusion or FusionConfig(),
                    registration or RegistrationConfig(),
                    config or MapConfig(),
                )
            else:
                with file.decoding():
                    made = MapSettings.load(stored)
                different = made.list_differences(
                    descriptor,
                    loops=loops,
                    describe=describe,
                    fusion=fusion,
                    registration=registration,
                    map=config,
                )
                if different:
                    logger.warning(
                        "%s keeps what it was made with: %s has no effect",
                        file.path,
                        ", ".join(different),
                    )
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

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Close the file; delete one that was made here, if an error left it without keyframes."""
        with self._lock:
            if kind is not None and not len(self):
                self.file.close(failed=True)
            else:
                self.close()

    def __len__(self) -> int:
        """Number of keyframes."""
        return len(self.content)

    def __repr__(self) -> str:
        count = len(self.content.sessions)
        return f"PlaceMap({str(self.file.path)!r}, {len(self)} keyframes of {count} sessions)"

    @_one_at_a_time
    def close(self) -> None:
        """Close the file, after a warning if the robot turned within scans since it was opened."""
        for motion in (self._writer.motion, self._sight):
            motion.warn(str(self.file.path))
        try:
            self._writer.save_frames()
        finally:
            self.file.close()

    @property
    @_one_at_a_time
    def sessions(self) -> tuple[Session, ...]:
        """The drives, in the order in which they began."""
        return self.content.list_sessions()

    @property
    @_one_at_a_time
    def edges(self) -> tuple[Edge, ...]:
        """Odometry and loops between keyframes, whose numbers are their nodes."""
        return tuple(self.content.edges.values())

    @property
    @_one_at_a_time
    def loops(self) -> tuple[Edge, ...]:
        """Loops between keyframes, believed, refused or pending.

        Steps that were measured by the clouds of both keyframes, too, are none.
        """
        return self.content.loops

    @property
    def fusion(self) -> FusionConfig:
        """How frames are fused into the map's clouds."""
        return self.settings.fusion

    @property
    def corrections(self) -> Corrections:
        """What people changed by hand, and how to change it."""
        return Corrections(self, self._lock)

    @_one_at_a_time
    def describe(self) -> str:
        """Say what is in the map, a line for each session."""
        return self.content.describe(self.file.path.stat().st_size)

    @_one_at_a_time
    def check_recording(self, name: str) -> None:
        """Bind the open session to a recording, by its name.

        Raises:
            ConfigError: the session is that of another one (code "other-recording").
        """
        self._check_session()
        key = f"recording of {self.session}"
        known = self.file.setting(key)
        if known is None:
            with self.file.transaction():
                self.file.store_setting(key, name)
        elif known != name:
            raise ConfigError(
                f"session {self.session!r} of {self.file.path} is that of {known}, not of "
                f"{name}: expected a session of its own (--session NAME)",
                code="other-recording",
                fields=("session", str(self.session)),
            )

    @property
    def reason(self) -> Refusal | None:
        """What was wrong with the map as a whole when it was solved last, as of ``Solution``.

        None if nothing was. It is stored in the file.
        """
        return self.content.reason

    @property
    @_one_at_a_time
    def last_frame(self) -> int | None:
        """Number of the session's last frame that the file has; None if it has none."""
        return self._writer.last_frame

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
                motion ("not-a-rotation", "not-finite"), a frame that cannot be described, whose z
                does not point up ("not-up"), or the file cannot be written; nothing has changed
                then. The file was replaced or deleted since it was opened ("replaced"): what was
                added since is lost.
            ConfigError: the map was opened without a session, or read-only.
        """
        self._check_session()
        try:
            step = self._writer.add(frame, odometry)
        except BaseException:
            if self._writer.is_torn:
                self.reload()  # what is in memory follows the file
            raise
        if step.loops:
            self.forget_motion()  # its poses are those of the former solution
        return step

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
            DataError: a cloud that cannot be described, a frame whose z does not point up (code
                "not-up"), or a map without keyframes ("empty").
        """
        if not len(self):
            raise DataError(f"{self.file.path}: the map has no keyframes", code="empty")
        mount = np.eye(4)
        if isinstance(frame_or_cloud, Frame):
            mount = self.settings.robot_from_cloud(frame_or_cloud)
            stamp_ns = frame_or_cloud.stamp_ns if stamp_ns is None else stamp_ns
            odometry = frame_or_cloud.odometry if odometry is None else odometry
        moved = None if odometry is None else check_pose("odometry", odometry) @ mount
        seen = self.detector.observe(
            frame_or_cloud, stamp_ns=stamp_ns, odometry=moved, before=self._recent
        )
        assert seen.cloud is not None
        seen.add_to(self._recent, 0)
        self._sight.follow(stamp_ns, moved)
        seen.cloud.moved = self._sight.within(seen.span)
        found = self._localizer.localize(seen, self.detector.nearest_frames(seen.vectors))
        if found.map_from_robot is None:
            return found
        assert found.covariance is not None
        return replace(
            found,
            map_from_robot=found.map_from_robot @ np.linalg.inv(mount),
            covariance=carry_covariance(mount, found.covariance),
        )

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
        self.file.check_writable()
        with PlaceMap.open(other, read_only=True) as second:
            check_mergeable(self, second)
            vectors = vectors_as_of(self, second)
            between = find_loops_between(self, second, vectors, progress)
            merge = judge_merge(self, second, between)
            if merge.reason is None:
                with self.file.transaction():
                    copy_sessions(self, second, vectors, between)
        if merge.reason is None:
            self.reload()
            self._settle()
        return merge

    @property
    def settings(self) -> MapSettings:
        """The configuration that all keyframes share."""
        return self._writer.settings

    @_one_at_a_time
    def forget_motion(self) -> None:
        """Localise without regard to what was localised before, as after the robot was carried."""
        self._localizer.forget()
        self._recent.clear()

    @_one_at_a_time
    def forget(self, session: str) -> None:
        """Delete a session: its keyframes, and their loops. If it is open, it begins anew.

        Raises:
            ConfigError: there is no such session, or the map is read-only.
        """
        self.file.check_writable()
        number = self.content.find_session(session)
        with self.file.transaction():
            forget_corrections(self.file, {each.id for each in self._keyframes_of(session)})
            self.file.forget_session(number)
        self.reload()
        self._settle()

    @_one_at_a_time
    def trajectory(self, session: str) -> tuple[NDArray[np.int64], Floats]:
        """Return stamps, int64 (n,), and map_from_robot, float64 (n, 4, 4), of a session.

        They are those that the file gives later, for which the graph is solved if loops came since
        its last solution.

        Raises:
            ConfigError: there is no such session.
        """
        if self.content.solve_new_loops():
            self.forget_motion()  # its poses are those of the former solution
        keyframes = self._keyframes_of(session)
        stamps = np.array([each.stamp_ns for each in keyframes], np.int64)
        return stamps, robot_poses(keyframes, self.content.poses_of(each.id for each in keyframes))

    @_one_at_a_time
    def odometry(self, session: str) -> Floats:
        """Return odom_from_robot, float64 (n, 4, 4), of a session's keyframes.

        Raises:
            ConfigError: there is no such session.
        """
        keyframes = self._keyframes_of(session)
        return robot_poses(keyframes, [each.odometry for each in keyframes])

    @_one_at_a_time
    def frames(self, session: str) -> Integers:
        """Return the numbers, int64 (n,), of a session's frames that are keyframes.

        Raises:
            ConfigError: there is no such session.
        """
        return np.array([each.frame for each in self._keyframes_of(session)], np.int64)

    @_one_at_a_time
    def keyframes(self, session: str) -> Integers:
        """Return the numbers, int64 (n,), of a session's keyframes, as edges have them.

        Raises:
            ConfigError: there is no such session.
        """
        return np.array([each.id for each in self._keyframes_of(session)], np.int64)

    @property
    def path(self) -> Path:
        """Of the file."""
        return self.file.path

    @property
    def config(self) -> dict[str, Any]:
        """Everything that the map was made with, by section of the configuration."""
        return self.settings.dump()

    @_one_at_a_time
    def cloud(self, voxel: float = 0.1) -> Cloud:
        """Return the map's coloured cloud: one point for each voxel, of the map's first part."""
        return join_clouds(((pose, cloud) for pose, cloud, _ in self._first_part()), voxel)

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
        problems = self.file.check()
        for keyframe in self.content.keyframes:
            try:
                unpack_cloud(self.file.cloud(keyframe.id).points)
                self.file.frames_after(keyframe.id)
                self._kept[keyframe.id].packed()
            except DataError as error:
                if error.code == "changed":
                    raise
                problems.append(f"keyframe {keyframe.id}: {error}")
        return problems

    # What follows keeps memory and file alike.

    @_one_at_a_time
    def reload(self) -> None:
        """Take everything from the file but frames that wait for the next keyframe."""
        former = self._writer
        self._load()
        self._writer.keep_frames(former)

    def _load(self) -> None:
        file = self.file
        with file.reading():
            stored = file.setting("config")
            content = file.sessions(), file.keyframes(), file.edges(), file.solution()
            placed = file.positions(), file.origins(), file.reason()
            vectors = file.vectors()
        with file.decoding():
            settings = self._given if stored is None else MapSettings.load(stored)
            self.content = MapContent(*content, *placed)
        self._kept = FileClouds(file, self.content.odometry)
        is_new = stored is None and not len(self)  # the caller's configuration may be wrong
        with nullcontext() if is_new else file.decoding():
            self.detector = resume_detector(settings, file, self.content, self._kept, vectors)
        parts = file, self.content, self.detector, self._kept
        self._writer = MapWriter(self.session, settings, *parts)
        find, lost_after = self.detector.stored_frame, settings.map.lost_after
        self._localizer = Localizer(self.content, find, settings.loops, lost_after)

    @_one_at_a_time
    def solve(self) -> None:
        """Solve the graph of the map anew and store the poses, as at the end of a drive.

        ``add`` solves it from time to time only. In between, loops move the newest poses. Where
        times of points are known, but motion within scans was not undone, it is undone along the
        solved path, loops and steps are measured anew by these clouds, and it is solved once more.
        """
        self.file.check_writable()
        self._writer.save_frames()
        self.content.is_live = False
        self._settle()
        anew = measure_anew(self.content, self.settings, self.file)
        if anew:
            self.content.take(anew)
            self._settle()
            self._writer.motion.turned.clear()  # nothing is left to warn of

    def _settle(self) -> None:
        """Store the poses that all edges ask for."""
        if not self.content.is_live:
            self.content.solve()
        self.forget_motion()  # its poses are those of the former solution
        with self.file.transaction():
            self.content.save(self.file)
        self.content.saved()

    def _keyframes_of(self, session: str) -> list[StoredKeyframe]:
        return self.content.keyframes_of(self.content.find_session(session))

    def _first_part(self) -> Iterator[tuple[Matrix, Cloud, float]]:
        """Poses, clouds and ground levels of the part of the map that began first."""
        numbers = self.content.first_part()
        read = lru_cache(4)(self.file.cloud)
        sweeps = SolvedSweeps(self.content, read, self.file.frames_after)
        for number, pose in zip(numbers, self.content.poses_of(numbers), strict=True):
            yield pose, sweeps.cloud(number), read(number).ground_level

    def _positions(self) -> Floats:
        return self.content.poses_of(self.content.first_part())[:, :2, 3]

    def _placed_clouds(self) -> Iterator[PlacedCloud]:
        for pose, cloud, ground_level in self._first_part():
            yield PlacedCloud(cloud.points, pose, ground_level)

    def _check_session(self) -> None:
        self.file.check_writable()
        if not self.session:
            raise ConfigError(
                "the map was opened without a session: expected PlaceMap.open(path, session=NAME)",
                code="choice",
                fields=("session",),
            )
