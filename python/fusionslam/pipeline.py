# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""From a recording to descriptors: fuse and describe every frame, in parallel and resumable."""

import hashlib
import json
import os
import shutil
import time
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fusionslam import _core
from fusionslam._files import atomic_path
from fusionslam.config import Section, option
from fusionslam.descriptors import (
    DescriptorConfig,
    describe,
    descriptor_named,
    for_sequence,
)
from fusionslam.errors import DataError
from fusionslam.evaluation import DescriptorRun, EvaluationConfig
from fusionslam.fusion import FusionConfig, fuse
from fusionslam.loop_closure import LoopConfig

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset

Progress = Callable[[int, int], None]

CHUNK = 16
"""Frames that are written together; what an interruption can lose."""


class PipelineConfig(Section):
    """The configuration of every stage."""

    fusion: FusionConfig = option(FusionConfig(), "frames to coloured clouds")
    descriptors: DescriptorConfig = option(DescriptorConfig(), "clouds to vectors")
    loop_closure: LoopConfig = option(LoopConfig(), "vectors to loops")
    evaluation: EvaluationConfig = option(EvaluationConfig(), "how loops are judged")


@dataclass(frozen=True)
class _Described:
    """One frame: its vectors, the number of its points, and seconds by stage."""

    vectors: dict[str, NDArray[np.float32]]
    points: int
    seconds: dict[str, float]


def describe_dataset(
    dataset: "Dataset",
    names: Sequence[str],
    folder: str | os.PathLike[str],
    *,
    config: PipelineConfig | None = None,
    jobs: int = 1,
    progress: Progress | None = None,
) -> list[DescriptorRun]:
    """Describe every frame with every named descriptor and store one run a descriptor.

    Frames done are kept in ``folder/.partial-*`` until all are: a call that was interrupted goes
    on where it stopped. Results do not depend on ``jobs``.

    Args:
        dataset: the recording.
        names: descriptors.
        folder: runs are written to ``folder/<source>-<descriptor>.npz``.
        jobs: frames worked on at a time (threads; the work is done outside the GIL).
        progress: called with (frames done, frames in all).

    Raises:
        DataError: a frame that cannot be read, fused or described (the message names it), or a
            folder that cannot be written.
        ConfigError: an unknown descriptor.
    """
    settings = config or PipelineConfig()
    for name in names:
        descriptor_named(name)
    settings = settled(dataset, names, settings)
    work = _Work(dataset, tuple(names), settings, Path(folder))
    done = 0
    for chunk in work.run(max(jobs, 1)):
        done += chunk
        if progress is not None:
            progress(done, len(dataset))
    return work.finish()


def settled(dataset: "Dataset", names: Sequence[str], config: PipelineConfig) -> PipelineConfig:
    """The configuration with what depends on the first frame fixed."""
    if not any(descriptor_named(name).needs_normals for name in names):
        return config
    try:
        described = for_sequence(config.descriptors, fuse(dataset[0], config.fusion))
    except DataError as error:
        raise DataError(f"{dataset.name}, frame {dataset.numbers[0]}: {error}") from error
    return config.model_copy(update={"descriptors": described})


