# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Published figures of views, and those measured again with the author's program."""

from dataclasses import dataclass

VIEW_CITATION = (
    "Stastny 2022, tables 5.2 to 5.5: clouds in world coordinates with perfect odometry, angles "
    "compared as the author's program does (72 and 7.2 degrees); times on an i7-8650U in a "
    "virtual machine"
)
RERUN_CITATION = (
    "the author's first stage and others run again on the worlds of the recordings, collision "
    "scans, published parameters, threshold 0.737, judged by the rule of the paper"
)
WORLDS = ("warehouse", "house", "hospital")
METHODS = ("first stage", "both stages", "RatSLAM")


@dataclass(frozen=True)
class PublishedViews:
    """Published figures of one method in one world.

    Attributes:
        world, method: from ``WORLDS`` and ``METHODS``.
        accuracy: a share.
        mean_error, max_error: metres, of the false positives.
        build_ms, match_ms: milliseconds to build a view, and to compare two views.
        view_bytes: bytes per view.
        views: number of stored views.
    """

    world: str
    method: str
    accuracy: float
    mean_error: float
    max_error: float
    build_ms: float
    match_ms: float
    view_bytes: int
    views: int


@dataclass(frozen=True)
class RerunViews:
    """Figures of one input in one world, measured again; shares, None if not measured.

    Attributes:
        world: from ``WORLDS``.
        input: what was compared, and in which frame.
        accuracy, loop_recall: at a threshold chosen in the warehouse.
        best_loop_recall: at the world's own best threshold, which a robot cannot know.
    """

    world: str
    input: str
    accuracy: float
    loop_recall: float | None = None
    best_loop_recall: float | None = None


@dataclass(frozen=True)
class RerunDescriptor:
    """Figures of c-M2DP as a view: nearest neighbour among scans more than 20 s older.

    Attributes:
        world: from ``WORLDS``.
        input: the clouds that were described.
        top1: share of the revisits whose nearest neighbour is within 0.8 m and 22.9 degrees.
        recall_at_full_precision: share of the revisits; None where not measured.
    """

    world: str
    input: str
    top1: float
    recall_at_full_precision: float | None = None


# One row per method, one column per world.
_ACCURACY = ((88.84, 86.69, 86.19), (89.28, 86.94, 86.38), (77.67, 41.25, 79.36))
_MEAN_ERROR = ((1.32, 0.93, 1.00), (1.39, 0.99, 1.00), (8.93, 1.84, 6.56))
_MAX_ERROR = ((3.06, 1.16, 1.52), (3.06, 1.39, 1.51), (11.52, 3.93, 14.57))
_BUILD_MS = ((42.432, 52.380, 55.271), (52.078, 88.265, 65.609), (2.053, 1.448, 1.762))
_MATCH_MS = ((0.153, 0.396, 0.399), (0.159, 0.368, 0.409), (0.083, 0.137, 0.092))
_BYTES = ((78, 128, 130), (1102, 1152, 1154), (600, 600, 600))
_VIEWS = ((194, 219, 151), (191, 216, 148), (312, 445, 219))

PUBLISHED_VIEWS = tuple(
    PublishedViews(
        world=world,
        method=method,
        accuracy=_ACCURACY[row][column] / 100,
        mean_error=_MEAN_ERROR[row][column],
        max_error=_MAX_ERROR[row][column],
        build_ms=_BUILD_MS[row][column],
        match_ms=_MATCH_MS[row][column],
        view_bytes=_BYTES[row][column],
        views=_VIEWS[row][column],
    )
    for row, method in enumerate(METHODS)
    for column, world in enumerate(WORLDS)
)
"""Tables 5.2 to 5.5."""

_UNKNOWN = (None, None, None)
# Input -> accuracy, loop recall, loop recall at the best threshold; per cent, a column per world.
_RERUN: dict[str, tuple[tuple[float | None, ...], ...]] = {
    "first stage, world coordinates, perfect odometry": (
        (85.8, 89.0, 92.8),
        (74, 84, 73),
        _UNKNOWN,
    ),
    "first stage, robot's frame": ((75.8, 76.6, 83.9), (55, 65, 57), _UNKNOWN),
    "first stage, robot's frame, tuned again": ((87.6, 85.9, 83.9), (76, 86, 71), _UNKNOWN),
    "first stage, world coordinates, drifting odometry": (
        (72.3, 74.7, 81.7),
        (3, 14, 0),
        _UNKNOWN,
    ),
    "no sensor: new every 3rd": ((87.3, 91.6, 97.4), (0, 0, 0), _UNKNOWN),
    "visual templates of RatSLAM, 10 Hz": ((59.5, 75.9, 88.9), _UNKNOWN, _UNKNOWN),
    "range image and colour, nearest neighbour": ((90.1, 91.6, 57.5), _UNKNOWN, (80, 87, 81)),
    "registering every pair of scans": ((96.8, 96.8, 92.7), _UNKNOWN, (89, 96, 87)),
}


def _share(percent: float | None) -> float | None:
    return None if percent is None else percent / 100


RERUN_VIEWS = tuple(
    RerunViews(world, name, *(_share(row[column]) for row in rows))  # type: ignore[arg-type]
    for name, rows in _RERUN.items()
    for column, world in enumerate(WORLDS)
)
"""Figures measured again, which show what the published ones really mean."""

_CM2DP = {
    "c-M2DP, ground left in": ((94.8, 96.9, 84.4), (0.75, 0.82, 0.29)),
    "c-M2DP, without ground": ((85.6, 96.9, 84.8), (0.45, 0.60, 0.27)),
    "c-M2DP, ground left in, axis signs of the robot's frame": ((94.8, 96.9, 89.6), None),
}
RERUN_DESCRIPTORS = tuple(
    RerunDescriptor(world, name, top1[column] / 100, recall[column] if recall else None)
    for name, (top1, recall) in _CM2DP.items()
    for column, world in enumerate(WORLDS)
)
"""The first thesis's descriptor (c-M2DP) in the second thesis's worlds."""


def world_of(name: str) -> str | None:
    """Return the thesis's world that a recording is named after ("house" for "small_house").

    None if there is none.
    """
    plain = name.strip().lower().replace("-", "_").removeprefix("small_")
    return plain if plain in WORLDS else None


def published_views(name: str) -> tuple[PublishedViews, ...]:
    """Return the published figures of a world, one per method; none for other worlds."""
    world = world_of(name)
    return tuple(figures for figures in PUBLISHED_VIEWS if figures.world == world)


def rerun_views(name: str) -> tuple[RerunViews, ...]:
    """Return the figures measured again in a world; none if there are none."""
    world = world_of(name)
    return tuple(figures for figures in RERUN_VIEWS if figures.world == world)


def rerun_descriptors(name: str) -> tuple[RerunDescriptor, ...]:
    """Return the figures of c-M2DP in a world; none if not measured."""
    world = world_of(name)
    return tuple(figures for figures in RERUN_DESCRIPTORS if figures.world == world)
