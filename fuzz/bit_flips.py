# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Flips single bits of every stored format: each is refused, or the content is what it was.

What is stored in a folder with others, as a part of a database, is copied to its place there
before it is read.
"""

import pickle
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from fleet_places import SETTINGS, VECTORS, made_places, made_segment, made_vectors
from fusionslam.datasets.range_recording import RangeRecording
from fusionslam.errors import DataError
from fusionslam.fleet.config import FleetConfig, FleetSettings
from fusionslam.fleet.place_database import PlaceDatabase
from fusionslam.fleet.segment import Segment, digest_of
from fusionslam.mapping.map_file import MapFile
from fusionslam.mapping.place_map import PlaceMap
from fusionslam.pipelines import describe
from fusionslam.pipelines.describe import PipelineConfig
from fusionslam.pipelines.recording import Recording
from fusionslam.pipelines.results import Work
from fusionslam.pipelines.tuning import Generation, TuningState
from fusionslam.report.views.previews import load_previews, save_previews
from fusionslam.views.matcher import ViewMatcher
from fuzz.place_maps import valid_map
from fuzz.stored_formats import FORMATS as FUZZED
from fuzz.stored_formats import Format, matcher
from fuzz.target import scratch
from scenes import LAPS, write_recording


@dataclass(frozen=True)
class FlipCount:
    """What came of flipped bits.

    Attributes:
        tried: number of bits, one at a time.
        refused: refused by a reader, or found by the check of the format.
        silent: places of bits with which readers gave other content without an error.
        missed: places of bits of other content, or refused by readers, which the check let pass.
    """

    tried: int
    refused: int
    silent: list[int]
    missed: list[int]


def flip_bits(form: Format, folder: Path, bits: Callable[[bytes], Iterator[int]]) -> FlipCount:
    """Flip the bits that ``bits`` chooses for the content of a file, one at a time."""
    path = folder / "file.npz"
    form.write(path)
    whole, expected = path.read_bytes(), _content(form, path)
    tried, refused = 0, 0
    silent: list[int] = []
    missed: list[int] = []
    for bit in bits(whole):
        path.write_bytes(flipped(whole, bit))
        tried += 1
        try:
            is_other = _content(form, path) != expected
            is_refused = False
        except DataError:
            is_other, is_refused = False, True
        if form.check is not None:
            try:
                form.check(path)
            except DataError:
                refused += 1
                continue
            if is_other or is_refused:
                missed.append(bit)
        refused += is_refused
        if is_other:
            silent.append(bit)
    return FlipCount(tried, refused, silent, missed)


def random_bits(count: int, seed: int = 3) -> Callable[[bytes], Iterator[int]]:
    """Half of them in the first 400 bytes, which hold headers, the others anywhere."""

    def choose(whole: bytes) -> Iterator[int]:
        rng, most = np.random.default_rng(seed), 8 * len(whole)
        yield from rng.integers(0, min(most, 8 * 400), count // 2).tolist()
        yield from rng.integers(0, most, count - count // 2).tolist()

    return choose


def flipped(whole: bytes, bit: int) -> bytes:
    """The content with one bit changed."""
    damaged = bytearray(whole)
    damaged[bit // 8] ^= 1 << bit % 8
    return bytes(damaged)


def _content(form: Format, path: Path) -> bytes:
    again = path.with_name("again")
    form.again(form.read(path), again)
    return again.read_bytes()


def _pickle(value: Any, path: Path) -> None:
    """For what saves itself elsewhere: all that it is."""
    path.write_bytes(pickle.dumps(value if isinstance(value, dict | list) else vars(value)))


def _write_chunk(path: Path) -> None:
    vectors = {"m2dp": np.ones(8, np.float32)}
    done = [describe._Described(k, vectors, 9, {"load": 0.1}) for k in range(3)]
    describe._save_chunk(path, [*done, describe._Described(3, reason="empty")])


def _load_tuning(path: Path) -> list[Any]:
    state = TuningState(path)
    state.begin({"seed": 1})
    return [vars(each) for each in state.generations]


def _write_tuning(path: Path) -> None:
    state, rng = TuningState(path), np.random.default_rng(5)
    state.begin({"seed": 1})
    state.add(Generation(rng.random((4, 3)), rng.random(4)))


def _named(name: str, save: Callable[[Path], object], load: Callable[[Path], Any]) -> Format:
    """A format that has a name of its own in a folder."""

    def write(path: Path) -> None:
        save(path.parent)
        path.with_name(name).rename(path)

    def read(path: Path) -> Any:
        shutil.copyfile(path, path.with_name(name))
        return load(path.parent)

    return Format(write, read, again=_pickle)


def _save_work(folder: Path) -> None:
    Work(recording=Recording("a.bag"), dataset="a", configs={"lidar": {"a": 1}}).save(folder)


def _save_settings(folder: Path) -> None:
    FleetSettings.of(("m2dp",), PipelineConfig(), FleetConfig()).save(folder)


def _segment(suffix: str) -> Format:
    """One of the files of a segment of an index, beside the other one."""

    @cache
    def made() -> tuple[Path, str]:
        path = made_segment(scratch() / f"segment{suffix}")
        return path, digest_of(path)

    def write(path: Path) -> None:
        shutil.copyfile(made()[0].with_suffix(suffix), path)

    def read(path: Path) -> dict[str, Any]:
        shutil.copyfile(path, made()[0].with_suffix(suffix))
        segment = Segment(*made())
        found = segment.search(VECTORS[::300], segment.lists, 30, None)
        return {"found": found.tolist(), "vectors": segment.vectors[:200].tolist()}

    return Format(write, read, again=_pickle)


def _table(part: str) -> Format:
    """The newest file of a part of a database's table."""

    @cache
    def made() -> tuple[Path, bytes]:
        folder = scratch() / f"database-{part}"
        with PlaceDatabase.create(folder, SETTINGS) as database:
            database.add(made_places("monday", 130, seed=1))
        files = [each for each in (folder / "places.lance" / part).iterdir() if each.is_file()]
        file = max(files, key=lambda each: (each.suffix != ".json", each.stat().st_mtime_ns))
        return file, file.read_bytes()

    def put(path: Path) -> Path:
        shutil.copyfile(path, made()[0])
        return made()[0].parents[2]

    def read(path: Path) -> dict[str, Any]:
        with PlaceDatabase.open(put(path), read_only=True) as database:
            found = database.query(made_vectors(50, seed=1)[::5], k=130)
            rows = [[(each.key, *map(str, vars(each).values())) for each in row] for row in found]
            return {"rows": rows, "poses": str(database.positions("").poses)}

    def check(path: Path) -> None:
        with PlaceDatabase.open(put(path), read_only=True) as database:
            database.check()

    return Format(lambda path: path.write_bytes(made()[1]), read, again=_pickle, check=check)


