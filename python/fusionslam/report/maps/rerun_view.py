# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``LiveView``: a growing map, in the rerun viewer or in a file for it.

    with LiveView("run.rrd") as view:
        for event in events:
            view.step(slam.step(event), slam, event)

``run_ratslam`` and ``run_events`` take ``view.step`` as their ``watch``.
"""

import logging
import os
import re
from contextlib import ExitStack
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.errors import ConfigError, DataError, FusionSlamError
from fusionslam.geometry.rigid import RigidMotion
from fusionslam.pipelines.maps import true_poses
from fusionslam.ratslam.events import Event, Look
from fusionslam.ratslam.slam import RatSlam, Step
from fusionslam.ratslam.view_sources import TemplateSource
from fusionslam.sensors.frame import Frame
from fusionslam.sensors.messages import Picture
from fusionslam.storage.arrays import Floats
from fusionslam.storage.files import atomic_path

if TYPE_CHECKING:
    from fusionslam.geometry.trajectory import Trajectory


logger = logging.getLogger(__name__)

ELAPSED, STAMP = "elapsed", "stamp"
"""Timelines: time since the first step, and the time stamps as dates since 1970."""

_COLOURS = {"live": (40, 110, 220), "dead_reckoning": (220, 120, 30), "truth": (110, 110, 110)}
_OF_THE_MAP = (200, 40, 60)
_ROBOT_NS = 10**8
"""Interval between updates of the robot, which is also updated at every view step."""
_GROWN_NS = 10**9
_GROWTH = 100
"""Data that grow with the run are logged again after the longer of a second and a hundredth of the
run's duration so far: a file then grows with n log n, not n^2."""
_APART_M = 0.1
"""Points of a path closer than this to the previous one are left out."""
_ANSWER_S = 10.0
"""A viewer that does not answer within this time counts as absent."""
_IMAGE_NS = 2 * 10**8
"""Smallest interval between images, which make up most of a file."""
_IMAGE_WIDTH = 320


