# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Node that extends a map that lasts by the robot's drive, or finds the robot on it."""

import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from fusionslam.base.arrays import Matrix
from fusionslam.config import Section, option
from fusionslam.descriptors import DescriptorConfig
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.fusion import FusionConfig
from fusionslam.loop_closure import LoopConfig
from fusionslam.mapping import Localization, MapConfig, MapStep, PlaceMap
from fusionslam.mapping.fixes import add_fixes
from fusionslam.registration import Refusal, RegistrationConfig
from fusionslam.ros.messages.library import build, respond
from fusionslam.ros.messages.maps import (
    grid_message,
    localize_response,
    located_pose,
    trajectory_message,
)
from fusionslam.ros.messages.types import (
    CLOUD,
    FIX,
    GRID,
    LOCALIZE,
    LOCATED_POSE,
    PATH,
    TRANSFORMS,
    header,
)
from fusionslam.ros.nodes.frame_node import TF, FrameNode, FramesConfig
from fusionslam.ros.runtime.node import Health, Input, Outlet, Service, Timer
from fusionslam.sensors.frame import Frame
from fusionslam.sensors.messages import (
    NANOSECONDS,
    Fix,
    FrameTransform,
    FrameTransforms,
    Scan,
)
from fusionslam.sensors.transforms import TransformError

FIXES = "fix"
CLOUDS, GRIDS, WAY, POSE = "~cloud", "~grid", "~path", "~pose"
_SHARE = 4
"""Drawing the map takes at most 1 in this many seconds."""
_CLOSING_S = 5.0
"""A drawing that is not finished this long after the end of the node is left to itself."""
_APART_S = 10.0
"""Fixes this far in time from the newest frame are of another clock."""
_ODOMETRY = (
    "no odometry, which a map needs: publish it on odom (odom:=/its/name), or as TF of the robot "
    "in the odometry frame"
)


class MapFileConfig(Section):
    """Which map, and what for."""

    file: str = option("", "the map (.fsmap), made if it is missing")
    session: str = option("", "name of the drive; empty: the date")
    read_only: bool = option(False, "only find the robot on the map, which does not change")


class DrawingConfig(Section):
    """How the map is published; only to subscribers."""

    every: float = option(
        2.0, "shortest time between two drawings; longer for large maps", unit="s", gt=0
    )
    voxel: float = option(0.2, "one point of the cloud a cube of this size", unit="m", ge=0.01)
    resolution: float = option(0.1, "side of a cell of the grid", unit="m", ge=0.01)


class TransformConfig(Section):
    """How the pose of the odometry frame on the map is published."""

    publish: bool = option(True, "whether it is published on /tf")
    rate: float = option(20.0, "how often", unit="Hz", gt=0, le=1000)
    ahead: float = option(
        0.1, "how far its stamp is ahead of the present, so that it holds until the next", ge=0
    )


class MapperConfig(FramesConfig):
    """Configuration of the node mapper; a map that exists keeps how it was made."""

    map: MapFileConfig = option(MapFileConfig(), "which map, and what for")
    descriptor: str = option("cm2dp", "descriptor of a new map")
    descriptors: DescriptorConfig = option(DescriptorConfig(), "clouds to vectors")
    loop_closure: LoopConfig = option(LoopConfig(window=20), "vectors to loops")
    fusion: FusionConfig = option(FusionConfig(), "source and frame of the clouds")
    registration: RegistrationConfig = option(RegistrationConfig(), "pairs of clouds to poses")
    mapping: MapConfig = option(MapConfig(), "what a map keeps of a drive")
    map_frame: str = option("map", "the frame of the map")
    tf: TransformConfig = option(TransformConfig(), "map to odometry on /tf")
    drawing: DrawingConfig = option(DrawingConfig(), "cloud, grid and path")
    every: float = option(
        1.0, "of map/read_only: shortest time between two localisations", unit="s", ge=0
    )


