# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The messages of a robot as a bag, their overview, and the first cloud made of them."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

from fusionslam.datasets.bags.dataset import dataset_of
from fusionslam.datasets.bags.indexed_bag import IndexedBag, index_bag, restamp
from fusionslam.datasets.bags.reader import Bag
from fusionslam.datasets.bags.topics import INFO_ROLES, TRANSFORM_TYPES
from fusionslam.datasets.streams import Request
from fusionslam.errors import DataError
from fusionslam.fusion import SENSORS_OF
from fusionslam.pipelines.bag_overview import Inspection
from fusionslam.pipelines.frame_check import FirstCloud, try_frames
from fusionslam.pipelines.overview import Overview, look_at_bag
from fusionslam.ros.check.graph import Advice, Graph
from fusionslam.ros.nodes.data_fusion import DataFusionConfig
from fusionslam.ros.nodes.frame_node import frame_builder
from fusionslam.ros.topic_choice import Choice
from fusionslam.sensors.frame import Frame
from fusionslam.sensors.frame_builder import FrameBuilder
from fusionslam.sensors.messages import CameraInfo, FrameTransforms, Message

_OF_FILES = ("name", "kind", "folder", "fusion", "checked")
"""Labels of an overview that say nothing about a running robot, or what a finding says."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """The evidence gathered by listening.

    Attributes:
        advice: of the middleware.
        graph: the topics of the robot.
        choices: chosen topics by role.
        roles: topics that were listened to, by role.
        bag: the messages that arrived.
        config: of data_fusion.
        seconds: how long it waited for messages, and then listened.
        unreachable: publishers that cannot be reached, with their addresses.
        clock: whether ROS time runs.
        remappings: as given, NAME:=TOPIC.
        options: the other arguments as given.
    """

    advice: Advice
    graph: Graph
    choices: Mapping[str, Choice]
    roles: Mapping[str, str]
    bag: Bag
    config: DataFusionConfig
    seconds: float
    unreachable: Mapping[str, str]
    clock: bool
    remappings: Sequence[str] = ()
    options: Sequence[str] = ()

    @property
    def by_arrival(self) -> bool:
        """Whether the nodes use times of arrival instead of stamps."""
        return self.config.node.stamps == "arrival"

    @cached_property
    def source(self) -> IndexedBag:
        """The messages, indexed as ``fusionslam info`` indexes a bag."""
        roles = {role: topic for role, topic in self.roles.items() if topic in self.bag.topics}
        stamps = "bag" if self.by_arrival else "header"
        return index_bag(self.bag, roles.values(), roles, stamps)

    @cached_property
    def overview(self) -> Overview:
        """The overview of a bag with these messages, as ``fusionslam info`` makes it."""
        sensors = SENSORS_OF[self.config.fusion.source]
        request = Request(sensors=sensors, sync=self.config.online.sync)
        whole = look_at_bag(Inspection(self.source), lambda: dataset_of(self.source, request))
        return replace(whole, rows=[row for row in whole.rows if row[0] not in _OF_FILES])

    @cached_property
    def builder(self) -> FrameBuilder:
        """The frame builder of data_fusion, which ``trial`` uses."""
        return frame_builder(self.config.online, self.config.fusion.source)

    @cached_property
    def trial(self) -> FirstCloud | None:
        """The first cloud that data_fusion would make of the messages; None without a frame."""
        return try_frames(self._frames(), self.config.fusion)

    @property
    def robot(self) -> str:
        """The robot's frame as data_fusion finds it; empty if it does not."""
        _ = self.trial  # which tells the builder the frames
        return self.builder.robot.robot or ""

    @property
    def has_clouds(self) -> bool:
        """Whether a cloud with points could be fused."""
        return self.trial is not None and self.trial.points > 0

    def first(self, role: str) -> Message | None:
        """Return the first message of a role; None if there is none, or if it is unreadable."""
        if role not in self.source.roles:
            return None
        topic, series = self.source.roles[role], self.source.series(role)
        with suppress(DataError):
            return self.bag.message(topic, *series.place(0))
        return None

    def _frames(self) -> Iterator[Frame]:
        """Yield the frames that data_fusion would make; it does not use ground truth."""
        roles = self.source.roles
        topics = [topic for role, topic in roles.items() if role != "truth"]
        topics += [each.name for each in self.bag.topics.values() if each.type in TRANSFORM_TYPES]
        right = [roles.get(role) for role in ("right", INFO_ROLES["right"])]
        for raw in self.bag.raw(topics, on_error=lambda *_: None):
            with suppress(DataError):
                value = self._usable(raw.value(), raw.time_ns)
                if value is not None:
                    camera = "right" if raw.topic in right else "left"
                    yield from self.builder.process(value, camera)
        yield from self.builder.flush()

    def _usable(self, value: Message, time_ns: int) -> Message | None:
        """Return a message with the stamp in force; None without a stamp, which nodes refuse."""
        if isinstance(value, CameraInfo):
            return value
        if self.by_arrival:
            return restamp(value, time_ns)
        if isinstance(value, FrameTransforms):
            stamped = [each for each in value.transforms if each.static or each.stamp_ns]
            return FrameTransforms(transforms=tuple(stamped))
        return value if value.stamp_ns else None
