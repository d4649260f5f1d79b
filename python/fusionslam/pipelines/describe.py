# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Fuse and describe every frame of a recording, in parallel and resumable."""

import hashlib
import json
import logging
import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from fusionslam import _core
from fusionslam.base.archive import load_archive, save_archive
from fusionslam.base.argument_types import checked
from fusionslam.base.machine import peak_memory
from fusionslam.base.parallel import ordered_results
from fusionslam.base.progress import Progress
from fusionslam.base.texts import PER_FRAME
from fusionslam.base.timer import Stopwatch
from fusionslam.config import Section, merged, option
from fusionslam.descriptors import (
    DescriptorConfig,
    describe,
    describe_or_zeros,
    find_descriptor,
    for_clouds,
    for_preset,
    for_sequence,
    in_file_names,
    needs_up,
    own_files,
    without_colors,
)
from fusionslam.descriptors.registry import POINT_DATA, Need
from fusionslam.errors import DataError, FusionSlamError
from fusionslam.evaluation import DescriptorRun, EvaluationConfig
from fusionslam.fusion import FusionConfig, fuse, load_sensors, require_up
from fusionslam.loop_closure.config import LoopConfig
from fusionslam.pipelines.frame_check import check_bad_frames, warn_left_out
from fusionslam.pipelines.recording import name_frame
from fusionslam.pipelines.results import run_path
from fusionslam.registration import RegistrationConfig
from fusionslam.sensors.frame import Frame

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset

logger = logging.getLogger(__name__)

CHUNK_FORMAT = "fusionslam.described_frames.1"

T = TypeVar("T")
Arrays = Mapping[str, NDArray[Any]]

_LONGEST = 150
"""Characters of the names of descriptors in the name of a folder."""

CHUNK = 16
"""Number of frames written together. An interruption loses at most these and those in progress."""


class PipelineConfig(Section):
    """The configuration of every stage."""

    fusion: FusionConfig = option(FusionConfig(), "frames to coloured clouds")
    descriptors: DescriptorConfig = option(DescriptorConfig(), "clouds to vectors")
    loop_closure: LoopConfig = option(LoopConfig(), "vectors to loops")
    registration: RegistrationConfig = option(RegistrationConfig(), "pairs of clouds to poses")
    evaluation: EvaluationConfig = option(EvaluationConfig(), "how loops are judged")


@checked
def describe_dataset(
    dataset: "Dataset",
    names: Sequence[str],
    folder: str | os.PathLike[str],
    *,
    config: PipelineConfig | None = None,
    jobs: int = 1,
    bad_frames: str = "error",
    progress: Progress | None = None,
) -> list[DescriptorRun]:
    """Describe every frame with every named descriptor and store one run per descriptor.

    Finished frames are kept in ``folder/.partial-*`` until all are done: an interrupted call
    resumes where it stopped. Results do not depend on ``jobs``.

    Args:
        dataset: the recording.
        names: descriptors, each with its preset if it is not that of ``config``: "cm2dp:author".
        folder: runs are written to ``run_path(folder, source, name)``.
        jobs: number of frames processed in parallel (threads; the work is done outside the GIL).
        bad_frames: "error" fails on a frame that cannot be read, fused or described; "skip"
            leaves it out and logs and stores its number and the reason with the run. Of several
            descriptors, one that cannot describe a frame that others can gets zeros there.
        progress: called with (frames done, total frames).

    Raises:
        DataError: a frame cannot be read, fused or described (the message names it), no frame
            can be, or the folder cannot be written.
        ConfigError: an unknown descriptor, preset or value of ``bad_frames``.
    """
    settings = config or PipelineConfig()
    check_bad_frames(bad_frames)
    for name in names:
        find_descriptor(name)
    settings = fit_descriptors(dataset, names, settings, bad_frames)
    work = _Work(dataset, tuple(names), settings, Path(folder), bad_frames)
    done = 0
    for chunk in work.run(max(jobs, 1)):
        done += chunk
        if progress is not None:
            progress(done, len(dataset))
    return work.finish()


def for_source(config: PipelineConfig, source: str) -> PipelineConfig:
    """Return the configuration with this source of clouds."""
    return merged(config, {"fusion": {"source": source}})


