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
from fusionslam.geometry.se2 import places_of
from fusionslam.loop_closure import Loop, LoopConfig, LoopDetector
from fusionslam.registration import RegistrationConfig
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

    descriptor: Literal[
        "m2dp", "cm2dp", "shot", "cshot", "scan_context", "cscan_context", "bev_spectrum"
    ] = option("cm2dp", "descriptor that is compared")
    descriptors: DescriptorConfig = option(DescriptorConfig(), "clouds to vectors")
    loop_closure: LoopConfig = option(LoopConfig(), "vectors to loops")
    registration: RegistrationConfig = option(
        RegistrationConfig(method="planar"), "pairs of clouds to poses"
    )
    memory: SavingConfig = option(SavingConfig(), "folder of the descriptors")


class LoopClosure(Node[LoopClosureConfig]):
    """Finds clouds that were taken at the place of an older one."""

    name = "loop_closure"
    defaults = LoopClosureConfig()
    outputs: ClassVar = {LOOPS: LOOP_CLOSURE}

    def __init__(self, config: LoopClosureConfig, outlet: Outlet) -> None:
        super().__init__(config, outlet)
        self._loops = LoopDetector(
            config.descriptor,
            config=config.loop_closure,
            describe=config.descriptors,
            fusion=ROBOT_FUSION,
            registration=config.registration,
        )
        self._saver = self.make_saver(config.memory, lambda path: self._loops.save(path))
        self._saver.resume(self._load, _settings(self._loops))

    def _load(self, path: Path) -> Settings:
        wanted = self._loops
        self._loops = LoopDetector.load(path)
        # What is stored does not depend on these.
        self._loops.threshold = wanted.threshold
        changed = {"max_frames": wanted.config.max_frames}
        self._loops.config = merged(self._loops.config, changed)
        return _settings(self._loops)

    @property
    def inputs(self) -> Sequence[Input]:
        """Inputs: coloured clouds."""
        return [Input(COLORED, [CLOUD], self._take)]

    def _take(self, scan: Scan) -> None:
        cloud = cloud_of(scan)
        if not len(cloud):
            raise DataError(EMPTY, code="empty-cloud")
        loop = self._loops.add(cloud, stamp_ns=scan.stamp_ns)
        self.counts["clouds"] += 1
        if loop is not None:
            self.counts["loops"] += 1
            match_stamp_ns = self._loops.stamp_ns(loop.match)
            self.outlet.publish(LOOPS, _message(scan, loop, match_stamp_ns))
        self._saver.note_change()


def _settings(detector: LoopDetector) -> Settings:
    """Return the parameters that its memory depends on; the first cloud may fix the radius."""
    describe = detector.describe_config.model_dump(exclude={"threads", "normal_radius"})
    return {
        "descriptor": detector.descriptor,
        "verifies": detector.verifies,
        "registration": detector.registration_config.model_dump(),
        "loop_closure": detector.config.model_dump(exclude={"threshold", "max_frames"}),
        "descriptors": describe,
    }


def _message(scan: Scan, loop: Loop, match_stamp_ns: int) -> Any:
    place = (0.0, 0.0, 0.0)
    if loop.match_from_query is not None:
        x, y, yaw = places_of(loop.match_from_query[None])[0].tolist()
        place = (x, y, yaw)
    return make(
        LOOP_CLOSURE,
        header=header(scan.stamp_ns, scan.frame_id),
        query=loop.query,
        match=loop.match,
        match_stamp=ros_time(match_stamp_ns),
        distance=loop.distance,
        probability=-1.0 if loop.probability is None else loop.probability,
        pose=ground_pose(place),
    )
