# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""One flipped bit anywhere in a stored file is refused, or the file loads equal data.

FUSIONSLAM_FLIPS is the number of bits tried in each file; "all" tries every bit of the first 400
bytes, of all headers of members and arrays, and of the central directory, and 3,000 others.
"""

import io
import os
import pickle
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drives import SECOND, circle_events, take
from fusionslam import DescriptorIndex, LoopDetector
from fusionslam.datasets.range_recording import RangeRecording
from fusionslam.errors import DataError
from fusionslam.evaluation import DescriptorRun, VerifiedRun, precision_recall
from fusionslam.evaluation.loops.precision_recall import PrecisionRecall
from fusionslam.evaluation.maps.judge import judge_map
from fusionslam.evaluation.maps.report import MapReport
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.evaluation.views.run import ViewRun
from fusionslam.pipelines import describe
from fusionslam.pipelines.recording import Recording
from fusionslam.pipelines.results import Work
from fusionslam.pipelines.tuning import Generation, TuningState
from fusionslam.ratslam import Look, RatSlam, TemplateSource
from fusionslam.report.views.previews import load_previews, save_previews
from fusionslam.sensors.frame import Cloud
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.recognisers import ViewMatcherConfig
from fusionslam.views.scene_set import CloudArray, SceneSet
from fusionslam.views.visual_templates import VisualTemplates
from maps import square_run
from rows import rows
from scenes import LAPS, place, write_recording
from verified import verified_run

TRIED = os.environ.get("FUSIONSLAM_FLIPS", "4")


@dataclass(frozen=True)
class Stored:
    """A stored format: writes an example; loads it and returns something that can be compared."""

    write: Callable[[Path], Any]
    load: Callable[[Path], Any]


def random_rows(*shape: int) -> Any:
    return np.random.default_rng(5).random(shape)


def matcher(**values: Any) -> Stored:
    def write(path: Path) -> None:
        made = ViewMatcher(ViewMatcherConfig(**values))
        for visit, number in enumerate(LAPS[:4]):
            made.process(place(number, visit))
        made.save(path)

    return Stored(write, lambda path: saved(ViewMatcher.load(path).save))


def saved(save: Callable[[io.BytesIO], None]) -> bytes:
    stream = io.BytesIO()
    save(stream)
    return stream.getvalue()


def saved_file(save: Callable[[Path], None], path: Path) -> bytes:
    again = path.with_name("again")
    save(again)
    content = again.read_bytes()
    again.unlink()
    return content


def write_slam(path: Path) -> None:
    slam = RatSlam(views=TemplateSource(bottom=100))
    take(slam, circle_events(0.2))
    take(slam, [Look(100 * SECOND, random_rows(100, 120).astype(np.uint8))])
    slam.save(path)


def write_templates(path: Path) -> None:
    templates = VisualTemplates(columns=12, rows=4, bottom=None, shift=2)
    for seed in range(3):
        image = np.random.default_rng(seed).integers(0, 256, (48, 120))
        templates.process(image.astype(np.uint8))
    templates.save(path)


def scene_set() -> SceneSet:
    clouds = [place(number) for number in range(3)]
    return SceneSet(
        name="a drive",
        frame="robot",
        scene_config={},
        source={"data": "made"},
        stamps_ns=np.arange(3, dtype=np.int64),
        numbers=np.arange(3, dtype=np.int64),
        empty=np.zeros(3, bool),
        poses=random_rows(3, 3),
        clouds=CloudArray.of(clouds),
        scenes=None,
        features={"m2dp": random_rows(3, 8).astype(np.float32)},
    )


def write_chunk(path: Path) -> None:
    vectors = {"m2dp": np.ones(8, np.float32)}
    done = [describe._Described(k, vectors, 9, {"load": 0.1}) for k in range(3)]
    describe._save_chunk(path, [*done, describe._Described(3, reason="empty")])


def load_tuning(path: Path) -> Any:
    state = TuningState(path)
    state.begin({"seed": 1})
    return [vars(each) for each in state.generations]


def write_tuning(path: Path) -> None:
    state = TuningState(path)
    state.begin({"seed": 1})
    state.add(Generation(random_rows(4, 3), random_rows(4)))


def write_detector(path: Path) -> None:
    made, folder = LoopDetector("m2dp", window=2), path.with_name("detector")
    for number in range(4):
        made.add(Cloud(place(number).points))
    made.save(folder)
    path.write_bytes((folder / "detector.npz").read_bytes())


def load_detector(path: Path) -> bytes:
    folder = path.with_name("detector")
    (folder / "detector.npz").write_bytes(path.read_bytes())
    return pickle.dumps(LoopDetector.load(folder))


def write_index(path: Path) -> None:
    index = DescriptorIndex(5)
    for row in random_rows(4, 5).astype(np.float32):
        index.add(row)
    index.save(path)


def load_index(path: Path) -> bytes:
    index = DescriptorIndex.load(path)
    return saved_file(index.save, path)


def view_run() -> ViewRun:
    poses = random_rows(6, 3)
    return ViewRun("w", "m", np.array([0, 1, 0, -1, 2, 0]), poses, np.arange(6.0))


def descriptor_run() -> DescriptorRun:
    return DescriptorRun(
        source="lidar",
        descriptor="m2dp",
        dataset="06",
        descriptors=random_rows(5, 8).astype(np.float32),
        frames=np.arange(5),
        stamps_ns=np.arange(5),
        poses=None,
        seconds={"load": np.ones(5)},
        peak_memory_bytes=1,
        points=np.arange(5),
        config={"a": 1},
        numbers=np.arange(5),
        skipped={7: "empty"},
    )


def curve() -> PrecisionRecall:
    places = np.zeros((40, 3))
    places[:, 0] = np.arange(40) % 20
    return precision_recall(random_rows(40, 4).astype(np.float32), places, window=2, radius=0.5)


def write_work(path: Path) -> None:
    Work(recording=Recording("a.bag"), dataset="a", configs={"lidar": {"a": 1}}).save(path.parent)
    path.write_bytes(path.with_name("run.json").read_bytes())


def load_work(path: Path) -> Any:
    path.with_name("run.json").write_bytes(path.read_bytes())
    return Work.load(path.parent)


def plain(load: Callable[[Path], Any]) -> Callable[[Path], bytes]:
    return lambda path: pickle.dumps(vars(load(path)))


FORMATS: dict[str, Stored] = {
    **{method: matcher(method=method) for method in ("alignment", "objects", "m2dp", "shot")},
    "RatSlam": Stored(write_slam, lambda path: saved_file(RatSlam.load(path).save, path)),
    "templates": Stored(write_templates, lambda path: saved(VisualTemplates.load(path).save)),
    "scene set": Stored(
        lambda path: scene_set().save(path),
        lambda path: saved_file(SceneSet.load(path).save, path),
    ),
    "descriptor run": Stored(lambda p: descriptor_run().save(p), plain(DescriptorRun.load)),
    "verified run": Stored(lambda p: verified_run().save(p), plain(VerifiedRun.load)),
    "view run": Stored(lambda p: view_run().save(p), plain(ViewRun.load)),
    "RatSLAM run": Stored(lambda p: square_run().save(p), plain(RatSlamRun.load)),
    "recording": Stored(lambda p: write_recording(p, LAPS[:4]), plain(RangeRecording.open)),
    "chunk": Stored(write_chunk, lambda path: pickle.dumps(describe._load_chunk(path))),
    "tuning": Stored(write_tuning, lambda path: pickle.dumps(load_tuning(path))),
    "previews": Stored(
        lambda path: save_previews(path, {1: b"one", 2: b"two"}), lambda path: load_previews(path)
    ),
    "loop detector": Stored(write_detector, load_detector),
    "descriptor index": Stored(write_index, load_index),
    "curve": Stored(lambda path: curve().save(path), plain(PrecisionRecall.load)),
    "map report": Stored(
        lambda path: judge_map(square_run()).save(path), lambda path: MapReport.load(path).metrics()
    ),
    "run.json": Stored(write_work, load_work),
}


def bits(content: bytes) -> Iterator[int]:
    """Positions of the bits to flip."""
    rng = np.random.default_rng(3)
    count = 8 * len(content)
    if TRIED != "all":
        yield from rng.integers(0, min(count, 8 * 400), int(TRIED) // 2).tolist()
        yield from rng.integers(0, count, int(TRIED) // 2).tolist()
        return
    spans = [(0, 400)] + [
        (match.start(), match.start() + 200)
        for match in re.finditer(rb"PK\x01\x02|PK\x03\x04|PK\x05\x06|\x93NUMPY", content)
    ]
    chosen = {bit for begin, end in spans for bit in range(8 * begin, min(8 * end, count))}
    yield from sorted(chosen | set(rng.integers(0, count, 3000).tolist()))


def flipped(content: bytes) -> Iterator[tuple[int, bytes]]:
    for bit in bits(content):
        damaged = bytearray(content)
        damaged[bit // 8] ^= 1 << bit % 8
        yield bit, bytes(damaged)


@rows("name", FORMATS)
def test_a_flipped_bit_is_refused_or_changes_nothing(name: str, tmp_path: Path) -> None:
    stored, path = FORMATS[name], tmp_path / "file.npz"
    stored.write(path)
    content = path.read_bytes()
    expected = stored.load(path)
    refused = tried = 0
    for bit, damaged in flipped(content):
        path.write_bytes(damaged)
        tried += 1
        try:
            found = stored.load(path)
        except DataError:
            refused += 1
        else:
            assert found == expected, f"bit {bit} of {8 * len(content)}"
    print(f"{name}: {tried} bits flipped, {refused} refused")
    assert refused > tried / 4


def test_a_flipped_bit_of_a_checkpoint_is_refused_or_changes_nothing(tmp_path: Path) -> None:
    torch = pytest.importorskip("torch")
    from fusionslam.learning.training_loop import OptimiserConfig, _Run

    class Little:
        network = torch.nn.Linear(3, 2)

    def run() -> Any:
        return _Run(Little(), OptimiserConfig(), "{}")

    path, again, first = tmp_path / "checkpoint.pt", tmp_path / "again", run()
    first.task.network(torch.ones(1, 3)).sum().backward()
    first.optimiser.step()
    first.save(path, [{"epoch": 1.0}], [0.5])
    content = path.read_bytes()
    for _, damaged in flipped(content):
        path.write_bytes(damaged)
        other = run()
        try:
            loaded = other.resume(path)
        except DataError:
            continue
        other.save(again, *loaded)
        assert again.read_bytes() == content
