# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Similarity of scenes: as in the original program, and one scene against many."""

import json
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from clouds import MADE, load_made
from fusionslam.errors import ConfigError, DataError
from fusionslam.views import (
    Scene,
    SceneIndex,
    SimilarityConfig,
    build_scene,
    dbscan,
    scene_similarity,
)
from rows import rows
from scenes import EMPTY_SCENE, many_scenes, random_scene

PRESETS = ("robust", "paper", "author")


def test_the_same_place_is_more_like_itself_than_others_under_every_preset() -> None:
    names = ("house_000", "house_006", "house_016", "house_112")
    same = np.eye(4, dtype=bool)
    same[2:, 2:] = True  # two visits of one place
    scenes = [build_scene(*load_made(name)) for name in names]
    for preset in PRESETS:
        found = np.array([[scene_similarity(a, b, preset=preset) for b in scenes] for a in scenes])
        assert found[same].min() > found[~same].max() + 0.1


def test_our_scenes_are_exactly_like_themselves_and_published_ones_are_not() -> None:
    for scene in many_scenes(20, 8):
        if len(scene):
            assert scene_similarity(scene, scene) == pytest.approx(1, abs=1e-14)
            assert scene_similarity(scene, scene, preset="author") == pytest.approx(
                0.8614, abs=1e-4
            )


@rows("preset", PRESETS)
def test_one_against_many_is_what_pairs_give(preset: str) -> None:
    scenes = many_scenes(80, 14)
    index = index_of(scenes, preset=preset)
    assert len(index) == 80
    for current in scenes[::9]:
        pairs = [scene_similarity(current, stored, preset=preset) for stored in scenes]
        np.testing.assert_allclose(index.similarities(current), pairs, rtol=0, atol=1e-6)


def index_of(scenes: Iterable[Scene], **options: Any) -> SceneIndex:
    index = SceneIndex(**options)
    for scene in scenes:
        index.add(scene)
    return index


def test_similarities_do_not_depend_on_the_number_of_threads() -> None:
    scenes = many_scenes(600, 5)
    index = index_of(scenes)
    alone = index.similarities(scenes[3])
    for threads in (0, 2, 5):
        np.testing.assert_array_equal(index.similarities(scenes[3], threads=threads), alone)


def test_an_index_without_scenes_answers_with_nothing() -> None:
    found = SceneIndex().similarities(many_scenes(1, 3, seed=2)[0])
    assert found.shape == (0,) and found.dtype == np.float64


@rows("preset", PRESETS)
def test_an_empty_scene_is_like_an_empty_one_only(preset: str) -> None:
    scene = random_scene(0, 3)
    index = index_of([EMPTY_SCENE, scene], preset=preset)
    assert index.similarities(EMPTY_SCENE).tolist() == [1, 0]
    assert index.similarities(scene)[0] == 0
    assert scene_similarity(EMPTY_SCENE, EMPTY_SCENE, preset=preset) == 1
    assert scene_similarity(scene, EMPTY_SCENE, preset=preset) == 0


def test_replaced_and_removed_scenes_are_gone() -> None:
    first, second, third = (random_scene(seed, 4) for seed in range(3))
    index = index_of([first, second])
    index.replace(0, third)
    assert index.similarities(third)[0] == pytest.approx(1, abs=1e-6)
    index.remove(0)
    assert len(index) == 1
    assert index.similarities(second) == pytest.approx([1], abs=1e-6)


@rows("number", [-1, 2])
def test_scenes_that_are_not_stored_cannot_be_replaced_or_removed(number: int) -> None:
    index = index_of(many_scenes(2, 3))
    for change in (lambda: index.remove(number), lambda: index.replace(number, EMPTY_SCENE)):
        with pytest.raises(ConfigError, match=f"{number}"):
            change()


def test_threads_may_share_an_index() -> None:
    scenes = many_scenes(300, 6)
    index = index_of(scenes[:100])
    with ThreadPoolExecutor(3) as pool:
        asked = [pool.submit(index.similarities, scenes[0]) for _ in range(150)]
        for scene in scenes[100:]:
            index.add(scene)
    whole = index.similarities(scenes[0])
    for each in asked:
        np.testing.assert_array_equal(each.result(), whole[: len(each.result())])


def test_a_similar_colour_matters_more_under_ours_than_under_the_published_weights() -> None:
    scene = random_scene(4, 1)
    objects = scene.objects.copy()
    objects["color"] = 255 - objects["color"]
    lost = {
        preset: scene_similarity(scene, scene, preset=preset)
        - scene_similarity(scene, Scene(objects), preset=preset)
        for preset in PRESETS
    }
    assert lost["robust"] > 0.2
    assert max(lost["paper"], lost["author"]) < 0.03


def test_the_same_shift_weighs_less_far_away_than_near() -> None:
    objects = random_scene(5, 1).objects.copy()
    found = []
    for x in (1.0, 8.0):
        objects["center"] = [x, 0, 1]
        stored = Scene(objects)
        objects["center"] += [0, 0.5, 0]
        found.append(scene_similarity(Scene(objects), stored))
    assert found[0] + 0.1 < found[1] < 1


