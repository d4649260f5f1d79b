# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a detector said of each frame of a recording, and the ``VerifiedRun`` that it makes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from fusionslam.descriptors import PRESETS, with_preset
from fusionslam.evaluation import VerifiedRun
from fusionslam.evaluation.loops.verified_run import REJECTED
from fusionslam.loop_closure import Loop, Rejected
from fusionslam.pipelines.cloud_frames import body_from_clouds
from fusionslam.pipelines.describe import PipelineConfig
from fusionslam.registration import RegistrationConfig, has_lengths
from fusionslam.storage.arrays import Floats

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset

_SOFT = ("improbable", "low-overlap", "alone")


def may_be_right(candidate: Loop) -> bool:
    """Whether a candidate is a loop, or one whose pose is only not certain enough."""
    return candidate.reason is None or candidate.reason.code in _SOFT


def label_of(name: str, config: PipelineConfig) -> str:
    """Name of a descriptor, with its preset if it is not the default one: "cm2dp:author"."""
    return with_preset(name, config.descriptors).removesuffix(f":{PRESETS[0]}")


def run_values(config: PipelineConfig, used: RegistrationConfig) -> dict[str, Any]:
    """Return the values of a run, with the lengths used, and whether they are fitted to clouds."""
    fits = {"fits_lengths": not has_lengths(config.registration)}
    return config.model_dump(mode="json") | {"registration": used.model_dump(mode="json")} | fits


def bodies_of(dataset: "Dataset", frames: Sequence[int], config: PipelineConfig) -> Floats | None:
    """``body_from_clouds`` of some frames of a dataset."""
    only = dataset.only([*frames]) if len(frames) < len(dataset) else dataset
    return body_from_clouds(only, config.fusion)


@dataclass
class LoopRecord:
    """What a detector said of each frame, in the order of the frames.

    Attributes:
        frames: indices into the dataset.
        points: numbers of points of the clouds.
        nearest: the best candidate, if it may be right.
        accepted: whether it is a loop.
        candidates: all that were compared, the most promising first.
        rejected: rows of the frames, and candidates that are no loop.
        seconds: by stage.
    """

    frames: list[int] = field(default_factory=list)
    points: list[int] = field(default_factory=list)
    nearest: list[Loop | None] = field(default_factory=list)
    accepted: list[bool] = field(default_factory=list)
    candidates: list[list[int]] = field(default_factory=list)
    rejected: list[tuple[int, Rejected]] = field(default_factory=list)
    seconds: dict[str, list[float]] = field(
        default_factory=lambda: {"load": [], "describe": [], "register": []}
    )

    def take(
        self,
        index: int,
        nearest: Loop | None,
        rejected: Sequence[Rejected],
        *,
        points: int,
        seconds: Sequence[float],
    ) -> None:
        """Note what was said of the next frame.

        Args:
            index: of the frame in the dataset.
            nearest: its best candidate, accepted unless it has a reason.
            rejected: its candidates that are no loop.
            points: of its cloud.
            seconds: of the stages load, describe and register.
        """
        row = len(self.frames)
        for values, value in zip(self.seconds.values(), seconds, strict=True):
            values.append(value)
        self.frames.append(index)
        self.points.append(points)
        self.accepted.append(nearest is not None and nearest.reason is None)
        self.nearest.append(nearest if nearest is not None and may_be_right(nearest) else None)
        tried = [] if nearest is None else [nearest.match]
        tried += [each.match for each in rejected]
        self.candidates.append(list(dict.fromkeys(tried)))
        self.rejected += [(row, each) for each in rejected]

    def to_run(
        self,
        dataset: "Dataset",
        descriptors: Sequence[str],
        *,
        config: PipelineConfig,
        used: RegistrationConfig,
        body_from_cloud: Floats | None,
        skipped: Mapping[int, str],
    ) -> VerifiedRun:
        """Return the run.

        Args:
            dataset: whose frames these are.
            descriptors: those that proposed candidates.
            config: of all stages.
            used: how clouds were registered, with the lengths.
            body_from_cloud: ``bodies_of`` the frames.
            skipped: number -> reason, of the frames that were left out.
        """
        frames = np.array(self.frames, np.int64)
        best, poses = self.nearest, dataset.true_poses
        unknown = {"pose": np.full((4, 4), np.nan), "covariance": np.full((6, 6), np.nan)}

        def column(key: str, absent: Any) -> Any:
            values = [None if each is None else getattr(each, key) for each in best]
            return np.array([absent if value is None else value for value in values])

        widest = max(1, *(len(each) for each in self.candidates))
        candidates = np.full((len(frames), widest), -1, np.int64)
        for row, matches in enumerate(self.candidates):
            candidates[row, : len(matches)] = matches
        rejected = [(row, each.match, each.code, each.number) for row, each in self.rejected]
        return VerifiedRun(
            source=config.fusion.source,
            descriptors=tuple(dict.fromkeys(descriptors)),
            dataset=dataset.name,
            frames=frames,
            numbers=dataset.numbers[frames],
            stamps_ns=dataset.stamps_ns[frames],
            poses=None if poses is None else poses[frames],
            body_from_cloud=body_from_cloud,
            points=np.array(self.points, np.int64),
            match=column("match", -1).astype(np.int64),
            match_from_query=column("match_from_query", unknown["pose"]).reshape(-1, 4, 4),
            covariance=column("covariance", unknown["covariance"]).reshape(-1, 6, 6),
            overlap=column("overlap", np.nan).astype(np.float64),
            probability=column("probability", np.nan).astype(np.float64),
            distance=column("distance", np.inf).astype(np.float64),
            accepted=np.array(self.accepted, np.bool_),
            candidates=candidates,
            rejected=np.array(rejected, REJECTED),
            seconds={stage: np.array(values) for stage, values in self.seconds.items()},
            config=run_values(config, used),
            skipped=dict(skipped),
            recorded=dataset.recorded,
        )
