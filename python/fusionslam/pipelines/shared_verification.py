# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Prove the loops that each of several descriptors alone proposes, all by one verifier.

The pose of two clouds does not depend on the descriptor that proposes the pair: each pair is
registered once, whatever the number of descriptors. The loops of a descriptor are those of a
``LoopDetector`` without voters, whatever descriptors are proven with it.
"""

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial, reduce
from typing import TYPE_CHECKING

import numpy as np

from fusionslam.base.arrays import Integers
from fusionslam.base.parallel import ordered_results
from fusionslam.base.progress import Progress, Step, label_progress
from fusionslam.config import merged
from fusionslam.descriptors import find_descriptor
from fusionslam.evaluation import DescriptorRun, VerifiedRun
from fusionslam.loop_closure import LoopConfig, Observation
from fusionslam.loop_closure.memory import FrameClouds, FrameMemory
from fusionslam.loop_closure.observation import FrameObserver
from fusionslam.loop_closure.verification import (
    PairComparisons,
    SequenceGate,
    StoredFrame,
    Verified,
    verify_candidates,
)
from fusionslam.pipelines.describe import PipelineConfig
from fusionslam.pipelines.recording import Recording, name_frame
from fusionslam.pipelines.results import Work, claim, delete_page, verified_path
from fusionslam.pipelines.reusable_runs import with_true_poses
from fusionslam.pipelines.verified_loops import (
    FrameRecord,
    bodies_of,
    load_verified_run,
    observe_timed,
    run_of,
)
from fusionslam.registration import PreparedCloud, RegistrationConfig, has_lengths

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset


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
    # Descriptors are those of single clouds.
    single = {"loop_closure": {"voters": (), "max_frames": 0}, "registration": {"local_map": 0.0}}
    config = merged(config, single)
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
    return [with_true_poses(found[run.name], dataset) for run in runs]


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


def propose(run: DescriptorRun, config: LoopConfig) -> list[dict[int, float]]:
    """Return the distances of the nearest earlier frames by row, the nearest first, of each frame.

    A descriptor of zeros, which describes nothing, proposes nothing and is proposed by none.
    """
    memory = FrameMemory({run.name: run.metric}, config, RegistrationConfig())
    proposed: list[dict[int, float]] = []
    for row, (vector, stamp) in enumerate(
        zip(run.descriptors, run.stamps_ns.tolist(), strict=True)
    ):
        seen = Observation({run.name: vector}, stamp)
        proposed.append(dict(memory.query(seen.vectors, config.candidates, stamp)[run.name]))
        if vector.any():
            memory.add(row, seen)
    return proposed


def _verify_together(
    dataset: "Dataset",
    runs: Sequence[DescriptorRun],
    configs: Mapping[str, PipelineConfig],
    config: PipelineConfig,
    jobs: int,
    step: Step | None,
) -> list[VerifiedRun]:
    source, frames = config.fusion.source, runs[0].frames.tolist()
    show = label_progress(step, f"preparing clouds, source {source}")
    clouds, prepared = _prepare(dataset, frames, config, jobs, show)
    progress = label_progress(step, f"proving loops, source {source}")
    records = _prove(runs, clouds, prepared, config.loop_closure, jobs, progress)
    bodies = bodies_of(dataset, frames, config)
    return [
        run_of(
            record,
            dataset,
            (run.name,),
            config=configs[run.name],
            used=clouds.registration,
            body_from_cloud=bodies,
            skipped=run.skipped,
        )
        for run, record in zip(runs, records, strict=True)
    ]


def _prove(
    runs: Sequence[DescriptorRun],
    clouds: FrameClouds,
    prepared: Sequence[tuple[float, float]],
    loops: LoopConfig,
    jobs: int,
    progress: Progress,
) -> list[list[FrameRecord]]:
    """Prove the loops of each run, those of equal pairs at once; as of ``_prepare``."""
    proposed, first = [propose(run, loops) for run in runs], runs[0]

    def stored(row: int) -> StoredFrame:
        return clouds.frame(row, int(first.stamps_ns[row]))

    def prove(row: int) -> list[tuple[Verified, float]]:
        cloud = PreparedCloud.from_bytes(clouds.kept[row].packed(), clouds.registration)
        pairs, found = PairComparisons(cloud, stored), []
        for candidates in proposed:
            before = pairs.seconds
            verified = verify_candidates(row, candidates[row], pairs, loops)
            found.append((verified, pairs.seconds - before))
        return found

    gates, records = [SequenceGate(loops) for _ in runs], [list[FrameRecord]() for _ in runs]
    with ordered_results(prove, range(len(first)), jobs) as proven:
        for row, each in enumerate(proven):
            load, prepare = prepared[row]
            for run, gate, record, (found, register) in zip(
                runs, gates, records, each, strict=True
            ):
                decided = gate.decide(found, stored(row).odometry, stored)
                described = run.seconds.get("describe")
                describe = prepare + (0.0 if described is None else float(described[row]))
                seconds = load, describe, register
                record.append(
                    FrameRecord(int(run.frames[row]), decided, int(run.points[row]), seconds)
                )
            progress(row + 1, len(first))
    return records


def _prepare(
    dataset: "Dataset",
    frames: Sequence[int],
    config: PipelineConfig,
    jobs: int,
    progress: Progress,
) -> tuple[FrameClouds, list[tuple[float, float]]]:
    """Prepare the clouds of frames, by row; the first one fixes lengths that are not given.

    Returns:
        The clouds, and the seconds that it took to load and to prepare each.
    """
    first = FrameObserver(
        {},
        config.descriptors,
        config.fusion,
        config.registration,
        verifies=True,
        fits_lengths=not has_lengths(config.registration),
    )
    with name_frame(dataset, frames[0]):
        seen, *begun = observe_timed(
            dataset, frames[0], config.fusion, partial(first.observe, is_first=True)
        )
    assert seen.cloud is not None
    observer = first.fixed_by(seen)
    clouds = FrameClouds(observer.registration)
    clouds.add(0, seen.cloud, seen.odometry)
    progress(1, len(frames))

    def prepare(row: int) -> tuple[float, float]:
        with name_frame(dataset, frames[row]):
            seen, load, prepare = observe_timed(
                dataset, frames[row], config.fusion, observer.observe
            )
        assert seen.cloud is not None
        started = time.perf_counter()
        clouds.add(row, seen.cloud, seen.odometry)
        return load, prepare + time.perf_counter() - started

    seconds = [(begun[0], begun[1])]
    with ordered_results(prepare, range(1, len(frames)), jobs) as others:
        for each in others:
            seconds.append(each)
            progress(len(seconds), len(frames))
    return clouds, seconds
