# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Node that finds loops, with the robot's pose, from coloured clouds (Perdomo 2019, chapter 3)."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar, Literal

from fusionslam.config import merged, option
from fusionslam.descriptors import DescriptorConfig
from fusionslam.errors import DataError
from fusionslam.fusion import ROBOT_FUSION
from fusionslam.loop_closure.aligned import AlignedLoop, AlignedLoopDetector
from fusionslam.loop_closure.detector import LoopConfig, LoopDetector
from fusionslam.ros.messages.types import CLOUD, LOOP_CLOSURE, ground_pose, header, make, ros_time
from fusionslam.ros.nodes.data_fusion import COLORED
from fusionslam.ros.nodes.view_config import EMPTY, cloud_of
from fusionslam.ros.runtime.checkpoints import SavingConfig, Settings
from fusionslam.ros.runtime.config import CommonConfig
from fusionslam.ros.runtime.node import Input, Node, Outlet
from fusionslam.sensors.messages import Scan

LOOPS = "loop_closures"


class LoopClosureConfig(CommonConfig):
    """Configuration of the node loop_closure."""

    descriptor: Literal["m2dp", "cm2dp", "shot", "cshot", "scan_context"] = option(
        "cm2dp", "descriptor that is compared"
    )
    descriptors: DescriptorConfig = option(DescriptorConfig(), "clouds to vectors")
    loop_closure: LoopConfig = option(LoopConfig(), "vectors to loops")
    memory: SavingConfig = option(SavingConfig(), "folder of the descriptors")


class LoopClosure(Node[LoopClosureConfig]):
    """Finds clouds that were taken at the place of an older one."""

    name = "loop_closure"
    defaults = LoopClosureConfig()
    outputs: ClassVar = {LOOPS: LOOP_CLOSURE}

    def __init__(self, config: LoopClosureConfig, outlet: Outlet) -> None:
        super().__init__(config, outlet)
        self._loops = AlignedLoopDetector(
            LoopDetector(
                config.descriptor,
                config=config.loop_closure,
                describe=config.descriptors,
                fusion=ROBOT_FUSION,
            )
        )
        self._saver = self.make_saver(config.memory, lambda path: self._loops.save(path))
        self._saver.resume(self._load, _settings(self._loops.detector))

    def _load(self, path: Path) -> Settings:
        wanted = self._loops.detector
        self._loops = AlignedLoopDetector.load(path)
        detector = self._loops.detector
        # What is stored does not depend on these.
        detector.threshold = wanted.threshold
        detector.config = merged(detector.config, {"max_frames": wanted.config.max_frames})
        return _settings(detector)

    @property
    def inputs(self) -> Sequence[Input]:
        """Inputs: coloured clouds."""
        return [Input(COLORED, [CLOUD], self._take)]

    def _take(self, scan: Scan) -> None:
        cloud = cloud_of(scan)
        if not len(cloud):
            raise DataError(EMPTY, code="empty-cloud")
        loop = self._loops.add(cloud, scan.stamp_ns)
        self.counts["clouds"] += 1
        if loop is not None:
            self.counts["loops"] += 1
            self.outlet.publish(LOOPS, _message(scan, loop))
        self._saver.note_change()


def _settings(detector: LoopDetector) -> Settings:
    """Return the parameters that its memory depends on; the first cloud may fix the radius."""
    describe = detector.describe_config.model_dump(exclude={"threads", "normal_radius"})
    return {
        "descriptor": detector.descriptor,
        "loop_closure": detector.config.model_dump(exclude={"threshold", "max_frames"}),
        "descriptors": describe,
    }


def _message(scan: Scan, found: AlignedLoop) -> Any:
    return make(
        LOOP_CLOSURE,
        header=header(scan.stamp_ns, scan.frame_id),
        query=found.loop.query,
        match=found.loop.match,
        match_stamp=ros_time(found.match_stamp_ns),
        distance=found.loop.distance,
        probability=-1.0 if found.probability is None else found.probability,
        pose=ground_pose(found.pose or (0.0, 0.0, 0.0)),
    )
