# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Find and prove the loops of a whole recording as a robot would: frame after frame."""

import logging
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from fusionslam.base.arrays import Floats
from fusionslam.base.csv_files import write_csv
from fusionslam.base.parallel import ordered_results
from fusionslam.base.progress import Progress, Step, label_progress
from fusionslam.base.texts import counted, listed
from fusionslam.config import flatten
from fusionslam.datasets import graph_files
from fusionslam.datasets.graph_files import edge_of_pose
from fusionslam.descriptors import PRESETS, with_preset
from fusionslam.errors import DataError
from fusionslam.evaluation import VerifiedRun
from fusionslam.evaluation.loops.verified_run import REJECTED
from fusionslam.fusion import FusionConfig, load_sensors
from fusionslam.loop_closure import LoopDetector, Observation
from fusionslam.loop_closure.loop import may_be_right
from fusionslam.loop_closure.verification import Verified
from fusionslam.pipelines.describe import PipelineConfig, fit_descriptors, for_descriptor
from fusionslam.pipelines.frame_check import warn_left_out
from fusionslam.pipelines.loops import explain_nothing, explain_shortness
from fusionslam.pipelines.recording import Recording, body_from_clouds, name_frame
from fusionslam.pipelines.results import Work, claim, delete_page, verified_path
from fusionslam.pipelines.reusable_runs import (
    differences,
    has_all_frames,
    is_outdated,
    with_true_poses,
)
from fusionslam.registration import RegistrationConfig, has_lengths, without_lengths
from fusionslam.sensors.frame import Frame

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset

logger = logging.getLogger(__name__)

POSE_COLUMNS = ("overlap", "probability", "x", "y", "z", "qx", "qy", "qz", "qw")
_COLUMNS = ("query", "match", "distance", "query_stamp_ns", "match_stamp_ns", *POSE_COLUMNS)
_STAGES = ("fusion", "descriptors", "loop_closure", "registration", "fits_lengths")


def new_detector(config: PipelineConfig, name: str) -> LoopDetector:
    """Make the loop detector of a configuration for a descriptor, "cm2dp" or "cm2dp:author"."""
    return LoopDetector(
        name,
        config=config.loop_closure,
        describe=config.descriptors,
        fusion=config.fusion,
        registration=config.registration,
    )


def verify_recording(
    recording: Recording,
    dataset: "Dataset",
    folder: str | os.PathLike[str],
    name: str,
    *,
    config: PipelineConfig,
    jobs: int = 1,
    bad_frames: str = "error",
    command: str = "",
    step: Step | None = None,
    demo: bool = False,
) -> VerifiedRun:
    """Find and prove the loops of a recording, or read them if they are stored.

    They are stored in ``verified_path(folder, source, name)``. Results do not depend on ``jobs``.

    Args:
        recording, dataset: the data, and as opened for the source of ``config``.
        folder: output folder.
        name: the detector's descriptor, "cm2dp" or "cm2dp:author".
        config: of all stages; loops must not be unverified.
        jobs: number of frames described in parallel, while one is verified; local maps are
            described one after the other.
        bad_frames: "skip" leaves out frames that cannot be used; as for ``describe_dataset``.
        command: the command line to store with the results.
        step: progress callback.
        demo: whether a later demo may replace the results.

    Raises:
        DataError: a frame cannot be used, or the folder holds results of other data.
        FusionSlamError: the extra ``map`` is not installed (code "missing-extra").
    """
    source = config.fusion.source
    values = config.model_dump(mode="json")
    claim(folder, Work(recording, dataset.name, command, {source: values}, demo=demo))
    config = for_descriptor(fit_descriptors(dataset, [name], config, bad_frames), name)
    path = verified_path(folder, source, label_of(name, config))
    stored = load_verified_run(path, dataset, name, config, bad_frames)
    if stored is None:
        delete_page(folder, "report")
        progress = label_progress(step, f"proving loops, source {source}")
        stored = _verify(dataset, name, config, jobs, bad_frames, progress)
        stored.save(path)
    return with_true_poses(stored, dataset)


