# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``OnlineRatSlam``: a map that grows while odometry and views arrive, as on a robot.

>>> from fusionslam.ratslam import GivenView, Look, Motion, OnlineRatSlam
>>> online = OnlineRatSlam()
>>> for event in (Motion(0, 0.5, 0.0), Look(0, GivenView(0, True)), Motion(33_000_000, 0.5, 0.0)):
...     steps = online.process(event)
>>> [step.why for step in online.flush()]
['node 0 made of view 0']
"""

import logging
import os
import threading
from collections import Counter
from collections.abc import Iterable
from typing import Any

import numpy as np

from fusionslam.config import Section, merged, option
from fusionslam.errors import DataError, FusionSlamError
from fusionslam.ratslam.event_order import OrderConfig, StampOrder
from fusionslam.ratslam.events import Event, Look, Motion, is_looking, stamp_of
from fusionslam.ratslam.external_views import GivenViews
from fusionslam.ratslam.map_snapshot import LiveMap
from fusionslam.ratslam.odometry import Ground, odometry_of
from fusionslam.ratslam.slam import RatSlam, RatSlamConfig, Step
from fusionslam.sensors.messages import NANOSECONDS, Odometry
from fusionslam.storage.arrays import Matrix
from fusionslam.storage.files import uninterrupted

logger = logging.getLogger(__name__)


BAD_EVENT = "no event, or one without a stamp"
ZERO_STAMP = "a stamp of zero among others"
TOO_LATE = "later ones were taken before"
BAD_ODOMETRY = "odometry that RatSLAM refuses"
BAD_VIEW = "a view that RatSLAM refuses"

_DAY_NS = 86_400 * NANOSECONDS


class OnlineRatSlamConfig(Section):
    """How a map is made of what arrives."""

    ratslam: RatSlamConfig = option(RatSlamConfig(), "the cells and the map")
    # The wait delays the map only while nobody sees anything, when there is nothing to map; shorter
    # ones were missed by busy machines that play a bag at five times its pace.
    order: OrderConfig = option(
        OrderConfig(wait=10.0, in_order=True, jump=1.0), "in which order what arrives is taken"
    )


class OnlineRatSlam:
    """Takes odometry and the views of another process as they arrive, and never stops on bad ones.

    Whatever the interleaving and the pace, the steps are those of a recording of the same messages:
    odometry counts from the last one before the first view on. An event is taken once odometry and
    views have both come as far (``order``). May be used by several threads.

    Args:
        config: None for the defaults.
        changes: values of the configuration that differ from it.

    Attributes:
        config: what it was made with.
        slam: the map and all that belongs to it; not to be changed by others.
        views: what numbers the views of the map.
        refused: events that were left out, by cause.
        jumps: how often the clock went back; the map went on.
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
        self._said: set[str] = set()
        self._odometry: Odometry | None = None
        self._here: tuple[Ground, Odometry] | None = None
        self._before: Event | None = None
        self._go_on(RatSlam(self.config.ratslam, views=GivenViews()))

    def _go_on(self, slam: RatSlam) -> None:
        newest_ns = slam.memory.newest_ns
        self.slam, self._begun = slam, newest_ns is not None
        self._newest_ns = dict.fromkeys((False, True), newest_ns or 0)
        self._taken_ns = newest_ns
        self._order = StampOrder(self.config.order, after_ns=newest_ns)

    @property
    def views(self) -> GivenViews:
        """What numbers the views of the map."""
        assert isinstance(self.slam.views, GivenViews)
        return self.slam.views

    def process(self, event: Odometry | Motion | Look) -> list[Step]:
        """Take what arrived; returns the steps that it completes, in the order of their stamps.

        Args:
            event: odometry, or a ``Look`` at a ``GivenView``. What is at fault is left out, counted
                and logged once per cause; the map is unchanged.
        """
        with uninterrupted(), self._lock:
            return self._take(self._order_events(event))

    def flush(self) -> list[Step]:
        """The steps of all that waits: nothing more will come."""
        with uninterrupted(), self._lock:
            return self._take(self._order.flush())

    @property
    def map_from_odometry(self) -> Matrix | None:
        """float64 (4, 4): ``map_from_odometry`` as of the last step; None while odometry has told
        no pose."""
        return None if self._here is None else map_from_odometry(*self._here)

    def live_map(self, name: str, odometry: str) -> LiveMap:
        """The map as it is now, which ``export_run`` writes; both names are for people.

        Args:
            name: of what is driven.
            odometry: what tells the way.
        """
        with uninterrupted(), self._lock:
            return LiveMap.of(self.slam, name, odometry)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the map to one file, whole or not at all, from which ``load`` goes on.

        What waits for its turn is not in it; ``flush`` before, if nothing more will come.

        Raises:
            DataError: it cannot be written.
        """
        with uninterrupted(), self._lock:
            self.slam.save(path)

    @classmethod
    def load(
        cls, path: str | os.PathLike[str], config: OnlineRatSlamConfig | None = None, **changes: Any
    ) -> "OnlineRatSlam":
        """Go on from what ``save`` wrote; earlier stamps are those of a clock that went back.

        Args:
            path: the file.
            config: None for the defaults. Cells and map keep what they were made with.
            changes: values of the configuration that differ from it.

        Raises:
            DataError: missing, cut short, damaged, of another version, or with views of its own;
                the message names the file. ConfigError: as for a new one.
        """
        slam = RatSlam.load(path)
        if not isinstance(slam.views, GivenViews):
            kind = "nothing" if slam.views is None else slam.views.title
            raise DataError(f"{path}: it recognises by {kind}, expected {GivenViews.kind}")
        online = cls(config, **changes)
        if slam.config != online.config.ratslam:
            logger.warning("%s: the map keeps the configuration that it was made with", path)
        online.config = merged(online.config, {"ratslam": slam.config.model_dump()})
        online._go_on(slam)
        return online

    def _order_events(self, event: Any) -> list[Event]:
        late = self._order.too_late
        try:
            if not isinstance(event, Odometry | Motion | Look):
                raise DataError(f"{type(event).__name__}: expected Odometry, Motion or Look")
            if self._is_unset(stamp_of(event), is_looking(event)):
                self._refuse(ZERO_STAMP, f"{type(event).__name__}: its sender sets no stamp")
                return []
            ready = self._order.add(event)
        except FusionSlamError as error:
            self._refuse(BAD_EVENT, str(error))
            return []
        if self._order.too_late > late:
            self._refuse(TOO_LATE, f"{type(event).__name__} at {event.stamp_ns} ns")
        return ready

    def _is_unset(self, stamp_ns: int, is_view: bool) -> bool:
        """Zero, where its own kind has other stamps, or the other one is days from it."""
        own_ns, any_ns = self._newest_ns[is_view], max(self._newest_ns.values())
        if stamp_ns == 0 and (own_ns > NANOSECONDS or any_ns > _DAY_NS):
            return True
        self._newest_ns[is_view] = stamp_ns
        return False

    def _take(self, events: list[Event]) -> list[Step]:
        steps = []
        for event in (one for ready in events for one in self._counting(ready)):
            if self._taken_ns is not None and event.stamp_ns < self._taken_ns:
                self._turn_back(self._taken_ns, event.stamp_ns)
            self._taken_ns = event.stamp_ns
            step = self._step(event)
            if step is not None:
                steps.append(step)
        return steps

    def _counting(self, event: Event) -> Iterable[Event]:
        """Before the first view, only the last odometry counts."""
        if self._begun:
            return [event]
        if not is_looking(event):
            self._before = event
            return []
        self._begun = True
        return [event] if self._before is None else [self._before, event]

    def _turn_back(self, before_ns: int, now_ns: int) -> None:
        level = logging.INFO if self.jumps else logging.WARNING
        self.jumps += 1
        self.slam.forget_clock()
        apart = (before_ns - now_ns) / NANOSECONDS
        logger.log(
            level, "the clock went back by %.3f s: the map goes on from where odometry is", apart
        )

    def _step(self, event: Event) -> Step | None:
        """None of what is refused."""
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
        level = logging.DEBUG if cause in self._said else logging.WARNING
        self._said.add(cause)
        logger.log(level, "left out, %s: %s", cause, why)


def map_from_odometry(pose: Ground, odometry: Odometry) -> Matrix | None:
    """Where the odometry frame is on the map, so that the robot stands at a pose of the map.

    Only x, y and heading are corrected: height, roll and pitch stay those of odometry.

    Args:
        pose: x, y in metres and heading in radians on the map, of ``Step.pose``.
        odometry: of the same time.

    Returns:
        float64 (4, 4), map_from_odometry; None where odometry does not tell a finite pose.

    Raises:
        DataError: odometry with neither a finite pose nor velocity.
    """
    said = odometry_of(odometry)
    if said is None or said.pose is None:
        return None
    return _lift_pose(pose) @ np.linalg.inv(_lift_pose(said.pose))


def _lift_pose(pose: Ground) -> Matrix:
    """float64 (4, 4) of a pose on the ground."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.array([[c, -s, 0, pose[0]], [s, c, 0, pose[1]], [0, 0, 1, 0], [0, 0, 0, 1]])
