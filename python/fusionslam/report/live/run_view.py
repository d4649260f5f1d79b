# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``RunView``: decides when a growing map is shown, whatever shows it."""

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats
from fusionslam.errors import DataError
from fusionslam.geometry.rigid import RigidMotion
from fusionslam.pipelines.maps import true_poses
from fusionslam.ratslam.events import Event, Look
from fusionslam.ratslam.slam import RatSlam, Step
from fusionslam.ratslam.view_sources import TemplateSource
from fusionslam.sensors.frame import Frame
from fusionslam.sensors.messages import Picture

if TYPE_CHECKING:
    from fusionslam.geometry.trajectory import Trajectory

COLOURS = {"live": (40, 110, 220), "dead_reckoning": (220, 120, 30), "truth": (110, 110, 110)}
"""Of the robot and its way: on the map, by odometry alone, and in truth."""
OF_THE_MAP = (200, 40, 60)
_ROBOT_NS = 10**8
"""Interval between updates of the robot, which is also updated at every view step."""
_GROWN_NS = 10**9
_GROWTH = 100
"""Data that grow with the run are shown again after the longer of a second and a hundredth of the
run's duration so far: a file then grows with n log n, not n^2."""
_APART_M = 0.1
"""Points of a path closer than this to the previous one are left out."""
_ITEM_NS = 2 * 10**8
"""Smallest interval between images and clouds, which make up most of what is shown."""


class RunView(ABC):
    """Shows a run of RatSLAM; ``run_ratslam`` and ``run_events`` take ``step`` as ``watch``.

    The ground truth is moved so that it starts where dead reckoning is at that time.

    Args:
        truth: true trajectory of the robot; None if unknown.
    """

    def __init__(self, truth: "Trajectory | None" = None) -> None:
        self._truth, self._closed = truth, False
        self._first_ns: int | None = None
        self._seen_ns: int | None = None
        self._grown_ns = self._robots_ns = 0
        self._moved: RigidMotion | None = None
        self._ways: dict[str, list[list[float]]] = {which: [] for which in COLOURS}
        self._last: tuple[Step, RatSlam] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def step(self, step: Step, slam: RatSlam, event: Event | None = None) -> None:
        """Show a step.

        Args:
            step: the step.
            slam: the RatSLAM that made it; not changed.
            event: the input of the step, of which cloud and image are shown if it has them.

        Raises:
            DataError: the view is closed.
        """
        if self._closed:
            raise DataError("the live view is closed: make another one", code="closed")
        if self._first_ns is None:
            self._first_ns = step.stamp_ns
        begins, self._last = self._last is None, (step, slam)
        now = step.stamp_ns
        self._set_time(now)
        if begins or step.looked or now - self._robots_ns >= _ROBOT_NS:
            self._robots_ns = now
            self._show_robots(step)
        if step.looked:
            self._show_view(step, slam)
            if self._seen_ns is None or now - self._seen_ns >= _ITEM_NS:
                item = event.item if isinstance(event, Look) else event
                if self._show_item(item, slam):
                    self._seen_ns = now
        if step.why:
            self._show_text(step.why, is_refusal=step.refused is not None)
        pause = max(_GROWN_NS, (self._grown_ns - self._first_ns) // _GROWTH)
        if begins or now - self._grown_ns >= pause:
            self._grown_ns = now
            self._show_map(slam)

    def close(self) -> None:
        """Show the final map and end. May be called twice. Raises as ``_end``."""
        if self._closed:
            return
        self._closed = True
        try:
            if self._last is not None:
                self._set_time(self._last[0].stamp_ns)
                self._show_map(self._last[1])
        finally:
            self._end()

    @abstractmethod
    def _set_time(self, stamp_ns: int) -> None:
        """Set the time of what is shown from now on."""

    @abstractmethod
    def _show_robot(self, which: str, place: list[float], heading: float) -> None:
        """Show where one of ``COLOURS`` is: x, y, z and a heading."""

    @abstractmethod
    def _show_view(self, step: Step, slam: RatSlam) -> None:
        """Show which view was recognised."""

    @abstractmethod
    def _show_item(self, item: Any, slam: RatSlam) -> bool:
        """Show what was looked at; tell whether there was anything to show."""

    @abstractmethod
    def _show_text(self, text: str, *, is_refusal: bool) -> None:
        """Show what happened; refused loops stand out."""

    @abstractmethod
    def _show_map(self, slam: RatSlam) -> None:
        """Show data that grow with the run: the map and the ways."""

    @abstractmethod
    def _end(self) -> None:
        """Let go of whatever shows it."""

    def _show_robots(self, step: Step) -> None:
        poses = {"live": step.pose, "dead_reckoning": step.dead_reckoning}
        if self._truth is not None:
            truth = true_poses(self._truth, [step.stamp_ns])
            if np.isfinite(truth).all():
                poses["truth"] = self._on_map(truth, step)[0]
        for which, pose in poses.items():
            x, y, heading = (float(value) for value in pose)
            way, place = self._ways[which], [x, y, 0.0]
            if not way or np.hypot(x - way[-1][0], y - way[-1][1]) >= _APART_M:
                way.append(place)
            self._show_robot(which, place, heading)

    def _on_map(self, truth: Floats, step: Step) -> Floats:
        """Move true poses (n, 3) so that the first one ever shown lies on dead reckoning."""
        if self._moved is None:
            turn = step.dead_reckoning[2] - truth[0, 2]
            there = RigidMotion(0.0, 0.0, turn).apply(truth)[0]
            x, y = np.array(step.dead_reckoning[:2]) - there[:2]
            self._moved = RigidMotion(float(x), float(y), float(turn))
        return self._moved.apply(truth)


def image_of(item: Any, slam: RatSlam) -> NDArray[np.uint8] | None:
    """uint8 (H, W, 3) or (H, W): the image seen, or its stored template; None without one."""
    if isinstance(item, Picture):
        return item.image
    if isinstance(item, Frame):
        return next(iter(item.images.values()), None)
    if not isinstance(item, np.ndarray):
        return None
    if item.dtype == np.uint8:
        return item
    if isinstance(slam.views, TemplateSource):
        config = slam.views.templates.config
        blocks = item.reshape(config.columns, config.rows).T
        return np.asarray(np.rint(255 * np.clip(blocks, 0, 1)), np.uint8)
    return None