@dataclass(frozen=True)
class _Work:
    """One call of describe_dataset."""

    dataset: "Dataset"
    names: tuple[str, ...]
    config: PipelineConfig
    folder: Path

    @cached_property
    def partial(self) -> Path:
        """Where finished chunks wait; the name changes with anything that changes the result."""
        files = [stream.files for stream in self.dataset.streams.values()]
        identity = [
            _core.__version__,
            str(self.dataset.root),
            [_state(paths[number]) for paths in files for number in self.dataset.numbers.tolist()],
            self.names,
            self.config.fusion.model_dump(),
            self.config.descriptors.model_dump(),
        ]
        key = hashlib.sha256(json.dumps(identity).encode()).hexdigest()[:12]
        return self.folder / f".partial-{key}"

    def run(self, jobs: int) -> Iterator[int]:
        """Do the chunks that are missing; yield the number of frames in each chunk."""
        with ThreadPoolExecutor(jobs) as pool:
            try:
                for start in range(0, len(self.dataset), CHUNK):
                    frames = range(start, min(start + CHUNK, len(self.dataset)))
                    path = self._chunk_path(start)
                    if not path.exists():
                        _save_chunk(path, list(pool.map(self._frame, frames)), self.names)
                    yield len(frames)
            except BaseException:
                pool.shutdown(wait=True, cancel_futures=True)
                raise

    def finish(self) -> list[DescriptorRun]:
        """Join the chunks into runs, store these, and forget the chunks."""
        starts = range(0, len(self.dataset), CHUNK)
        chunks = [_load_chunk(self._chunk_path(start)) for start in starts]
        joined = {key: np.concatenate([chunk[key] for chunk in chunks]) for key in chunks[0]}
        runs = [self._descriptor_run(name, joined) for name in self.names]
        for run in runs:
            run.save(run_path(self.folder, run.source, run.descriptor))
        shutil.rmtree(self.partial, ignore_errors=True)
        return runs

    def _chunk_path(self, start: int) -> Path:
        return self.partial / f"{start:06d}.npz"

    def _frame(self, index: int) -> _Described:
        clock = _Clock()
        frame = self.dataset[index]
        number = int(self.dataset.numbers[index])
        try:
            _load(frame, self.config.fusion.source)
            clock.lap("load")
            cloud = fuse(frame, self.config.fusion)
            clock.lap("fuse")
            vectors = {}
            for name in self.names:
                vectors[name] = describe(cloud, name, self.config.descriptors)
                clock.lap(name)
        except DataError as error:
            raise DataError(f"{self.dataset.name}, frame {number}: {error}") from error
        return _Described(vectors, len(cloud), clock.seconds)

    def _descriptor_run(self, name: str, joined: Mapping[str, NDArray[Any]]) -> DescriptorRun:
        return DescriptorRun(
            source=self.config.fusion.source,
            descriptor=name,
            dataset=self.dataset.name,
            descriptors=joined[f"vectors.{name}"],
            frames=np.arange(len(self.dataset), dtype=np.int64),
            stamps_ns=self.dataset.stamps_ns,
            poses=self.dataset.poses,
            seconds={
                "load": joined["seconds.load"],
                "fuse": joined["seconds.fuse"],
                "describe": joined[f"seconds.{name}"],
            },
            peak_memory_bytes=self._working_memory(name, joined["points"]),
            points=joined["points"],
            config=self.config.model_dump(mode="json"),
        )

    def _working_memory(self, name: str, points: NDArray[np.int64]) -> int:
        """Memory that describing the largest cloud takes on top of what was there before."""
        cloud = fuse(self.dataset[int(points.argmax())], self.config.fusion)
        return peak_memory(lambda: describe(cloud, name, self.config.descriptors))


def run_path(folder: str | os.PathLike[str], source: str, descriptor: str) -> Path:
    """Where describe_dataset stores a run."""
    return Path(folder) / f"{source}-{descriptor}.npz"


def load_runs(folder: str | os.PathLike[str]) -> list[DescriptorRun]:
    """All runs in a folder. Raises DataError if there is none."""
    paths = sorted(Path(folder).glob("*-*.npz"))
    if not paths:
        raise DataError(f"{folder} holds no descriptor runs: make some with fusionslam describe")
    return [DescriptorRun.load(path) for path in paths]


def peak_memory(work: Callable[[], object]) -> int:
    """Bytes of resident memory that ``work`` takes at most on top of what is in use (Linux).

    0 where the kernel does not tell.
    """
    import ctypes

    with suppress(OSError, AttributeError):
        ctypes.CDLL("libc.so.6").malloc_trim(0)
    try:
        Path("/proc/self/clear_refs").write_text("5")
        before = _status_bytes("VmRSS")
        work()
        return max(_status_bytes("VmHWM") - before, 0)
    except OSError:
        return 0


def _status_bytes(key: str) -> int:
    lines = Path("/proc/self/status").read_text().splitlines()
    found = next(line for line in lines if line.startswith(f"{key}:"))
    return int(found.split()[1]) * 1024


def _state(path: Path) -> list[Any]:
    """What changes when a file does; a file that is gone is reported when it is read."""
    with suppress(OSError):
        status = path.stat()
        return [str(path), status.st_size, status.st_mtime_ns]
    return [str(path)]


class _Clock:
    """Seconds since the last lap, by name."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.seconds[name] = now - self._last
        self._last = now


def _load(frame: Any, source: str) -> None:
    """Read what the source needs now, so that reading is timed apart from fusing."""
    if source != "stereo":
        _ = frame.points
    for camera in {"lidar": ("left",), "stereo": ("left", "right")}.get(source, ()):
        if camera in frame.images:
            _ = frame.images[camera]


def _save_chunk(path: Path, frames: Sequence[_Described], names: Sequence[str]) -> None:
    arrays: dict[str, NDArray[Any]] = {"points": np.array([f.points for f in frames], np.int64)}
    for name in names:
        arrays[f"vectors.{name}"] = np.array([f.vectors[name] for f in frames], np.float32)
    for stage in frames[0].seconds:
        arrays[f"seconds.{stage}"] = np.array([f.seconds[stage] for f in frames])
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        np.savez(stream, **arrays)  # type: ignore[arg-type]


def _load_chunk(path: Path) -> dict[str, NDArray[Any]]:
    try:
        with np.load(path, allow_pickle=False) as stored:
            return {name: stored[name] for name in stored.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise DataError(f"{path}: cannot be read ({error}); delete it and run again") from error
