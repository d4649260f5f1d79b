# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Extends a session of a map: which frames become keyframes, and what is measured of them."""

import logging
from collections import ChainMap
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from fusionslam.base.arrays import Floats, Floats32, Integers, Matrix
from fusionslam.base.machine import release_memory
from fusionslam.errors import DataError, ShapeError
from fusionslam.fusion import fuse
from fusionslam.geometry.keyframes import is_keyframe
from fusionslam.geometry.se3 import carry_covariance, exp, inverse, log
from fusionslam.loop_closure.detector import LoopDetector
from fusionslam.loop_closure.loop import Loop, Rejected
from fusionslam.loop_closure.observation import Observation
from fusionslam.mapping.clouds import FileClouds, pack_cloud
from fusionslam.mapping.config import odometry_covariance, step_covariance
from fusionslam.mapping.continuity import contradicts, fastest_step, find_doubt
from fusionslam.mapping.edge import CHI2_999, Edge, check_pose, deviations_of
from fusionslam.mapping.map_content import MapContent
from fusionslam.mapping.map_file import MapFile, StoredFrames, StoredKeyframe
from fusionslam.mapping.map_settings import MapSettings
from fusionslam.registration import PreparedCloud, Refusal, register
from fusionslam.sensors.frame import Frame
from fusionslam.sensors.scan_motion import ScanMotion

_MOST_WAITING = 1000
"""Frames since a keyframe that wait for the next one in memory."""
_RELEASE = 10
"""Keyframes after which memory that is free is given back, which takes some milliseconds."""

_STOOD_M = 0.1
"""Odometry that moved no farther stood, however long."""

logger = logging.getLogger(__name__)


class MapStep(NamedTuple):
    """What a map made of a frame.

    Attributes:
        keyframe: its number; None if the frame is too near the last keyframe.
        loops: edges that the keyframe closes loops by, with their states so far.
        refused: candidates that are no loop, and why.
        pose: float64 (4, 4), map_from_robot.
        why: what is unusual about the frame; None if nothing is. Its code is "jump" (number:
            metres of odometry since the frame before), "restart" (metres back to the origin of
            odometry), or "silence" (seconds since then, and clouds contradict odometry), each of
            which begins a part of the map, or "stamp" (seconds that the time stamp is before that
            of the frame before; many begin a part unless clouds confirm odometry).
        covariance: float64 (6, 6) of the pose's error against the first keyframe of its part of the
            map, as a small motion in the robot's frame: at most that of the best chain of odometry
            and believed loops from there.
        unconfirmed_m: metres by odometry since a believed loop confirmed the position, or since the
            part began.
        is_lost: whether they are more than ``MapConfig.lost_after``.
    """

    keyframe: int | None
    loops: tuple[Edge, ...]
    refused: tuple[Rejected, ...]
    pose: Matrix
    why: Refusal | None
    covariance: Floats
    unconfirmed_m: float
    is_lost: bool

    @property
    def deviation_m(self) -> float:
        """Root mean square of the error of the position that is to be expected, metres."""
        return float(deviations_of(self.covariance)[0])

    @property
    def deviation_deg(self) -> float:
        """The same of the rotation, degrees."""
        return float(deviations_of(self.covariance)[1])