def for_descriptor(config: PipelineConfig, name: str) -> PipelineConfig:
    """Return the configuration with the preset that the descriptor's name ends with, if any."""
    return config.model_copy(update={"descriptors": for_preset(config.descriptors, name)})


def describable(
    dataset: "Dataset",
    names: Sequence[str],
    config: PipelineConfig,
    bad_frames: str = "error",
    *,
    replace: bool = False,
) -> list[str]:
    """Return the descriptors that the clouds allow; logs those that they do not.

    Args:
        dataset: opened for the source of ``config``.
        names: descriptors.
        config: of all stages.
        bad_frames: as for ``describe_dataset``.
        replace: take ``without_colors`` in place of those that need what the clouds lack.

    Raises:
        DataError: no descriptor is left.
    """

    names = _those_for_frame(dataset, names, config, bad_frames)
    if not any(find_descriptor(name).point_data for name in names):
        return list(names)

    def find_missing(index: int) -> set[Need]:
        cloud = fuse(dataset[index], config.fusion)
        return {need for need in POINT_DATA if getattr(cloud, need) is None}

    missing = first_that_works(dataset, find_missing, bad_frames)
    for need, said in POINT_DATA.items():
        if need in missing:
            names = _those_without(dataset, names, need, said, replace)
    return list(names)


def _those_without(
    dataset: "Dataset", names: Sequence[str], need: Need, said: str, replace: bool
) -> list[str]:
    """Leave out or replace the descriptors that need what the clouds lack; log or raise."""
    hungry = [name for name in names if need in find_descriptor(name).needs]
    if not hungry:
        return list(names)
    plain = list(dict.fromkeys(without_colors(name) for name in names))
    if replace and not any(need in find_descriptor(name).needs for name in plain):
        instead = ", ".join(plain), ", ".join(hungry)
        logger.warning("%s has no %s: %s instead of %s", dataset.name, said, *instead)
        return plain
    if len(hungry) == len(names):
        raise DataError(
            f"{dataset.name} has no {said}, which {', '.join(names)} need",
            code=f"no-{need}",
            fields=(",".join(names), ",".join(plain)),
        )
    logger.warning("%s has no %s: left out %s", dataset.name, said, ", ".join(hungry))
    return [name for name in names if name not in hungry]


def _those_for_frame(
    dataset: "Dataset", names: Sequence[str], config: PipelineConfig, bad_frames: str
) -> list[str]:
    """Leave out the descriptors that need z to point up where it does not, unless none is left."""
    upright = [name for name in names if needs_up(name, config.descriptors)]
    if not upright or len(upright) == len(names):
        return list(names)
    try:
        first_that_works(
            dataset, lambda index: require_up(config.fusion, dataset[index]), bad_frames
        )
    except FusionSlamError as error:
        if error.code != "not-up":
            raise
        logger.warning("left out %s: %s", ", ".join(upright), error)
        return [name for name in names if name not in upright]
    return list(names)


def fit_descriptors(
    dataset: "Dataset", names: Sequence[str], config: PipelineConfig, bad_frames: str = "error"
) -> PipelineConfig:
    """Return the configuration with what the first frame fixes, unless it is configured."""
    if not any(find_descriptor(name).fits_first for name in names):
        return config

    def fit(index: int) -> DescriptorConfig:
        return for_sequence(config.descriptors, names, fuse(dataset[index], config.fusion))

    described = first_that_works(dataset, fit, bad_frames)
    return config.model_copy(update={"descriptors": described})


def first_that_works(dataset: "Dataset", action: Callable[[int], T], bad_frames: str) -> T:
    """Return an action's result for the first frame, or for the first frame that it succeeds on.

    Raises:
        DataError: from the action, with the name of the frame.
    """
    problems: list[DataError] = []
    for index in range(len(dataset)):
        try:
            with name_frame(dataset, index, can_skip=bad_frames == "error"):
                return action(index)
        except DataError as error:
            if bad_frames == "error":
                raise
            problems.append(error)
    raise DataError(f"no frame can be described; {problems[0]}", code="no-frame") from problems[0]


