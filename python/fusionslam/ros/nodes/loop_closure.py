# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Node that finds loops, with the robot's pose, from coloured clouds (Perdomo 2019, chapter 3)."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

from pydantic import field_validator

from fusionslam.config import option
from fusionslam.descriptors import DescriptorConfig, find_descriptor, without_fitted
from fusionslam.errors import DataError
from fusionslam.fusion import ROBOT_FUSION
from fusionslam.geometry.se2 import places_of
from fusionslam.loop_closure import Loop, LoopConfig, LoopDetector
from fusionslam.registration import RegistrationConfig, has_lengths, without_lengths
from fusionslam.ros.messages.library import make, ros_time
from fusionslam.ros.messages.types import (
    CLOUD,
    LOOP_CLOSURE,
    ground_pose,
    header,
    pose_with_covariance,
)
from fusionslam.ros.nodes.data_fusion import COLORED
from fusionslam.ros.nodes.view_config import EMPTY, cloud_of
from fusionslam.ros.runtime.checkpoints import SavingConfig, Settings
from fusionslam.ros.runtime.config import CommonConfig
from fusionslam.ros.runtime.node import Input, Node, Outlet
from fusionslam.sensors.messages import Scan

LOOPS = "loop_closures"


class LoopClosureConfig(CommonConfig):
    """Configuration of the node loop_closure."""

    descriptor: str = option("cm2dp", "descriptor that is compared, such as scan_context")
    descriptors: DescriptorConfig = option(DescriptorConfig(), "clouds to vectors")
    loop_closure: LoopConfig = option(LoopConfig(), "vectors to loops")
    registration: RegistrationConfig = option(
        RegistrationConfig(method="planar"), "pairs of clouds to poses"
    )
    memory: SavingConfig = option(SavingConfig(), "folder of the descriptors")

    @field_validator("descriptor")
    @classmethod
    def _check_descriptor(cls, name: str) -> str:
        find_descriptor(name)
        return name


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
        self._saver.resume(self._load, self._settings(self._loops))

    def _load(self, path: Path) -> Settings:
        wanted = self._loops
        self._loops = LoopDetector.load(path)
        # What is stored does not depend on these.
        self._loops.threshold = wanted.threshold
        self._loops.limit_frames(wanted.config.max_frames)
        return self._settings(self._loops)

    def _settings(self, detector: LoopDetector) -> Settings:
        """Return the parameters that its memory depends on.

        The first cloud fixes lengths that were not given.
        """
        describe = without_fitted(detector.describe_config, self.config.descriptors)
        describe.pop("threads")
        compared = detector.config.model_dump(exclude={"threshold", "max_frames"})
        registration = detector.registration_config
        given = has_lengths(self.config.registration)
        return {
            "descriptor": detector.descriptor,
            "loop_closure": compared | {"verify": detector.verifies},
            "descriptors": describe,
            "registration": registration.model_dump() if given else without_lengths(registration),
        }

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
            self.outlet.publish(LOOPS, _message(scan, loop, len(self._loops.rejected)))
        self._saver.note_change()


def _message(scan: Scan, loop: Loop, rejected: int) -> Any:
    found: dict[str, Any] = {"probability": -1.0, "overlap": -1.0}
    pose = loop.match_from_query
    if pose is not None and loop.covariance is not None:
        x, y, yaw = places_of(pose[None])[0].tolist()
        found = {
            "probability": loop.probability,
            "overlap": loop.overlap,
            "match_from_query": pose_with_covariance(pose, loop.covariance),
            "pose": ground_pose((x, y, yaw)),
        }
    return make(
        LOOP_CLOSURE,
        header=header(scan.stamp_ns, scan.frame_id),
        query=loop.query,
        match=loop.match,
        match_stamp=ros_time(loop.match_stamp_ns or 0),
        distance=loop.distance,
        rejected=rejected,
        **found,
    )
