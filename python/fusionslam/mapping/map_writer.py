# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Extends a session of a map: which frames become keyframes, and what is measured of them."""

import logging
from collections import ChainMap
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from fusionslam.base.arrays import Floats32, Integers, Matrix
from fusionslam.base.machine import release_memory
from fusionslam.errors import DataError, ShapeError
from fusionslam.fusion import fuse
from fusionslam.geometry.keyframes import is_keyframe
from fusionslam.geometry.se3 import inverse, log
from fusionslam.loop_closure.detector import LoopDetector
from fusionslam.loop_closure.loop import Loop, Rejected
from fusionslam.loop_closure.observation import Observation
from fusionslam.mapping.clouds import NOT_DRIVEN, FileClouds, pack_cloud
from fusionslam.mapping.config import odometry_covariance, step_covariance
from fusionslam.mapping.continuity import contradicts, fastest_step, find_doubt
from fusionslam.mapping.edge import CHI2_999, Edge, check_pose
from fusionslam.mapping.map_content import MapContent
from fusionslam.mapping.map_file import MapFile, StoredKeyframe
from fusionslam.mapping.map_settings import MapSettings
from fusionslam.registration import PreparedCloud, Refusal, register
from fusionslam.sensors.frame import Frame
from fusionslam.sensors.scan_motion import ScanMotion

_ABOUT = 8
"""Frames after a keyframe, and before the next one, whose odometry is kept."""
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
    """

    keyframe: int | None
    loops: tuple[Edge, ...]
    refused: tuple[Rejected, ...]
    pose: Matrix
    why: Refusal | None = None


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
        """Number of the session's last frame that is a keyframe; None if it has none."""
        self._last_odometry: Matrix | None = None
        self._last_stamp_ns = 0
        self._doubt: Refusal | None = None
        """Why odometry since the last keyframe may be wrong."""
        self._scans: tuple[PreparedCloud | None, PreparedCloud | None] = None, None
        """Of the last keyframe and of the new one, where their clouds are local maps."""
        self._driven: list[tuple[int, Matrix]] = []
        """Stamps and odometry of frames since the last keyframe, odom_from_cloud."""
        self._stretch: list[StoredKeyframe] = []  # that goes on
        if self._last is not None:
            self._last_odometry = _odom_from_robot(self._last)
            self._last_stamp_ns = self._last.stamp_ns
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
        if waited <= 0:
            self._driven = []
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
            self._driven.append((frame.stamp_ns, robot @ mount))
            del self._driven[_ABOUT:-_ABOUT]
            return MapStep(None, (), (), pose, back)
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
        driven = NOT_DRIVEN
        if self._driven:
            stamps_ns, poses = zip(*self._driven, strict=True)
            seconds = (np.array(stamps_ns) - frame.stamp_ns) / 1e9
            driven = np.column_stack([seconds, log(inverse(robot @ mount) @ np.array(poses))])
        cloud = pack_cloud(fuse(frame, self.settings.fusion), self.settings.map.voxel, driven)
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
        self._last, self._driven = keyframe, []
        self._stretch.append(keyframe)
        self._fastest = max(self._fastest, fastest_step(self._stretch[-2:]))
        self.last_frame = max(frame.number, self.last_frame or 0)
        closed = (content.edges[edges[-1].number],) if loop is not None else ()
        pose = content.pose(number) @ np.linalg.inv(mount)
        return MapStep(number, closed, tuple(self._detector.rejected), pose, reason)

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
        distance = self.settings.map.keyframe_distance
        if distance is None:
            distance = 4 * self._detector.registration_config.voxel
        step = np.linalg.inv(_odom_from_robot(last)) @ robot
        return is_keyframe(step, distance, self.settings.map.keyframe_turn)


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
