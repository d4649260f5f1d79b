# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Ids of views that another process gives: what they mean after it, or the map, started anew."""

import logging
from typing import Any

import numpy as np
import pytest

from fusionslam.errors import DataError
from fusionslam.ratslam import GivenView, GivenViews, Look, Motion, RatSlam
from map_arrivals import on_map, told
from slam_drives import circle_events, everything, same, take


def numbers(views: GivenViews, ids: str) -> list[int]:
    """Of ids such as "0+ 1+ 0", of which + says that one is new: the numbers on the map."""
    seen = [GivenView(int(word.rstrip("+")), word.endswith("+")) for word in ids.split()]
    return [views.look(view, k).view_id for k, view in enumerate(seen)]


@pytest.mark.parametrize(
    ("ids", "wanted", "restarts"),
    [
        ("0+ 1+ 0 -1 2+ 1 3+", [0, 1, 0, -1, 2, 1, 3], 0),
        # The matcher came back with nothing.
        ("0+ 1+ 2+ 0+ 1+ 0 2+ 3+", [0, 1, 2, 3, 4, 3, 5, 6], 1),
        # It came back with its first two views.
        ("0+ 1+ 2+ 3+ 1 2+ 0 2 3+ 1", [0, 1, 2, 3, 1, 4, 0, 4, 5, 1], 1),
        # Twice.
        ("0+ 0+ 0+ 0", [0, 1, 2, 2], 2),
        # The map began when the matcher had 57 views.
        ("56 57+ 3 56 57 58+ 3", [0, 1, 2, 0, 1, 3, 2], 2),
        # Both.
        ("9 10+ 0+ 9 10 1+", [0, 1, 2, 3, 4, 5], 5),
        # A view that it told as new was never heard of.
        ("0+ 2+ 1 1 3+", [0, 1, 2, 2, 3], 1),
    ],
)
def test_ids_mean_what_they_meant_until_somebody_starts_anew(
    ids: str, wanted: list[int], restarts: int
) -> None:
    views = GivenViews()
    assert numbers(views, ids) == wanted and views.restarts == restarts


@pytest.mark.parametrize("at", range(11))
def test_numbers_go_on_from_bytes(at: int) -> None:
    ids = ["0+", "1+", "2+", "3+", "1", "2+", "0", "7", "3+", "1", "9+"]
    whole, first, second = GivenViews(), GivenViews(), GivenViews()
    expected = numbers(whole, " ".join(ids))
    found = numbers(first, " ".join(ids[:at]))
    second.restore(first.to_bytes())
    assert found + numbers(second, " ".join(ids[at:])) == expected
    assert second.to_bytes() == whole.to_bytes()


def test_a_sighting_tells_what_was_given_and_the_number_where_it_differs() -> None:
    views = GivenViews()
    seen = views.look(GivenView(0, True, 0.5, (1.0, -2.0), "it is like nothing"), 7)
    assert (seen.stamp_ns, seen.view_id, seen.relative_rotation) == (7, 0, 0.5)
    assert (seen.relative_place, seen.reason) == ((1.0, -2.0), "it is like nothing")
    assert (
        views.look(GivenView(0, True, reason="new"), 8).reason == "new, which is view 1 of this map"
    )
    assert views.look(GivenView(0, False), 9).reason == "view 0, which is view 1 of this map"
    assert views.look(GivenView(-1, False, reason="too few points"), 10).reason == "too few points"


def test_a_restart_is_said_once_as_a_warning(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO):
        numbers(GivenViews(), "0+ 1+ 2+ 1+ 8")
    assert [(one.levelname, one.message) for one in caplog.records] == [
        ("WARNING", "view 1 is new once more: 2 views were lost; the map has it as another view"),
        ("INFO", "view 8 is of before this map began; the map has it as another view"),
    ]


@pytest.mark.parametrize("preset", ["robust", "openratslam"])
def test_without_restarts_the_map_is_that_of_sightings_to_the_last_bit(preset: str) -> None:
    events = circle_events(1.3)
    plain, through = RatSlam(preset=preset), RatSlam(preset=preset, views=GivenViews())
    assert take(through, told(events)) == take(plain, events)
    assert same(on_map(through), on_map(plain))


@pytest.mark.parametrize(
    "item",
    [
        GivenView(-2, False),
        GivenView(1, True, np.nan),
        GivenView(1, True, 0.0, (np.inf, 0.0)),
        GivenView(1, True, 0.0, (1.0,)),
        GivenView("1", True),
        GivenView(None, True),
        "0",
    ],
)
def test_what_is_no_view_is_refused_and_no_number_is_lost(item: Any) -> None:
    slam = RatSlam(views=GivenViews())
    take(slam, [Motion(0, 0.5, 0.0), Look(0, GivenView(0, True)), Motion(10**8, 0.5, 0.0)])
    before = everything(slam)
    with pytest.raises(DataError, match=r"expected|no stored"):
        slam.step(Look(2 * 10**8, item))
    assert same(everything(slam), before)
    assert slam.step(Look(2 * 10**8, GivenView(1, True))).view_id == 1


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"[]",
        b"{}",
        b"\xff\xfe",
        b'{"count": 1, "numbers": [[0, 1]]}',
        b'{"count": 1, "numbers": [[-1, 0]]}',
        b'{"count": 1, "numbers": [[0]]}',
        b'{"count": "1", "numbers": []}',
    ],
)
def test_bytes_of_something_else_are_refused_and_change_nothing(content: bytes) -> None:
    views = GivenViews()
    numbers(views, "0+ 1+")
    before = views.to_bytes()
    with pytest.raises(DataError, match="stored ids of views"):
        views.restore(content)
    assert views.to_bytes() == before
