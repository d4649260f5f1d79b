# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Pairs scans with images, or messages of other sensors, by their stamps.

Works as messages arrive, on a robot or from a bag, in bounded memory. Stastny 2022, section
4.3, takes the last image before the scan; his program takes the nearest one.
"""

from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from pydantic import model_validator

from fusionslam.base.argument_types import checked
from fusionslam.config import Section, merged, option
from fusionslam.errors import ConfigError
from fusionslam.sensors.messages import NANOSECONDS, as_nanoseconds, as_stamp

DUPLICATE = "duplicate"
LATE = "late"
NO_IMAGE = "no image near"
BUFFER_FULL = "buffer full"
CLOCK_JUMP = "clock jumped back"
REASONS = {
    DUPLICATE: "the sensor delivered this stamp before",
    LATE: "everything that it could have belonged to was decided already",
    NO_IMAGE: "no image of some camera lies within max_difference of the scan",
    BUFFER_FULL: "more messages waited than the buffer holds",
    CLOCK_JUMP: "it waited while the sensor's clock went back",
}


class SyncConfig(Section):
    """Configuration of how scans and images are paired."""

    policy: Literal["nearest", "last_before"] = option(
        "nearest", "image of a scan: the nearest in time, or the last one that is not after it"
    )
    max_difference: float = option(
        0.1, "an image further from the scan does not belong to it", unit="s", ge=0
    )
    stereo_difference: float = option(
        0.01, "left and right images further apart are no stereo pair", unit="s", ge=0
    )
    scan_difference: float = option(
        0.05, "scans of several scanners further apart are not merged", unit="s", ge=0, le=0.5
    )
    buffer: int = option(100, "messages of each sensor that wait at most", ge=1)
    lateness: float = option(
        0.0, "how far a stamp may lie behind the newest one that arrived before it", unit="s", ge=0
    )
    jump: float = option(
        1.0, "a stamp further behind its sensor's newest one starts all anew", unit="s", gt=0
    )

    @model_validator(mode="after")
    def _late_is_no_jump(self) -> "SyncConfig":
        if self.jump <= self.lateness:
            raise ValueError(f"jump ({self.jump:g} s) must exceed lateness ({self.lateness:g} s)")
        return self


class Stamped(NamedTuple):
    """An item with its time in nanoseconds."""

    stamp_ns: int
    item: Any


@dataclass(frozen=True, eq=False)
class Pair:
    """A scan and its images by camera name."""

    stamp_ns: int
    item: Any
    images: Mapping[str, Stamped]


@dataclass(eq=False)
class _Waiting:
    """Buffered messages of one sensor, by ascending stamp."""

    stamps: list[int]
    items: list[Any]
    used: list[bool]
    newest: int | None = None

    def insert(self, stamp_ns: int, item: Any) -> bool:
        """Insert an item; returns whether the stamp was new."""
        place = bisect_left(self.stamps, stamp_ns)
        if place < len(self.stamps) and self.stamps[place] == stamp_ns:
            return False
        self.stamps.insert(place, stamp_ns)
        self.items.insert(place, item)
        self.used.insert(place, False)
        self.newest = stamp_ns if self.newest is None else max(self.newest, stamp_ns)
        return True

    def remove_first(self, count: int) -> list[bool]:
        """Remove the oldest messages; returns whether each had been used."""
        used = self.used[:count]
        del self.stamps[:count], self.items[:count], self.used[:count]
        return used


@checked
class Synchronizer:
    """Pairs each scan with one image of every camera, in the order of the scans' stamps.

    A scan is decided once no better image can arrive: every camera's newest stamp is later by
    more than ``lateness`` (with policy nearest: plus the distance of the best image so far), or an
    image has exactly the scan's stamp; or when a buffer is full, on ``settle`` or ``flush``. If no
    message is later than ``lateness`` allows, the pairs are those of the sorted messages, whatever
    the order of arrival. One image may serve several scans, as a LiDAR may be faster than the
    camera; of two equally near images, the earlier one is taken.

    For every sensor this always holds: added = paired + unused + dropped + waiting.

    Args:
        config: limits and policy.
        cameras: the sensors of which every pair needs an image.
        scans: the sensor that the others are paired with; a camera if there is no LiDAR.

    Attributes:
        added: messages by sensor.
        paired: those that are part of a pair, by sensor.
        unused: images that no scan needed, by camera.
        dropped: by (sensor, reason); ``REASONS`` explains them.
        jumps: number of times a clock jumped back.
    """

    def __init__(
        self,
        config: SyncConfig | None = None,
        *,
        cameras: Iterable[str] = ("left",),
        scans: str = "points",
    ) -> None:
        self.config = config or SyncConfig()
        self.scans = scans
        self.cameras = tuple(cameras)
        self.added: Counter[str] = Counter()
        self.paired: Counter[str] = Counter()
        self.unused: Counter[str] = Counter()
        self.dropped: Counter[tuple[str, str]] = Counter()
        self.jumps = 0
        self._lateness = as_nanoseconds("lateness", self.config.lateness)
        self._reach = as_nanoseconds("max_difference", self.config.max_difference)
        self._restart()

    @property
    def waiting(self) -> dict[str, int]:
        """Number of messages by sensor that are neither part of a pair nor given up."""
        return {name: buffer.used.count(False) for name, buffer in self._buffers.items()}

    @property
    def buffered(self) -> dict[str, int]:
        """Number of messages held in memory, by sensor."""
        return {name: len(buffer.stamps) for name, buffer in self._buffers.items()}

    def add(self, sensor: str, stamp_ns: int, item: Any) -> list[Pair]:
        """Add a message and return the pairs that it completes.

        Raises:
            ConfigError: the sensor was not named at construction.
            DataError: the stamp is no integer.
        """
        stamp_ns = as_stamp(stamp_ns)
        if sensor not in self._buffers:
            raise ConfigError(f"sensor is {sensor!r}, expected one of {', '.join(self._buffers)}")
        self.added[sensor] += 1
        newest, decided = self._buffers[sensor].newest, self._decided_ns
        if newest is not None and newest - stamp_ns > self.config.jump * NANOSECONDS:
            self.jumps += 1
            for name, count in self.waiting.items():
                self._drop(name, CLOCK_JUMP, count)
            self._restart()
            decided = None
        if sensor == self.scans and decided is not None and stamp_ns <= decided:
            self._drop(sensor, DUPLICATE if stamp_ns == decided else LATE)
        elif sensor != self.scans and stamp_ns < self._first_useful(sensor):
            self._drop(sensor, LATE)
        elif not self._buffers[sensor].insert(stamp_ns, item):
            self._drop(sensor, DUPLICATE)
        return self._decide_all()

    def settle(self) -> list[Pair]:
        """Decide all waiting scans after a silence; images wait for scans that may still come."""
        return [pair for _ in range(len(self._scans.stamps)) if (pair := self._decide())]

    def flush(self) -> list[Pair]:
        """Decide all waiting scans; no more messages are expected."""
        pairs = self.settle()
        for camera in self.cameras:
            self._retire(camera, len(self._buffers[camera].stamps))
        return pairs

    def _restart(self) -> None:
        self._buffers = {name: _Waiting([], [], []) for name in (self.scans, *self.cameras)}
        self._scans = self._buffers[self.scans]
        # All scans decided from now on have later stamps.
        self._decided_ns: int | None = None

    def _drop(self, sensor: str, reason: str, count: int = 1) -> None:
        if count:
            self.dropped[sensor, reason] += count

    def _first_useful(self, camera: str) -> float:
        """Stamp before which no future scan needs an image.

        Future scans are later than the last decided one, so of the images up to that one only the
        newest can still be the last before a scan, or the nearest.
        """
        if self._decided_ns is None:
            return float("-inf")
        stamps = self._buffers[camera].stamps
        place = bisect_right(stamps, self._decided_ns)
        far = self._decided_ns - self._reach
        return max(stamps[place - 1], far) if place else far

    def _decide_all(self) -> list[Pair]:
        pairs, buffers = [], self._buffers.values()
        while self._scans.stamps and (
            all(self._is_settled(camera, self._scans.stamps[0]) for camera in self.cameras)
            or any(len(buffer.stamps) > self.config.buffer for buffer in buffers)
        ):
            if pair := self._decide():
                pairs.append(pair)
        for camera in self.cameras:
            excess = len(self._buffers[camera].stamps) - self.config.buffer
            self._retire(camera, excess, BUFFER_FULL)
        return pairs

    def _is_settled(self, camera: str, stamp_ns: int) -> bool:
        """Whether no better image of a scan can arrive."""
        buffer, place, ahead = self._buffers[camera], self._match(camera, stamp_ns), self._reach
        if place is not None:
            ahead = abs(buffer.stamps[place] - stamp_ns)
            # No image is nearer; but with lateness, an earlier scan may still arrive.
            if ahead == 0 and self._lateness == 0:
                return True
        if self.config.policy != "nearest":
            ahead = 0
        return buffer.newest is not None and buffer.newest > stamp_ns + ahead + self._lateness

    def _match(self, camera: str, stamp_ns: int) -> int | None:
        """Index of the image that belongs to a scan, among the buffered ones."""
        stamps = self._buffers[camera].stamps
        return choose_image(stamps, stamp_ns, self.config.policy, self._reach)

    def _decide(self) -> Pair | None:
        """Pair the oldest scan or give it up, and discard the images no longer needed."""
        stamp_ns, item = self._scans.stamps[0], self._scans.items[0]
        self._scans.remove_first(1)
        self._decided_ns = stamp_ns
        places = {camera: self._match(camera, stamp_ns) for camera in self.cameras}
        pair = None
        if None in places.values():
            self._drop(self.scans, NO_IMAGE)
        else:
            self.paired[self.scans] += 1
            images = {}
            for camera, place in places.items():
                assert place is not None  # of any camera
                buffer = self._buffers[camera]
                self.paired[camera] += not buffer.used[place]
                buffer.used[place] = True
                images[camera] = Stamped(buffer.stamps[place], buffer.items[place])
            pair = Pair(stamp_ns, item, images)
        for camera in self.cameras:
            useful = self._first_useful(camera)
            self._retire(camera, bisect_left(self._buffers[camera].stamps, useful))
        return pair

    def _retire(self, camera: str, count: int, reason: str | None = None) -> None:
        """Discard the oldest images; those never used count as unused, or as dropped."""
        used = self._buffers[camera].remove_first(max(count, 0))
        if reason is None:
            self.unused[camera] += used.count(False)
        else:
            self._drop(camera, reason, used.count(False))


def choose_image(stamps: Sequence[int], stamp_ns: int, policy: str, reach_ns: int) -> int | None:
    """The image that belongs to a scan, by its place among ascending stamps; None if none is near.

    Args:
        stamps: of the images, nanoseconds.
        stamp_ns: of the scan.
        policy: "nearest" (of two equally near ones the earlier), or "last_before".
        reach_ns: an image further away does not belong to the scan.
    """
    after = bisect_right(stamps, stamp_ns)
    # The earlier one comes first, so that it wins ties.
    places = [after - 1] if after else []
    if policy == "nearest" and after < len(stamps):
        places.append(after)
    near = [place for place in places if abs(stamps[place] - stamp_ns) <= reach_ns]
    return min(near, key=lambda place: abs(stamps[place] - stamp_ns), default=None)


def partner_config(config: SyncConfig) -> SyncConfig:
    """How scans of further scanners are found: the nearest one, within ``scan_difference``."""
    return merged(config, {"policy": "nearest", "max_difference": config.scan_difference})


def stereo_synchronizer(config: SyncConfig) -> Synchronizer:
    """Make a synchroniser that pairs each left image with the right one of the same time.

    Args:
        config: its ``stereo_difference`` is the limit, whatever the policy for scans.
    """
    own = {"policy": "nearest", "max_difference": config.stereo_difference}
    return Synchronizer(merged(config, own), cameras=("right",), scans="left")
