# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``IndexedBag``: an open bag, its topics by role, and what one pass through it finds.

That is stamps, frames and all small messages, but no clouds and no images.
"""

import logging
from array import array
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Matrix
from fusionslam.datasets.bags.messages import stamp_of
from fusionslam.datasets.bags.reader import Bag, RawMessage
from fusionslam.datasets.bags.topics import READ_LATE, TRANSFORM_TYPES, info_role
from fusionslam.errors import DataError, cause_of
from fusionslam.sensors.imu_buffer import ImuBuffer
from fusionslam.sensors.messages import CameraInfo, FrameTransforms, Imu, Message, Odometry
from fusionslam.sensors.robot_frames import RobotFrames
from fusionslam.sensors.transforms import TransformError, TransformTree

logger = logging.getLogger(__name__)

T = TypeVar("T", bound=Message)

STAMPS = ("header", "bag")
"""Sources of a message's stamp: its header, or its arrival in the bag."""

# How far a robot's motion is extrapolated beyond the first and the last odometry.
EXTRAPOLATION_S = 0.1


@dataclass(eq=False)
class Series:
    """Messages of a topic in order of arrival.

    Attributes:
        by_arrival: whether stamps are times of arrival instead of those of the headers.
        headers: stamp of each header, nanoseconds; the time of arrival if it has none.
        times: time of arrival of each, nanoseconds.
        frame_id: the frame of the first one.
    """

    by_arrival: bool
    headers: "array[int]" = field(default_factory=lambda: array("q"))
    times: "array[int]" = field(default_factory=lambda: array("q"))
    frame_id: str = ""
    # Of the last message left out: its time of arrival, and how many arrived then.
    _lost: tuple[int, int] = (0, 0)
    # By row, the number of messages left out before it that arrived at the same time.
    _lost_before: dict[int, int] = field(default_factory=dict)

    def add(self, raw: RawMessage) -> int:
        """Add a message and return its stamp."""
        content = raw.content
        if hasattr(content, "header"):
            header = content.header
        else:  # transforms have those of their own
            header = content.transforms[0].header if content.transforms else None
        self.headers.append(raw.time_ns if header is None else stamp_of(header.stamp))
        self.times.append(raw.time_ns)
        if self._lost[1] and self._lost[0] == raw.time_ns:
            self._lost_before[len(self.times) - 1] = self._lost[1]
        if len(self.times) == 1 and header is not None:
            self.frame_id = str(header.frame_id).removeprefix("/")
        return self.stamps[-1]

    def leave_out(self, time_ns: int) -> None:
        """Note that a message of this time of arrival cannot be decoded."""
        self._lost = time_ns, self._lost[1] + 1 if self._lost[0] == time_ns else 1

    @property
    def stamps(self) -> "array[int]":
        """Stamp of each message, nanoseconds."""
        return self.times if self.by_arrival else self.headers

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """Stamps as int64 (N)."""
        return np.array(self.stamps, dtype=np.int64)

    @property
    def delays_ns(self) -> NDArray[np.int64]:
        """Nanoseconds from each header's stamp to the arrival, int64 (N)."""
        return np.array(self.times, dtype=np.int64) - np.array(self.headers, dtype=np.int64)

    def place(self, row: int) -> tuple[int, int]:
        """Time of arrival, and the message's rank among those that arrived at that time."""
        first = row
        while first and self.times[first - 1] == self.times[row]:
            first -= 1
        return self.times[row], row - first + self._lost_before.get(row, 0)


