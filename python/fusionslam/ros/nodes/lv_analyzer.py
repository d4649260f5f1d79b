# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Node that evaluates view ids against ground truth (Stastny 2022, 4.2.6)."""

import json
import logging
from collections import OrderedDict, deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Literal

from fusionslam.base.files import write_file
from fusionslam.config import option
from fusionslam.datasets.bags.messages import stamp_of
from fusionslam.errors import DataError
from fusionslam.evaluation.views.online import JudgedView, RunningViews
from fusionslam.ratslam.external_views import GivenView, GivenViews
from fusionslam.report.views.false_positives import write_false_positive
from fusionslam.report.views.thumbnails import image_preview
from fusionslam.ros.messages.library import make
from fusionslam.ros.messages.types import (
    IMAGES,
    ODOMETRY,
    VIEW_STATISTICS,
    VIEW_TEMPLATE,
    header,
)
from fusionslam.ros.nodes.frame_node import LEFT
from fusionslam.ros.nodes.lv_dataset_creator import TRUTH
from fusionslam.ros.nodes.lv_matching import TEMPLATES
from fusionslam.ros.runtime.config import CommonConfig
from fusionslam.ros.runtime.node import Input, Node, Outlet
from fusionslam.sensors.messages import NANOSECONDS, Odometry, Picture
from fusionslam.sensors.pose_buffer import Ground, PoseQueue

logger = logging.getLogger(__name__)

STATISTICS = "view_statistics"
_RECENT = 100
"""Number of recent images kept until their views arrive."""

SHARES = ("accuracy", "precision", "recall", "loop_recall", "loop_precision")


class ViewAnalyzerConfig(CommonConfig):
    """Configuration of the node lv_analyzer."""

    rule: Literal["paper", "author"] = option("paper", "how views are judged")
    output: str = option(
        "",
        "folder for the figures (at the end) and pictures of false positives; empty: none",
    )
    max_pictures: int = option(
        200, "largest number of pictures of false positives; later ones are counted", ge=0
    )
    max_places: int = option(
        5000,
        "largest number of places whose first image is remembered; the oldest is forgotten",
        ge=1,
    )
    image_difference: float = option(
        0.2, "largest time between a view and its image", unit="s", ge=0
    )


class ViewAnalyzer(Node[ViewAnalyzerConfig]):
    """Evaluates the ids against ground-truth poses while the robot drives."""

    name = "lv_analyzer"
    defaults = ViewAnalyzerConfig()
    outputs: ClassVar = {STATISTICS: VIEW_STATISTICS}
    latched = (STATISTICS,)

    def __init__(self, config: ViewAnalyzerConfig, outlet: Outlet) -> None:
        super().__init__(config, outlet)
        self._running = RunningViews(config.rule)
        self._waiting: PoseQueue[int] = PoseQueue()
        self._views = GivenViews()
        self._images: deque[tuple[int, bytes]] = deque(maxlen=_RECENT)
        self._first: OrderedDict[int, bytes | None] = OrderedDict()
        self._last_ns: int | None = None
        self._offset_ns = 0

    @property
    def inputs(self) -> Sequence[Input]:
        """Inputs: ids, ground truth, and images, which only pictures need."""
        found = [
            Input(TEMPLATES, [VIEW_TEMPLATE], self._take_view),
            Input(
                TRUTH, [ODOMETRY], lambda pose: self._judge(self._waiting.move(pose)), small=True
            ),
        ]
        if self.config.output:
            found.append(Input(LEFT[0], IMAGES, self._take_image, optional=True))
        return found

    def idle(self) -> None:
        """Judge the waiting views: no more poses are expected."""
        self._judge(self._waiting.flush())

    def close(self) -> None:
        """Log and write how good the ids were."""
        self._judge(self._waiting.flush())
        if not len(self._running):
            logger.warning("nothing was judged: no views with a true pose")
            return
        report = self._running.report()
        logger.info("%s", report)
        if self.config.output:
            write_file(self._folder / "views.json", json.dumps(report.metrics(), indent=1))

    def report(self) -> Mapping[str, int]:
        """Count views judged, and views without a ground-truth pose."""
        return {**self.counts, "views judged": len(self._running), "jumps": self._waiting.jumps}

    @property
    def _folder(self) -> Path:
        return Path(self.config.output).expanduser()

    def _take_view(self, message: Any) -> None:
        stamp_ns = stamp_of(message.header.stamp)
        # A matcher that lost its memory reuses ids for other places.
        view = GivenView(message.current_id, message.is_new)
        self._judge(self._waiting.add(stamp_ns, self._views.look(view, stamp_ns).view_id))

    def _take_image(self, picture: Picture) -> None:
        self._images.append((picture.stamp_ns, image_preview(picture.image)))

    def _take_truth(self, odometry: Odometry) -> None:
        self._judge(self._waiting.move(odometry))

    def _judge(self, placed: list[tuple[int, int, Ground | None]]) -> None:
        for stamp_ns, view_id, pose in placed:
            if pose is None:
                self.counts["without a true pose"] += 1
                continue
            # By a monotonic clock: the drive continues when a bag restarts.
            if self._last_ns is not None and stamp_ns + self._offset_ns < self._last_ns:
                self._offset_ns = self._last_ns + NANOSECONDS - stamp_ns
            self._last_ns = stamp_ns + self._offset_ns
            self._remember(self._running.add(self._last_ns, view_id, pose), stamp_ns)
        if not placed:
            return
        report = self._running.report()
        shares = {name: getattr(report, name) for name in SHARES}
        message = make(
            VIEW_STATISTICS,
            header=header(placed[-1][0], ""),
            views=report.n,
            places=report.views,
            false_positives=report.false_positives,
            false_negatives=report.false_negatives,
            **{name: -1.0 if value is None else value for name, value in shares.items()},
        )
        self.outlet.publish(STATISTICS, message)

    def _remember(self, judged: JudgedView, stamp_ns: int) -> None:
        """Keep the image of a new place; write a picture of a false positive."""
        if not self.config.output:
            return
        # The nearest in time, if it is near enough.
        near = min(self._images, key=lambda image: abs(image[0] - stamp_ns), default=None)
        reach = self.config.image_difference * NANOSECONDS
        image = None if near is None or abs(near[0] - stamp_ns) > reach else near[1]
        if judged.is_first:
            self._first[judged.id] = image
            if len(self._first) > self.config.max_places:
                self._first.popitem(last=False)
        elif judged.false_positive:
            self.counts["false positives"] += 1
            if self.counts["pictures"] < self.config.max_pictures:
                self._write(judged, image)

    def _write(self, judged: JudgedView, image: bytes | None) -> None:
        path = self._folder / f"false_positive_{judged.scan:06d}.jpg"
        try:
            write_false_positive(path, judged, image, self._first.get(judged.id))
        except DataError as error:
            advice = "make room, allow it, or give another folder"
            problem = f"no picture can be written: {advice}\n{error}"
            self.problems.add("~output", problem, "cannot-write")
            return
        self.counts["pictures"] += 1
