# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Compare the accuracy and cost of descriptors on one recording.

recording = Recording.at("kitti/dataset", sequence="06")
for evaluation in benchmark(recording, "out", ["m2dp", "cm2dp"]):
    print(evaluation.run.source, evaluation.run.descriptor, evaluation.curves["revisit"])
"""

import logging
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from fusionslam.base.progress import Step, label_progress
from fusionslam.config import explain_choice, merged
from fusionslam.datasets import match_poses
from fusionslam.descriptors import PRESETS, USUAL, find_descriptor
from fusionslam.errors import ConfigError, DataError
from fusionslam.evaluation import (
    DescriptorRun,
    Evaluation,
    EvaluationConfig,
    evaluate,
    evaluate_verified,
)
from fusionslam.evaluation.loops.evaluation import check_judged
from fusionslam.evaluation.loops.protocols import (
    check_bound,
    check_matches,
    find_protocol,
    judged_together,
)
from fusionslam.loop_closure.config import LoopConfig
from fusionslam.loop_closure.observation import can_verify
from fusionslam.pipelines.describe import PipelineConfig, describable, for_source
from fusionslam.pipelines.loops import find_loops
from fusionslam.pipelines.recording import Recording, warn_of_odometry
from fusionslam.pipelines.results import (
    Work,
    load_runs,
    load_verified,
    run_files,
    runs_folder,
)
from fusionslam.pipelines.reusable_runs import Run, describe_recording
from fusionslam.pipelines.shared_verification import verify_each
from fusionslam.pipelines.verified_loops import verify_recording

logger = logging.getLogger(__name__)

VERIFY = ("each", "one", "none")
"""Whose loops ``benchmark`` proves: those of each descriptor, of one with its voters, or none."""

_DEMO = yaml.safe_load(Path(__file__).with_name("demo.yaml").read_text(encoding="utf-8"))
DEMO: Mapping[str, Mapping[str, Any]] = _DEMO["settings"]
"""Settings that the demo changes, by source: dense stereo clouds are thinned to save time."""
DEMO_DESCRIPTORS: Mapping[str, Sequence[str]] = {"lidar": USUAL, "stereo": USUAL, **_DEMO["others"]}
"""The demo's sources and the descriptors computed from each."""
QUICK_TOWN: Sequence[str] = tuple(_DEMO["quick_town"])
"""Settings of the quick demo: two rounds of one block with small sensors."""
INDOOR: Mapping[str, Any] = _DEMO["indoor"]
"""Settings that the demo changes indoors: places are smaller; 40 scans are 20 s."""
INDOOR_DESCRIPTORS: Mapping[str, Sequence[str]] = {"lidar": USUAL}
"""The indoor demo's source: a robot's scan, coloured by its camera."""
DEMO_NOTE: str = _DEMO["note"]
TARGET_PRECISION = 0.95
"""Share of the loops that are right at a threshold taken from a stored run."""
_LONGEST_STEP_M = 100.0
"""Between frames that follow each other: 3 s of a fast car."""