@dataclass(eq=False)
class IndexedBag:
    """An open bag with its topics by role and its index.

    Attributes:
        bag: open for reading.
        roles: topics in use by role ("points", "left", "camera_info", ...).
        stamps: "header" or "bag".
        indexed: messages by topic: of these topics, or of all.
        infos: by topic, the calibrations that differ from the one before.
        frames: TF and odometry.
        truth: ground truth motion, from the frame ``truth_frames[0]`` to ``truth_frames[1]``.
        refused: by cause, the number of unusable messages and the error of the first one.
    """

    bag: Bag
    roles: Mapping[str, str]
    stamps: str
    indexed: dict[str, Series] = field(default_factory=dict)
    infos: dict[str, list[CameraInfo]] = field(default_factory=dict)
    frames: RobotFrames = field(
        default_factory=lambda: RobotFrames(history_s=None, extrapolation_s=EXTRAPOLATION_S)
    )
    truth: TransformTree = field(
        default_factory=lambda: TransformTree(history_s=None, extrapolation_s=EXTRAPOLATION_S)
    )
    truth_frames: tuple[str, str] | None = None
    refused: dict[tuple[str, ...], tuple[int, str]] = field(default_factory=dict)
    _said: set[str] = field(default_factory=set)

    def series(self, sensor: str) -> Series:
        """Messages of a sensor, which the bag must have."""
        return self.indexed[self.roles[sensor]]

    def info_at(self, stamp_ns: int, camera: str = "left") -> CameraInfo | None:
        """Calibration that is valid for an image's stamp; None if the bag has none."""
        infos = self.infos.get(self.roles.get(info_role(camera), ""), [])
        before = [info for info in infos if info.stamp_ns <= stamp_ns]
        return before[-1] if before else next(iter(infos), None)

    def optical_frame(self, camera: str = "left") -> str:
        """Optical frame of a camera; that of the left one also serves the right one."""
        info = self.info_at(0, camera)
        return (info.frame_id if info else "") or self.series(camera).frame_id

    def points_frame(self, sensors: Sequence[str]) -> str:
        """Frame of the points when frames have these sensors.

        The scans' frame, also for stereo pairs alone if TF links it to the camera; else the left
        camera's frame.
        """
        if "points" in sensors:
            return self.series("points").frame_id
        if "points" in self.roles:
            scanner = self.series("points").frame_id
            with suppress(DataError):
                self.frames.tree.chain(self.optical_frame(), scanner)
                return scanner
        return self.optical_frame()

    def camera_from_points(
        self, image_ns: int, points_frame: str, scan_ns: int, name: str = "left"
    ) -> Matrix:
        """float64 (4, 4), for a scan and an image with these stamps.

        Without odometry the robot is assumed to stand still between the two.

        Raises:
            TransformError: TF does not link the two frames.
        """
        frames, camera = self.frames, self.optical_frame(name)
        if points_frame == camera and image_ns == scan_ns:
            return np.eye(4)
        try:
            return frames.camera_from_points(camera, image_ns, points_frame, scan_ns)
        except TransformError:
            return frames.camera_from_points(camera, image_ns, points_frame, scan_ns, still=True)

    def odometry_at(self, stamp_ns: int) -> Matrix | None:
        """float64 (4, 4), odom_from_robot, or None if it is not known."""
        return lookup_or_none(lambda: self.frames.odometry_from_robot(stamp_ns))

    def find_transform(self, body: str, frame: str, stamp_ns: int) -> Matrix | None:
        """float64 (4, 4), body_from_frame, or None if it is not known."""
        return lookup_or_none(lambda: self.frames.tree.lookup(body, frame, stamp_ns))

    def messages(self, role: str, kind: type[T]) -> Iterator[T]:
        """Read what the topic of a role says, of a kind; nothing if there is no such topic.

        Messages that cannot be used are left out, which is logged.
        """
        topic, by_arrival = self.roles.get(role), self.stamps == "bag"

        def leave_out(topic: str, time_ns: int, error: DataError) -> None:
            self.say_once(f"{topic} {error.code}", f"{self.bag.path}: {error}")

        for raw in self.bag.raw([topic], on_error=leave_out) if topic else ():
            try:
                value = restamp(raw.value(), raw.time_ns if by_arrival else None)
            except DataError as error:
                leave_out(raw.topic, raw.time_ns, error)
                continue
            assert isinstance(value, kind)
            yield value

    def say_once(self, cause: str, words: str) -> None:
        """Log a warning, unless one of the same cause was logged before."""
        if cause not in self._said:
            self._said.add(cause)
            logger.warning("%s", words)

    def refuse(self, error: DataError) -> None:
        """Count an unusable message."""
        count, first = self.refused.get(cause_of(error), (0, str(error)))
        self.refused[cause_of(error)] = count + 1, first

    def store(self, raw: RawMessage, stamp_ns: int | None) -> None:
        """Store a message if it is small, with another stamp if one is given.

        Raises:
            DataError: it cannot be used.
        """
        is_motion = raw.type in TRANSFORM_TYPES or raw.topic == self.roles.get("odometry")
        is_truth = raw.topic == self.roles.get("truth")
        if not is_motion and not is_truth and raw.type != "sensor_msgs/CameraInfo":
            return
        value = restamp(raw.value(), stamp_ns)
        if isinstance(value, CameraInfo):
            infos = self.infos.setdefault(raw.topic, [])
            names = [each.name for each in fields(CameraInfo) if each.name != "stamp_ns"]
            if not infos or not all(
                np.array_equal(getattr(infos[-1], name), getattr(value, name)) for name in names
            ):
                infos.append(value)
        elif isinstance(value, Odometry) and is_truth and not is_motion:
            self.truth_frames = value.frame_id, value.child_frame_id
            self.truth.add(value.transform)
        elif isinstance(value, FrameTransforms | Odometry):
            self.frames.add(value)


