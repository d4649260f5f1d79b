# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Node that gives views the ids of places (Stastny 2022, 4.2.4).

It can also match images, as in the original RatSLAM.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from fusionslam.config import option
from fusionslam.datasets.bags.messages import stamp_of
from fusionslam.ratslam.event_order import OrderConfig, StampOrder
from fusionslam.ratslam.events import Event, Look, Sighting
from fusionslam.ratslam.odometry import odometry_of
from fusionslam.ratslam.view_sources import (
    MatcherSource,
    TemplateSource,
    ViewSource,
    restore_source,
    save_source,
)
from fusionslam.ros.messages.library import make
from fusionslam.ros.messages.types import (
    IMAGES,
    ODOMETRY,
    VIEW_DESCRIPTION,
    VIEW_TEMPLATE,
    header,
)
from fusionslam.ros.nodes.frame_node import LEFT, ODOM
from fusionslam.ros.nodes.lv_builder import DESCRIPTIONS
from fusionslam.ros.nodes.view_config import ViewsConfig, matcher_of, source_of
from fusionslam.ros.runtime.checkpoints import SavingConfig, Settings
from fusionslam.ros.runtime.node import Input, Node, Outlet
from fusionslam.sensors.messages import NANOSECONDS, Odometry, Picture
from fusionslam.views.comparison import View
from fusionslam.views.serialization import view_from_bytes

TEMPLATES = "LocalView/Template"
_WHY_LATE = {
    "order": "its publisher sends stamps that go back",
    "wait": "its way here takes longer than ~order/wait, which is {wait:g} s of stamps",
    "silence": "nothing had come for ~node/idle, which is {idle:g} s, so views waited no longer",
    "full": "too many messages waited for it",
}


class _Waiting(NamedTuple):
    """A view that waits for odometry."""

    view: View
    frame_id: str


class ViewMatchingConfig(ViewsConfig):
    """Configuration of the node lv_matching."""

    odometry: bool = option(
        True, "source alignment: wait for odometry, and weigh stored views by it"
    )
    order: OrderConfig = option(
        OrderConfig(wait=2.0, in_order=True, jump=1.0),
        "order of odometry and views; without odometry for this long, views are compared alone",
    )
    memory: SavingConfig = option(SavingConfig(), "file of the views")


class ViewMatching(Node[ViewMatchingConfig]):
    """Gives every view the id of its place, or a new one."""

    name = "lv_matching"
    defaults = ViewMatchingConfig()
    outputs: ClassVar = {TEMPLATES: VIEW_TEMPLATE}

    def __init__(self, config: ViewMatchingConfig, outlet: Outlet) -> None:
        super().__init__(config, outlet)
        self._source = source_of(config)
        self._saver = self.make_saver(config.memory, lambda path: save_source(self._source, path))
        self._saver.resume(self._load, _settings(self._source))
        # Views wait here for odometry; None if they do not.
        self._order: StampOrder | None = StampOrder(config.order) if self._waits else None
        self._first_ns: int | None = None
        self._has_odometry = False

    def _load(self, path: Path) -> Settings:
        restore_source(self._source, path)
        return _settings(self._source)

    @property
    def _waits(self) -> bool:
        """Whether views wait for odometry."""
        matcher = matcher_of(self._source)
        return self.config.odometry and matcher is not None and matcher.can_follow_odometry

    @property
    def inputs(self) -> Sequence[Input]:
        """Inputs: views of lv_builder, and odometry; or images."""
        if matcher_of(self._source) is None:
            return [Input(LEFT[0], IMAGES, self._take_image)]
        views = Input(DESCRIPTIONS, [VIEW_DESCRIPTION], self._take_view)
        if self._order is None:
            return [views]
        return [Input(ODOM, [ODOMETRY], self._take_odometry, small=True, optional=True), views]

    def idle(self) -> None:
        """Recognise the views that wait for odometry, and write the state."""
        if self._order is not None:
            self._process(self._order.settle())
        super().idle()

    def close(self) -> None:
        """As idle."""
        if self._order is not None:
            self._process(self._order.flush())
        super().close()

    def _take_odometry(self, odometry: Odometry) -> None:
        self._has_odometry = True
        if self._order is not None:
            self._sort(self._order, odometry, ODOM)

    def _sort(self, order: StampOrder, event: Event, topic: str) -> None:
        """Process what an event completes."""
        before = order.too_late
        events = order.add(event)
        if order.too_late > before:
            self.counts["too late"] += 1
            limits = {"wait": self.config.order.wait, "idle": self.config.node.idle}
            self.problems.add(
                topic,
                "a message came after later ones had been used and is dropped: "
                + _WHY_LATE[order.late_because].format(**limits),
                "too-late",
                order.late_because,
            )
        self._process(events)

    def _process(self, events: Sequence[Event]) -> None:
        for event in events:
            if isinstance(event, Odometry):
                odometry = odometry_of(event)
                if isinstance(self._source, MatcherSource) and odometry is not None:
                    self._source.follow(odometry)
            elif isinstance(event, Look):
                self._look(event.item.view, event.stamp_ns, event.item.frame_id)

    def _take_view(self, message: Any) -> None:
        matcher = matcher_of(self._source)
        assert matcher is not None  # else it listens to images
        view = view_from_bytes(matcher.comparison, bytes(message.data))
        stamp_ns, frame_id = stamp_of(message.header.stamp), message.header.frame_id
        if self._order is None:
            self._look(view, stamp_ns, frame_id)
            return
        self._sort(self._order, Look(stamp_ns, _Waiting(view, frame_id)), DESCRIPTIONS)
        self._stop_waiting(stamp_ns)

    def _stop_waiting(self, stamp_ns: int) -> None:
        """Compare views alone if there is no odometry."""
        if self._order is None or self._has_odometry:
            return
        if self._first_ns is None or stamp_ns < self._first_ns:
            self._first_ns = stamp_ns
        waited = (stamp_ns - self._first_ns) / NANOSECONDS
        if waited <= self.config.order.wait:
            return
        self.problems.add(
            ODOM,
            f"no odometry for {waited:.1f} s: views are compared alone, which cannot tell apart "
            "places that look alike; remap the topic, or set ~odometry to false",
            "no-odometry",
        )
        self._process(self._order.flush())
        if not self._waits:
            self._order = None

    def _take_image(self, picture: Picture) -> None:
        self._look(picture, picture.stamp_ns, picture.frame_id)

    def _look(self, item: Any, stamp_ns: int, frame_id: str) -> None:
        known = self._source.known
        sighting = self._source.look(item, stamp_ns)
        is_new = sighting.view_id >= known
        self.counts["new places"] += is_new
        self.counts["nothing recognised, or held back"] += sighting.view_id < 0
        self.outlet.publish(TEMPLATES, template_message(sighting, frame_id, is_new))
        self._saver.note_change()


def _settings(source: ViewSource) -> Settings:
    """Return the parameters that its memory depends on."""
    matcher = matcher_of(source)
    if matcher is not None:
        return {"views": matcher.config, "descriptors": matcher.descriptor_config}
    assert isinstance(source, TemplateSource)  # the only other kind
    return {"visual_templates": source.templates.config}


def template_message(sighting: Sighting, frame_id: str, is_new: bool) -> Any:
    """Return the message of a recognised view."""
    x, y = sighting.relative_place
    return make(
        VIEW_TEMPLATE,
        header=header(sighting.stamp_ns, frame_id),
        current_id=sighting.view_id,
        relative_rad=sighting.relative_rotation,
        relative_x=x,
        relative_y=y,
        is_new=is_new,
        reason=sighting.reason,
    )
