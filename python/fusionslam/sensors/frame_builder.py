# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Builds frames from messages, on a robot or from its recordings.

``FrameBuilder`` takes scans, images, calibrations, odometry and transforms as they arrive and
returns each scan as a ``Frame`` with its images and with the camera poses at the times of the
images.
"""

import logging
from collections import Counter, deque
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from fusionslam.base.argument_types import checked
from fusionslam.config import Section, option
from fusionslam.errors import ConfigError, DataError, cause_of
from fusionslam.sensors.companions import Companions
from fusionslam.sensors.frame import CloudFrame, Frame
from fusionslam.sensors.frame_assembly import frame_from_pair
from fusionslam.sensors.messages import (
    NANOSECONDS,
    CameraInfo,
    Fix,
    FrameTransforms,
    Imu,
    Message,
    Odometry,
    Picture,
    Scan,
    as_nanoseconds,
)
from fusionslam.sensors.robot_frames import RobotFrames
from fusionslam.sensors.scan_merging import Partner, merge_scans, time_remarks
from fusionslam.sensors.synchronizer import (
    BUFFER_FULL,
    CLOCK_JUMP,
    Pair,
    SyncConfig,
    Synchronizer,
    partner_config,
    stereo_synchronizer,
)
from fusionslam.sensors.transforms import TransformError

logger = logging.getLogger(__name__)


POINT_TIMES = "times of points"
NOT_DESKEWED = "motion within scans stays"
NO_TRANSFORM = "no transform"
NO_CAMERA_INFO = "no CameraInfo"
BAD_CALIBRATION = "calibration does not fit"
ALONE = "scans are used alone"

# Advice for the robot's owner.
_ADVICE = {
    NO_TRANSFORM: "publish it on /tf_static or /tf, as robot_state_publisher does",
    NO_CAMERA_INFO: "is it published, or has its topic to be remapped?",
    BAD_CALIBRATION: "its CameraInfo has to be of a calibration at the size of its images",
    BUFFER_FULL: "what they wait for, transforms or CameraInfo, comes too late (online.wait)",
    CLOCK_JUMP: "what waited is dropped and all starts anew; nothing is to be done for a bag that "
    "is played again",
    POINT_TIMES: "look at the scanner's driver if that is not so",
    NOT_DESKEWED: "clouds are bent by it; are odometry and transforms published without pauses, "
    "until the last point of each scan?",
    ALONE: "look at the topics, clocks and transforms of the scanners that are to be merged",
    "odometry": "images are placed as if the robot stood; is odometry published without pauses?",
    "FrameTransforms": "two publishers of /tf contradict each other: stop "
    "one, and start anew if it was the first",
    "Odometry": "look at its publisher",
    "Imu": "look at its driver; two IMUs need topics of their own",
}
_PAIR = ("left", "right")


class OnlineConfig(Section):
    """Configuration of how arriving messages become frames."""

    sync: SyncConfig = option(SyncConfig(), "which image belongs to which scan")
    robot_frame: str = option(
        "", "the robot's frame; empty: that of the odometry, else base_footprint or base_link"
    )
    odometry_frame: str = option(
        "", "the frame that odometry is measured in; empty: that of the odometry, else odom"
    )
    truth_frame: str = option(
        "world",
        "odometry in this frame is the true pose of frames; empty: there is none, and in "
        "odometry_frame it is odometry all the same",
    )
    wait: float = option(
        0.5, "how long a scan waits for its transforms and CameraInfo", unit="s", ge=0
    )
    history: float = option(10.0, "how long transforms are kept", unit="s", gt=0)
    deskew: bool = option(
        True, "whether motion within scans is undone by odometry, or an IMU, and times of points"
    )
    extrapolation: float = option(
        0.0, "how far beyond the known transforms a robot's motion is carried on", unit="s", ge=0
    )


def _pictures(pair: Pair) -> dict[str, Picture]:
    """All images of a pair, whose left one may itself be a stereo pair."""
    found = {"left": pair.item} if isinstance(pair.item, Picture) else {}
    for name, image in pair.images.items():
        found |= _pictures(image.item) if isinstance(image.item, Pair) else {name: image.item}
    return found


@checked
class FrameBuilder:
    """Builds frames from messages in bounded memory; bad messages never stop it.

    A scan becomes a frame once its images are decided (``Synchronizer``) and its transforms and
    CameraInfo have arrived; it waits for these for up to ``wait`` seconds, measured by the newest
    stamp of sensors and odometry. For the sensor ``sync.scans`` this always holds:
    added = frames + dropped + waiting.

    Args:
        config: limits and names.
        cameras: cameras that every frame needs; "left" and "right" together are a stereo pair.
        surround: further cameras, whose images frames take along if there are any.
        scanners: further scanners, whose scans are merged into those of the leading one.
        scans: whether frames are scans; else they are stereo pairs, in the left camera's frame.
        moving: whether frames wait for odometry even while nothing is known of it yet.

    Attributes:
        sync: the synchroniser, with its counts.
        stereo: synchroniser of stereo pairs, which go to ``sync`` as "left"; None without them.
        robot: poses of sensors and robot.
        frames: number of frames so far.
        refused: number of messages with invalid content by type: transforms that form a loop, ...
        still: number of frames without known odometry.
        skewed: number of frames whose points have times, but whose motion odometry did not undo.
        surround: images of the further cameras, and how many frames lack one.
        scanners: scans of the further scanners, and how many frames lack one.
    """

    def __init__(
        self,
        config: OnlineConfig | None = None,
        *,
        cameras: tuple[str, ...] = ("left",),
        surround: tuple[str, ...] = (),
        scanners: tuple[str, ...] = (),
        scans: bool = True,
        moving: bool = False,
    ) -> None:
        self.config = config or OnlineConfig()
        is_pair = {*_PAIR} <= {*cameras}
        if not scans and not (is_pair and len(cameras) == len(_PAIR)):
            raise ConfigError(f"cameras is {cameras}, expected left and right where scans is False")
        self.stereo = stereo_synchronizer(self.config.sync) if is_pair and scans else None
        others = [name for name in cameras if name != "right" or not is_pair]
        self.sync = (
            Synchronizer(self.config.sync, cameras=others)
            if scans
            else stereo_synchronizer(self.config.sync)
        )
        self.robot = RobotFrames(
            history_s=self.config.history,
            extrapolation_s=self.config.extrapolation,
            robot=self.config.robot_frame,
            odometry=self.config.odometry_frame,
            truth=self.config.truth_frame,
        )
        self.surround: Companions[Picture] = Companions(
            surround, self.config.sync, self.config.wait
        )
        self.scanners: Companions[Scan] = Companions(
            scanners if scans else (), partner_config(self.config.sync), self.config.wait
        )
        self._merged: _Merged | None = None
        self._moving = moving
        self.frames = self.still = self.skewed = 0
        self.refused: Counter[str] = Counter()
        self._infos: dict[str, CameraInfo] = {}
        self._pending: deque[Pair] = deque()
        self._given_up: Counter[tuple[str, str]] = Counter()
        self._newest_ns: int | None = None
        self._jump_ns = as_nanoseconds("jump", self.config.sync.jump)
        self._scan_frame = ""
        self._logged: set[tuple[str, ...]] = set()

    @property
    def jumps(self) -> int:
        """Number of times the clock of a scanner or camera jumped back."""
        return self.sync.jumps + (self.stereo.jumps if self.stereo else 0)

    def frame_of(self, cloud_frame: CloudFrame) -> str:
        """Name of the frame of clouds from ``fuse``, as far as it is known by now."""
        names = {"robot": self.robot.robot, "odometry": self.robot.odometry}
        if cloud_frame in names:
            return names[cloud_frame] or ""
        info = self._infos.get("left")
        seen = info.frame_id if info is not None else ""
        return self._scan_frame if cloud_frame == "scan" and self._scan_frame else seen

    @property
    def dropped(self) -> Counter[tuple[str, str]]:
        """Number of messages dropped, by (sensor, reason)."""
        paired = self.stereo.dropped if self.stereo else Counter()
        return self.sync.dropped + paired + self._given_up

    @property
    def waiting(self) -> dict[str, int]:
        """Number of undecided messages by sensor."""
        waiting = Counter(self.sync.waiting)
        if self.stereo:
            waiting.update(self.stereo.waiting)
        waiting[self.sync.scans] += len(self._pending)
        return dict(waiting)

    @checked
    def process(self, message: Message, sensor: str = "left") -> list[Frame]:
        """Process a message and return the frames that it completes, by ascending stamp.

        Args:
            message: from any sensor. Invalid content is refused, counted and logged once.
            sensor: the camera that an image or a CameraInfo belongs to, or the further scanner that
                a scan does.

        Raises:
            ConfigError: an image of a camera that was not named at construction, or a scan
                without ``scans``.
        """
        if isinstance(message, CameraInfo):
            self._infos[sensor] = message
        elif isinstance(message, Scan) and sensor in self.scanners.names:
            self.scanners.add(sensor, message)
        elif isinstance(message, Scan):
            self._scan_frame = message.frame_id
            self._synchronise("points", message)
        elif isinstance(message, Picture) and sensor in self.surround.names:
            self.surround.add(sensor, message)
            self._advance(message.stamp_ns)
        elif isinstance(message, Picture):
            self._synchronise(sensor, message)
        elif not isinstance(message, Fix):  # frames need none
            self._move(message)
        return self._complete()

    def settle(self) -> list[Frame]:
        """Return the frames of all waiting scans after a silence; later ones find their images."""
        if self.stereo:
            for both in self.stereo.settle():
                self._pending.extend(self.sync.add("left", both.stamp_ns, both))
        self._pending.extend(self.sync.settle())
        return self._complete(final=True)

    def flush(self) -> list[Frame]:
        """Return the frames of all waiting messages; no more are expected."""
        frames = self.settle()
        for each in filter(None, (self.stereo, self.sync)):
            each.flush()  # images that no scan needed
        return frames

    def _synchronise(self, sensor: str, message: Scan | Picture) -> None:
        jumps, pairs = self.sync.jumps, []
        if self.stereo is None or sensor not in _PAIR:
            pairs = self.sync.add(sensor, message.stamp_ns, message)
        else:  # left and right images pair first
            for both in self.stereo.add(sensor, message.stamp_ns, message):
                pairs += self.sync.add("left", both.stamp_ns, both)
        if self.sync.jumps > jumps:
            self._restart()
            # Odometry and TF that already have the new time are kept.
            self.robot.forget_after(message.stamp_ns + self._jump_ns)
        self._pending.extend(pairs)
        self._advance(message.stamp_ns)
        if len(self._pending) > self.config.sync.buffer:
            self._pending.popleft()
            self._give_up(BUFFER_FULL, "too many scans wait")

    def _move(self, message: FrameTransforms | Odometry | Imu) -> None:
        if not isinstance(message, Imu) and self.robot.goes_back(message, self._jump_ns):
            self.robot.forget_moving()
            self._restart()
        try:
            if isinstance(message, Imu):
                self.robot.imu.add(message, self._jump_ns)
            else:
                self.robot.add(message)
        except DataError as error:
            self.refused[type(message).__name__] += 1
            self._log(type(message).__name__, str(error), *cause_of(error))
        else:
            # Transforms may be stamped ahead, as a localiser's are: they do not advance the time.
            if isinstance(message, Odometry):
                self._advance(message.stamp_ns)

    def _advance(self, stamp_ns: int) -> None:
        self._newest_ns = stamp_ns if self._newest_ns is None else max(self._newest_ns, stamp_ns)

    def _restart(self) -> None:
        """Give up all waiting scans after the clock jumped back."""
        self._newest_ns = None
        self.surround.forget()
        self.scanners.forget()
        while self._pending:
            self._pending.popleft()
            self._give_up(CLOCK_JUMP, "the clock went back")

    def _complete(self, *, final: bool = False) -> list[Frame]:
        frames = []
        while self._pending:
            pair = self._pending[0]
            newest = pair.stamp_ns if self._newest_ns is None else self._newest_ns
            late = final or newest - pair.stamp_ns > self.config.wait * NANOSECONDS
            try:
                frame = self._frame(pair, late)
            except _NotYetError:
                break
            self._pending.popleft()
            if frame is not None:
                self.frames += 1
                self.surround.count(pair.stamp_ns, frame.images, frame.cameras)
                if (merged := self._merged) is not None:
                    self.scanners.count(pair.stamp_ns, merged.found, merged.placed)
                    self.scanners.missing.update(merged.found - merged.placed)
                frames.append(frame)
        return frames

    def _frame(self, pair: Pair, late: bool) -> Frame | None:
        """Frame of a pair, or None if it had to be given up. Raises _NotYetError."""
        newest = pair.stamp_ns if self._newest_ns is None else self._newest_ns
        both = self.surround, self.scanners
        if not late and not all(each.is_settled(pair.stamp_ns, newest) for each in both):
            raise _NotYetError
        missing = [name for name in _pictures(pair) if name not in self._infos]
        if missing and not late:
            raise _NotYetError
        if missing:
            self._give_up(NO_CAMERA_INFO, f"none arrived for {', '.join(missing)}", *missing)
            return None
        try:
            return self._assemble(pair, late)
        except TransformError as error:
            if error.may_come and not late:
                raise _NotYetError from error
            self._give_up(NO_TRANSFORM, str(error), *cause_of(error))
        except DataError as error:
            self._give_up(BAD_CALIBRATION, str(error), *cause_of(error))
        return None

    def _assemble(self, pair: Pair, late: bool) -> Frame:
        """Frame of a pair; where only odometry is missing, without what is made of it."""
        scan = self._merge(pair.item, late) if isinstance(pair.item, Scan) else None
        pose = None
        try:
            pose = self.robot.world_from_robot(pair.stamp_ns)
        except TransformError as error:
            if error.may_come and not late:
                raise
        given = scan, _pictures(pair), self._infos, self.robot
        make = partial(
            frame_from_pair,
            *given,
            surround=self.surround.choose(pair.stamp_ns),
            awaited=() if late else self.surround.awaited,
            index=self.frames,
            pose=pose,
            late=late,
        )
        try:
            frame = make(deskews=self.config.deskew)
        except TransformError as error:
            if error.may_come and not late:
                raise
            frame = self._assemble_without(make, error)
        if self._moving and frame.odometry is None and not late:
            raise _NotYetError
        return frame

    def _merge(self, leader: Scan, late: bool) -> Scan:
        """Merge the scans that belong to one, once. Raises TransformError if a place may come."""
        if self._merged is not None and self._merged.leader is leader:
            return self._merged.scan
        found, reach_s = self.scanners.choose(leader.stamp_ns), self.config.sync.scan_difference
        placed = {*found}

        def leave_out(name: str, error: TransformError) -> None:
            # A scanner that moves on the robot is placed a little later each time.
            is_awaited = name in self.scanners.awaited or error.code == "too-late"
            if error.may_come and not late and is_awaited:
                raise error
            placed.remove(name)
            self._log(ALONE, f"{name}: {error}", name, *cause_of(error))

        partners = {
            name: Partner(each.stamp_ns - leader.stamp_ns, each) for name, each in found.items()
        }
        scan = merge_scans(leader, partners, self.robot.tree, leave_out)
        for name, remark in time_remarks(leader, partners, scan).items():
            self._log(POINT_TIMES, remark, name)
        for name in [each for each in self.scanners.names if each not in found]:
            newest = self.scanners.newest(name)
            off_s = 0 if newest is None else (newest - leader.stamp_ns) / NANOSECONDS
            known = "none has come" if newest is None else f"its newest is {off_s:+.3f} s off"
            self._log(ALONE, f"no scan of {name} lies within {reach_s:g} s; {known}", name)
        self._merged = _Merged(leader, scan, {*found}, placed)
        return scan

    def _assemble_without(self, make: Callable[..., Frame], error: TransformError) -> Frame:
        """Frame taken as of one moment, or else as if the robot stood, as odometry is not known."""
        worse = error
        try:
            frame = make(deskews=False) if self.config.deskew else None
        except TransformError as found:
            frame, worse = None, found
        if frame is None:
            frame = make(still=True)
            self.still += 1
            self._log("odometry", str(worse), *cause_of(worse))
        else:
            self.skewed += 1
            self._log(NOT_DESKEWED, str(error), *cause_of(error))
        return frame

    def _give_up(self, reason: str, problem: str, *cause: str) -> None:
        self._given_up[self.sync.scans, reason] += 1
        self._log(reason, problem, *cause)

    def _log(self, reason: str, problem: str, *cause: str) -> None:
        """Log each cause as a warning once, then as debug messages."""
        cause = (reason, *cause)
        level = logging.DEBUG if cause in self._logged else logging.WARNING
        self._logged.add(cause)
        first, line, more = problem.partition("\n")
        words = reason, first, _ADVICE[reason], line + more
        logger.log(level, "%s: %s; %s%s", *words, extra={"cause": cause})


class _Merged(NamedTuple):
    """The scan of a frame: its leader, and the scanners of which scans were found and placed."""

    leader: Scan
    scan: Scan
    found: set[str]
    placed: set[str]


class _NotYetError(Exception):
    """A message that a pair needs may still arrive."""
