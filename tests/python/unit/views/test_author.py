# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Clusters, objects and similarities of simulated scenes, against what Stastny's program gave.

The scenes and the outputs are in ``tests/data/made``; its README says how they came to be.
"""

import json
from typing import Any

import numpy as np
import pytest

from clouds import MADE, load_made
from fusionslam.views import SimilarityConfig, build_scene, dbscan, scene_similarity
from rows import rows

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
