# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Indexes a bag in one pass: stamps, frames and all small messages, no clouds or images."""

import logging
from array import array
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.datasets.bags.messages import stamp_of
from fusionslam.datasets.bags.reader import Bag, RawMessage
from fusionslam.datasets.bags.topics import TRANSFORM_TYPES
from fusionslam.errors import DataError, cause_of
from fusionslam.sensors.messages import (
    CameraInfo,
    FrameTransforms,
    Message,
    Odometry,
)
from fusionslam.sensors.robot_frames import RobotFrames
from fusionslam.sensors.transforms import TransformTree

logger = logging.getLogger(__name__)

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
        header = _header(raw.content)
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
class BagIndex:
    """Index of a bag.

    Attributes:
        series: by topic.
        infos: by topic, the calibrations that differ from the one before.
        frames: TF and odometry.
        truth: ground truth motion, from the frame ``truth_frames[0]`` to ``truth_frames[1]``.
        refused: by cause, the number of unusable messages and the error of the first one.
    """

    series: dict[str, Series] = field(default_factory=dict)
    infos: dict[str, list[CameraInfo]] = field(default_factory=dict)
    frames: RobotFrames = field(
        default_factory=lambda: RobotFrames(history_s=None, extrapolation_s=EXTRAPOLATION_S)
    )
    truth: TransformTree = field(
        default_factory=lambda: TransformTree(history_s=None, extrapolation_s=EXTRAPOLATION_S)
    )
    truth_frames: tuple[str, str] | None = None
    refused: dict[tuple[str, ...], tuple[int, str]] = field(default_factory=dict)

    def refuse(self, error: DataError) -> None:
        """Count an unusable message."""
        count, first = self.refused.get(cause_of(error), (0, str(error)))
        self.refused[cause_of(error)] = count + 1, first


def index_bag(
    bag: Bag, topics: Iterable[str], roles: Mapping[str, str], stamps: str = "header"
) -> BagIndex:
    """Read the headers of topics, and all small messages: calibrations, odometry, transforms.

    Args:
        topics: those to read; TF is always read.
        roles: topics by role, as from ``choose_topics``.
        stamps: one of ``STAMPS``.

    Raises:
        DataError: the bag cannot be read, or none of the messages of a role's topic; other
            messages that cannot be used are left out, counted and logged.
    """
    index = BagIndex()
    moving = [topic.name for topic in bag.topics.values() if topic.type in TRANSFORM_TYPES]
    names = list(dict.fromkeys([*topics, *moving]))
    # Those without a usable message are dropped at the end.
    every: defaultdict[str, Series] = defaultdict(lambda: Series(stamps == "bag"))

    def leave_out(topic: str, time_ns: int, error: DataError) -> None:
        every[topic].leave_out(time_ns)
        index.refuse(error)

    for raw in bag.raw(names, on_error=leave_out):
        series = every[raw.topic]
        stamp_ns = series.add(raw)
        try:
            _store(index, raw, roles, stamp_ns if series.by_arrival else None)
        except DataError as error:
            index.refuse(error)
    index.series = {name: series for name, series in every.items() if series.times}
    _check_found(bag, index, {*roles.values()}, [name for name in moving if bag.topics[name].count])
    for count, first in index.refused.values():
        lost = "a message is" if count == 1 else f"{count} messages are"
        logger.warning("%s: %s left out: %s", bag.path, lost, first)
    return index


def _check_found(bag: Bag, index: BagIndex, used: set[str], moving: Iterable[str]) -> None:
    """Raise DataError if a topic in use has no message that can be decoded; of TF, say it only."""
    for topic in sorted({*used, *moving} - index.series.keys()):
        lost, first = index.refused.get(("undecodable", topic), (0, ""))
        message = f"{bag.path}: {topic} has no messages"
        if lost:
            message = f"{bag.path}: none of the {lost} messages of {topic} can be decoded: {first}"
        elif bag.topics[topic].count:
            message += f", but its index lists {bag.topics[topic].count}: the bag is damaged"
        if topic not in used:
            # Messages that cannot be decoded are logged with the others left out.
            if not lost:
                logger.warning("%s", message)
            continue
        raise DataError(message, code="undecodable" if lost else "no-messages", fields=(topic,))


def _header(content: Any) -> Any:
    """Header of a message; of transforms that of the first one, if there is one."""
    if hasattr(content, "header"):
        return content.header
    return content.transforms[0].header if content.transforms else None


def _store(index: BagIndex, raw: RawMessage, roles: Mapping[str, str], stamp: int | None) -> None:
    """Store a small message in the index."""
    is_motion = raw.type in TRANSFORM_TYPES or raw.topic == roles.get("odometry")
    is_truth = raw.topic == roles.get("truth")
    if not is_motion and not is_truth and raw.type != "sensor_msgs/CameraInfo":
        return
    value = restamp(raw.value(), stamp)
    if isinstance(value, CameraInfo):
        infos = index.infos.setdefault(raw.topic, [])
        if not infos or not _same_camera(infos[-1], value):
            infos.append(value)
    elif isinstance(value, Odometry) and is_truth and not is_motion:
        index.truth_frames = value.frame_id, value.child_frame_id
        index.truth.add(value.transform)
    elif isinstance(value, FrameTransforms | Odometry):
        index.frames.add(value)


def restamp(value: Message, stamp_ns: int | None) -> Message:
    """Replace the stamp of a value, if one is given."""
    if stamp_ns is None:
        return value
    if isinstance(value, FrameTransforms):
        moved = (replace(each, stamp_ns=stamp_ns) for each in value.transforms)
        return FrameTransforms(transforms=tuple(moved))
    return replace(value, stamp_ns=stamp_ns)


def _same_camera(first: CameraInfo, second: CameraInfo) -> bool:
    return (first.frame_id, first.size, first.distortion_model) == (
        second.frame_id,
        second.size,
        second.distortion_model,
    ) and all(
        np.array_equal(getattr(first, name), getattr(second, name))
        for name in ("camera_matrix", "distortion", "rectification", "projection")
    )
