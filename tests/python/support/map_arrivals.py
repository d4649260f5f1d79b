# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Odometry and given views as a robot's map gets them: in two streams that overtake each other."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fusionslam.ratslam import GivenView, Look, Motion, OnlineRatSlam, RatSlam, Sighting, Step
from fusionslam.ratslam.events import Event
from fusionslam.sensors.messages import Odometry
from slam_drives import everything

Message = Odometry | Motion | Look


def given(sightings: Iterable[Sighting]) -> list[Look]:
    """As the process that recognised them tells them."""
    known: set[int] = set()
    looks = []
    for one in sightings:
        is_new = one.view_id >= 0 and one.view_id not in known
        known.add(one.view_id)
        values = (one.relative_rotation, one.relative_place, one.reason)
        looks.append(Look(one.stamp_ns, GivenView(one.view_id, is_new, *values)))
    return looks


def told(events: Iterable[Event]) -> list[Message]:
    """Sightings as looks, in place."""
    kept = list(events)
    looks = iter(given(one for one in kept if isinstance(one, Sighting)))
    return [next(looks) if isinstance(one, Sighting) else one for one in kept]  # type: ignore[misc]


def arrived(
    odometry: Sequence[Message],
    looks: Sequence[Message],
    seed: int,
    *,
    lag_s: float = 0.1,
    jitter_s: float = 0.0,
) -> list[Message]:
    """Both streams, each in its order, by when they arrive.

    Args:
        odometry, looks: in the order of stamps.
        seed: of the delays.
        lag_s: how much later than odometry views arrive.
        jitter_s: how much later, at most, than that any message arrives.
    """
    rng = np.random.default_rng(seed)
    due = []
    for stream, lag in ((odometry, 0.0), (looks, lag_s)):
        stamps = np.array([one.stamp_ns for one in stream], np.float64)
        delayed = stamps + 1e9 * (lag + rng.uniform(0, jitter_s, len(stream)))
        due.append(np.maximum.accumulate(delayed))  # TCP keeps the order
    order = np.argsort(np.concatenate(due), kind="stable")
    both = [*odometry, *looks]
    return [both[k] for k in order]


def processed(online: OnlineRatSlam, messages: Iterable[Any]) -> list[Step]:
    return [step for message in messages for step in online.process(message)]


def all_of(online: OnlineRatSlam, messages: Iterable[Any]) -> list[Step]:
    return processed(online, messages) + online.flush()


def on_map(slam: RatSlam) -> dict[str, Any]:
    """As ``everything``, but for the source of views."""
    return everything(slam) | {"views": None}


def later(messages: Iterable[Message], seconds: float) -> list[Message]:
    """The same with other stamps."""
    shift = round(seconds * 1e9)
    return [replace(one, stamp_ns=one.stamp_ns + shift) for one in messages]