class MapWriter:
    """Extends the open session of a map frame by frame.

    Args:
        name: of the session; None if there is none.
        settings: of the map.
        file, content, detector, kept: of the map. Each keyframe becomes part of all.

    Attributes:
        settings: of the map. The first keyframe fixes lengths and radii.
        is_torn: whether the last frame failed after memory had changed: load it from the file.
        motion: within the scans of keyframes.
    """

    def __init__(
        self,
        name: str | None,
        settings: MapSettings,
        file: MapFile,
        content: MapContent,
        detector: LoopDetector,
        kept: FileClouds,
    ) -> None:
        self.settings, self.is_torn = settings, False
        self.motion = ScanMotion()
        detector.break_odometry()
        self._name, self._file, self._content = name, file, content
        self._detector, self._kept = detector, kept
        mine = content.keyframes_of(content.sessions.get(name or "", -1))
        self._last: StoredKeyframe | None = mine[-1] if mine else None
        self.last_frame = max((each.frame for each in mine), default=None)
        """Number of the session's last frame that the file has; None if it has none."""
        self._last_odometry: Matrix | None = None
        self._last_stamp_ns = 0
        self._doubt: Refusal | None = None
        """Why odometry since the last keyframe may be wrong."""
        self._scans: tuple[PreparedCloud | None, PreparedCloud | None] = None, None
        """Of the last keyframe and of the new one, where their clouds are local maps."""
        self._waiting: list[tuple[int, int, Matrix]] = []
        """Frames since the last keyframe that the file lacks: number, stamp, odom_from_robot."""
        self._written = 0  # frames since the last keyframe that it has
        self._stretch: list[StoredKeyframe] = []  # that goes on
        if self._last is not None:
            self._last_odometry = _odom_from_robot(self._last)
            self._last_stamp_ns = self._last.stamp_ns
            passed = file.frames_after(self._last.id)
            self._written = len(passed.numbers)
            if self._written:
                self.last_frame = max(self.last_frame or 0, int(passed.numbers.max()))
                self._last_odometry = self._last_odometry @ exp(passed.motions[-1])
                self._last_stamp_ns = int(passed.stamps_ns[-1]) or self._last_stamp_ns
            first = content.stretches[self._last.id]
            self._stretch = [each for each in mine if content.stretches[each.id] == first]
        self._fastest = fastest_step(self._stretch)
        """m/s by odometry."""

    def add(self, frame: Frame, odometry: Matrix | None = None) -> MapStep:
        """Add a frame; arguments and errors as of ``PlaceMap.add``."""
        if not isinstance(frame, Frame):
            raise ShapeError(f"expected a Frame, got {type(frame).__name__}")
        if not isinstance(frame.number, int | np.integer) or not 0 <= frame.number < 2**63:
            raise DataError(
                f"a frame has number {frame.number!r}: expected an integer from 0 on",
                code="frame-number",
                fields=(repr(frame.number),),
            )
        robot = _odometry_of(frame, odometry)
        mount = self.settings.robot_from_cloud(frame)
        waited = 0.0  # seconds since the frame before; 0 if unknown
        if frame.stamp_ns and self._last_stamp_ns:
            waited = (frame.stamp_ns - self._last_stamp_ns) / 1e9
        if self._last_odometry is not None:
            doubt = find_doubt(self._last_odometry, robot, waited, self._fastest, self.settings.map)
            if self._doubt is None or (doubt is not None and doubt.code == "jump"):
                self._doubt = doubt
        self._last_odometry = robot
        self._last_stamp_ns = frame.stamp_ns or self._last_stamp_ns
        self.motion.follow(frame.stamp_ns, robot @ mount)
        back = None
        if waited < 0:
            back = Refusal("stamp", -waited, f"the time stamp goes back by {-waited:.3f} s")
        if self._last is not None and self._doubt is None and not self._is_far(robot, self._last):
            last = self._last  # by which, and by odometry since, the robot's pose is known
            pose = self._content.pose(last.id) @ np.linalg.inv(last.odometry) @ robot
            moved = inverse(_odom_from_robot(last)) @ robot
            self._waiting.append((frame.number, frame.stamp_ns, robot))
            if len(self._waiting) >= _MOST_WAITING:
                self.save_frames()
            return MapStep(None, (), (), pose, back, *self._judge(last, moved))
        if self._doubt is not None:
            self._detector.break_odometry()
        seen = self._detector.observe(frame, stamp_ns=frame.stamp_ns, odometry=robot @ mount)
        if not np.any(seen.vectors[self._detector.descriptor]):
            raise DataError(
                f"frame {frame.number} has nothing that {self.settings.descriptor} describes"
            )
        assert seen.cloud is not None
        seen.cloud.moved = self.motion.within(seen.span)
        scan = seen.scan()
        if scan is not None:
            scan.moved = seen.cloud.moved
        self._scans = self._scans[1], scan
        seen = replace(seen, span=None)
        cloud = pack_cloud(fuse(frame, self.settings.fusion), self.settings.map.voxel)
        self.is_torn = True
        step = self._add_keyframe(frame, seen, cloud, mount)
        self.is_torn = False
        return step if step.why is not None else step._replace(why=back)

    def _add_keyframe(
        self, frame: Frame, seen: Observation, cloud: bytes, mount: Matrix
    ) -> MapStep:
        content, number = self._content, len(self._detector)
        assert seen.cloud is not None and seen.odometry is not None
        keyframe = StoredKeyframe(
            number, -1, frame.number, seen.stamp_ns or 0, seen.odometry, mount
        )
        edges = self._lead_on(keyframe, seen.cloud)
        reason, self._doubt = self._doubt, None
        if reason is not None:
            logger.warning("%s", reason)
        if not edges:
            self._stretch = []
        first = self._stretch[0].id if edges else number
        loop = self._detector.add_observation(
            seen,
            excluded=self._too_recent(keyframe.stamp_ns),
            stretches=ChainMap({number: first}, content.stretches),
        )
        with self._file.transaction():
            if not len(content):  # the first keyframe fixes lengths of registration, and the radius
                self.settings = replace(
                    self.settings,
                    describe=self._detector.describe_config,
                    registration=self._detector.registration_config,
                )
                self._file.store_setting("config", self.settings.dump())
            assert self._name is not None
            if self._name not in content.sessions:
                content.sessions[self._name] = self._file.add_session(self._name)
            session = content.sessions[self._name]
            keyframe = keyframe._replace(session=session)
            self._write_frames()
            if loop is not None:
                edges.append(self._loop_edge(loop, session, content.next_edge + len(edges)))
            content.add(keyframe, edges)
            stored = self._kept.take(number, cloud, seen.cloud.ground_level)
            self._file.add_keyframe(keyframe, stored, seen.vectors)
            content.save(self._file)
        content.saved()
        self._kept.written()
        if len(content) % _RELEASE == 0:
            release_memory()
        self._last, self._waiting, self._written = keyframe, [], 0
        self._stretch.append(keyframe)
        self._fastest = max(self._fastest, fastest_step(self._stretch[-2:]))
        self.last_frame = max(frame.number, self.last_frame or 0)
        closed = (content.edges[edges[-1].number],) if loop is not None else ()
        pose = content.pose(number) @ np.linalg.inv(mount)
        refused = tuple(self._detector.rejected)
        return MapStep(number, closed, refused, pose, reason, *self._judge(keyframe))

    def _judge(
        self, keyframe: StoredKeyframe, moved: Matrix | None = None
    ) -> tuple[Floats, float, bool]:
        """How sure the robot's pose is at a keyframe, or after a motion since: as of a step."""
        covariance, unconfirmed_m = self._content.bound(keyframe.id)
        covariance = carry_covariance(keyframe.robot_from_cloud, covariance)
        if moved is not None:
            drift = odometry_covariance(moved, self.settings.map)
            covariance = carry_covariance(inverse(moved), covariance) + drift
            unconfirmed_m += float(np.linalg.norm(moved[:3, 3]))
        return covariance, unconfirmed_m, unconfirmed_m > self.settings.map.lost_after

    def save_frames(self) -> None:
        """Write the frames since the last keyframe that the file lacks, if it is this process's."""
        if self._waiting and self._file.is_mine:
            with self._file.transaction():
                self._write_frames()
            self.last_frame = max(self.last_frame or 0, *(number for number, *_ in self._waiting))
            self._written += len(self._waiting)
            self._waiting = []

    def keep_frames(self, former: "MapWriter") -> None:
        """Take over frames that a writer of the same file has not written."""
        ends = {None if each is None else each.id for each in (self._last, former._last)}
        if former._waiting and len(ends) == 1:
            self._waiting = former._waiting
            _, stamp_ns, self._last_odometry = self._waiting[-1]
            self._last_stamp_ns = stamp_ns or self._last_stamp_ns

    def _write_frames(self) -> None:
        if self._waiting:
            assert self._last is not None
            numbers, stamps_ns, poses = map(np.array, zip(*self._waiting, strict=True))
            motions = log(inverse(_odom_from_robot(self._last)) @ poses)
            frames = StoredFrames(numbers, stamps_ns, motions)
            self._file.add_frames(self._last.id, self._written, frames)

    def _lead_on(self, keyframe: StoredKeyframe, cloud: PreparedCloud) -> list[Edge]:
        """Return the step from the last keyframe; nothing if odometry does not tell it."""
        doubt = self._doubt
        if self._last is None or (doubt is not None and doubt.code == "jump"):
            return []
        is_silent = doubt is not None and doubt.code == "silence"
        way = self._fastest * doubt.number if doubt is not None and is_silent else None
        edges = self._measure_step(self._last, keyframe, cloud, way)
        if doubt is None:
            return edges
        if len(edges) == 2:  # clouds measured the step as well
            driven, measured = edges
            off = log(inverse(driven.pose) @ measured.pose)
            spread = driven.covariance + measured.covariance
            goes_on = bool(off @ np.linalg.solve(spread, off) <= CHI2_999)
        else:
            stored = self._detector.stored_frame(self._last.id).unpack()
            goes_on = is_silent and not contradicts(cloud, stored, edges[0])
        if not goes_on:
            return []
        self._doubt = None
        return edges

    def _too_recent(self, stamp_ns: int) -> set[int]:
        """Keyframes that are no candidates: odometry that connects them is still good."""
        loops, count = self.settings.loops, len(self._stretch)
        recent = {each.id for each in self._stretch[max(count - loops.window, 0) :]}
        for each in reversed(self._stretch if loops.window_seconds else []):
            if stamp_ns - each.stamp_ns > loops.window_seconds * 1e9:
                break
            recent.add(each.id)
        return recent

    def _measure_step(
        self,
        before: StoredKeyframe,
        after: StoredKeyframe,
        cloud: PreparedCloud,
        way: float | None,
    ) -> list[Edge]:
        """Measure the step from the last keyframe by odometry, and by both clouds if they fit.

        Loops alone cannot tell odometry's scale.

        Args:
            before, after: the last keyframe and the new one.
            cloud: of the new one.
            way: metres that the robot may have driven unseen; None if it was seen all the time.
        """
        number, ends = self._content.next_edge, (before.id, after.id)
        step = np.linalg.inv(before.odometry) @ after.odometry
        covariance = odometry_covariance(step, self.settings.map)
        straight = float(np.linalg.norm(step[:3, 3]))
        if way is not None and straight > _STOOD_M:
            covariance *= max(way / straight, 1)  # variances grow with the way
        edges = [Edge(number, "odometry", *ends, step, covariance, "believed")]
        stored = self._detector.stored_frame(before.id).unpack()
        if cloud.further or stored.further:  # local maps share scans, which odometry joined
            last, new = self._scans
            if last is None or new is None:
                return edges
            stored, cloud = last, new
        found = register(cloud, stored, step, search=way is not None)
        if found.target_from_source is not None and found.covariance is not None:
            pose, covariance = found.target_from_source, found.covariance
            if cloud.scene is None and not cloud.is_sector:
                covariance = step_covariance(covariance, cloud.config, self.settings.map)
            edges.append(Edge(number + 1, "loop", *ends, pose, covariance, "pending"))
        return edges

    def _loop_edge(self, loop: Loop, session: int, number: int) -> Edge:
        assert loop.match_from_query is not None
        matched = self._content.keyframes[self._content.row[loop.match]]
        return Edge(
            number,
            "loop" if matched.session == session else "merge",
            loop.match,
            loop.query,
            loop.match_from_query,
            np.asarray(loop.covariance),
            "pending",
        )

    def _is_far(self, robot: Matrix, last: StoredKeyframe) -> bool:
        step = np.linalg.inv(_odom_from_robot(last)) @ robot
        return is_keyframe(step, self.settings.keyframe_distance, self.settings.map.keyframe_turn)