class LiveView:
    """Shows map, paths, pose cell activity, views and images while RatSLAM runs.

    Entities: ``map/nodes``, ``map/links``; ``way/live``, ``way/dead_reckoning``, ``way/truth`` and
    ``robot/...`` of the same names, all in metres in the map frame (the ground truth is moved so
    that it starts where dead reckoning is at that time); ``cells/sheet`` (activity summed over
    headings, by y and x) and ``cells/headings`` (summed over y and x); ``views/id`` and
    ``views/node``, as numbers; ``image``; ``log`` (events and their reasons). Each row has the time
    stamp of its step, on both timelines, and no other time.

    Args:
        path: .rrd file, written when the view is closed, also after an error, and kept in memory
            until then. None opens the viewer instead.
        name: name of the run, for display.
        truth: true trajectory of the robot; None if unknown.

    Raises:
        FusionSlamError: rerun is not installed, or its viewer does not start.
        DataError: the file cannot be written.
        ConfigError: the file name does not end in .rrd, by which rerun recognises its files.
    """

    def __init__(
        self,
        path: str | os.PathLike[str] | None = None,
        name: str = "RatSLAM",
        truth: "Trajectory | None" = None,
    ) -> None:
        if path is not None:
            _check(Path(path))
        self._rerun = _rerun()
        self._truth, self._files, self._closed = truth, ExitStack(), False
        self._first_ns: int | None = None
        self._imaged_ns: int | None = None
        self._grown_ns = self._robots_ns = 0
        self._moved: RigidMotion | None = None
        self._ways: dict[str, list[list[float]]] = {which: [] for which in _COLOURS}
        self._last: tuple[Step, RatSlam] | None = None
        # Without properties: they hold the wall clock's time, as does log_time.
        self._recording = self._rerun.RecordingStream(
            # Characters that rerun accepts in an application id; it warns about other names.
            "fusionslam " + re.sub(r"[^A-Za-z0-9 _-]", "-", name),
            send_properties=False,
            batcher_config=None if path is None else _large_chunks(self._rerun),
        )
        self._recording.set_log_time_enabled(False)
        self._temporary = None if path is None else self._files.enter_context(atomic_path(path))
        # In memory: rerun's own writer may wait forever on a full disk.
        self._kept = None if path is None else self._recording.binary_stream()
        if self._kept is None:
            self._open_viewer()
        self._recording.send_blueprint(_blueprint())

    def _open_viewer(self) -> None:
        try:
            self._recording.spawn()
            self._recording.flush(timeout_sec=_ANSWER_S)
        except (RuntimeError, OSError) as error:
            problem = (
                f"the viewer of rerun does not start ({error}): is there a screen? A .rrd file "
                "needs none"
            )
            raise FusionSlamError(problem, code="no-viewer") from error

    def __enter__(self) -> "LiveView":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def step(self, step: Step, slam: RatSlam, event: Event | None = None) -> None:
        """Show a step.

        Args:
            step: the step.
            slam: the RatSLAM that made it; not changed.
            event: the input of the step, whose image is shown if it has one.

        Raises:
            DataError: the view is closed.
        """
        if self._closed:
            raise DataError("the live view is closed: make another one", code="closed")
        if self._first_ns is None:
            self._first_ns = step.stamp_ns
        begins, self._last = self._last is None, (step, slam)
        self._set_time(step.stamp_ns)
        if begins or step.looked or step.stamp_ns - self._robots_ns >= _ROBOT_NS:
            self._robots_ns = step.stamp_ns
            self._robots(step)
        if step.looked:
            self._look(step, slam, event)
        if step.why:
            # Refused loops stand out from other events.
            level = "INFO" if step.refused is None else "WARN"
            self._log("log", self._rerun.TextLog(step.why, level=level))
        if begins or step.stamp_ns - self._grown_ns >= self._pause_ns():
            self._grown_ns = step.stamp_ns
            self._grown(slam)

    def close(self) -> None:
        """Show the final map and close the file. May be called twice.

        Raises:
            DataError: the file could not be written; then there is none.
        """
        if self._closed:
            return
        self._closed = True
        if self._last is not None:
            self._set_time(self._last[0].stamp_ns)
            self._grown(self._last[1])
        with self._files:
            if self._temporary is not None and self._kept is not None:
                self._temporary.write_bytes(self._kept.read() or b"")
        if self._temporary is None:
            self._leave_viewer()
        self._recording.disconnect()

    def _leave_viewer(self) -> None:
        """Disconnect from the viewer; a viewer closed by the user is not an error of the run."""
        try:
            self._recording.flush(timeout_sec=_ANSWER_S)
        except RuntimeError as error:
            logger.warning("the viewer of rerun was closed before the end: %s", error)

    def _pause_ns(self) -> int:
        return max(_GROWN_NS, (self._grown_ns - (self._first_ns or 0)) // _GROWTH)

    def _robots(self, step: Step) -> None:
        self._robot("live", step.pose)
        self._robot("dead_reckoning", step.dead_reckoning)
        if self._truth is None:
            return
        truth = true_poses(self._truth, [step.stamp_ns])
        if np.isfinite(truth).all():
            self._robot("truth", self._on_map(truth, step)[0])

    def _on_map(self, truth: Floats, step: Step) -> Floats:
        """Move true poses (n, 3) so that the first one ever shown lies on dead reckoning."""
        if self._moved is None:
            turn = step.dead_reckoning[2] - truth[0, 2]
            there = RigidMotion(0.0, 0.0, turn).apply(truth)[0]
            x, y = np.array(step.dead_reckoning[:2]) - there[:2]
            self._moved = RigidMotion(float(x), float(y), float(turn))
        return self._moved.apply(truth)

    def _robot(self, which: str, pose: Any) -> None:
        x, y, heading = (float(value) for value in pose)
        way, place = self._ways[which], [x, y, 0.0]
        if not way or np.hypot(x - way[-1][0], y - way[-1][1]) >= _APART_M:
            way.append(place)
        ahead = [0.4 * np.cos(heading), 0.4 * np.sin(heading), 0.0]
        self._log(
            f"robot/{which}",
            self._rerun.Arrows3D(
                origins=[place], vectors=[ahead], colors=[_COLOURS[which]], radii=0.04
            ),
        )

    def _look(self, step: Step, slam: RatSlam, event: Event | None) -> None:
        activity = slam.cells.activity
        sheet = activity.sum(axis=0).astype(np.float32)
        headings = activity.sum(axis=(1, 2)).astype(np.float32)
        self._log("cells/sheet", self._rerun.Tensor(sheet, dim_names=("y", "x")))
        self._log("cells/headings", self._rerun.BarChart(headings))
        for name, number in (("id", step.view_id), ("node", step.node)):
            if number is not None:
                self._log(f"views/{name}", self._rerun.Scalars([float(number)]))
        if self._imaged_ns is not None and step.stamp_ns - self._imaged_ns < _IMAGE_NS:
            return
        image = _image_of(event, slam)
        if image is not None:
            self._imaged_ns = step.stamp_ns
            every = -(-image.shape[1] // _IMAGE_WIDTH)
            small = np.ascontiguousarray(image[::every, ::every])
            self._log("image", self._rerun.Image(small).compress(jpeg_quality=75))

    def _grown(self, slam: RatSlam) -> None:
        """Show data that grow with the run: the map and the paths."""
        for which, way in self._ways.items():
            if len(way) > 1:
                line = self._rerun.LineStrips3D([way], colors=[_COLOURS[which]], radii=0.02)
                self._log(f"way/{which}", line)
        nodes, links = slam.map.nodes, slam.map.links
        places = np.column_stack([nodes[:, :2], np.zeros(len(nodes))])
        self._log("map/nodes", self._rerun.Points3D(places, colors=[_OF_THE_MAP], radii=0.08))
        ends = np.stack([places[links["source"]], places[links["target"]]], axis=1)
        self._log("map/links", self._rerun.LineStrips3D(ends, colors=[_OF_THE_MAP], radii=0.02))

    def _set_time(self, stamp_ns: int) -> None:
        elapsed = np.timedelta64(stamp_ns - (self._first_ns or 0), "ns")
        self._recording.set_time(ELAPSED, duration=elapsed)
        self._recording.set_time(STAMP, timestamp=np.datetime64(stamp_ns, "ns"))

    def _log(self, entity: str, what: Any) -> None:
        self._recording.log(entity, what)


def _image_of(event: Any, slam: RatSlam) -> NDArray[np.uint8] | None:
    """uint8 (H, W, 3) or (H, W): the image seen, or its stored template; None without one."""
    item = event.item if isinstance(event, Look) else event
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


def _check(path: Path) -> None:
    """Raise at the start the errors that would otherwise appear at the end."""
    if path.suffix != ".rrd":
        raise ConfigError(f"live view into {path}: expected a name that ends in .rrd")
    if path.is_dir():
        raise DataError(f"cannot write {path}: it is a folder")


def _large_chunks(rerun: Any) -> Any:
    """Batch rows of a file by size only, as nobody waits for them."""
    config = rerun.ChunkBatcherConfig.DEFAULT()
    config.flush_tick = timedelta(days=1)
    return config


def _blueprint() -> Any:
    """Map and paths from above on the left; cells, views, image and log on the right."""
    import rerun.blueprint as rrb

    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial3DView(name="map", contents=["/map/**", "/way/**", "/robot/**"]),
            rrb.Vertical(
                rrb.Horizontal(
                    rrb.TensorView(origin="/cells/sheet", name="pose cells"),
                    rrb.BarChartView(origin="/cells/headings", name="headings of the cells"),
                    rrb.Spatial2DView(origin="/image", name="image"),
                ),
                rrb.TimeSeriesView(origin="/views", name="views and nodes"),
                rrb.TextLogView(origin="/log", name="what happened"),
            ),
            column_shares=[3, 2],
        ),
        rrb.TimePanel(timeline=ELAPSED),
        collapse_panels=True,
    )


def _rerun() -> Any:
    try:
        import rerun
    except ImportError as error:
        problem = (
            "the live view needs rerun, which is not installed: pip install 'fusionslam[live]'"
        )
        raise FusionSlamError(problem, code="missing-extra", fields=("live",)) from error
    return rerun