def test_distances_shrink_with_the_range_of_the_nearer_object() -> None:
    config = SimilarityConfig(
        color_weight=0, volume_weight=0, ratio_weight=0, extent_weight=0, distance_weight=1
    )
    x0, a = config.distance_x0, config.distance_a
    for near, far in ((4.0, 4.3), (6.0, 5.4), (0.0, 0.5)):
        pair = []
        for x in (near, far):
            objects = random_scene(1, 1).objects.copy()
            objects["center"] = [[0.6 * x, 0.8 * x, 1]]
            pair.append(Scene(objects))
        distance = abs(far - near) / (1 + config.range_slack * min(near, far))
        expected = (1 + np.exp(-a * x0)) / (1 + np.exp(a * (distance - x0)))
        assert scene_similarity(*pair, config=config) == pytest.approx(expected, rel=1e-6)


def test_weights_that_are_all_0_are_refused() -> None:
    config = SimilarityConfig(color_weight=0, distance_weight=0, extent_weight=0)
    for use in (
        lambda: scene_similarity(EMPTY_SCENE, EMPTY_SCENE, config=config),
        lambda: SceneIndex(config),
    ):
        with pytest.raises(ConfigError, match="color_weight"):
            use()


@rows(
    "options, words",
    [
        ({"color_weight": -1}, r"color_weight .*-1"),
        ({"distance_a": float("nan")}, r"distance_a .*\bnan"),
        ({"color_difference": "cie94"}, "cie76, ciede2000, rgb, author"),
        ({"weight": 1}, "no option 'weight'"),
        ({"preset": "best"}, "paper, author, robust"),
    ],
)
def test_configurations_out_of_range_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        SimilarityConfig(**options)


def test_objects_of_impossible_colour_are_refused() -> None:
    objects = random_scene(6, 2).objects.copy()
    objects["color"][1] = [0, 300, 0]
    scene, index = Scene(objects), SceneIndex()
    for use in (lambda: scene_similarity(scene, EMPTY_SCENE), lambda: index.add(scene)):
        with pytest.raises(DataError, match=r"object 1.*color"):
            use()
    with pytest.raises(DataError, match=r"object 1.*color"):
        index.similarities(scene)


def test_objects_that_are_not_finite_make_no_scene() -> None:
    objects = random_scene(7, 2).objects.copy()
    objects["center"][0] = np.nan
    with pytest.raises(DataError, match="center"):
        Scene(objects)


STORED: dict[str, Any] = json.loads((MADE / "views_author.json").read_text(encoding="utf-8"))
SCENES: dict[str, list[dict[str, Any]]] = {
    scene["cloud"]: scene["description"] for scene in STORED["scenes"]
}


@rows("name", SCENES)
def test_clusters_are_those_of_the_authors_program(name: str) -> None:
    with np.load(MADE / "views_author.npz") as file:
        theirs = file[f"{name}_labels"].astype(int) - 1  # 0 is noise there, -1 here
    ours = dbscan(*load_made(name), eps=STORED["eps"], min_points=STORED["min_points"])
    assert np.array_equal(ours < 0, theirs < 0)
    pairs = set(zip(ours.tolist(), theirs.tolist(), strict=True))
    assert len(pairs) == len(set(theirs.tolist())) == len(set(ours.tolist()))


@rows("name", SCENES)
def test_objects_are_those_of_the_authors_program(name: str) -> None:
    scene = build_scene(*load_made(name), preset="author")
    theirs = {tuple(entry["center"]): entry for entry in SCENES[name]}
    assert {tuple(ours["center"].tolist()) for ours in scene.objects} == set(theirs)
    for ours in scene.objects:
        entry = theirs[tuple(ours["center"].tolist())]
        assert bytes(ours["color"].astype(np.uint8)).hex() == entry["color"][2:]
        assert ours["points"] == entry["cluster_size"]
        assert ours["volume"] == pytest.approx(entry["volume"], rel=1e-6)
        assert ours["area"] == pytest.approx(entry["area"], rel=1e-6)
        assert np.array_equal(ours["box_max"] - ours["box_min"], entry["boundary_size"])


def test_the_author_preset_holds_the_parameters_of_his_program() -> None:
    config = SimilarityConfig(preset="author")
    terms = ("color", "distance", "volume", "ratio")
    held = [getattr(config, f"{t}_{part}") for t in terms for part in ("x0", "a", "weight")]
    assert held == STORED["params"]


def test_similarities_are_those_of_the_authors_program() -> None:
    scenes = [build_scene(*load_made(name), preset="author") for name in SCENES]
    found = [[scene_similarity(a, b, preset="author") for b in scenes] for a in scenes]
    np.testing.assert_allclose(found, STORED["similarity"], rtol=0, atol=1e-9)
