# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Node that gives views the ids of places (Stastny 2022, 4.2.4).

It can also match images, as in the original RatSLAM.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

from fusionslam.config import option
from fusionslam.datasets.bags.messages import stamp_of
from fusionslam.ratslam.events import Sighting
from fusionslam.ratslam.view_sources import TemplateSource, ViewSource, restore_source, save_source
from fusionslam.ros.messages.types import IMAGES, VIEW_DESCRIPTION, VIEW_TEMPLATE, header, make
from fusionslam.ros.nodes.frame_node import LEFT
from fusionslam.ros.nodes.lv_builder import DESCRIPTIONS
from fusionslam.ros.nodes.view_config import ViewsConfig, matcher_of, source_of
from fusionslam.ros.runtime.checkpoints import SavingConfig, Settings
from fusionslam.ros.runtime.node import Input, Node, Outlet
from fusionslam.sensors.messages import Picture
from fusionslam.views.serialization import view_from_bytes

TEMPLATES = "LocalView/Template"


class ViewMatchingConfig(ViewsConfig):
    """Configuration of the node lv_matching."""

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

    def _load(self, path: Path) -> Settings:
        restore_source(self._source, path)
        return _settings(self._source)

    @property
    def inputs(self) -> Sequence[Input]:
        """Inputs: views of lv_builder, or images."""
        if matcher_of(self._source) is None:
            return [Input(LEFT[0], IMAGES, self._take_image)]
        return [Input(DESCRIPTIONS, [VIEW_DESCRIPTION], self._take_view)]

    def _take_view(self, message: Any) -> None:
        matcher = matcher_of(self._source)
        assert matcher is not None  # else it listens to images
        view = view_from_bytes(matcher.comparison, message.data)
        self._look(view, stamp_of(message.header.stamp), message.header.frame_id)

    def _take_image(self, picture: Picture) -> None:
        self._look(picture, picture.stamp_ns, picture.frame_id)

    def _look(self, item: Any, stamp_ns: int, frame_id: str) -> None:
        known = self._source.known
        sighting = self._source.look(item, stamp_ns)
        is_new = sighting.view_id >= known
        self.counts["new places"] += is_new
        self.counts["nothing recognised"] += sighting.view_id < 0
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
