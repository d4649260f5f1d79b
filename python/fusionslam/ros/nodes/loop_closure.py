# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Node that finds loops, with the robot's pose, from coloured clouds (Perdomo 2019, chapter 3)."""

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar, Literal

from fusionslam.config import option
from fusionslam.descriptors import DescriptorConfig
from fusionslam.errors import DataError
from fusionslam.loop_closure.aligned import AlignedLoop, AlignedLoopDetector
from fusionslam.loop_closure.detector import LoopConfig, LoopDetector
from fusionslam.ros.messages.types import CLOUD, LOOP_CLOSURE, ground_pose, header, make, ros_time
from fusionslam.ros.nodes.data_fusion import COLORED
from fusionslam.ros.nodes.view_config import EMPTY, cloud_of
from fusionslam.ros.runtime.checkpoints import SavingConfig, continued, other_settings
from fusionslam.ros.runtime.config import CommonConfig
from fusionslam.ros.runtime.node import Input, Node, Outlet
from fusionslam.sensors.messages import Scan

logger = logging.getLogger(__name__)

LOOPS = "loop_closures"


class LoopClosureConfig(CommonConfig):
    """Configuration of the node loop_closure."""

    descriptor: Literal["m2dp", "cm2dp", "shot", "cshot"] = option("cm2dp", "which one is compared")
    descriptors: DescriptorConfig = option(DescriptorConfig(), "clouds to vectors")
    loop_closure: LoopConfig = option(LoopConfig(), "vectors to loops")
    memory: SavingConfig = option(SavingConfig(), "the folder where descriptors are kept")


class LoopClosure(Node[LoopClosureConfig]):
    """Finds clouds that were taken at the place of an older one."""

    name = "loop_closure"
    defaults = LoopClosureConfig()
    outputs: ClassVar = {LOOPS: LOOP_CLOSURE}

    def __init__(self, config: LoopClosureConfig, outlet: Outlet) -> None:
        super().__init__(config, outlet)
        self._loops = AlignedLoopDetector(
            LoopDetector(config.descriptor, config=config.loop_closure, describe=config.descriptors)
        )
        self._saver = self.saved(config.memory, lambda path: self._loops.save(path))
        self._go_on(self._saver.kept)

    def _go_on(self, path: Path | None) -> None:
        if path is None:
            return
        with continued(path):
            loops = AlignedLoopDetector.load(path)
        wanted = _settings(self._loops.detector)
        for name, stored in _settings(loops.detector).items():
            if stored != wanted[name]:
                raise other_settings(name, path)
        self._loops = loops
        logger.info("goes on with %d clouds of %s", len(loops), path)

    @property
    def inputs(self) -> Sequence[Input]:
        """Inputs: coloured clouds."""
        return [Input(COLORED, [CLOUD], self._take)]

    def idle(self) -> None:
        """Save the descriptors so far."""
        self._saver.write()

    def close(self) -> None:
        """Save all descriptors."""
        self._saver.close()

    def _take(self, scan: Scan) -> None:
        cloud = cloud_of(scan)
        if not len(cloud):
            raise DataError(EMPTY, code="empty-cloud")
        loop = self._loops.add(cloud, scan.stamp_ns)
        self.counts["clouds"] += 1
        if loop is not None:
            self.counts["loops"] += 1
            self.outlet.publish(LOOPS, _message(scan, loop))
        self._saver.changed()


def _settings(detector: LoopDetector) -> dict[str, Any]:
    """Return the parameters that its memory depends on; the first cloud may fix the radius."""
    describe = detector.describe_config.model_dump(exclude={"threads", "normal_radius"})
    return {
        "descriptor": detector.descriptor,
        "loop_closure": detector.config,
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
