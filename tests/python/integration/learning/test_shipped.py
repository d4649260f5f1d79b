# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The networks that come with the package: size, cards, ONNX against torch, and what they do."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from error_codes import has_code
from fusionslam.errors import DataError
from fusionslam.learning.places import PairConfig, Places, Sights, make_pairs, same_places
from fusionslam.sensors.frame import Cloud
from fusionslam.views.second_stage import MODELS, SecondStage
from fusionslam.views.second_stage.inputs import network_input
from fusionslam.views.second_stage.network_files import SHIPPED, check_digest
from fusionslam.views.second_stage.scores import area_under_curve
from learning import cloud, simulated_places
from refusals import refuses
from rows import rows
from stored import change_json

pytest.importorskip("onnxruntime", reason="onnxruntime is not installed")

STEMS = [Path(name).stem for names in MODELS.values() for name in names if name]


@rows("stem", STEMS)
def test_each_network_is_below_a_megabyte_and_has_a_card(stem: str) -> None:
    for suffix in ("safetensors", "onnx"):
        assert 0 < (SHIPPED / f"{stem}.{suffix}").stat().st_size < 1_000_000
    card = json.loads((SHIPPED / f"{stem}.json").read_text())
    assert card["command"].startswith("fusionslam views train ")
    assert card["data"] and card["cpu_seconds"] > 0 and card["scores"]
    assert card["config"]["optimiser"]["seed"] == 0


@rows("stem", STEMS)
@rows("suffix", ["onnx", "safetensors"])
def test_a_changed_bit_is_noticed(stem: str, suffix: str, tmp_path: Path) -> None:
    for path in SHIPPED.glob(f"{stem}.*"):
        shutil.copy(path, tmp_path)
    path = tmp_path / f"{stem}.{suffix}"
    check_digest(path)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    with pytest.raises(DataError, check=has_code("wrong-digest", path)):
        check_digest(path)
    if suffix == "onnx" and stem.endswith("features"):
        with pytest.raises(DataError, check=has_code("wrong-digest", path)):
            SecondStage(path, tmp_path / path.name)
    change_json(tmp_path / f"{stem}.json", sha256={})
    check_digest(path)


def test_nothing_else_is_shipped() -> None:
    found = {path.name for path in SHIPPED.iterdir()}
    assert found == {f"{stem}.{end}" for stem in STEMS for end in ("safetensors", "onnx", "json")}


@rows("model", MODELS)
def test_shipped_onnx_gives_what_the_shipped_weights_give(model: str) -> None:
    torch = pytest.importorskip("torch", reason="torch is not installed")
    pytest.importorskip("safetensors", reason="safetensors is not installed")
    from fusionslam.learning.weight_files import load_pointnet

    stage = SecondStage(model)
    network, about = load_pointnet((SHIPPED / MODELS[model][0]).with_suffix(".safetensors"))
    assert about.architecture == stage.config and stage.config.features == 256
    seen, config = cloud(2000, 5), stage.config
    taken = network_input(seen.points, seen.colors, config)
    with torch.no_grad():
        expected = network(torch.from_numpy(taken)[None])[0][0].numpy()
    np.testing.assert_allclose(stage.features(seen), expected, atol=1e-5)


@rows("model", MODELS)
def test_features_are_a_kilobyte_and_repeat_bit_for_bit(model: str) -> None:
    seen, stage = cloud(700, 1), SecondStage(model)
    first, again = stage.features(seen), SecondStage(model).features(seen.points, seen.colors)
    assert first.nbytes == 1024
    np.testing.assert_array_equal(first, again)


def test_places_looks_at_colours_and_thesis_does_not() -> None:
    seen = cloud(300, 2)
    assert seen.colors is not None
    grey = Cloud(seen.points, np.full_like(seen.colors, 128))
    thesis, places = SecondStage("thesis"), SecondStage("places")
    np.testing.assert_array_equal(thesis.features(seen), thesis.features(Cloud(seen.points)))
    assert np.abs(places.features(seen) - places.features(grey)).max() > 0.01
    with refuses("no-colors"):
        places.features(Cloud(seen.points))


def test_a_sight_is_the_same_place_as_itself() -> None:
    stage = SecondStage("places")
    row = stage.features(cloud(800, 3))
    assert stage.probability(row, row) > 0.9


@pytest.fixture(scope="session")
def unknown_places() -> Places:
    """Of a world that no network was trained on."""
    pytest.importorskip("embreex", reason="the simulator is not installed")
    return Places.of([simulated_places(seed=900, places=16, sights=5)])


WAREHOUSE: dict[str, Any] = {"seed": 3, "kinds": ("warehouse",), "places": 3, "sights": 3}


@pytest.fixture(scope="session")
def warehouse() -> Sights:
    pytest.importorskip("embreex", reason="the simulator is not installed")
    return simulated_places(**WAREHOUSE)


@rows("model, least", [("places", 0.95), ("thesis", 0.85)])
def test_unknown_places_are_told_apart(model: str, least: float, unknown_places: Places) -> None:
    places = unknown_places
    stage, everything = SecondStage(model), range(len(places))
    table = np.stack([stage.features(places[index]) for index in everything])
    first, second = np.triu_indices(len(places), 1)
    scores = np.stack([stage.probabilities(row, table) for row in table])[first, second]
    same, _ = same_places(places, first, second)
    assert area_under_curve(scores, same) > least


@pytest.mark.slow
def test_simulated_places_repeat_with_their_seed(warehouse: Sights) -> None:
    from fusionslam.learning.simulated_places import SimulatedPlacesConfig, simulate_places

    name, clouds, poses = warehouse
    config = SimulatedPlacesConfig(worlds=1, **WAREHOUSE)
    _, again, _ = next(simulate_places(config))
    assert name == "warehouse_0" and poses is not None and len(clouds) == len(poses)
    places = Places.of([(name, clouds, poses)])
    assert make_pairs(places, PairConfig(), np.random.default_rng(0)).same.any()
    for one, other in zip(clouds, again, strict=True):
        np.testing.assert_array_equal(one.points, other.points)
        np.testing.assert_array_equal(one.colors, other.colors)
        assert len(one) >= config.least and (one.points[:, 2] > 0.1).all()
        # The sector looks forward.
        assert (np.abs(np.arctan2(one.points[:, 1], one.points[:, 0] + 0.064)) < 0.56).all()
        assert one.colors is not None and np.ptp(one.colors) > 20
