# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Formats that fusionslam itself stores: damaged ones, and forged ones with valid digests.

A damaged file must be refused or give the same content. A forged file must be refused, or give
something that works without NaN.
"""

import io
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import arrays
import drives
import maps
import scenes
from fusionslam import DescriptorIndex, LoopDetector
from fusionslam.base.archive import load_arrays, save_archive, save_json
from fusionslam.evaluation import (
    DescriptorRun,
    MapReport,
    PrecisionRecall,
    RatSlamRun,
    VerifiedRun,
    ViewCurve,
    ViewJudge,
    ViewRun,
    evaluate_verified,
    judge_map,
    precision_recall,
    sweep_pairs,
)
from fusionslam.loop_closure.detector import FILE
from fusionslam.ratslam import Motion, RatSlam, Sighting, Step
from fusionslam.registration import RegistrationConfig
from fusionslam.views import SceneSet, ViewMatcher, ViewMatcherConfig
from fusionslam.views.visual_templates import VisualTemplates
from fuzz.hostile_values import (
    GENERATE,
    HOSTILE_JSON,
    Forged,
    driven_by_bytes,
    hostile_arrays,
    random_bytes,
)
from fuzz.target import SilentError, Target, check_numbers, refusing, scratch
from verified import verified_run


@dataclass(frozen=True)
class Format:
    """A stored format.

    Attributes:
        write: writes a small valid file.
        read: reads a file.
        use: uses what was read, as a program would.
        again: writes what was read; the bytes tell whether its content is the same.
        check: reads all of the file, where readers read parts. Raises DataError if it is damaged.
    """

    write: Callable[[Path], object]
    read: Callable[[Path], Any]
    use: Callable[[Any], object] = lambda value: None
    again: Callable[[Any, Path], object] = lambda value, path: value.save(path)
    check: Callable[[Path], object] | None = None


def _descriptor_run(path: Path) -> None:
    rng = np.random.default_rng(0)
    count = 12
    DescriptorRun(
        source="left",
        descriptor="m2dp",
        dataset="line",
        descriptors=rng.normal(size=(count, 8)).astype(np.float32),
        frames=np.arange(count),
        stamps_ns=np.arange(count) * 10**8,
        poses=np.tile(np.eye(4), (count, 1, 1)),
        seconds={"describe": rng.uniform(0, 1, count)},
        peak_memory_bytes=10,
        points=np.full(count, 100),
        config={"a": 1},
    ).save(path)


def _precision_recall(path: Path) -> None:
    rng = np.random.default_rng(0)
    precision_recall(
        rng.normal(size=(30, 4)).astype(np.float32), rng.uniform(0, 9, (30, 3)), window=2
    ).save(path)


def _view_curve(path: Path) -> None:
    seconds, places = np.arange(6) * 5.0, np.array([[0.0, 0, 0], [9, 0, 0], [0, 0, 0]] * 2)
    likeness, stored = np.array([0, 0.2, 0.9, 0.3, 0.5, 0.8]), np.array([-1, 0, 0, 1, 1, 2])
    sweep_pairs(ViewJudge(places, seconds), likeness, stored).save(path)


def _view_run(path: Path) -> None:
    count = 9
    ViewRun(
        world="house",
        method="alignment",
        ids=np.array([0, 1, 2, 3, 4, 0, 1, 2, 3]),
        poses=np.arange(count * 3.0).reshape(-1, 3),
        stamps=np.arange(0.0, 2 * count, 2),
        similarities=np.linspace(0, 1, count),
        threshold=0.5,
        build_seconds=np.full(count, 0.1),
        match_seconds=np.full(count, 0.1),
        bytes_per_view=10.0,
    ).save(path)


def matcher(**options: Any) -> Callable[[Path], None]:
    """Writes a view matcher with such options."""

    def write(path: Path) -> None:
        made = ViewMatcher(ViewMatcherConfig(**options))
        for visit, number in enumerate(scenes.LAPS):
            made.process(scenes.place(number, visit))
        made.save(path)

    return write


def _match(matcher: ViewMatcher) -> None:
    for number in (0, 3, 8):
        matcher.process(scenes.place(number, visit=7))


def _templates(path: Path) -> None:
    templates = VisualTemplates()
    rng = np.random.default_rng(0)
    for _ in range(4):
        templates.process(rng.integers(0, 256, (160, 160, 3), dtype=np.uint8))
    templates.save(path)


def _look(templates: VisualTemplates) -> None:
    templates.process(np.random.default_rng(0).integers(0, 256, (160, 160, 3), dtype=np.uint8))


def _rat_slam(path: Path) -> None:
    slam = RatSlam()
    drives.take(slam, drives.circle_events(laps=1.2))
    slam.save(path)


def _drive_on(slam: RatSlam) -> list[Step]:
    start = max([0, *(stamp for stamp in slam.seen_ns if stamp is not None)])
    steps = []
    for number in range(4):
        stamp_ns = start + (number + 1) * 10**8
        steps.append(slam.step(Motion(stamp_ns, 0.5, 0.1)))
        steps.append(slam.step(Sighting(stamp_ns, number)))
    return steps


def _loop_detector(path: Path) -> None:
    planar = RegistrationConfig(method="planar")  # needs no other library
    detector = LoopDetector("cm2dp", window=1, registration=planar)
    for visit, number in enumerate((0, 1, 2, 0)):
        detector.add(scenes.place(number, visit), stamp_ns=visit * 10**9)
    _save_detector(detector, path)


def _save_detector(detector: LoopDetector, path: Path) -> None:
    detector.save(scratch())
    (scratch() / FILE).replace(path)


def _load_detector(path: Path) -> LoopDetector:
    """Read it from the folder of a file's own name, as a detector has it."""
    folder = scratch() / "loop_detector"
    folder.mkdir(exist_ok=True)
    (folder / FILE).write_bytes(path.read_bytes())
    return LoopDetector.load(folder)


