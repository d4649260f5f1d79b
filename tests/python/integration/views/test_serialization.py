# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Views that go to another process as bytes, which must change nothing."""

import zlib
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from clouds import load_made
from fusionslam.descriptors import DescriptorConfig
from fusionslam.errors import DataError
from fusionslam.sensors.frame import Cloud
from fusionslam.views.comparison import Comparison, View
from fusionslam.views.match import NO_VIEW, ViewMatch
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.recognisers import ViewMatcherConfig
from fusionslam.views.scenes import build_scene, scene_from_arrays, scene_to_arrays
from fusionslam.views.serialization import FORMAT, view_from_bytes, view_to_bytes
from refusals import refuses
from rows import rows
from scenes import NOTHING, MeanColor, config_of, matcher, place, two_stages

LINE = Cloud(np.arange(90, dtype=np.float32).reshape(-1, 3) * [1, 0, 0], np.zeros((30, 3), "u1"))
KINDS: dict[str, dict[str, Any]] = {
    "alignment": {},
    "objects": {"method": "objects"},
    "objects with images": {"method": "objects", "scene": {"image": True}},
    "paper": {"preset": "paper", "min_objects": 0},
    "author": {"preset": "author"},
    "cm2dp": {"method": "cm2dp"},
    "m2dp": {"method": "m2dp", "policy": "several"},
}
TWO_STAGES = "two stages"


def make(kind: str) -> ViewMatcher:
    return two_stages(MeanColor()) if kind == TWO_STAGES else matcher(**KINDS[kind])


def send(builder: Comparison, one: ViewMatcher, clouds: list[Cloud]) -> list[ViewMatch]:
    """What a matcher says of views that another comparison made and that came as bytes."""
    taken = [view_to_bytes(builder, builder.view(cloud)) for cloud in clouds]
    return [one.process(view_from_bytes(one.comparison, data)) for data in taken]


@cache
def make_clouds() -> list[Cloud]:
    few = Cloud(place(0).points[:3], place(0).colors[:3])
    visits = [
        NOTHING if n < 0 else place(n, visit) for visit, n in enumerate((0, 1, 2, 0, -1, 1, 3))
    ]
    return [NOTHING, *visits, LINE, few, place(9, objects=1)]


@cache
def view_bytes(kind: str) -> bytes:
    """Of the first place."""
    compares = make(kind).comparison
    return view_to_bytes(compares, compares.view(place(0)))


@rows("kind", [*KINDS, TWO_STAGES])
def test_views_sent_as_bytes_are_recognised_as_their_clouds_are(kind: str, tmp_path: Path) -> None:
    straight, distant = make(kind), make(kind)
    expected = [straight.process(cloud) for cloud in make_clouds()]
    assert send(make(kind).comparison, distant, make_clouds()) == expected
    assert {match.is_new for match in expected} == {True, False}
    assert straight.stats == distant.stats
    distant.save(tmp_path / "views")
    fresh = make(kind).comparison if kind == TWO_STAGES else None
    again = ViewMatcher.load(tmp_path / "views", comparison=fresh)
    expected = [straight.process(cloud) for cloud in make_clouds()]
    assert send(make(kind).comparison, again, make_clouds()) == expected


@rows("kind", ["alignment", "objects with images", "paper", "cm2dp"])
def test_views_of_simulated_scans_sent_as_bytes_are_recognised(kind: str) -> None:
    scans = [load_made(name) for name in ("house_000", "house_006", "house_016", "town_040")]
    # Every other point is a visit of its own.
    clouds = [Cloud(points[k::2], colors[k::2]) for k in range(2) for points, colors in scans]
    straight, distant = make(kind), make(kind)
    expected = [straight.process(cloud) for cloud in clouds]
    assert send(make(kind).comparison, distant, clouds) == expected
    assert any(not match.is_new for match in expected) and straight.stats == distant.stats


def test_the_shipped_second_stage_is_told_the_same() -> None:
    pytest.importorskip("onnxruntime")
    config = ViewMatcherConfig(second_stage="places")
    straight, distant = ViewMatcher(config), ViewMatcher(config)
    expected = [straight.process(cloud) for cloud in make_clouds()]
    assert send(ViewMatcher(config).comparison, distant, make_clouds()) == expected
    short = two_stages(MeanColor()).comparison  # has three features
    data = view_to_bytes(short, short.view(place(0)))
    with refuses("other-settings", "comparison"):
        view_from_bytes(distant.comparison, data)


def test_scenes_come_back_as_they_were_with_boxes_and_image() -> None:
    for cloud in make_clouds():
        scene = build_scene(cloud.points, cloud.colors)
        assert scene_from_arrays(scene_to_arrays(scene)) == scene


@rows("kind", ["alignment", TWO_STAGES, "cm2dp"])
def test_a_view_tells_the_objects_it_was_made_of(kind: str) -> None:
    compares, cloud = make(kind).comparison, place(2)
    scene = compares.scene(compares.view(cloud))
    assert scene == (None if kind == "cm2dp" else build_scene(cloud.points, cloud.colors))


def test_equal_views_have_equal_bytes() -> None:
    compares = make("alignment").comparison
    assert view_to_bytes(compares, compares.view(place(0))) == view_bytes("alignment")


@rows("kind", ["alignment", "cm2dp", TWO_STAGES])
def test_bytes_that_are_cut_or_damaged_are_refused(kind: str) -> None:
    compares, random = make(kind).comparison, np.random.default_rng(3)
    whole, begun = view_bytes(kind), len(FORMAT)
    wrong = [whole[:size] for size in (0, 1, begun, begun + 4, *range(0, len(whole), 99))]
    for spot in random.integers(0, len(whole), 150).tolist():
        damaged = bytearray(whole)
        damaged[spot] ^= int(random.integers(1, 256))
        wrong.append(bytes(damaged))
    for content in (*wrong, whole[:-1]):
        with pytest.raises(DataError):
            view_from_bytes(compares, content)
    for other in (b"a text", b"fusionslam.view.2\n" + whole[begun:]):
        with pytest.raises(DataError, match=r"fusionslam\.view\.1"):
            view_from_bytes(compares, other)


