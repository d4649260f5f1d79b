# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Fuse incoming messages as data_fusion would, and diagnose why that fails."""

from collections import Counter

from fusionslam.datasets.bags.index import Series
from fusionslam.datasets.bags.topics import INFO_ROLES
from fusionslam.errors import DataError, FusionSlamError, one_line
from fusionslam.fusion import fuse
from fusionslam.pipelines.first_frame import FirstCloud, try_frame
from fusionslam.ros.nodes.data_fusion import DataFusionConfig, frame_builder
from fusionslam.sensors.frame import Frame
from fusionslam.sensors.frame_assembly import frame_from_pair
from fusionslam.sensors.frame_builder import BAD_CALIBRATION, NO_CAMERA_INFO, NO_TRANSFORM
from fusionslam.sensors.messages import CameraInfo, FrameTransforms, Message, Picture, Scan
from fusionslam.sensors.synchronizer import REASONS
from fusionslam.sensors.transforms import TransformTree

_RIGHT = ("right", INFO_ROLES["right"])
_ASK = {
    "lidar": "; does the scanner look where the camera looks, and is the frame of the CameraInfo "
    "the optical one (z ahead, x right)?",
    "stereo": "; do the two cameras see the same, with enough light and texture?",
    "cloud": "",
}


class Links:
    """All transforms that arrived.

    Attributes:
        tree: the consistent transforms.
        problems: the others, by what is wrong with them.
        moving: stamps and arrival times of moving transforms, by frame.
    """

    def __init__(self) -> None:
        self.tree = TransformTree()
        self.problems: Counter[str] = Counter()
        self.moving: dict[str, Series] = {}

    def refuse(self, why: str) -> None:
        """Count a transform that cannot be used."""
        self.problems[why] += 1

    def take(self, message: FrameTransforms, time_ns: int) -> FrameTransforms:
        """Process transforms that arrived at a time; return those that the nodes use."""
        used = []
        for each in message.transforms:
            if not (each.static or each.stamp_ns):
                self.refuse(f"the transform of '{each.child}' has the stamp zero")
                continue
            used.append(each)
            try:
                self.tree.add(each)
            except DataError as error:
                self.refuse(one_line(error))
            if not each.static:
                series = self.moving.setdefault(each.child, Series(by_arrival=False))
                series.headers.append(each.stamp_ns)
                series.times.append(time_ns)
        return FrameTransforms(transforms=tuple(used))


class TrialFusion:
    """Fuses incoming messages until a first cloud is made.

    Args:
        config: of data_fusion.

    Attributes:
        first: the first cloud with points, if there is one yet.
        above: number of its points that are not ground.
        links: all transforms.
        frames: the frame builder.
    """

    def __init__(self, config: DataFusionConfig) -> None:
        self.config = config
        self.frames = frame_builder(config)
        self.links = Links()
        self.first: FirstCloud | None = None
        self.above = 0
        self._why = ""
        self._last: dict[str, Message] = {}

    def take(self, role: str, message: Message, time_ns: int) -> None:
        """Process a message of a role that arrived at a time; transforms have no role."""
        if isinstance(message, FrameTransforms):
            message = self.links.take(message, time_ns)
        else:
            self._last[role] = message
        camera = "right" if role in _RIGHT else "left"
        # data_fusion does not use ground truth.
        if role != "truth":
            self._fuse_first(self.frames.process(message, camera))

    def end(self) -> None:
        """Finish: no more messages will come."""
        self._fuse_first(self.frames.flush())

    def reason(self) -> str:
        """Say why there is no cloud; empty if nothing could be tried."""
        dropped = {why for _, why in self.frames.dropped}
        if self._why or not dropped:
            return self._why
        # Pairs that were given up lack TF or a calibration, unlike scans without an image.
        given_up = dropped & {NO_TRANSFORM, NO_CAMERA_INFO, BAD_CALIBRATION}
        return (
            self._diagnose_last_pair()
            if given_up
            else "; ".join(REASONS[why] for why in sorted(dropped))
        )

    def _fuse_first(self, frames: list[Frame]) -> None:
        for frame in frames:
            if self.first is not None:
                return
            try:
                self._fuse(frame)
            except FusionSlamError as error:
                self._why = one_line(error)

    def _fuse(self, frame: Frame) -> None:
        config = self.config.fusion
        found = try_frame(frame, config.model_copy(update={"ground": "none"}))
        if not found.points:
            self._why = found.problem + _ASK[config.source]
            return
        self.above, self.first = len(fuse(frame, config)), found

    def _diagnose_last_pair(self) -> str:
        """Say what is wrong with a frame made from the last messages, ignoring their times."""
        pictures = {
            name: picture
            for name in ("left", "right")
            if isinstance(picture := self._last.get(name), Picture)
        }
        infos = {
            name: info
            for name in pictures
            if isinstance(info := self._last.get(INFO_ROLES[name]), CameraInfo)
        }
        if missing := pictures.keys() - infos.keys():
            return f"no CameraInfo arrived for {', '.join(sorted(missing))}"
        scan = self._last.get("points")
        try:
            frame_from_pair(
                scan if isinstance(scan, Scan) else None,
                pictures,
                infos,
                self.frames.robot,
                still=True,
            )
        except FusionSlamError as error:
            return one_line(error)
        return "its transforms came too late or do not reach back to it"