def index_bag(
    bag: Bag, topics: Iterable[str], roles: Mapping[str, str], stamps: str = "header"
) -> IndexedBag:
    """Read the headers of topics, and all small messages: calibrations, odometry, transforms.

    Args:
        bag: open for reading.
        topics: those to read; TF is always read.
        roles: topics by role, as from ``choose_topics``.
        stamps: one of ``STAMPS``.

    Raises:
        DataError: the bag cannot be read, or none of the messages of a role's topic; other
            messages that cannot be used are left out, counted and logged.
    """
    source = IndexedBag(bag, roles, stamps)
    if "imu" in roles:
        source.frames.imu = ImuBuffer(load=lambda: source.messages("imu", Imu))
    moving = [topic.name for topic in bag.topics.values() if topic.type in TRANSFORM_TYPES]
    names = list(dict.fromkeys([*topics, *moving]))
    # Those without a usable message are dropped at the end.
    every: defaultdict[str, Series] = defaultdict(lambda: Series(stamps == "bag"))

    def leave_out(topic: str, time_ns: int, error: DataError) -> None:
        every[topic].leave_out(time_ns)
        source.refuse(error)

    for raw in bag.raw(names, on_error=leave_out):
        series = every[raw.topic]
        stamp_ns = series.add(raw)
        try:
            source.store(raw, stamp_ns if series.by_arrival else None)
        except DataError as error:
            source.refuse(error)
    source.indexed = {name: series for name, series in every.items() if series.times}
    _check_found(source, [name for name in moving if bag.topics[name].count])
    for count, first in source.refused.values():
        lost = "a message is" if count == 1 else f"{count} messages are"
        logger.warning("%s: %s left out: %s", bag.path, lost, first)
    return source


def _check_found(source: IndexedBag, moving: Iterable[str]) -> None:
    """Raise DataError if a topic in use has no message that can be decoded; of TF, say it only."""
    bag = source.bag
    used = {topic for role, topic in source.roles.items() if role not in READ_LATE}
    for topic in sorted({*used, *moving} - source.indexed.keys()):
        lost, first = source.refused.get(("undecodable", topic), (0, ""))
        message = f"{bag.path}: {topic} has no messages"
        if lost:
            message = f"{bag.path}: none of the {lost} messages of {topic} can be decoded: {first}"
        elif bag.topics[topic].count:
            message += f", but its index lists {bag.topics[topic].count}: the bag is damaged"
        if topic in used:
            raise DataError(message, code="undecodable" if lost else "no-messages", fields=(topic,))
        if not lost:  # else it is logged with the others left out
            logger.warning("%s", message)


def restamp(value: Message, stamp_ns: int | None) -> Message:
    """Replace the stamp of a value, if one is given."""
    if stamp_ns is None:
        return value
    if isinstance(value, FrameTransforms):
        moved = (replace(each, stamp_ns=stamp_ns) for each in value.transforms)
        return FrameTransforms(transforms=tuple(moved))
    return replace(value, stamp_ns=stamp_ns)


def lookup_or_none(lookup: Callable[[], Matrix | None]) -> Matrix | None:
    try:
        return lookup()
    except TransformError:
        return None