def with_sum(content: bytes) -> bytes:
    return FORMAT + zlib.crc32(content).to_bytes(4, "little") + content


def test_contents_that_others_wrote_never_crash_it() -> None:
    compares, random = make("alignment").comparison, np.random.default_rng(5)
    whole = view_bytes("alignment")[len(FORMAT) + 4 :]
    refused = 0
    for number in range(500):
        foreign = bytearray(whole[: len(whole) - (number % 3 == 0) * int(random.integers(1, 99))])
        for spot in random.integers(-600 if number % 2 else -len(foreign), 0, 2).tolist():
            foreign[spot] = int(random.integers(256))
        try:
            view_from_bytes(compares, with_sum(bytes(foreign)))
        except DataError:
            refused += 1
    assert refused > 330
    with pytest.raises(DataError):
        view_from_bytes(compares, with_sum(b""))


class Sends:
    """A comparison whose views are whatever arrays they are said to be."""

    def __init__(self, kind: str, arrays: dict[str, Any], about: dict[str, Any]) -> None:
        self.kind, self.arrays, self.about = kind, arrays, about

    def settings(self) -> dict[str, Any]:
        return self.about

    def arrays_of(self, view: View) -> dict[str, Any]:
        return self.arrays


def refusal(kind: str, change: dict[str, Any]) -> str:
    """Why a matcher refuses a view's arrays once they were changed; None takes one out."""
    compares = make(kind).comparison
    arrays = {**compares.arrays_of(compares.view(place(0))), **change}
    left = {name: array for name, array in arrays.items() if array is not None}
    sender: Any = Sends(compares.kind, left, compares.settings())
    with pytest.raises(DataError) as caught:
        view_from_bytes(compares, view_to_bytes(sender, View(None, 0)))
    return str(caught.value)


def change_field(name: str, field: str, value: float) -> dict[str, Any]:
    cloud = place(0)
    array = scene_to_arrays(build_scene(cloud.points, cloud.colors))[name].copy()
    array[field][0] = value
    return {name: array}


@rows(
    "kind, change, words",
    [
        ("alignment", {"objects": None}, "objects"),
        ("alignment", change_field("objects", "volume", np.nan), "volume"),
        ("alignment", change_field("objects", "center", np.inf), "center"),
        ("alignment", change_field("objects", "points", 0), "points"),
        ("alignment", change_field("cells", "column", 9999), "cell"),
        ("alignment", {"cells": np.zeros(3)}, "float64 (3,)"),
        ("alignment", {"directions": np.full(5, np.nan, np.float32)}, "directions"),
        ("alignment", {"directions": np.zeros(4, np.float32)}, "directions"),
        ("alignment", {"directions": np.zeros(5, np.float32)}, "0.0"),
        ("cm2dp", {"descriptor": None}, "descriptor"),
        ("cm2dp", {"descriptor": np.zeros(192, np.float32)}, "(192,)"),
        ("cm2dp", {"descriptor": np.zeros(576)}, "float64"),
        ("cm2dp", {"descriptor": np.full(576, np.inf, np.float32)}, "finite"),
        (TWO_STAGES, {"features": np.array([1, np.nan, 2], np.float32)}, "finite"),
        (TWO_STAGES, {"features": np.zeros((1, 3), np.float32)}, "float32 (1, 3)"),
        (TWO_STAGES, {"features": None}, "features"),
    ],
)
def test_arrays_of_no_cloud_are_refused(kind: str, change: dict[str, Any], words: str) -> None:
    assert words in refusal(kind, change)


def test_features_of_nothing_are_refused() -> None:
    compares = make(TWO_STAGES).comparison
    arrays = compares.arrays_of(compares.view(NOTHING))
    assert "features (3,)" in refusal(TWO_STAGES, arrays | {"features": np.zeros(3)})


@rows(
    "one, other, setting",
    [
        ({}, {"method": "cm2dp"}, "comparison"),
        ({"scene": {"azimuth_step": 2.0}}, {}, "scene.azimuth_step"),
        ({"method": "m2dp"}, {"method": "cm2dp"}, "comparison"),
        ({"second_stage": "thesis"}, {"second_stage": "places"}, "second_stage"),
    ],
)
def test_views_that_were_made_otherwise_are_refused(one: Any, other: Any, setting: str) -> None:
    pytest.importorskip("onnxruntime")
    builder, taker = (matcher(**values).comparison for values in (one, other))
    data = view_to_bytes(builder, builder.view(place(0)))
    with refuses("other-settings", setting):
        view_from_bytes(taker, data)


@rows("kind, objects", [("alignment", 3), ("cm2dp", 1)])
def test_settings_that_only_the_matcher_needs_may_differ(kind: str, objects: int) -> None:
    values = {**KINDS[kind], "threshold": 0.5, "min_objects": 4, "policy": "several"}
    taker = ViewMatcher(config_of(**values), descriptors=DescriptorConfig(threads=2))
    view = view_from_bytes(taker.comparison, view_bytes(kind))
    assert taker.process(view).id == NO_VIEW and view.objects == objects


@rows("text", [b"{", b"[1]", b"\xff", b""])
def test_views_that_do_not_say_how_they_were_made_are_refused(text: bytes) -> None:
    assert refusal("alignment", {"about": np.frombuffer(text, np.uint8)})
