# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Courses that RatSLAM is driven over again and again: what is seen there is looked at once.

Views depend neither on odometry nor on what the cells and the map make of them, so the same
sightings serve every run; ``run_ratslam`` gives the same maps.
"""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fusionslam.cli.recordings import build_recording
from fusionslam.errors import DataError
from fusionslam.evaluation import RatSlamRun
from fusionslam.evaluation.views.rules import view_rule
from fusionslam.geometry.odometry_noise import OdometryConfig
from fusionslam.pipelines.compare_views import find_recordings
from fusionslam.pipelines.drives import Drive, open_drive
from fusionslam.pipelines.map_events import RunEvents, during, events_of, motions_of
from fusionslam.pipelines.maps import RunRecorder, truth_at
from fusionslam.ratslam import RatSlam, RatSlamConfig, Sighting, ViewSource
from fusionslam.ratslam.view_sources import build_view_source
from fusionslam.sim.rendered_images import rendered_images
from fusionslam.views.match import NO_VIEW

VIEWS = ("alignment", "objects", "two_stages", "cm2dp", "visual_templates")
"""Recognisers that are compared."""
MADE = ("warehouse", "house", "hospital")
"""Procedural worlds."""


@dataclass(eq=False)
class Course:
    """A drive through a world with one source of views.

    Attributes:
        drive: scans or images, and the motion.
        views: name of the recogniser.
    """

    drive: Drive
    views: str

    @cached_property
    def source(self) -> ViewSource:
        """What recognised the places; it has looked at everything once ``sightings`` is there."""
        return build_view_source(self.views)

    @cached_property
    def _looks(self) -> RunEvents:
        return events_of(self.drive, self.source, "truth", jobs=os.cpu_count() or 1)

    @cached_property
    def sightings(self) -> list[Sighting]:
        """What the source says of everything that there is to look at."""
        stamps = self._looks.look_stamps_ns.tolist()
        return [self.source.look(self._looks.item(i), stamp) for i, stamp in enumerate(stamps)]

    @cached_property
    def places(self) -> NDArray[np.float64]:
        """float64 (n, 3): true poses of the sightings."""
        found = truth_at(self.drive.truth, self._looks.look_stamps_ns.tolist())
        if found is None:
            raise DataError(f"{self.drive.name}: no true poses, without which nothing is judged")
        return found

    def run(
        self,
        config: RatSlamConfig,
        errors: OdometryConfig,
        sightings: Sequence[Sighting] | None = None,
    ) -> RatSlamRun:
        """Make a map.

        Args:
            config: of the cells and the map.
            errors: of odometry.
            sightings: one for each look; None for what the source says.
        """
        seen = self.sightings if sightings is None else sightings
        title, motions = motions_of(self.drive, "truth+noise", errors)
        events = replace(
            self._looks,
            odometry=title,
            motions=during(motions, self._looks.look_stamps_ns),
            item=seen.__getitem__,
        )
        recorder = RunRecorder(RatSlam(config), events)
        for event in events:
            recorder.step(getattr(event, "item", event))
        return replace(recorder.record(), views=self.views)


def courses(worlds: Sequence[str] = (), views: Sequence[str] = ()) -> Iterator[Course]:
    """The recordings that are there and the procedural worlds, each with each source of views.

    Args:
        worlds: names of drives, "simulated warehouse" for a procedural one; none for all.
        views: names of sources; none for all.
    """
    for place in [*find_recordings(), *MADE]:
        drive = open_drive(
            build_recording(Path(place)), render=rendered_images, jobs=os.cpu_count() or 1
        )
        for name in views or VIEWS:
            if not worlds or drive.name in worlds:
                yield Course(drive, name)


def with_false_matches(course: Course, share: float, seed: int = 0) -> tuple[list[Sighting], int]:
    """Sightings of which some are told to be of a known view that is elsewhere.

    What is true of a larger share is true of a smaller one with the same seed: fewer are wrong, at
    the same times.

    Args:
        course: what was truly seen.
        share: of the looks at which something was recognised or new.
        seed: decides which.

    Returns:
        The sightings, with ids that count from 0 again, and how many of them are wrong.
    """
    radius = view_rule("paper")[1].loop_distance
    luck = np.random.default_rng(seed).random((len(course.sightings), 2))
    known: dict[int, int] = {}
    first: list[NDArray[np.float64]] = []
    told, wrong = [], 0
    for sighting, here, (chance, which) in zip(
        course.sightings, course.places[:, :2], luck, strict=True
    ):
        apart = np.linalg.norm(np.array(first).reshape(-1, 2) - here, axis=1)
        elsewhere = np.flatnonzero(apart > 2 * radius)
        if sighting.view_id == NO_VIEW or chance >= share or not elsewhere.size:
            told.append(_renumber(sighting, here, known, first))
            continue
        view = int(elsewhere[int(which * elsewhere.size)])
        told.append(Sighting(sighting.stamp_ns, view, reason="told wrongly"))
        wrong += 1
    return told, wrong


def _renumber(
    sighting: Sighting,
    here: NDArray[np.float64],
    known: dict[int, int],
    first: list[NDArray[np.float64]],
) -> Sighting:
    if sighting.view_id == NO_VIEW:
        return sighting
    view = known.setdefault(sighting.view_id, len(first))
    if view == len(first):
        first.append(here)
    return replace(sighting, view_id=view)