@dataclass(frozen=True)
class _Described:
    """One described frame: index, vectors, number of points, seconds by stage; or why it failed."""

    index: int
    vectors: dict[str, NDArray[np.float32]] = field(default_factory=dict)
    points: int = 0
    seconds: dict[str, float] = field(default_factory=dict)
    reason: str | None = None


@dataclass(frozen=True)
class _Work:
    """One call of describe_dataset."""

    dataset: "Dataset"
    names: tuple[str, ...]
    config: PipelineConfig
    folder: Path
    bad_frames: str

    @cached_property
    def partial(self) -> Path:
        """Folder of finished chunks; its name changes with anything that changes the result."""
        identity = [
            _core.__version__,
            str(self.dataset.root),
            self.dataset.name,
            [_state(path) for path in (*self.dataset.files(), *own_files(self.names))],
            self.dataset.stamps_ns.tolist(),
            self.config.fusion.model_dump(),
            self.config.descriptors.model_dump(),
            self.bad_frames,
        ]
        key = hashlib.sha256(json.dumps(identity).encode()).hexdigest()[:12]
        return self.folder / f".partial-{self.config.fusion.source}-{self._label}-{key}"

    @property
    def _label(self) -> str:
        """The descriptors as a part of a folder's name, which has at most 255 bytes."""
        names = "+".join(map(in_file_names, self.names))
        return names if len(names) <= _LONGEST else hashlib.sha256(names.encode()).hexdigest()[:12]

    def run(self, jobs: int) -> Iterator[int]:
        """Process the missing chunks; yield the number of frames in each chunk."""
        missing = [chunk for chunk in self._chunks() if not self._is_stored(chunk)]
        frames = (index for chunk in missing for index in chunk)
        with ordered_results(self._frame, frames, jobs) as described:
            for chunk in self._chunks():
                if chunk in missing:
                    _save_chunk(self._chunk_path(chunk), list(islice(described, len(chunk))))
                yield len(chunk)

    def finish(self) -> list[DescriptorRun]:
        """Join the chunks into runs, store the runs and delete the chunks."""
        chunks = [_load_chunk(self._chunk_path(chunk)) for chunk in self._chunks()]
        keys = dict.fromkeys(key for chunk in chunks for key in chunk)
        joined = {key: np.concatenate([c[key] for c in chunks if key in c]) for key in keys}
        numbers = self.dataset.numbers[joined["bad"]].tolist()
        skipped = dict(zip(numbers, joined["reasons"].tolist(), strict=True))
        warn_left_out(self.dataset, skipped)
        runs = {name: self._descriptor_run(name, joined, skipped) for name in self.names}
        for name, run in runs.items():
            run.save(run_path(self.folder, run.source, name))
        self._delete_chunks()
        return list(runs.values())

    def _chunks(self) -> list[range]:
        count = len(self.dataset)
        return [range(start, min(start + CHUNK, count)) for start in range(0, count, CHUNK)]

    def _chunk_path(self, chunk: range) -> Path:
        return self.partial / f"{chunk.start:06d}.npz"

    def _is_stored(self, chunk: range) -> bool:
        """Whether the frames of a chunk are in its file; those of a damaged file are not."""
        path = self._chunk_path(chunk)
        if not path.exists():
            return False
        try:
            arrays = _load_chunk(path)
            frames = [*arrays["rows"].tolist(), *arrays["bad"].tolist()]
        except (DataError, KeyError) as error:
            logger.warning("%s is damaged, its frames are described again: %s", path, error)
            return False
        return sorted(frames) == list(chunk)

    def _delete_chunks(self) -> None:
        """Delete the chunks of these descriptors or some of them, whatever the settings."""
        prefix = f".partial-{self.config.fusion.source}-"
        names = {in_file_names(name) for name in self.names}
        for path in self.folder.glob(f"{prefix}*-*"):
            label = path.name.removeprefix(prefix).rpartition("-")[0]
            if label == self._label or set(label.split("+")) <= names:
                shutil.rmtree(path, ignore_errors=True)

    def _frame(self, index: int) -> "_Described":
        try:
            return self._describe(index)
        except DataError as error:
            if self.bad_frames == "skip":
                return _Described(index, reason=str(error))
            with name_frame(self.dataset, index, can_skip=True):
                raise

    def _describe(self, index: int) -> "_Described":
        watch, vectors = Stopwatch(), {}
        with watch.measure("load"):
            frame = self.dataset[index]
            load_sensors(frame, self.config.fusion)
        with watch.measure("fuse"):
            cloud = fuse(frame, self.config.fusion)
        problems: dict[str, DataError] = {}
        for name in self.names:
            config = self._config_of(name, frame)
            with watch.measure(name):
                vectors[name], found = describe_or_zeros(cloud, name, config)
            if found is not None:
                if self.bad_frames == "error":
                    raise found
                problems[name] = found
        if len(problems) == len(self.names):
            raise problems[self.names[0]]
        for name, problem in problems.items():
            logger.warning(
                "%s, frame %d: %s",
                self.dataset.name,
                self.dataset.numbers[index],
                problem,
                extra={PER_FRAME: f"{name} cannot describe it and has zeros"},
            )
        seconds = {part: watch.total(part) for part in ("load", "fuse", *self.names)}
        return _Described(index, vectors, len(cloud), seconds)

    def _descriptor_run(self, name: str, joined: Arrays, skipped: dict[int, str]) -> DescriptorRun:
        rows, poses = joined["rows"], self.dataset.true_poses
        points, described = joined["points"], joined[f"vectors.{name}"].any(axis=1)
        memory = 0  # that describing the largest cloud takes beyond what was in use before
        if described.any():
            frame = self.dataset[int(rows[np.where(described, points, -1).argmax()])]
            cloud, config = fuse(frame, self.config.fusion), self._config_of(name, frame)
            memory = peak_memory(lambda: describe(cloud, name, config))
        return DescriptorRun(
            source=self.config.fusion.source,
            descriptor=find_descriptor(name).name,
            dataset=self.dataset.name,
            descriptors=joined[f"vectors.{name}"],
            frames=rows,
            stamps_ns=self.dataset.stamps_ns[rows],
            poses=None if poses is None else poses[rows],
            seconds={
                "load": joined["seconds.load"],
                "fuse": joined["seconds.fuse"],
                "describe": joined[f"seconds.{name}"],
            },
            peak_memory_bytes=memory,
            points=points,
            config=for_descriptor(self.config, name).model_dump(mode="json"),
            numbers=self.dataset.numbers[rows],
            skipped=skipped,
            recorded=self.dataset.recorded,
        )

    def _config_of(self, name: str, frame: Frame) -> DescriptorConfig:
        return for_clouds(self.config.descriptors, name, self.config.fusion, frame)