def benchmark(
    recording: Recording,
    folder: str | os.PathLike[str],
    names: Sequence[str] | Mapping[str, Sequence[str]] = USUAL,
    *,
    configs: Mapping[str, PipelineConfig] | None = None,
    jobs: int = 1,
    bad_frames: str = "error",
    command: str = "",
    step: Step | None = None,
    demo: bool = False,
    verify: str = "one",
) -> list[Evaluation]:
    """Describe a recording, find its loops and evaluate them, for every source and descriptor.

    Where the extra ``map`` is installed the loops of every source are proven as well: by a detector
    of one of its descriptors with its voters ("one"), or those that each descriptor alone proposes,
    all by one verifier ("each", ``verify_each``). The window is the larger one, of ``loop_closure``
    and ``evaluation``: matches within the evaluation's cannot be judged.

    Runs are stored in ``folder/descriptors``; existing ones are reused. The time of a stage is
    that of one frame while ``jobs`` frames are processed in parallel.

    Args:
        recording: the data.
        folder: output folder.
        names: descriptors, or descriptors by source; those that need colours are left out where
            clouds have none.
        configs: by source; None for the defaults with every source that the data allow.
        jobs: number of frames processed in parallel.
        bad_frames: as for ``describe_dataset``.
        command: the command line to store with the results.
        step: progress callback.
        demo: whether a later demo may replace the results.
        verify: whose loops are proven: "one", "each" or "none".

    Raises:
        DataError: the data cannot be used, or the folder cannot be written or holds the results
            of other data.
        ConfigError: an unknown descriptor or value of ``verify``, or a protocol by pose where loops
            are not proven, as descriptors give no poses.
    """
    if verify not in VERIFY:
        problem = f"verify is {verify!r}, {explain_choice(verify, VERIFY)}"
        raise ConfigError(problem, code="choice", fields=("verify", verify))
    configs = configs or {source: PipelineConfig() for source in recording.sources()}
    wanted = names if isinstance(names, Mapping) else dict.fromkeys(configs, names)
    for name in (name for source in configs for name in wanted[source]):
        find_descriptor(name)
    for config in configs.values():
        verifies = can_verify(config.loop_closure, config.registration)
        has_poses = verifies and verify != "none"
        check_bound(config.evaluation.protocol, has_poses=has_poses)
    evaluations = []
    for source, config in configs.items():
        own = for_source(config, source)
        dataset = recording.open(source)
        warn_of_odometry(dataset)
        usable = describable(dataset, wanted[source], own, bad_frames)
        runs = describe_recording(
            recording,
            dataset,
            folder,
            usable,
            config=own,
            jobs=jobs,
            bad_frames=bad_frames,
            command=command,
            step=step,
            demo=demo,
        )
        evaluations += [time_and_evaluate(run, own, step) for run in runs]
        name = _proposer(usable)
        judges_pairs = find_protocol(own.evaluation.protocol).pairs is not None
        if verify == "none" or judges_pairs or not can_verify(own.loop_closure, own.registration):
            continue
        window = max(own.loop_closure.window, own.evaluation.window)
        proving = merged(own, {"loop_closure": {"window": window}})
        whole: dict[str, Any] = {
            "config": proving,
            "jobs": jobs,
            "bad_frames": bad_frames,
            "command": command,
            "step": step,
            "demo": demo,
        }
        if verify == "one":
            proven = [verify_recording(recording, dataset, folder, name, **whole)]
        else:
            proven = verify_each(recording, dataset, folder, runs, **whole)
        evaluations += [evaluate_verified(run, **_rule(own.evaluation)) for run in proven]
    _warn_of_poses(evaluations)
    return evaluations


def _proposer(names: Sequence[str]) -> str:
    """Return the descriptor of the detector that proves loops: one with colours if there is one."""
    colorful = [name for name in names if find_descriptor(name).needs_colors]
    fast = [name for name in [*colorful, *names] if "normals" not in find_descriptor(name).needs]
    return (fast or list(names))[0]


def time_and_evaluate(
    run: DescriptorRun, config: PipelineConfig, step: Step | None = None
) -> Evaluation:
    """Evaluate a run under the protocols of the configuration.

    The search for each frame's nearest candidate is timed.
    """
    progress = label_progress(step, f"matching {run.source} {run.name}")
    # Any threshold: descriptors may have none that was fitted, and time alone is taken.
    loops = merged(LoopConfig(), config.loop_closure.model_dump() | {"threshold": 1.0})
    report = find_loops(run, loops, progress)
    timed = replace(run, seconds=run.seconds | {"match": report.seconds})
    progress = label_progress(step, f"judging {run.source} {run.name}")
    progress(0, 1)
    evaluation = evaluate(timed, **_rule(config.evaluation))
    progress(1, 1)
    return evaluation


def _rule(config: EvaluationConfig) -> dict[str, Any]:
    """Return the arguments of ``evaluate``: protocols, radius and window."""
    protocols = judged_together(config.protocol)
    return {"protocols": protocols, "radius": config.radius, "window": config.window}


def evaluate_stored(
    folder: str | os.PathLike[str],
    changes: Mapping[str, Any] | None = None,
    truth: str | os.PathLike[str] | None = None,
    step: Step | None = None,
) -> tuple[list[Evaluation], EvaluationConfig]:
    """Evaluate every run in a folder of results, of descriptors and of verified loops.

    Args:
        folder: written by ``benchmark`` or ``describe_dataset``.
        changes: to the evaluation configuration stored there.
        truth: file of ground-truth poses in KITTI or TUM format, to use instead of those in the
            runs; of the same body, where protocols by pose are to hold.
        step: progress callback.

    Raises:
        DataError: no such folder, no runs in it, poses that do not fit, or verified loops that the
            window excludes.
        ConfigError: a value out of range, a protocol by pose without verified loops, or one that
            judges pairs without descriptors.
    """
    if not Path(folder).is_dir():
        raise DataError(f"{folder} is no folder: expected one with descriptor runs")
    config = merged(PipelineConfig(), {"evaluation": stored_config(folder).given()})
    config = merged(config, {"evaluation": changes or {}})
    verified = load_verified(folder)
    described = run_files(runs_folder(folder)) or not verified
    runs = load_runs(runs_folder(folder)) if described else []
    if not runs and "window" not in (changes or {}):  # loops alone are judged as they were found
        windows = (run.config.get("loop_closure", {}).get("window") for run in verified)
        own = min(window for window in (*windows, config.evaluation.window) if window is not None)
        config = merged(config, {"evaluation": {"window": own}})
    if not runs:
        check_matches(config.evaluation.protocol)
    if truth is not None:
        runs = [_with_truth(run, truth) for run in runs]
        verified = [_with_truth(run, truth) for run in verified]
    evaluations = [time_and_evaluate(run, config, step) for run in runs]
    evaluations += [evaluate_verified(run, **_rule(config.evaluation)) for run in verified]
    check_judged(evaluations, config.evaluation.protocol)
    _warn_of_poses(evaluations)
    return evaluations, config.evaluation