class PlaceMapper(FrameNode[MapperConfig]):
    """Adds frames to a ``PlaceMap``, as ``fusionslam map build`` does, or localises them on it."""

    name = "mapper"
    defaults = MapperConfig()
    outputs: ClassVar = {
        CLOUDS: CLOUD,
        GRIDS: GRID,
        WAY: PATH,
        POSE: LOCATED_POSE,
        TF: TRANSFORMS,
    }
    latched = (CLOUDS, GRIDS, WAY)

    def __init__(self, config: MapperConfig, outlet: Outlet) -> None:
        if not config.map.file:
            raise ConfigError(
                "~map/file is empty: expected the path of a map (.fsmap)",
                code="no-map-file",
                fields=("~map/file",),
            )
        self._path = Path(config.map.file).expanduser()
        self._read_only = config.map.read_only
        self._session = config.map.session or time.strftime("%Y-%m-%d")
        self._site = PlaceMap.open(
            self._path,
            None if self._read_only else self._session,
            read_only=self._read_only,
            descriptor=config.descriptor if "descriptor" in config.model_fields_set else None,
            loops=config.loop_closure,
            describe=config.descriptors,
            fusion=config.fusion,
            registration=config.registration,
            config=config.mapping,
        )
        super().__init__(config, outlet, self._site.fusion.source, moving=not self._read_only)
        if not self._read_only:
            self._site.check_recording("live topics")
        last = self._site.last_frame
        self._first_number = 0 if last is None else last + 1
        self._fixes: list[Fix] = []
        """Since the newest keyframe that the map has fixes of."""
        self._keyframe: int | None = None
        self._newest: Frame | None = None
        self._map_from_odometry: Matrix | None = None
        self._state, self._reason = "waiting", ""
        self._last: MapStep | Localization | None = None
        self._is_solved = True
        self._tried_ns: int | None = None
        self._localizing_s = 0.0
        self._sent_ns = 0
        self._changes = 1
        self._drawn: dict[str, int] = {}
        self._drawing = threading.Lock()
        self._next_drawing = 0.0

    @property
    def services(self) -> Sequence[Service]:
        """Services: localise, solve the graph, forget where the robot was."""
        return [
            Service("~localize", LOCALIZE, lambda _: self._answer_localize()),
            Service("~solve", "std_srvs/Trigger", lambda _: self._answer_solve()),
            Service("~forget_motion", "std_srvs/Empty", lambda _: self._answer_forget()),
        ]

    @property
    def timers(self) -> Sequence[Timer]:
        """TF, and drawing the map: both go on while frames are added."""
        drawing = Timer("drawing", self.config.drawing.every, self.draw)
        if not self.config.tf.publish:
            return [drawing]
        return [drawing, Timer(TF, 1 / self.config.tf.rate, self.publish_frame)]

    @property
    def inputs(self) -> Sequence[Input]:
        """With fixes of a satellite receiver, if the map is extended."""
        if self._read_only:
            return super().inputs
        return [*super().inputs, Input(FIXES, [FIX], self._take_fix, small=True, optional=True)]

    def take_frame(self, frame: Frame) -> None:
        """Add a frame to the map, or localise it."""
        self._newest = frame
        if self._read_only:
            # The newest frame matters, not each: those that wait meanwhile are skipped.
            tried, every = self._tried_ns, max(self.config.every, 2 * self._localizing_s)
            if tried is None or abs(frame.stamp_ns - tried) >= every * NANOSECONDS:
                self._tried_ns = frame.stamp_ns
                self._localize(frame)
            return
        frame.number += self._first_number
        step = self._site.add(frame)
        if step.keyframe is not None:
            self._keyframe = step.keyframe
            self._is_solved, self._changes = False, self._changes + 1
            self.counts["new keyframes"] += 1
            self.counts["loops"] += len(step.loops)
            self.counts["refused"] += len(step.refused)
            reasons = [*step.refused, *(edge.reason for edge in step.loops), step.why]
            self._reason = next((each.text for each in reasons[::-1] if each), self._reason)
        self._last = step
        self._place(step.pose, frame.odometry)
        if self._map_from_odometry is not None:
            top = header(frame.stamp_ns, self.config.map_frame)
            self.outlet.publish(POSE, located_pose(top, step.pose, step.covariance))

    def explain(self, error: DataError | ShapeError) -> str:
        """Say why a frame is not on the map, and what to do."""
        text = _ODOMETRY if error.code == "no-odometry" else str(error)
        return f"a frame is left out: {text}"

    def went_back(self) -> None:
        """Forget where the robot was: odometry has begun anew."""
        self._site.forget_motion()
        self._fixes.clear()
        if self._read_only:
            self._map_from_odometry, self._state, self._tried_ns = None, "searching", None

    def idle(self) -> None:
        """Add the waiting frames, and solve the graph while the robot stands."""
        super().idle()
        self._solve()

    def close(self) -> None:
        """Add the waiting frames, solve the graph, and close the file."""
        try:
            super().idle()
            self._solve()
        finally:
            # A reader that is open beside it would leave the log of changes behind.
            is_free = self._drawing.acquire(timeout=_CLOSING_S)
            self._site.close()
            if is_free:
                self._drawing.release()

    def report(self) -> Mapping[str, int | str]:
        """Say what state the map is in, and count keyframes, loops and refused candidates."""
        known = {"state": self._state, "last reason": self._reason}
        if self._last is not None:
            values = {
                "deviation [m]": self._last.deviation_m,
                "deviation [degrees]": self._last.deviation_deg,
                "unconfirmed [m]": self._last.unconfirmed_m,
            }
            known |= {k: "unknown" if v is None else f"{v:.3f}" for k, v in values.items()}
        if (origin := self._site.content.origin) is not None:
            known["origin"] = str(origin)
        return {**known, "keyframes": len(self._site), **super().report()}

    def health(self) -> Health:
        """Say whether the robot is lost, or may soon be: half the way on which it gets lost."""
        last, limit = self._last, self._site.settings.map.lost_after
        if last is None:
            return Health()
        driven = "odometry does not tell how far it drove"
        if last.unconfirmed_m is not None:
            driven = f"{last.unconfirmed_m:.0f} m since its position was confirmed"
        if last.is_lost and self._state != "mapping":  # who explores is unsure
            return Health("lost", f"the robot is lost ({self._state}): {driven}")
        is_known = self._state in ("mapping", "localised")
        if is_known and last.unconfirmed_m is not None and last.unconfirmed_m <= limit / 2:
            return Health()
        return Health("unsure", f"where the robot is is not sure ({self._state}): {driven}")

    def publish_frame(self, now_ns: int) -> None:
        """Publish map_from_odometry, stamped a little ahead of now. Called in any thread."""
        place, stamp_ns = self._map_from_odometry, now_ns + round(self.config.tf.ahead * 1e9)
        # TF warns of each stamp that it has already, as while simulated time stands still.
        if place is None or not now_ns or stamp_ns == self._sent_ns:
            return
        child = self.frames.frame_of("odometry")
        if child.strip("/") in ("", self.config.map_frame):
            self.problems.add(
                TF,
                f"the frame of odometry is '{child}': nothing is published; odometry needs a "
                "frame other than ~map_frame, or set ~tf/publish to false",
                "odometry-in-map-frame",
            )
            return
        self._sent_ns = stamp_ns
        link = FrameTransform(
            stamp_ns=stamp_ns,
            parent=self.config.map_frame,
            child=child,
            parent_from_child=place,
        )
        self.outlet.publish(TF, build(FrameTransforms(transforms=(link,))))

    def draw(self, now_ns: int) -> None:
        """Publish cloud, grid and path to subscribers, if the map changed. Called in any thread.

        It reads the map as the file has it, so that adding frames does not wait.
        """
        changes, began = self._changes, time.monotonic()
        wanted = [
            topic
            for topic in self.latched
            if self._drawn.get(topic) != changes and self.outlet.is_wanted(topic)
        ]
        if not wanted or began < self._next_drawing:
            return
        with self._drawing, PlaceMap.open(self._path, read_only=True) as site:
            if len(site):
                for topic in wanted:
                    self.outlet.publish(topic, self._drawing_of(topic, site))
        self._drawn |= dict.fromkeys(wanted, changes)
        self._next_drawing = time.monotonic() + (_SHARE - 1) * (time.monotonic() - began)

    def _drawing_of(self, topic: str, site: PlaceMap) -> Any:
        stamp_ns = 0 if self._newest is None else self._newest.stamp_ns
        frame, drawing = self.config.map_frame, self.config.drawing
        if topic == CLOUDS:
            cloud = site.cloud(drawing.voxel)
            return build(
                Scan(stamp_ns=stamp_ns, frame_id=frame, points=cloud.points, colors=cloud.colors)
            )
        top = header(stamp_ns, frame)
        if topic == GRIDS:
            return grid_message(top, site.grid(drawing.resolution))
        if self._read_only or self._session not in site.content.sessions:
            return trajectory_message(top, np.empty(0, np.int64), np.empty((0, 4, 4)))
        stamps, poses = site.trajectory(self._session)
        joined = [_is_joined(site, each) for each in site.keyframes(self._session).tolist()]
        return trajectory_message(top, stamps[joined], poses[joined])

    def _place(self, pose: Matrix, odometry: Matrix | None) -> None:
        """Take the robot's pose on the map, unless it is in a part that is not joined yet."""
        if self._keyframe is None:
            self._keyframe = int(self._site.keyframes(self._session)[-1])
        is_joined = _is_joined(self._site, self._keyframe)
        self._state = "mapping" if is_joined else "mapping, not joined with the map yet"
        self._map_from_odometry = None
        if is_joined and odometry is not None:
            self._map_from_odometry = pose @ np.linalg.inv(odometry)

    def _solve(self) -> None:
        if self._is_solved:
            return
        if not self._add_fixes():
            self._site.solve()
        self._is_solved, self._changes = True, self._changes + 1
        if self._site.reason is not None:
            self._reason = self._site.reason.text
        if self._keyframe is not None:
            _, poses = self._site.trajectory(self._session)
            self._place(poses[-1], self._site.odometry(self._session)[-1])

    def _take_fix(self, fix: Fix) -> None:
        """Keep a fix until the graph is solved. Before the first frame it tells nothing."""
        if fix.position is None or self._newest is None:
            return
        late_s = (fix.stamp_ns - self._newest.stamp_ns) / NANOSECONDS
        if abs(late_s) > _APART_S:
            text = (
                f"fixes are left out whose stamps are {late_s:+.1f} s from that of the newest "
                "frame: expected one clock"
            )
            self.problems.add(FIXES, text, "other-clock")
            return
        self.counts["fixes"] += 1
        self._fixes.append(fix)

    def _add_fixes(self) -> bool:
        """Put the map where the satellite receiver has it, and solve; False if nothing is new."""
        keyframes = self._site.keyframes(self._session) if self._fixes and len(self._site) else ()
        if len(keyframes) < 2:
            return False
        first = self._fixes[0]
        try:
            mount = self.frames.robot.robot_from(first.frame_id, first.stamp_ns)
        except TransformError:
            mount = None
        if mount is None:
            text = (
                f"TF does not link the antenna ({first.frame_id!r}) to the robot: fixes wait until "
                "it does"
            )
            self.problems.add(FIXES, text, "no-antenna")
            return False
        try:
            is_new = add_fixes(self._site, self._session, self._fixes, mount)
        except DataError as error:
            if error.code not in ("no-fixes", "other-clock"):
                raise
            return False  # none lies between two keyframes yet
        newest_ns = self._site.trajectory(self._session)[0][-1]
        self._fixes = [fix for fix in self._fixes if fix.stamp_ns >= newest_ns]
        for place in self._site.content.places.values():
            if isinstance(place, Refusal):
                self._reason = place.text
        return is_new

    def _localize(self, frame: Frame) -> Localization:
        began = time.monotonic()
        try:
            found = self._site.localize(frame)
        except DataError as error:
            found = Localization(None, reason=Refusal(error.code, 0, str(error)))
            if self._last is not None:  # one frame that cannot be used is no sign of being lost
                driven, is_lost = self._last.unconfirmed_m, self._last.is_lost
                found = replace(found, unconfirmed_m=driven, is_lost=is_lost)
        self._localizing_s = time.monotonic() - began
        self.counts["localisations"] += 1
        self.counts["found"] += found.map_from_robot is not None
        if found.reason is not None:
            self.counts[f"not found: {found.reason.code}"] += 1
        self._reason = "" if found.reason is None else found.reason.text
        if self._read_only:
            self._take_place(frame, found)
        return found

    def _take_place(self, frame: Frame, found: Localization) -> None:
        """Publish where the robot is; where it is not found, odometry carries on."""
        pose = found.map_from_robot
        self._state, self._last = "searching" if pose is None else "localised", found
        if (
            pose is None
            or found.covariance is None
            or found.keyframe is None
            or not _is_joined(self._site, found.keyframe)
        ):
            return
        top = header(frame.stamp_ns, self.config.map_frame)
        self.outlet.publish(POSE, located_pose(top, pose, found.covariance))
        if frame.odometry is not None:
            self._map_from_odometry = pose @ np.linalg.inv(frame.odometry)

    def _answer_localize(self) -> Any:
        if self._newest is None:
            text = "no frame has come yet: are the sensors published?"
            found, stamp_ns = Localization(None, reason=Refusal("no-frame", 0, text)), 0
        else:
            found, stamp_ns = self._localize(self._newest), self._newest.stamp_ns
        return localize_response(header(stamp_ns, self.config.map_frame), found)

    def _answer_solve(self) -> Any:
        self._is_solved = False
        self._solve()
        states = [edge.state for edge in self._site.loops]
        text = ", ".join(f"{states.count(each)} {each}" for each in ("believed", "refused"))
        return respond("std_srvs/Trigger", success=True, message=text)

    def _answer_forget(self) -> Any:
        self.went_back()
        return respond("std_srvs/Empty")


def _is_joined(site: PlaceMap, keyframe: int) -> bool:
    """Whether a keyframe is in the part of the map that began first, whose frame is published."""
    return site.content.part(keyframe) == site.content.parts[0]
