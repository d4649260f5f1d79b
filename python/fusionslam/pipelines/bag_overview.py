# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Summarise a bag for people: topics, rates, clocks, sensor placement, what is missing."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fusionslam.datasets.bags.calibration import CALIBRATED
from fusionslam.datasets.bags.indexed_bag import IndexedBag, Series
from fusionslam.datasets.bags.pairing import open_indexed_bag
from fusionslam.datasets.bags.reader import Topic
from fusionslam.datasets.bags.topics import ROLES, further_cameras, further_scanners
from fusionslam.errors import DataError, one_line
from fusionslam.pipelines.frame_check import FirstCloud, first_cloud

if TYPE_CHECKING:
    from fusionslam.datasets.base import Dataset

# A step longer than this many median steps is a gap.
_GAP = 1.5
# A message that arrives within this time of its stamp is not late.
_PROMPT_MS = 0.05
_NEEDED = {"points": "PointCloud2", "left": "Image", "camera_info": "CameraInfo"}


@dataclass(frozen=True, eq=False)
class Inspection:
    """A bag whose topics are all indexed."""

    source: IndexedBag

    @classmethod
    def of(
        cls,
        path: Path,
        topics: Mapping[str, str],
        stamps: str,
        calibration: Path | None = None,
    ) -> "Inspection":
        """Pass through a bag. Raises DataError and ConfigError as ``open_indexed_bag``."""
        return cls(open_indexed_bag(path, topics, stamps, calibration=calibration, everything=True))

    def rows(self) -> Iterator[tuple[str, str]]:
        """Yield (label, value) pairs about the bag itself."""
        bag = self.source.bag
        yield "name", bag.path.name
        yield "kind", bag.kind + (", without its end: it was cut or not closed" * bag.is_cut)
        yield "folder", str(bag.path.parent)
        lasts = (bag.stop_ns - bag.start_ns) / 1e9
        yield "arrived", f"{lasts:.1f} s from {bag.start_ns / 1e9:.3f} s on"
        for topic in bag.topics.values():
            yield f"topic {topic.name}", self._topic(topic)
        roles = self.source.roles
        in_use = [role for role in ROLES if role in roles]
        in_use += [*further_cameras(roles), *further_scanners(roles)]
        yield "in use", ", ".join(f"{role} {roles[role]}" for role in in_use) or "-"
        yield "extrinsics", self._extrinsics()
        for count, first in self.source.refused.values():
            yield "refused", f"{_count_noun(count, 'message')}: {first}"

    def fusion(self, dataset: "Dataset | None") -> FirstCloud:
        """Tell whether the bag can be fused; if not, list everything known to be missing."""
        if (
            dataset is not None
            and dataset.sensors == ("points",)
            and "left" not in self.source.roles
        ):
            return first_cloud(dataset)
        missing = [
            f"no {kind}" + (" of the camera" * (role == "camera_info"))
            for role, kind in _NEEDED.items()
            if role not in self.source.roles
        ]
        if "points" in self.source.roles and "left" in self.source.roles:
            missing += self._missing_link()
        has_pairs = dataset is not None and dataset.has_stereo and not dataset.has_points
        if dataset is None or (missing and not has_pairs):
            left = (
                "" if dataset is None else f"; commands use {' and '.join(dataset.sensors)} alone"
            )
            return FirstCloud("not possible", problem=f"{'; '.join(missing) or 'no frames'}{left}")
        return first_cloud(dataset)

    def cameras(self) -> str:
        """Describe a camera whose pose relative to the scan is unknown."""
        roles = self.source.roles
        images = f"images in {roles['left']}" if "left" in roles else "no images"
        calibration = f"calibration in {roles['camera_info']}" if "camera_info" in roles else ""
        scans = "" if "points" in roles else ", no scans to place the camera against"
        return f"{images}, {calibration or 'no calibration'}{scans}"

    def _topic(self, topic: Topic) -> str:
        about = f"{topic.type}, {_count_noun(topic.count, 'message')}"
        if not topic.is_known:
            return f"{about}, of a type that is not read"
        series = self.source.indexed.get(topic.name)
        rate = rate_words(series) if series else ""
        return f"{about}, {rate}" if rate else about

    def _extrinsics(self) -> str:
        if not {"points", "left"} <= self.source.roles.keys():
            return "no camera and scanner to link"
        camera, scanner = self._ends()
        origin = "the calibration" if camera == CALIBRATED else "TF"
        try:
            chain = self.source.frames.tree.chain(camera, scanner)
            return f"{' <- '.join(chain)}, from {origin}"
        except DataError as error:
            return f"camera in '{camera}', scanner in '{scanner}': {one_line(error)}"

    def _missing_link(self) -> list[str]:
        camera, scanner = self._ends()
        try:
            self.source.frames.tree.chain(camera, scanner)
        except DataError as error:
            return [f"TF does not link '{camera}' and '{scanner}': {one_line(error)}"]
        return []

    def _ends(self) -> tuple[str, str]:
        return self.source.optical_frame(), self.source.series("points").frame_id


def rate_words(series: Series) -> str:
    """Describe the rate and anomalies: gaps between stamps, messages that arrive late."""
    parts = [step_words(series.stamps_ns)] if len(series.times) > 1 else []
    delays = series.delays_ns / 1e6
    if np.abs(delays).max() >= _PROMPT_MS:
        parts.append(
            f"arrives {np.median(delays):+.1f} ms after its stamp "
            f"({delays.min():+.1f} to {delays.max():+.1f})"
        )
    return ", ".join(parts)


def step_words(stamps_ns: NDArray[np.int64]) -> str:
    """Describe the rate of at least two stamps, gaps between them and steps back in time."""
    steps = np.diff(stamps_ns) / 1e9
    median = float(np.median(steps))
    if median <= 0:
        return "stamps that do not rise"
    gaps, back = int((steps > _GAP * median).sum()), int((steps < 0).sum())
    unusual = []
    if gaps:
        longest = f"longest step {steps.max():.3f} s, {steps.max() / median:.1f} x the median"
        unusual.append(f"{longest}; {_count_noun(gaps, 'gap')}")
    if back:
        unusual.append(_count_noun(back, "step") + " back")
    return f"{1 / median:.2f} Hz" + (f" ({', '.join(unusual)})" if unusual else "")


def _count_noun(count: int, thing: str) -> str:
    return f"{count} {thing}" + "s" * (count != 1)