def _with_truth(run: Run, truth: str | os.PathLike[str]) -> Run:
    """The run with the poses of a file, without the frames that it lacks at both ends."""
    poses = match_poses(truth, run.numbers, run.stamps_ns, recorded=run.recorded)
    known = np.isfinite(poses).all(axis=(1, 2))
    return replace(run, poses=poses).only(np.flatnonzero(known))


def stored_threshold(folder: str | os.PathLike[str], source: str, name: str) -> float:
    """Return the largest threshold at which loops of a stored run were right.

    Args:
        folder: written by ``benchmark`` or ``describe_dataset``; it holds a run with true poses.
        source, name: the run's source of clouds, and its descriptor, "cm2dp" or "cm2dp:author".

    Raises:
        DataError: there is no such run, its drive has no revisits, or it has no threshold whose
            loops were right (``TARGET_PRECISION``).
    """
    name = name.removesuffix(f":{PRESETS[0]}")
    runs = load_runs(runs_folder(folder))
    stored = [run for run in runs if (run.source, run.name) == (source, name)]
    judged = [each for each in stored if each.poses is not None]
    if not judged:
        lacks = "true poses" if stored else "such a run: make one with fusionslam bench"
        raise DataError(
            f"{folder}: no threshold for {source} clouds, {name}: it lacks {lacks}",
            code="no-runs",
            fields=(str(folder), source, name),
        )
    rule = stored_config(folder)
    evaluation = evaluate(judged[0], radius=rule.radius, window=rule.window)
    _warn_of_poses([evaluation])
    curve = evaluation.curves["revisit"]
    if not curve.n_revisits:
        raise DataError(
            f"{folder}: no threshold, as its drive does not return within {rule.radius:g} m after "
            f"{rule.window} frames: bench a drive that does, or one with evaluation.radius and "
            "evaluation.window that fit it",
            code="no-revisits",
            fields=(str(folder), source, name),
        )
    threshold = curve.threshold_at(TARGET_PRECISION)
    if threshold is None:
        raise DataError(
            f"{folder}: at no threshold are {TARGET_PRECISION:.0%} of the loops of {source} "
            f"clouds, {name}, right",
            code="no-threshold",
            fields=(str(folder), source, name),
        )
    return threshold


def _warn_of_poses(evaluations: Sequence[Evaluation]) -> None:
    """Log once that poses are far apart, as in another unit, or that the radius is too large."""
    places = next((e.run.positions for e in evaluations if e.run.positions is not None), None)
    if places is not None and len(places) > 1:
        step = np.median(np.linalg.norm(np.diff(places, axis=0), axis=1))
        if step > _LONGEST_STEP_M:
            logger.warning(
                "the poses of frames that follow each other are %.0f m apart (median): expected "
                "poses in metres",
                step,
            )
    _warn_of_radius(evaluations)


def _warn_of_radius(evaluations: Sequence[Evaluation]) -> None:
    """Log once a radius so large, for the path, that every frame with candidates is a revisit.

    Where a drive's first round is within the window, each frame rightly is one: the radius is at
    fault only if a place, twice the radius wide, spans half of the path or more.
    """
    for curve, places in (
        (c, e.run.positions) for e in evaluations for c in e.query_curves.values()
    ):
        assert places is not None  # there are no curves without
        revisit, extent = curve.revisit[curve.window + 1 :], np.linalg.norm(np.ptp(places, axis=0))
        if len(revisit) and revisit.all() and 4 * curve.radius >= extent:
            logger.warning(
                "all %d frames that have candidates count as revisits: the radius is %g m and the "
                "path extends %.1f m, so that figures and thresholds tell little; choose a smaller "
                "radius (--set evaluation.radius=..., EvaluationConfig(radius=...))",
                len(revisit),
                curve.radius,
                extent,
            )
            return


def stored_config(folder: str | os.PathLike[str]) -> EvaluationConfig:
    """Return the evaluation configuration stored in a folder, else the default."""
    work = Work.load(folder)
    stored = next(iter(work.configs.values()), {}) if work else {}
    return merged(EvaluationConfig(), stored.get("evaluation", {}))