def resume_detector(
    settings: MapSettings,
    file: MapFile,
    content: MapContent,
    kept: FileClouds,
    vectors: Mapping[str, tuple[Integers, Floats32]],
) -> LoopDetector:
    """Return a detector that has the keyframes of a map.

    Raises:
        DataError: keyframes lack vectors (code "damaged").
    """
    detector = settings.new_detector()
    numbers = content.numbers
    for name in {detector.descriptor, *vectors}:
        known = vectors[name][0] if name in vectors else numbers[:0]
        if not np.array_equal(known, numbers):
            raise DataError(
                f"{file.path} is damaged: vectors of {name} of {len(known)} keyframes of "
                f"{len(numbers)}",
                code="damaged",
                fields=(str(file.path),),
            )
    stamps = np.array([each.stamp_ns for each in content.keyframes], np.int64)
    detector.resume(kept, {n: rows for n, (_, rows) in vectors.items()}, numbers, stamps)
    return detector


def _odom_from_robot(keyframe: StoredKeyframe) -> Matrix:
    pose: Matrix = keyframe.odometry @ np.linalg.inv(keyframe.robot_from_cloud)
    return pose


def _odometry_of(frame: Frame, odometry: Matrix | None) -> Matrix:
    pose = frame.odometry if odometry is None else odometry
    if pose is None:
        raise DataError(
            f"frame {frame.number} has no odometry, which a map needs: record it, or take "
            "that of its scans (fusionslam odometry)",
            code="no-odometry",  # without fields: it is one cause, whichever frame lacks it
        )
    return check_pose("odometry", pose)
