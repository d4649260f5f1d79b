# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Published figures of views, and those measured again with the author's program."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import yaml

from fusionslam.base.argument_types import checked

VIEW_CITATION = (
    "Stastny 2022, tables 5.2 to 5.5: clouds in world coordinates with perfect odometry, angles "
    "compared as the author's program does (72 and 7.2 degrees); times on an i7-8650U in a "
    "virtual machine"
)
RERUN_CITATION = (
    "the author's first stage and others run again on the worlds of the recordings, collision "
    "scans, published parameters, threshold 0.737, judged by the rule of the paper"
)
T = TypeVar("T")
_STORED: dict[str, Any] = yaml.safe_load(
    Path(__file__).with_name("published.yaml").read_text(encoding="utf-8")
)
WORLDS: tuple[str, ...] = tuple(_STORED["worlds"])


@dataclass(frozen=True)
class PublishedViews:
    """Published figures of one method in one world.

    Attributes:
        world: from ``WORLDS``.
        method: "first stage", "both stages" or "RatSLAM".
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


def _build(kind: Callable[..., T], part: str) -> tuple[T, ...]:
    """Build one value per row and world of a part of ``published.yaml``."""
    return tuple(
        kind(world, name, **{figure: values[column] for figure, values in figures.items()})
        for name, figures in _STORED[part].items()
        for column, world in enumerate(WORLDS)
    )


PUBLISHED_VIEWS = _build(PublishedViews, "published")
"""Tables 5.2 to 5.5."""
RERUN_VIEWS = _build(RerunViews, "rerun")
"""Figures measured again, which show what the published ones really mean."""
RERUN_DESCRIPTORS = _build(RerunDescriptor, "descriptors")
"""The first thesis's descriptor (c-M2DP) in the second thesis's worlds."""


def world_of(name: str) -> str | None:
    """Return the thesis's world that a recording is named after ("house" for "small_house").

    None if there is none.
    """
    plain = name.strip().lower().replace("-", "_").removeprefix("small_")
    return plain if plain in WORLDS else None


@checked
def published_views(name: str) -> tuple[PublishedViews, ...]:
    """Return the published figures of a world, one per method; none for other worlds."""
    world = world_of(name)
    return tuple(figures for figures in PUBLISHED_VIEWS if figures.world == world)


@checked
def rerun_views(name: str) -> tuple[RerunViews, ...]:
    """Return the figures measured again in a world; none if there are none."""
    world = world_of(name)
    return tuple(figures for figures in RERUN_VIEWS if figures.world == world)


@checked
def rerun_descriptors(name: str) -> tuple[RerunDescriptor, ...]:
    """Return the figures of c-M2DP in a world; none if not measured."""
    world = world_of(name)
    return tuple(figures for figures in RERUN_DESCRIPTORS if figures.world == world)