def _save_chunk(path: Path, frames: Sequence[_Described]) -> None:
    """Write some frames atomically. Raises DataError."""
    good, bad = [f for f in frames if f.reason is None], [f for f in frames if f.reason is not None]
    arrays: dict[str, NDArray[Any]] = {
        "rows": np.array([f.index for f in good], np.int64),
        "points": np.array([f.points for f in good], np.int64),
        "bad": np.array([f.index for f in bad], np.int64),
        "reasons": np.array([f.reason for f in bad], np.str_),
    }
    for first in good[:1]:
        for name in first.vectors:
            arrays[f"vectors.{name}"] = np.array([f.vectors[name] for f in good], np.float32)
        for stage in first.seconds:
            arrays[f"seconds.{stage}"] = np.array([f.seconds[stage] for f in good])
    save_archive(path, CHUNK_FORMAT, {}, arrays)


def _load_chunk(path: Path) -> dict[str, NDArray[Any]]:
    """Read what ``_save_chunk`` wrote. Raises DataError."""
    with load_archive(path, CHUNK_FORMAT, "described frames; delete it and run again") as (
        _,
        arrays,
    ):
        return arrays


def _state(path: Path) -> list[Any]:
    """Fingerprint of a file, to detect changes; a missing file is reported when it is read."""
    with suppress(OSError):
        status = path.stat()
        return [str(path), status.st_size, status.st_mtime_ns]
    return [str(path)]