def _read_map(path: Path) -> dict[str, Any]:
    """All that a map's file holds, read as others read it."""
    with MapFile(path, read_only=True) as file:
        keyframes = file.keyframes()
        return {
            "about": (keyframes, file.sessions(), file.edges(), file.vectors(), file.solution()),
            "config": file.setting("config"),
            "clouds": [file.cloud(each.id) for each in keyframes],
        }


def _write_map(path: Path) -> None:
    path.write_bytes(_solved_map())


@cache
def _solved_map() -> bytes:
    path = scratch() / "solved.fsmap"
    path.write_bytes(valid_map())
    with PlaceMap.open(path) as site:
        site.solve()
    return path.read_bytes()


def _check_map(path: Path) -> None:
    with PlaceMap.open(path, read_only=True) as site:
        if problems := site.check():
            raise DataError(problems[0], code="damaged")


FORMATS: dict[str, Format] = FUZZED | {
    "view_matcher_m2dp": Format(matcher(method="m2dp"), ViewMatcher.load),
    "view_matcher_shot": Format(matcher(method="shot"), ViewMatcher.load),
    "recording": Format(
        lambda path: write_recording(path, LAPS[:4]), RangeRecording.open, again=_pickle
    ),
    "chunk": Format(_write_chunk, describe._load_chunk, again=_pickle),
    "tuning": Format(_write_tuning, _load_tuning, again=_pickle),
    "previews": Format(
        lambda path: save_previews(path, {1: b"one", 2: b"two"}), load_previews, again=_pickle
    ),
    "run.json": _named("run.json", _save_work, Work.load),
    "fleet.json": _named("fleet.json", _save_settings, FleetSettings.load),
    "rows of a segment": _segment(".npy"),
    "lists of a segment": _segment(".faiss"),
}
"""Formats of one file, by name; all read quickly."""
DATABASES: dict[str, Format] = {
    "map": Format(_write_map, _read_map, again=_pickle, check=_check_map),
    "table of places": _table("data"),
    "versions of places": _table("_versions"),
}
"""Those that need the libraries of maps and fleets."""
