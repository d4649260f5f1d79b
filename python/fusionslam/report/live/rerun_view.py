# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``RerunView``: a growing map, in the rerun viewer or in a file for it.

    with RerunView("run.rrd") as view:
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

from fusionslam.base.files import atomic_path
from fusionslam.errors import ConfigError, DataError, FusionSlamError, needing
from fusionslam.ratslam.slam import RatSlam, Step
from fusionslam.report.live.run_view import COLOURS, OF_THE_MAP, RunView, image_of

if TYPE_CHECKING:
    from fusionslam.geometry.trajectory import Trajectory


logger = logging.getLogger(__name__)

ELAPSED, STAMP = "elapsed", "stamp"
"""Timelines: time since the first step, and the time stamps as dates since 1970."""

_ANSWER_S = 10.0
"""A viewer that does not answer within this time counts as absent."""
_IMAGE_WIDTH = 320


class RerunView(RunView):
    """Shows map, paths, pose cell activity, views and images while RatSLAM runs.

    Entities: ``map/nodes``, ``map/links``; ``way/live``, ``way/dead_reckoning``, ``way/truth`` and
    ``robot/...`` of the same names, all in metres in the map frame; ``cells/sheet`` (activity
    summed over headings, by y and x) and ``cells/headings`` (summed over y and x); ``views/id`` and
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
        if path is not None:  # errors that would otherwise appear at the end
            if Path(path).suffix != ".rrd":
                raise ConfigError(f"live view into {path}: expected a name that ends in .rrd")
            if Path(path).is_dir():
                raise DataError(f"cannot write {path}: it is a folder")
        with needing("live", "the live view needs rerun"):
            import rerun
        self._rerun: Any = rerun
        batches = self._rerun.ChunkBatcherConfig.DEFAULT()
        batches.flush_tick = timedelta(days=1)  # by size only, as nobody waits for those of a file
        super().__init__(truth)
        self._files = ExitStack()
        # Without properties: they hold the wall clock's time, as does log_time.
        self._recording = self._rerun.RecordingStream(
            # Characters that rerun accepts in an application id; it warns about other names.
            "fusionslam " + re.sub(r"[^A-Za-z0-9 _-]", "-", name),
            send_properties=False,
            batcher_config=None if path is None else batches,
        )
        self._recording.set_log_time_enabled(False)
        self._temporary = None if path is None else self._files.enter_context(atomic_path(path))
        # In memory: rerun's own writer may wait forever on a full disk.
        self._kept = None if path is None else self._recording.binary_stream()
        if self._kept is None:
            try:
                self._recording.spawn()
                self._recording.flush(timeout_sec=_ANSWER_S)
            except (RuntimeError, OSError) as error:
                problem = (
                    f"the viewer of rerun does not start ({error}): is there a screen? A .rrd file "
                    "needs none"
                )
                raise FusionSlamError(problem, code="no-viewer") from error
        self._recording.send_blueprint(_blueprint())

    def _end(self) -> None:
        """Close the file, or the connection. Raises DataError if the file cannot be written.

        A viewer that was closed by the user is not an error of the run.
        """
        with self._files:
            if self._temporary is not None and self._kept is not None:
                self._temporary.write_bytes(self._kept.read() or b"")
        if self._temporary is None:
            try:
                self._recording.flush(timeout_sec=_ANSWER_S)
            except RuntimeError as error:
                logger.warning("the viewer of rerun was closed before the end: %s", error)
        self._recording.disconnect()

    def _show_robot(self, which: str, place: list[float], heading: float) -> None:
        ahead = [0.4 * np.cos(heading), 0.4 * np.sin(heading), 0.0]
        self._log(
            f"robot/{which}",
            self._rerun.Arrows3D(
                origins=[place], vectors=[ahead], colors=[COLOURS[which]], radii=0.04
            ),
        )

    def _show_view(self, step: Step, slam: RatSlam) -> None:
        activity = slam.cells.activity
        sheet = activity.sum(axis=0).astype(np.float32)
        headings = activity.sum(axis=(1, 2)).astype(np.float32)
        self._log("cells/sheet", self._rerun.Tensor(sheet, dim_names=("y", "x")))
        self._log("cells/headings", self._rerun.BarChart(headings))
        for name, number in (("id", step.view_id), ("node", step.node)):
            if number is not None:
                self._log(f"views/{name}", self._rerun.Scalars([float(number)]))

    def _show_item(self, item: Any, slam: RatSlam) -> bool:
        image = image_of(item, slam)
        if image is None:
            return False
        every = -(-image.shape[1] // _IMAGE_WIDTH)
        small = np.ascontiguousarray(image[::every, ::every])
        self._log("image", self._rerun.Image(small).compress(jpeg_quality=75))
        return True

    def _show_text(self, text: str, *, is_refusal: bool) -> None:
        self._log("log", self._rerun.TextLog(text, level="WARN" if is_refusal else "INFO"))

    def _show_map(self, slam: RatSlam) -> None:
        for which, way in self._ways.items():
            if len(way) > 1:
                line = self._rerun.LineStrips3D([way], colors=[COLOURS[which]], radii=0.02)
                self._log(f"way/{which}", line)
        nodes, links = slam.map.nodes, slam.map.links
        places = np.column_stack([nodes[:, :2], np.zeros(len(nodes))])
        self._log("map/nodes", self._rerun.Points3D(places, colors=[OF_THE_MAP], radii=0.08))
        ends = np.stack([places[links["source"]], places[links["target"]]], axis=1)
        self._log("map/links", self._rerun.LineStrips3D(ends, colors=[OF_THE_MAP], radii=0.02))

    def _set_time(self, stamp_ns: int) -> None:
        elapsed = np.timedelta64(stamp_ns - (self._first_ns or 0), "ns")
        self._recording.set_time(ELAPSED, duration=elapsed)
        self._recording.set_time(STAMP, timestamp=np.datetime64(stamp_ns, "ns"))

    def _log(self, entity: str, what: Any) -> None:
        self._recording.log(entity, what)


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