def load_verified_run(
    path: Path, dataset: "Dataset", name: str, config: PipelineConfig, bad_frames: str
) -> VerifiedRun | None:
    """Return the stored run if it is what would be made again; the log says why it is not."""
    if not path.exists():
        return None
    try:
        run = VerifiedRun.load(path)
    except DataError as error:
        logger.warning("%s; proving loops again", error)
        return None
    then, now = run.config, run_values(config, config.registration)
    if then.get("fits_lengths") and now["fits_lengths"]:  # to the same recording
        now["registration"] = without_lengths(config.registration)
        kept = {k: v for k, v in then["registration"].items() if k in now["registration"]}
        then = then | {"registration": kept}
    before, wanted = (flatten({k: v[k] for k in _STAGES if k in v}) for v in (then, now))
    changes = [*differences(before, wanted)]
    if (
        run.dataset == dataset.name
        and run.descriptors[0] == label_of(name, config)
        and not changes
        and has_all_frames(run, dataset)
        and (bad_frames == "skip" or not run.skipped)
        and not is_outdated(path, dataset, name)
    ):
        return run
    changes = changes or ["the recording or the program is newer, or frames differ"]
    logger.warning("%s is replaced by a new run: %s", path, "; ".join(changes))
    return None


def observe_timed(
    dataset: "Dataset", index: int, fusion: FusionConfig, observe: Callable[[Frame], Observation]
) -> tuple[Observation, float, float]:
    """Load a frame and observe it; return the seconds that both took, too."""
    started = time.perf_counter()
    frame = dataset[index]
    load_sensors(frame, fusion)
    loaded = time.perf_counter()
    seen = observe(frame)
    return seen, loaded - started, time.perf_counter() - loaded


_Seen = tuple[Observation, float, float]
"""What is seen of a frame, and the seconds that it took to load and to observe it."""


def _observe_all(
    dataset: "Dataset", detector: LoopDetector, config: PipelineConfig, jobs: int, bad_frames: str
) -> Iterator[tuple[int, _Seen | DataError]]:
    """Yield what is seen of each frame, by its row, or why it cannot be used.

    The first frame that can be used fixes what all others are described with, once it is added.
    """

    def observe(index: int) -> _Seen | DataError:
        try:
            return observe_timed(dataset, index, config.fusion, detector.observe)
        except DataError as error:
            if bad_frames == "skip":
                return error
            with name_frame(dataset, index, can_skip=True):
                raise

    pending = iter(range(len(dataset)))
    looks_back = False
    for index in pending:
        seen = observe(index)
        yield index, seen
        if len(detector) and not isinstance(seen, DataError):
            first, *_ = seen
            looks_back = first.level is not None and first.odometry is not None
            break
    # Each is joined with those that were added, or levelled by the ground that they showed.
    if looks_back or detector.registration_config.local_map:
        yield from ((index, observe(index)) for index in pending)
        return
    rest = list(pending)
    with ordered_results(observe, rest, jobs) as observed:
        yield from zip(rest, observed, strict=True)


def _verify(
    dataset: "Dataset",
    name: str,
    config: PipelineConfig,
    jobs: int,
    bad_frames: str,
    progress: Progress,
) -> VerifiedRun:
    detector = new_detector(config, name)
    records: list[FrameRecord] = []
    skipped: dict[int, str] = {}
    for row, seen in _observe_all(dataset, detector, config, jobs, bad_frames):
        if isinstance(seen, DataError):
            skipped[int(dataset.numbers[row])] = str(seen)
        else:
            observation, load, describe = seen
            started = time.perf_counter()
            detector.add_observation(observation)
            seconds = load, describe, time.perf_counter() - started
            found = Verified(detector.nearest, detector.rejected)
            records.append(FrameRecord(row, found, observation.points, seconds))
        progress(row + 1, len(dataset))
    warn_left_out(dataset, skipped)
    return run_of(
        records,
        dataset,
        (label_of(name, config), *detector.voters),
        config=config,
        used=detector.registration_config,
        body_from_cloud=bodies_of(dataset, [each.row for each in records], config),
        skipped=skipped,
    )


class FrameRecord(NamedTuple):
    """What was found for a frame.

    Attributes:
        row: of the frame in the dataset.
        found: its best candidate, accepted unless it has a reason, and all that are no loop.
        points: number of points of the cloud.
        seconds: of the stages load, describe and register.
    """

    row: int
    found: Verified
    points: int
    seconds: tuple[float, float, float]


