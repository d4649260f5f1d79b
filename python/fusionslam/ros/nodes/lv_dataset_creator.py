# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Node that writes clouds or scenes with ground truth, for tuning and training.

Source: Stastny 2022, 4.2.7.
"""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal

from fusionslam.config import option
from fusionslam.datasets.bags.messages import stamp_of
from fusionslam.errors import ClockError, ConfigError, DataError
from fusionslam.ros.messages.types import CLOUD, ODOMETRY, VIEW_DESCRIPTION
from fusionslam.ros.nodes.data_fusion import COLORED
from fusionslam.ros.nodes.lv_builder import DESCRIPTIONS
from fusionslam.ros.nodes.view_config import ViewsConfig, cloud_of, matcher_of, source_of
from fusionslam.ros.runtime.checkpoints import SavingConfig
from fusionslam.ros.runtime.node import Input, Node, Outlet
from fusionslam.sensors.frame import Cloud
from fusionslam.sensors.messages import Odometry, Scan
from fusionslam.sensors.pose_buffer import Ground, PoseQueue
from fusionslam.views.recognisers import scene_config
from fusionslam.views.scene_recorder import SceneRecorder
from fusionslam.views.scenes import Scene
from fusionslam.views.serialization import view_from_bytes

TRUTH = "ground_truth"
_MOST_WAITING = 100
"""Maximum number of clouds, a few megabytes each, that wait for ground truth."""


class DatasetCreatorConfig(ViewsConfig):
    """Configuration of the node lv_dataset_creator."""

    keep: Literal["clouds", "scenes"] = option(
        "clouds",
        "content of the set; scenes are small, but cannot be built again with other values",
    )
    memory: SavingConfig = option(
        SavingConfig(file="scenes.npz", every=60.0),
        "file of the scene set; an older one of that name is replaced",
    )
    max_scans: int = option(20_000, "largest number of scans; more are dropped and counted", ge=1)


class DatasetCreator(Node[DatasetCreatorConfig]):
    """Pairs clouds or scenes with ground-truth poses and writes a scene set."""

    name = "lv_dataset_creator"
    defaults = DatasetCreatorConfig()
    outputs: ClassVar = {}

    def __init__(self, config: DatasetCreatorConfig, outlet: Outlet) -> None:
        super().__init__(config, outlet)
        self._waiting: PoseQueue[Cloud | Scene] = PoseQueue(most=_MOST_WAITING)
        matcher = matcher_of(source_of(config))
        if matcher is None:
            raise ConfigError(
                f"~source is {config.source!r}: lv_dataset_creator keeps clouds or scenes"
            )
        self._comparison = matcher.comparison
        kept = scene_config(matcher.config) if config.keep == "scenes" else None
        self._recorder = SceneRecorder("a drive", scene_config=kept, max_scans=config.max_scans)
        self._saver = self.make_saver(config.memory, lambda path: self._recorder.save(path))

    @property
    def inputs(self) -> Sequence[Input]:
        """Inputs: clouds or scenes, whichever is kept, and ground truth."""
        what = (
            Input(COLORED, [CLOUD], self._take_cloud)
            if self.config.keep == "clouds"
            else Input(DESCRIPTIONS, [VIEW_DESCRIPTION], self._take_description)
        )
        return [
            what,
            Input(TRUTH, [ODOMETRY], self._take_truth, small=True),
        ]

    def idle(self) -> None:
        """Process the waiting scans: no more poses are expected."""
        self._keep(self._waiting.flush())
        super().idle()

    def close(self) -> None:
        """Write the set."""
        self._keep(self._waiting.flush())
        super().close()

    def report(self) -> Mapping[str, int]:
        """Count scans kept, dropped, and without a pose."""
        return {
            **self.counts,
            "scans kept": len(self._recorder),
            "without a true pose": self._recorder.without_pose,
            "beyond max_scans": self._recorder.dropped,
            "jumps": self._waiting.jumps,
        }

    def _take_cloud(self, scan: Scan) -> None:
        self._keep(self._waiting.add(scan.stamp_ns, cloud_of(scan)))

    def _take_description(self, message: Any) -> None:
        view = view_from_bytes(self._comparison, bytes(message.data))
        if not isinstance(view.content, Scene):
            raise DataError(f"a view of {message.kind} holds no scene: set ~keep to clouds")
        self._keep(self._waiting.add(stamp_of(message.header.stamp), view.content))

    def _take_truth(self, odometry: Odometry) -> None:
        self._keep(self._waiting.move(odometry))

    def _keep(self, placed: list[tuple[int, Cloud | Scene, Ground | None]]) -> None:
        for stamp_ns, item, pose in placed:
            try:
                self._recorder.add(stamp_ns, item, pose)
            except ClockError:
                self.counts["before a jump of the clock"] += 1
                continue
            self._saver.note_change()