def _close_loops(detector: LoopDetector) -> list[Any]:
    answers: list[Any] = []
    for visit, number in enumerate((1, 2), start=9):
        answers.append(detector.add(scenes.place(number, visit), stamp_ns=visit * 10**9))
        answers += [detector.nearest, detector.rejected, detector.candidates(2)]
    return answers


def _index_again(index: DescriptorIndex, path: Path) -> None:
    index.save(str(path))


def _ask(index: DescriptorIndex) -> None:
    index.add(np.zeros(index.dimension, np.float32), stamp_ns=2**60)


FORMATS: dict[str, Format] = {
    "descriptor_index": Format(
        lambda path: arrays.filled().save(str(path)),
        lambda path: DescriptorIndex.load(str(path)),
        _ask,
        _index_again,
    ),
    "loop_detector": Format(_loop_detector, _load_detector, _close_loops, _save_detector),
    "descriptor_run": Format(_descriptor_run, DescriptorRun.load),
    "verified_run": Format(
        lambda path: verified_run().save(path),
        VerifiedRun.load,
        lambda run: str(evaluate_verified(run, window=0)),
    ),
    "view_run": Format(_view_run, ViewRun.load, lambda run: str(run.judge())),
    "rat_slam_run": Format(lambda path: maps.square_run().save(path), RatSlamRun.load, judge_map),
    "precision_recall": Format(_precision_recall, PrecisionRecall.load),
    "view_curve": Format(_view_curve, ViewCurve.load),
    "map_report": Format(lambda path: judge_map(maps.square_run()).save(path), MapReport.load, str),
    "scene_set": Format(lambda path: scenes.drive(scenes.LAPS).save(path), SceneSet.load),
    "view_matcher_alignment": Format(matcher(), ViewMatcher.load, _match),
    "view_matcher_objects": Format(matcher(method="objects"), ViewMatcher.load, _match),
    "view_matcher_cm2dp": Format(matcher(method="cm2dp"), ViewMatcher.load, _match),
    "visual_templates": Format(_templates, VisualTemplates.load, _look),
    "rat_slam": Format(_rat_slam, RatSlam.load, _drive_on),
}