def run_of(
    records: Sequence[FrameRecord],
    dataset: "Dataset",
    descriptors: Sequence[str],
    *,
    config: PipelineConfig,
    used: RegistrationConfig,
    body_from_cloud: Floats | None,
    skipped: Mapping[int, str],
) -> VerifiedRun:
    """Return the run that frames' records make.

    Args:
        records: in the order of the frames.
        dataset: whose frames these are.
        descriptors: those that proposed candidates.
        config: of all stages.
        used: how clouds were registered, with the lengths.
        body_from_cloud: ``bodies_of`` the frames.
        skipped: number -> reason, of the frames that were left out.
    """
    frames = np.array([each.row for each in records], np.int64)
    found = [each.found.best for each in records]
    best = [each if each is not None and may_be_right(each) else None for each in found]
    poses = dataset.true_poses
    unknown = {"pose": np.full((4, 4), np.nan), "covariance": np.full((6, 6), np.nan)}

    def column(key: str, absent: Any) -> Any:
        values = [None if each is None else getattr(each, key) for each in best]
        return np.array([absent if value is None else value for value in values])

    tried = [
        list(dict.fromkeys(each.match for each in (one.best, *one.rejected) if each is not None))
        for one in (each.found for each in records)
    ]
    candidates = np.full((len(frames), max(1, *map(len, tried))), -1, np.int64)
    for row, matches in enumerate(tried):
        candidates[row, : len(matches)] = matches
    rejected = [
        (row, each.match, each.code, each.number)
        for row, record in enumerate(records)
        for each in record.found.rejected
    ]
    seconds = zip(*(each.seconds for each in records), strict=True)
    return VerifiedRun(
        source=config.fusion.source,
        descriptors=tuple(dict.fromkeys(descriptors)),
        dataset=dataset.name,
        frames=frames,
        numbers=dataset.numbers[frames],
        stamps_ns=dataset.stamps_ns[frames],
        poses=None if poses is None else poses[frames],
        body_from_cloud=body_from_cloud,
        points=np.array([each.points for each in records], np.int64),
        match=column("match", -1).astype(np.int64),
        match_from_query=column("match_from_query", unknown["pose"]).reshape(-1, 4, 4),
        covariance=column("covariance", unknown["covariance"]).reshape(-1, 6, 6),
        overlap=column("overlap", np.nan).astype(np.float64),
        probability=column("probability", np.nan).astype(np.float64),
        distance=column("distance", np.inf).astype(np.float64),
        accepted=np.array([each is not None and each.reason is None for each in found], np.bool_),
        candidates=candidates,
        rejected=np.array(rejected, REJECTED),
        seconds=dict(zip(("load", "describe", "register"), map(np.array, seconds), strict=True)),
        config=run_values(config, used),
        skipped=dict(skipped),
        recorded=dataset.recorded,
    )


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


def describe_loops(run: VerifiedRun) -> str:
    """Say how many loops were proven, and why the other frames have none."""
    loops, queries = int(run.accepted.sum()), counted(len(run), "frame")
    without = int((run.candidates < 0).all(axis=1).sum())
    refused = len(run) - without - loops
    text = f"{counted(loops, 'loop')} proven in {queries}: {without} without candidates"
    text += f", {refused} refused"
    if refused:
        first = np.unique(run.rejected["query"], return_index=True)[1]
        rows = run.rejected[first]
        codes = rows["code"][~run.accepted[rows["query"]]]
        names, counts = np.unique(codes, return_counts=True)
        order = np.argsort(-counts, kind="stable")
        text += f" ({listed([f'{counts[k]} {names[k]}' for k in order])})"
    window = run.config["loop_closure"]["window"]
    if refused and not loops:
        return text + explain_nothing(window, run.descriptor)
    return text + explain_shortness(len(run), len(run) - without, window)


def write_loops(run: VerifiedRun, path: str | os.PathLike[str]) -> None:
    """Write a CSV with one line per proven loop: numbers of the frames, and the pose.

    The pose is match_from_query: metres, and a quaternion. Raises DataError.
    """

    def rows() -> Iterator[list[object]]:
        for row in np.flatnonzero(run.accepted):
            pair = [row, run.match[row]]
            pose = run.match_from_query[row]
            turn = Rotation.from_matrix(pose[:3, :3]).as_quat()
            values = [run.overlap[row], run.probability[row], *pose[:3, 3], *turn]
            texts = [f"{value:.9g}" for value in (run.distance[row], *values)]
            yield [*run.numbers[pair], texts[0], *run.stamps_ns[pair], *texts[1:]]

    write_csv(Path(path), _COLUMNS, rows())


def write_g2o(run: VerifiedRun, path: str | os.PathLike[str]) -> None:
    """Write the proven loops for pose graph optimisers: EDGE_SE3:QUAT between frame numbers.

    An edge leads from the match to the query; its measurement is the query's pose in the match's
    frame, metres and a quaternion, and its information the inverse of the covariance, of x, y, z
    and the vector of the quaternion (half of the angle). Vertices are for odometry to give. Raises
    DataError.
    """
    graph_files.write_g2o(
        path,
        [],
        [
            edge_of_pose(
                int(run.numbers[run.match[row]]),
                int(run.numbers[row]),
                run.match_from_query[row],
                run.covariance[row],
            )
            for row in np.flatnonzero(run.accepted)
        ],
    )
