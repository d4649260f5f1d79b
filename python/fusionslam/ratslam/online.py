# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``OnlineRatSlam``: builds a map online while odometry and views arrive, as on a robot.

>>> from fusionslam.ratslam import GivenView, Look, Motion, OnlineRatSlam
>>> online = OnlineRatSlam()
>>> for event in (Motion(0, 0.5, 0.0), Look(0, GivenView(0, True)), Motion(33_000_000, 0.5, 0.0)):
...     steps = online.process(event)
>>> [step.why for step in online.flush()]
['node 0 made of view 0']
"""

import copy
import logging
import os
import threading
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Matrix
from fusionslam.base.files import delay_interrupts
from fusionslam.config import Section, merged, option
from fusionslam.errors import DataError, FusionSlamError
from fusionslam.geometry.trajectory import ground_poses
from fusionslam.ratslam.event_order import OrderConfig, StampOrder
from fusionslam.ratslam.events import Event, Look, Motion, is_looking, stamp_of
from fusionslam.ratslam.external_views import GivenViews
from fusionslam.ratslam.map_snapshot import LiveMap
from fusionslam.ratslam.odometry import Ground, odometry_of
from fusionslam.ratslam.slam import RatSlam, RatSlamConfig, Step
from fusionslam.sensors.messages import NANOSECONDS, Odometry

logger = logging.getLogger(__name__)


BAD_EVENT = "not an event with a stamp"
ZERO_STAMP = "stamp 0 among other stamps"
TOO_LATE = "later events were already processed"
BAD_ODOMETRY = "invalid odometry"
BAD_VIEW = "invalid view"

_DAY_NS = 86_400 * NANOSECONDS


class OnlineRatSlamConfig(Section):
    """Settings of online mapping."""

    ratslam: RatSlamConfig = option(RatSlamConfig(), "the cells and the map")
    # The wait delays the map only while no views arrive, when there is nothing to map. Busy
    # machines that play a bag at five times its speed exceeded shorter ones.
    order: OrderConfig = option(
        OrderConfig(wait=10.0, in_order=True, jump=1.0), "order in which events are processed"
    )


@checked
class OnlineRatSlam:
    """Maps from odometry and the views of another process as they arrive; tolerates bad events.

    The steps do not depend on interleaving and rate: they equal those of a recording of the same
    messages. Odometry counts from the last message before the first view. An event is processed
    once odometry and views have both reached its stamp (``order``). Thread-safe. It
    can be sent to another process, with the events that wait.

    Args:
        config: None for the defaults.
        changes: configuration values to override.

    Attributes:
        config: the configuration in use.
        slam: the underlying RatSLAM; do not modify it.
        views: the source that numbers the views of the map.
        refused: number of events left out, by cause.
        jumps: number of times that the clock went back; the map continued.
        last: the last step; None before the first.

    Raises:
        ConfigError: an unknown key, or a value out of range.
    """

    def __init__(self, config: OnlineRatSlamConfig | None = None, **changes: Any) -> None:
        self.config = merged(config or OnlineRatSlamConfig(), changes)
        self.refused: Counter[str] = Counter()
        self.jumps = 0
        self.last: Step | None = None
        self._lock = threading.Lock()
        self._logged: set[str] = set()
        self._odometry: Odometry | None = None
        self._here: tuple[Ground, Odometry] | None = None
        self._before: Event | None = None
        self._start(RatSlam(self.config.ratslam, views=GivenViews()))

    def __getstate__(self) -> dict[str, Any]:
        with delay_interrupts(), self._lock:
            return copy.deepcopy({k: value for k, value in vars(self).items() if k != "_lock"})

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        vars(self).update(state, _lock=threading.Lock())

    def __repr__(self) -> str:
        return f"<OnlineRatSlam of {self.slam!r}>"

    def _start(self, slam: RatSlam) -> None:
        newest_ns = slam.memory.newest_ns
        self.slam, self._begun = slam, newest_ns is not None
        self._newest_ns = dict.fromkeys((False, True), newest_ns or 0)
        self._taken_ns = newest_ns
        self._order = StampOrder(self.config.order, after_ns=newest_ns)

    @property
    def views(self) -> GivenViews:
        """The source that numbers the views of the map."""
        assert isinstance(self.slam.views, GivenViews)
        return self.slam.views

    def process(self, event: Odometry | Motion | Look) -> list[Step]:
        """Process an event; returns the steps that it completes, in the order of their stamps.

        Args:
            event: odometry, or a ``Look`` at a ``GivenView``. A bad event is left out, counted and
                logged once per cause; the map is unchanged.
        """
        with delay_interrupts(), self._lock:
            return self._process_events(self._order_events(event))

    def settle(self) -> list[Step]:
        """Process the waiting views after a silence; returns the steps.

        Odometry after the last view still waits, so that the next view is not too late.
        """
        with delay_interrupts(), self._lock:
            return self._process_events(self._order.settle())

    def flush(self) -> list[Step]:
        """Process all waiting events at the end of the input; returns their steps."""
        with delay_interrupts(), self._lock:
            return self._process_events(self._order.flush())

    @property
    def map_from_odometry(self) -> Matrix | None:
        """float64 (4, 4): ``map_from_odometry`` at the last step; None without an odometry pose."""
        return None if self._here is None else map_from_odometry(*self._here)

    def live_map(self, name: str, odometry: str) -> LiveMap:
        """A snapshot of the map, which ``export_run`` can write.

        Args:
            name: human-readable name of the drive.
            odometry: human-readable name of the odometry.
        """
        with delay_interrupts(), self._lock:
            return LiveMap.of(self.slam, name, odometry)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Save the map atomically to one file, from which ``load`` resumes.

        Waiting events are not saved; ``flush`` first if the input has ended.

        Raises:
            DataError: the file cannot be written.
        """
        with delay_interrupts(), self._lock:
            self.slam.save(path)

    @classmethod
    def load(
        cls, path: str | os.PathLike[str], config: OnlineRatSlamConfig | None = None, **changes: Any
    ) -> "OnlineRatSlam":
        """Resume from what ``save`` wrote; earlier stamps mean that the clock went back.

        Args:
            path: path of the file.
            config: None for the defaults. Cells and map keep their stored configuration.
            changes: configuration values to override.

        Raises:
            DataError: the file is missing, truncated, damaged, of another version, or has a view
                source other than ``GivenViews``; the message names it. ConfigError: as in the
                constructor.
        """
        slam = RatSlam.load(path)
        if not isinstance(slam.views, GivenViews):
            kind = "none" if slam.views is None else slam.views.title
            raise DataError(f"{path}: the view source is {kind}, expected {GivenViews.kind}")
        online = cls(config, **changes)
        if slam.config != online.config.ratslam:
            logger.warning("%s: the map keeps its stored configuration", path)
        online.config = merged(online.config, {"ratslam": slam.config.model_dump()})
        online._start(slam)
        return online

    def _order_events(self, event: Any) -> list[Event]:
        late = self._order.too_late
        try:
            if not isinstance(event, Odometry | Motion | Look):
                raise DataError(f"{type(event).__name__}: expected Odometry, Motion or Look")
            if self._is_unset(stamp_of(event), is_looking(event)):
                self._refuse(ZERO_STAMP, f"{type(event).__name__}: its sender does not set stamps")
                return []
            ready = self._order.add(event)
        except FusionSlamError as error:
            self._refuse(BAD_EVENT, str(error))
            return []
        if self._order.too_late > late:
            self._refuse(TOO_LATE, f"{type(event).__name__} at {event.stamp_ns} ns")
        return ready

    def _is_unset(self, stamp_ns: int, is_view: bool) -> bool:
        """True for a stamp of 0 if its kind has other stamps, or the other kind is days later."""
        own_ns, any_ns = self._newest_ns[is_view], max(self._newest_ns.values())
        if stamp_ns == 0 and (own_ns > NANOSECONDS or any_ns > _DAY_NS):
            return True
        self._newest_ns[is_view] = stamp_ns
        return False

    def _process_events(self, events: list[Event]) -> list[Step]:
        steps = []
        for event in (one for ready in events for one in self._select_events(ready)):
            if self._taken_ns is not None and event.stamp_ns < self._taken_ns:
                level = logging.INFO if self.jumps else logging.WARNING
                self.jumps += 1
                self.slam.forget_clock()
                seconds = (self._taken_ns - event.stamp_ns) / NANOSECONDS
                said = "the clock went back by %.3f s: the map continues from odometry's pose"
                logger.log(level, said, seconds)
            self._taken_ns = event.stamp_ns
            step = self._step(event)
            if step is not None:
                steps.append(step)
        return steps

    def _select_events(self, event: Event) -> Iterable[Event]:
        """The events to process: of those before the first view, only the last odometry."""
        if self._begun:
            return [event]
        if not is_looking(event):
            self._before = event
            return []
        self._begun = True
        return [event] if self._before is None else [self._before, event]

    def _step(self, event: Event) -> Step | None:
        """Process one event; None if it is refused."""
        try:
            step = self.slam.step(event)
        except FusionSlamError as error:
            self._refuse(BAD_VIEW if is_looking(event) else BAD_ODOMETRY, str(error))
            return None
        self.last = step
        if isinstance(event, Odometry):
            self._odometry = event
        elif isinstance(event, Motion):
            self._odometry = None
        self._here = None if self._odometry is None else (step.pose, self._odometry)
        return step

    def _refuse(self, cause: str, why: str) -> None:
        self.refused[cause] += 1
        level = logging.DEBUG if cause in self._logged else logging.WARNING
        self._logged.add(cause)
        logger.log(level, "event ignored, %s: %s", cause, why)


def map_from_odometry(pose: Ground, odometry: Odometry) -> Matrix | None:
    """The transform from the odometry frame to the map that puts the robot at a pose on the map.

    Only x, y and heading are corrected; height, roll and pitch stay those of odometry.

    Args:
        pose: x, y in metres and heading in radians on the map, as ``Step.pose``.
        odometry: the odometry at the same time.

    Returns:
        float64 (4, 4), map_from_odometry; None if the odometry has no finite pose.

    Raises:
        DataError: the odometry has neither a finite pose nor a finite velocity.
    """
    said = odometry_of(odometry)
    if said is None or said.pose is None:
        return None
    map_from_robot, odometry_from_robot = ground_poses(*np.array([pose, said.pose]).T)
    return np.asarray(map_from_robot @ np.linalg.inv(odometry_from_robot))