def stored_format_targets() -> Iterator[Target]:
    """A damaged and a forged target of each format."""
    for name, form in FORMATS.items():
        yield Target(f"damaged/{name}", _seeds(name, form), _Damaged(name, form))
        if name != "descriptor_index":  # fuzz/core forges it
            yield Target(f"forged/{name}", random_bytes, _Forged(name, form), largest=512)


def _seeds(name: str, form: Format) -> Callable[[], list[bytes]]:
    def make() -> list[bytes]:
        return [_valid_file(name, form)]

    return make


def _valid_file(name: str, form: Format) -> bytes:
    path = scratch() / f"{name}.valid"
    form.write(path)
    return path.read_bytes()


class _Damaged:
    """Refused, or the same content."""

    def __init__(self, name: str, form: Format) -> None:
        self.name, self.form = name, form
        self._expected: bytes | None = None

    def __call__(self, data: bytes) -> bool:
        path = scratch() / f"{self.name}.npz"
        path.write_bytes(data)
        return refusing(lambda: self._check(path))

    def _check(self, path: Path) -> None:
        again = self._content(path)
        if self._expected is None:
            whole = scratch() / f"{self.name}.whole.npz"
            whole.write_bytes(_valid_file(self.name, self.form))
            self._expected = self._content(whole)
        if again != self._expected:
            raise SilentError("a damaged file was read as other content")

    def _content(self, path: Path) -> bytes:
        value = self.form.read(path)
        again = scratch() / f"{self.name}.again"
        self.form.again(value, again)
        return again.read_bytes()


Leaves = dict[tuple[str | int, ...], Any]


def _leaves(value: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Paths of all values within nested JSON."""
    yield path
    items = (
        value
        if isinstance(value, dict)
        else dict(enumerate(value if isinstance(value, list) else ()))
    )
    for key, item in items.items():
        yield from _leaves(item, (*path, key))


def _replace(value: Any, path: tuple[str | int, ...], new: Any) -> Any:
    if not path:
        return new
    copy: Any = dict(value) if isinstance(value, dict) else list(value)
    copy[path[0]] = _replace(value[path[0]], path[1:], new)
    return copy


class _Forged(Forged):
    """Refused, or something that works; made by changing values and sealing the archive again."""

    def __init__(self, name: str, form: Format) -> None:
        super().__init__()
        self.name, self.form = name, form

    def _prepare(self) -> Callable[[bytes], bytes | None]:
        whole = _valid_file(self.name, self.form)
        members: dict[str, Any] | None = None
        if whole.startswith(b"{"):
            about = json.loads(whole)
        else:
            with load_arrays(io.BytesIO(whole), "a seed") as stored:
                members = dict(stored)
            about = json.loads(str(members.pop("about")))
        path = scratch() / f"{self.name}.forged.npz"

        @GENERATE
        @given(st.data())
        def forge(data: st.DataObject) -> None:
            changed, values = members and dict(members), about
            for _ in range(data.draw(st.integers(1, 3))):
                if members and changed and data.draw(st.booleans()):
                    key = data.draw(st.sampled_from(sorted(members)))
                    if changed[key] is not None:
                        changed[key] = data.draw(hostile_arrays(changed[key]))
                else:
                    where = data.draw(st.sampled_from(list(_leaves(values))[1:]))
                    values = _replace(values, where, data.draw(st.sampled_from(HOSTILE_JSON)))
            _seal(path, values, changed)
            self._accepted = refusing(lambda: check_numbers(self.form.use(self.form.read(path))))

        return driven_by_bytes(forge)


def _seal(path: Path, values: Mapping[str, Any], members: Mapping[str, Any] | None) -> None:
    """Write a file whose digests are right."""
    rest = {key: value for key, value in values.items() if "digest" not in key}
    if members is None:
        save_json(path, None, rest)
    else:
        save_archive(path, rest.pop("format", ""), rest, members)
