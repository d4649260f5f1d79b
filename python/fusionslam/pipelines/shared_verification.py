# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Prove the loops that each of several descriptors alone proposes, all by one verifier.

The pose of two clouds does not depend on the descriptor that proposes the pair: each pair is
registered once, whatever the number of descriptors. The loops of a descriptor are those of a
``LoopDetector`` without voters, whatever descriptors are proven with it.
"""

import logging
import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, reduce
from typing import TYPE_CHECKING

import numpy as np

from fusionslam._core import DescriptorIndex
from fusionslam.config import merged
from fusionslam.descriptors import find_descriptor
from fusionslam.evaluation import DescriptorRun, VerifiedRun
from fusionslam.fusion import FusionConfig, fuse, load_sensors
from fusionslam.loop_closure import LoopConfig
from fusionslam.loop_closure.observation import odometry_of, prepare_cloud, whole_scan
from fusionslam.loop_closure.sequence_gate import SequenceGate
from fusionslam.loop_closure.verification import (
    PairComparisons,
    StoredFrame,
    Verified,
    list_rejected,
    verify_candidates,
)
from fusionslam.pipelines.describe import PipelineConfig
from fusionslam.pipelines.loop_record import LoopRecord, bodies_of
from fusionslam.pipelines.recording import Recording, name_frame
from fusionslam.pipelines.results import Work, claim, delete_page, verified_path
from fusionslam.pipelines.verified_loops import load_verified_run
from fusionslam.registration import (
    PreparedCloud,
    RegistrationConfig,
    SearchImage,
    has_lengths,
)
from fusionslam.storage.arrays import Integers, Matrix
from fusionslam.storage.parallel import ordered_results
from fusionslam.storage.progress import Progress, Step, label_progress

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset

logger = logging.getLogger(__name__)

_UNPACKED = 64
"""Clouds that are kept ready; each takes some 2 MB."""


def verify_each(
    recording: Recording,
    dataset: "Dataset",
    folder: str | os.PathLike[str],
    runs: Sequence[DescriptorRun],
    *,
    config: PipelineConfig,
    jobs: int = 1,
    bad_frames: str = "error",
    command: str = "",
    step: Step | None = None,
    demo: bool = False,
) -> list[VerifiedRun]:
    """Prove the loops of each run's own candidates, or read them if they are stored.

    All are proven on the frames that every run has. They are stored in
    ``verified_path(folder, source, name)``; an interruption loses those that are being proven.
    Frames are never forgotten (``loop_closure.max_frames``). Results depend neither on ``jobs``
    nor on the other runs.

    Args:
        recording, dataset: the data, and as opened for the source of ``config``.
        folder: output folder.
        runs: descriptors of one source.
        config: of all stages; its voters propose nothing.
        jobs: number of frames worked on in parallel.
        bad_frames, command, step, demo: as for ``verify_recording``.

    Raises:
        DataError: a frame cannot be used, or the folder holds results of other data.
    """
    source = config.fusion.source
    config = merged(config, {"loop_closure": {"voters": (), "max_frames": 0}})
    values = config.model_dump(mode="json")
    claim(folder, Work(recording, dataset.name, command, {source: values}, demo=demo))
    runs = _with_same_frames(runs)
    configs = {run.name: _config_of(run, config) for run in runs}
    found: dict[str, VerifiedRun] = {}
    for run in runs:
        path = verified_path(folder, source, run.name)
        stored = load_verified_run(path, dataset, run.name, configs[run.name], bad_frames)
        if stored is not None and np.array_equal(stored.frames, run.frames):
            found[run.name] = stored
    missing = [run for run in runs if run.name not in found]
    if missing:
        delete_page(folder, "report")
        for made in _verify_together(dataset, missing, configs, config, jobs, step):
            made.save(verified_path(folder, source, made.descriptors[0]))
            found[made.descriptors[0]] = made
    poses = dataset.true_poses
    return [
        replace(found[run.name], poses=None if poses is None else poses[run.frames]) for run in runs
    ]


def _with_same_frames(runs: Sequence[DescriptorRun]) -> list[DescriptorRun]:
    """The runs of the frames that all of them have."""
    common: Integers = reduce(np.intersect1d, [run.frames for run in runs])
    skipped = {number: why for run in runs for number, why in run.skipped.items()}
    return [
        replace(run.only(np.flatnonzero(np.isin(run.frames, common))), skipped=skipped)
        for run in runs
    ]


def _config_of(run: DescriptorRun, config: PipelineConfig) -> PipelineConfig:
    """The configuration with the values of a descriptor that its run was made with."""
    described = run.config.get("descriptors", {})
    keys = find_descriptor(run.descriptor).keys
    own = {key: described[key] for key in keys if key in described}
    return merged(config, {"descriptors": own})


@dataclass(frozen=True)
class _PackedCloud:
    """The cloud of a frame, packed, with the seconds that it took to load and to prepare."""

    packed: bytes
    image: SearchImage | None
    odometry: Matrix | None
    config: RegistrationConfig
    load: float
    prepare: float


class _Clouds:
    """Clouds of all frames, by row; several threads may ask for them."""

    def __init__(
        self, frames: Sequence[_PackedCloud], stamps_ns: Integers, config: RegistrationConfig
    ) -> None:
        self.frames, self.config = frames, config
        self._stamps_ns = stamps_ns.tolist()
        self._ready = lru_cache(_UNPACKED)(self.unpack)

    def unpack(self, row: int) -> PreparedCloud:
        """Return the cloud of a frame, which nothing else holds."""
        return PreparedCloud.from_bytes(self.frames[row].packed, self.config)

    def stored(self, row: int) -> StoredFrame:
        """Return an earlier frame."""
        frame = self.frames[row]
        return StoredFrame(
            self._stamps_ns[row], frame.odometry, frame.image, lambda: self._ready(row)
        )


@dataclass
class _Proposer:
    """A descriptor, the candidates of each frame that it proposes, and what came of them."""

    run: DescriptorRun
    candidates: list[dict[int, float]]
    gate: SequenceGate
    record: LoopRecord = field(default_factory=LoopRecord)

    def take(self, row: int, found: Verified, seconds: float, clouds: _Clouds) -> None:
        """Note which candidate of a frame was proven; frames come in their order."""
        best, frame = found.best, clouds.frames[row]
        odometry = None
        if best is not None:
            match = clouds.stored(best.match)
            odometry, best = match.odometry, replace(best, match_stamp_ns=match.stamp_ns)
        best = self.gate.judge(best, frame.odometry, odometry)
        described = self.run.seconds.get("describe")
        describe = frame.prepare + (0.0 if described is None else float(described[row]))
        self.record.take(
            int(self.run.frames[row]),
            best,
            list_rejected(best, found.rejected),
            points=int(self.run.points[row]),
            seconds=(frame.load, describe, seconds),
        )


def propose(run: DescriptorRun, config: LoopConfig) -> list[dict[int, float]]:
    """Return the distances of the nearest earlier frames by row, the nearest first, of each frame.

    A descriptor of zeros, which describes nothing, proposes nothing and is proposed by none.
    """
    index = DescriptorIndex(
        run.descriptors.shape[1],
        window=config.window,
        window_seconds=config.window_seconds,
        metric=run.metric,
    )
    kept: list[int] = []
    proposed: list[dict[int, float]] = []
    for row, (vector, stamp) in enumerate(
        zip(run.descriptors, run.stamps_ns.tolist(), strict=True)
    ):
        if not vector.any():
            proposed.append({})
            continue
        rows, apart = index.query(vector, k=config.candidates, stamp_ns=stamp)
        pairs = zip(rows.tolist(), apart.tolist(), strict=True)
        proposed.append({kept[match]: distance for match, distance in pairs})
        index.add(vector, stamp_ns=stamp)
        kept.append(row)
    return proposed


def _verify_together(
    dataset: "Dataset",
    runs: Sequence[DescriptorRun],
    configs: Mapping[str, PipelineConfig],
    config: PipelineConfig,
    jobs: int,
    step: Step | None,
) -> list[VerifiedRun]:
    loops, first = config.loop_closure, runs[0]
    source = config.fusion.source
    proposers = [_Proposer(run, propose(run, loops), SequenceGate(loops)) for run in runs]
    clouds = _prepare(
        dataset,
        first.frames.tolist(),
        config,
        jobs,
        label_progress(step, f"preparing clouds, source {source}"),
    )

    def prove(row: int) -> list[tuple[Verified, float]]:
        pairs, found = PairComparisons(clouds.unpack(row), clouds.stored), []
        for each in proposers:
            before = pairs.seconds
            verified = verify_candidates(row, each.candidates[row], pairs, loops)
            found.append((verified, pairs.seconds - before))
        return found

    progress = label_progress(step, f"proving loops, source {source}")
    with ordered_results(prove, range(len(first)), jobs) as proven:
        for row, each in enumerate(proven):
            for proposer, (found, seconds) in zip(proposers, each, strict=True):
                proposer.take(row, found, seconds, clouds)
            progress(row + 1, len(first))
    bodies = bodies_of(dataset, first.frames.tolist(), config)
    return [
        each.record.to_run(
            dataset,
            (each.run.name,),
            config=configs[each.run.name],
            used=clouds.config,
            body_from_cloud=bodies,
            skipped=each.run.skipped,
        )
        for each in proposers
    ]


def _prepare(
    dataset: "Dataset",
    frames: Sequence[int],
    config: PipelineConfig,
    jobs: int,
    progress: Progress,
) -> _Clouds:
    """Prepare the clouds of some frames; the first one fixes lengths that are not given."""
    registration = config.registration

    def prepare(index: int, lengths: RegistrationConfig, *, is_first: bool) -> _PackedCloud:
        with name_frame(dataset, index):
            return _pack(dataset, index, config.fusion, lengths, is_first=is_first)

    first = prepare(frames[0], registration, is_first=True)
    progress(1, len(frames))
    packed = [first]

    def prepare_other(index: int) -> _PackedCloud:
        return prepare(index, first.config, is_first=False)

    with ordered_results(prepare_other, frames[1:], jobs) as others:
        for each in others:
            packed.append(each)
            progress(len(packed), len(frames))
    return _Clouds(packed, dataset.stamps_ns[np.array(frames)], first.config)


def _pack(
    dataset: "Dataset",
    index: int,
    fusion: FusionConfig,
    lengths: RegistrationConfig,
    *,
    is_first: bool,
) -> _PackedCloud:
    started = time.perf_counter()
    frame = dataset[index]
    load_sensors(frame, fusion)
    loaded = time.perf_counter()
    cloud = fuse(frame, fusion)
    prepared = prepare_cloud(
        whole_scan(frame, cloud, fusion, lengths),
        cloud,
        lengths,
        fits_lengths=is_first and not has_lengths(lengths),
        is_first=is_first,
    )
    image = prepared.search_image if prepared.has_search_image else None
    return _PackedCloud(
        prepared.to_bytes(),
        image,
        odometry_of(frame, fusion),
        prepared.config,
        load=loaded - started,
        prepare=time.perf_counter() - loaded,
    )
