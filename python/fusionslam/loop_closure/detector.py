# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Online loop detection: one ``add`` per frame says whether the place was seen before."""

import os
import uuid
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam import help_texts
from fusionslam._core import DescriptorIndex
from fusionslam.config import Section, merged, option
from fusionslam.descriptors import (
    DescriptorConfig,
    describe,
    find_descriptor,
    for_sequence,
    length_of,
)
from fusionslam.errors import DataError, ShapeError
from fusionslam.fusion import FusionConfig, fuse
from fusionslam.sensors.frame import Cloud, Frame
from fusionslam.storage.archive import load_json, save_json
from fusionslam.storage.files import atomic_path

FORMAT = "fusionslam.loop_detector.2"
ABOUT = "detector.json"


class LoopConfig(Section):
    """Conditions under which a nearest neighbour is a loop."""

    threshold: float = option(0.1, help_texts.THRESHOLD, ge=0, allow_inf_nan=False)
    window: int = option(50, help_texts.LOOP_WINDOW, unit="frames", ge=0)
    window_seconds: float = option(
        0.0, "candidates are older than this; 0 is off", unit="s", ge=0, allow_inf_nan=False
    )


@dataclass(frozen=True)
class Loop:
    """A loop: both frame numbers, in the order of adding, and their descriptor distance."""

    query: int
    match: int
    distance: float


class LoopDetector:
    """Describes each frame, compares it with all older ones outside the window, and stores it.

    Args:
        descriptor: "m2dp", "cm2dp", "shot" or "cshot".
        threshold, window, window_seconds: override the values of ``LoopConfig``.
        config: when a neighbour is a loop.
        describe: how clouds are described.
        fusion: how frames are fused into clouds.
        length: length of descriptors computed elsewhere; None for that of ``descriptor``.

    Raises:
        ConfigError: unknown descriptor, or a value out of range.
    """

    def __init__(
        self,
        descriptor: str = "cm2dp",
        *,
        threshold: float | None = None,
        window: int | None = None,
        window_seconds: float | None = None,
        config: LoopConfig | None = None,
        describe: DescriptorConfig | None = None,
        fusion: FusionConfig | None = None,
        length: int | None = None,
    ) -> None:
        given = {"threshold": threshold, "window": window, "window_seconds": window_seconds}
        changes = {key: value for key, value in given.items() if value is not None}
        self.descriptor = find_descriptor(descriptor).name
        self.config = merged(config or LoopConfig(), changes, "loop_closure.")
        self.describe_config = describe or DescriptorConfig()
        self.fusion_config = fusion or FusionConfig()
        self.nearest: Loop | None = None
        self._index: DescriptorIndex | None = None
        self._length = length

    def __len__(self) -> int:
        """Number of frames added so far."""
        return 0 if self._index is None else len(self._index)

    def add(self, frame_or_cloud: Frame | Cloud, *, stamp_ns: int | None = None) -> Loop | None:
        """Find the loop that this frame closes, if any, and store the frame.

        ``nearest`` holds the nearest candidate afterwards, whether accepted or not.

        Raises:
            DataError: a cloud that cannot be described; nothing is stored.
            ShapeError: neither a frame nor a cloud.
        """
        if isinstance(frame_or_cloud, Frame):
            stamp_ns = frame_or_cloud.stamp_ns if stamp_ns is None else stamp_ns
            cloud = self._fuse_frame(frame_or_cloud)
        elif isinstance(frame_or_cloud, Cloud):
            cloud = frame_or_cloud
        else:
            raise ShapeError(f"expected a Frame or a Cloud, got {type(frame_or_cloud).__name__}")
        config = self.describe_config
        if find_descriptor(self.descriptor).needs_normals and len(self) == 0:
            config = for_sequence(config, cloud)
        vector = describe(cloud, self.descriptor, config)
        loop = self.add_descriptor(vector, stamp_ns=stamp_ns)
        self.describe_config = config  # only now: a failed cloud must not fix the radius
        return loop

    def add_descriptor(
        self, descriptor: NDArray[np.float32], *, stamp_ns: int | None = None
    ) -> Loop | None:
        """``add`` for a descriptor, float32 (D,), computed elsewhere.

        Raises:
            ShapeError: another length than the descriptor's.
        """
        index = self._index
        if index is None:
            self._check_length(descriptor)
            index = DescriptorIndex(
                len(descriptor),
                window=self.config.window,
                window_seconds=self.config.window_seconds,
            )
        indices, distances = index.query(descriptor, stamp_ns=stamp_ns)
        number = index.add(descriptor, stamp_ns=stamp_ns)
        self._index = index  # only now: a failed first descriptor must not fix the length
        self.nearest = Loop(number, int(indices[0]), float(distances[0])) if len(indices) else None
        accepted = self.nearest and self.nearest.distance <= self.config.threshold
        return self.nearest if accepted else None

    def _fuse_frame(self, frame: Frame) -> Cloud:
        """Fuse a frame into a cloud; errors name the source used and how to select another."""
        try:
            return fuse(frame, self.fusion_config)
        except DataError as error:
            other = "stereo" if {"left", "right"} <= set(frame.images) else "cloud"
            wanted = self.fusion_config.source
            if wanted != "lidar" or (frame.has_points and "left" in frame.images):
                raise
            raise DataError(
                f"{error}: the detector's source is {wanted!r}; for this frame use "
                f"LoopDetector(..., fusion=FusionConfig(source={other!r}))"
            ) from error

    def _check_length(self, descriptor: Any) -> None:
        """Raise ShapeError for a wrong length; the index would accept any length first."""
        length = self._length or length_of(self.descriptor, self.describe_config)
        shape = np.shape(descriptor)
        if shape != (length,):
            found = "None" if descriptor is None else f"shape {shape}"
            raise ShapeError(
                f"descriptor: {found}, expected float32 ({length},) of {self.descriptor}"
            )

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Save the configuration and all descriptors to a folder atomically.

        The configuration file names its file of descriptors and is written last, so that the
        folder always holds a matching pair.

        Raises:
            DataError: nothing was added yet, or the folder cannot be written.
        """
        if self._index is None:
            raise DataError("the loop detector is empty: there is nothing to save", code="empty")
        target = Path(folder)
        descriptors = f"descriptors-{uuid.uuid4().hex[:12]}.index"
        about = {
            "descriptor": self.descriptor,
            "frames": len(self),
            "index": descriptors,
            "loop_closure": self.config.model_dump(),
            "descriptors": self.describe_config.model_dump(),
            "fusion": self.fusion_config.model_dump(),
        }
        with atomic_path(target / descriptors) as temporary:
            self._index.save(temporary)
        save_json(target / ABOUT, FORMAT, about, indent=1)
        for old in target.glob("descriptors-*.index"):
            if old.name != descriptors:
                old.unlink(missing_ok=True)

    @classmethod
    def load(cls, folder: str | os.PathLike[str]) -> "LoopDetector":
        """Resume from what ``save`` wrote. Raises DataError naming the file."""
        source = Path(folder)
        with load_json(source / ABOUT, FORMAT, "a stored loop detector") as about:
            detector = cls(
                about["descriptor"],
                config=merged(LoopConfig(), about["loop_closure"]),
                describe=merged(DescriptorConfig(), about["descriptors"]),
                fusion=merged(FusionConfig(), about["fusion"]),
            )
        detector._index = DescriptorIndex.load(source / Path(str(about.get("index"))).name)
        if len(detector) != about.get("frames"):
            raise DataError(
                f"{source}: {len(detector)} descriptors, detector.json says {about.get('frames')}"
            )
        return detector
