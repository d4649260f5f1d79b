# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Section 5.8 of Stastny 2022: RatSLAM with every view recognition method, and its maps."""

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np

from benchmarks.theses.config import OURS, QUICK_EACH, ReproduceConfig
from benchmarks.theses.drives import Source
from benchmarks.theses.view_study import own_frame, recognise_views
from benchmarks.theses.work_cache import WorkCache
from fusionslam.base.progress import Step
from fusionslam.evaluation import MapReport, ViewRun, judge_map
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.geometry.odometry_noise import DRIFT
from fusionslam.pipelines.drives import FrameName
from fusionslam.pipelines.map_events import RunEvents, Unreadable, during, motions_of
from fusionslam.pipelines.maps import RunRecorder, run_events
from fusionslam.pipelines.methods import find_method
from fusionslam.ratslam import RatSlam, RatSlamConfig
from fusionslam.ratslam.events import Event, Look, Sighting
from fusionslam.ratslam.view_sources import MatcherSource
from fusionslam.sensors.messages import NANOSECONDS

ODOMETRIES: dict[str, FrameName] = {"truth": "odometry", "truth+noise": "drift"}
"""Odometry, and the frame of the thesis's clouds that goes with it."""
Preset = Literal["openratslam", "robust"]
PRESETS: tuple[Preset, ...] = get_args(Preset)
"""RatSLAM as the thesis used it, and our own preset."""


@dataclass(frozen=True, eq=False)
class Mapped:
    """A map, or the reason why there is none.

    Attributes:
        world: world of the thesis.
        odometry: key of ``ODOMETRIES``.
        method: view recognition method, as ``find_method`` takes it.
        preset: preset of the cells and the map, from ``PRESETS``.
        run: None if the views are not available.
        note: why there is no run.
    """

    world: str
    odometry: str
    method: str
    preset: str
    run: RatSlamRun | None
    note: str = ""

    @cached_property
    def report(self) -> MapReport | None:
        """Report by the rule of the text: the view radius is 0.8 m and 22.9 degrees."""
        return None if self.run is None else judge_map(self.run, rule="paper")


@dataclass(frozen=True)
class MapStudy:
    """All maps of all worlds.

    Attributes:
        words: description of the drive, by world.
        made: the worlds simulated here instead of the thesis's.
        methods: view recognition methods, in order.
        maps: all maps.
    """

    words: dict[str, str]
    made: tuple[str, ...]
    methods: tuple[str, ...]
    maps: list[Mapped]

    def map(self, world: str, odometry: str, method: str, preset: str) -> Mapped | None:
        """Return one of the maps; None if it was not made."""
        wanted = (world, odometry, method, preset)
        found = (m for m in self.maps if (m.world, m.odometry, m.method, m.preset) == wanted)
        return next((one for one in found if one.run is not None), None)

    def notes(self) -> list[str]:
        """List the reasons for missing maps, one line each."""
        found = (f"{m.world}: {find_method(m.method).title}: {m.note}" for m in self.maps if m.note)
        return list(dict.fromkeys(found))


@dataclass(frozen=True, eq=False)
class SightingEvents(RunEvents):
    """Events with known view ids: its items are ``Sighting``."""

    def __iter__(self) -> Iterator[Event | Unreadable]:
        for event in super().__iter__():
            yield event.item if isinstance(event, Look) else event


def study_maps(
    config: ReproduceConfig, drives: Sequence[Source], pieces: WorkCache, step: Step | None
) -> MapStudy:
    """Make the maps of every drive; maps that are already stored are reused.

    Raises:
        DataError: a drive cannot be simulated or read, or the folder cannot be written.
    """
    maps = [
        _make_map(source, odometry, method, preset, pieces, step)
        for source in drives
        for odometry in ODOMETRIES
        for method in config.views
        for preset in PRESETS
        # Ours gives the robot's pose within a view, which the original cannot use.
        if (method, preset) != (OURS, "openratslam")
    ]
    words = {source.world: source.words for source in drives}
    made = tuple(source.world for source in drives if source.made)
    return MapStudy(words, made, config.views, maps)


def _make_map(
    source: Source, odometry: str, method: str, preset: Preset, pieces: WorkCache, step: Step | None
) -> Mapped:
    frame, slam = ODOMETRIES[odometry], RatSlamConfig(preset=preset)
    views = recognise_views(source, frame, method, pieces, step)
    about = (source.world, odometry, method, preset)
    if views.run is None:
        return Mapped(*about, None, views.note)
    known = {
        "source": source.identity,
        "odometry": [odometry, DRIFT.model_dump(mode="json")],
        "method": [method, own_frame(frame, method), _digest(views.run)],
        "slam": slam.model_dump(mode="json"),
    }
    make = _maker(source, odometry, method, slam, views.run, step)
    name = f"{source.world}-map-{method}-{odometry}-{preset}"
    run = pieces.load_or_make(name, known, make, RatSlamRun.save, RatSlamRun.load)
    return Mapped(*about, run)


def _digest(run: ViewRun) -> str:
    """A digest of the view ids of a run."""
    content = run.ids.tobytes() + np.ascontiguousarray(run.stamps).tobytes()
    return hashlib.sha256(content).hexdigest()[:12]


def _maker(
    source: Source,
    odometry: str,
    method: str,
    config: RatSlamConfig,
    views: ViewRun,
    step: Step | None,
) -> Callable[[], RatSlamRun]:
    def make() -> RatSlamRun:
        title = find_method(method).title
        if method == OURS:
            slam = RatSlam(config, views=MatcherSource(find_method(OURS).matcher()))  # type: ignore[misc]
            events = _looks(source, odometry)
        else:
            slam, events = RatSlam(config), _sightings(source, odometry, views)
        recorder = RunRecorder(slam, events)
        what = f"{source.world}: map by {title}, {odometry}, {config.preset}"
        run_events(recorder, None if step is None else _relabel(step, what))
        return replace(recorder.record(), views=title)

    return make


def _relabel(step: Step, label: str) -> Step:
    return lambda _, done, total: step(label, done, total)


def _sightings(source: Source, odometry: str, run: ViewRun) -> RunEvents:
    """Views of a run. The thesis's objects give no rotation, and its templates do not turn."""
    stamps_ns = np.round(run.stamps * NANOSECONDS).astype(np.int64)
    ids = run.ids.tolist()
    return _events(
        SightingEvents, source, odometry, stamps_ns, lambda i: Sighting(int(stamps_ns[i]), ids[i])
    )


def _looks(source: Source, odometry: str) -> RunEvents:
    """Clouds of a drive as events."""
    scenes = source.drive.scenes
    numbers = scenes.numbers.tolist()
    return _events(
        RunEvents, source, odometry, scenes.stamps_ns, lambda i: source.drive.cloud(numbers[i])
    )


def _events(
    kind: type[RunEvents], source: Source, odometry: str, stamps_ns: Any, item: Callable[[int], Any]
) -> RunEvents:
    drive = source.whole_drive
    title, motions = motions_of(drive, odometry, DRIFT)
    motions = during(motions, stamps_ns)[:: QUICK_EACH if source.quick else 1]
    return kind(source.drive.name, title, motions, stamps_ns, item, drive.truth)
