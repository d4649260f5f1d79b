# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""views train: shapes, places and comparison from the command line."""

import json
import re
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cli
from artefacts import artefact, copy_artefact
from error_codes import has_code
from fusionslam.cli.views_train import app
from fusionslam.errors import ConfigError, DataError
from fusionslam.views.scene_set import CloudArray, SceneSet
from fusionslam.views.second_stage import SecondStage
from learning import cloud, world
from rows import rows
from scenes import LAPS, write_recording

for module in ("torch", "safetensors", "onnx", "h5py", "onnxruntime"):
    pytest.importorskip(module, reason=f"{module} is not installed")

NETWORK = ("transform_points=[8,16]", "transform_head=[8]", "points=[8,16,32]")
SHAPES = ("procedural.train=1", "procedural.test=1", "procedural.points=32", "points=24")
PLACES = ("train.worlds=1", "train.places=5", "judged.worlds=1", "judged.places=4")


def tiny(*more: str) -> list[str]:
    return cli.settings(*(f"network.{text}" for text in NETWORK), "optimiser.epochs=2", *more)


run = partial(cli.run, command=app)
succeeds = partial(cli.succeeds, command=app)


@pytest.fixture(scope="module")
def features() -> Path:
    return artefact(
        "cli-shapes", lambda folder: succeeds("shapes", "-o", folder, *tiny(*SHAPES, "batch=8"))
    )


def test_shapes_leaves_weights_onnx_card_and_curves(features: Path) -> None:
    names = {path.name for path in features.iterdir()}
    assert {"features.safetensors", "features.onnx", "features.json"} <= names
    assert {"curves.csv", "curves.png", "checkpoint.pt"} <= names
    card = json.loads((features / "features.json").read_text())
    assert card["data"] == "procedural" and card["config"]["optimiser"]["seed"] == 0
    assert card["command"].startswith("fusionslam") and card["cpu_seconds"] >= 0
    rows = cli.table(features / "curves.csv")
    assert [row["epoch"] for row in rows] == ["1.0", "2.0"]
    assert card["scores"]["accuracy"] == pytest.approx(float(rows[-1]["accuracy"]), abs=1e-6)


def test_a_finished_training_stays_and_other_seeds_fail(features: Path, tmp_path: Path) -> None:
    folder = copy_artefact(features, tmp_path / "shapes")
    before = (features / "features.safetensors").read_bytes()
    result = succeeds("shapes", "-o", folder, *tiny(*SHAPES, "batch=8"))
    assert "2 epochs" in result.stdout
    assert (folder / "features.safetensors").read_bytes() == before
    result = run("shapes", "-o", folder, *tiny(*SHAPES, "batch=8", "optimiser.seed=3"))
    assert isinstance(result.exception, ConfigError)
    assert re.search(r"optimiser\.seed .*\b0\b.*\b3\b", str(result.exception))


@pytest.mark.slow
def test_places_are_simulated_once_and_trained_on(tmp_path: Path) -> None:
    pytest.importorskip("embreex", reason="the simulator is not installed")
    worlds = [f"simulated.{text}" for text in PLACES]
    small = ("network.embedding=16", "batch=4", "batches=2", "points=32", "worlds=1")
    succeeds("places", "-o", tmp_path, *tiny(*worlds, *small))
    first = {path.name: path.stat().st_mtime_ns for path in tmp_path.glob("*.npz")}
    assert set(first) == {"train.npz", "judged.npz"}
    succeeds("places", "-o", tmp_path, *tiny(*worlds, *small))
    assert {path.name: path.stat().st_mtime_ns for path in tmp_path.glob("*.npz")} == first
    card = json.loads((tmp_path / "features.json").read_text())
    assert card["data"] == "simulated" and 0 <= card["scores"]["auc"] <= 1
    assert card["config"]["simulated"]["train"]["worlds"] == 1


def test_simulated_places_of_other_settings_or_damaged_are_refused(tmp_path: Path) -> None:
    from fusionslam.learning.simulated_places import SimulatedPlacesConfig
    from fusionslam.learning.training_data import load_simulated_places

    path = tmp_path / "train.npz"
    names = ("points", "colors", "offsets", "poses", "worlds", "names")
    about = np.array('{"format": "fusionslam.places.1"}')
    np.savez(path, about=about, **{name: np.zeros(1) for name in names})
    with pytest.raises(ConfigError, check=has_code("other-settings", path)):
        load_simulated_places(SimulatedPlacesConfig(), path)
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(DataError, check=has_code("damaged-file", path)):
        load_simulated_places(SimulatedPlacesConfig(), path)


@rows("command", ["shapes", "places"])
def test_all_values_are_printed_as_yaml_that_is_read_back(command: str, tmp_path: Path) -> None:
    text = succeeds(command, "-o", tmp_path / "none", "--print-config").stdout
    assert "seed: 0" in text and not (tmp_path / "none").exists()
    file = tmp_path / "values.yaml"
    file.write_text(text.replace("learning_rate: 0.001", "learning_rate: 0.002"))
    again = succeeds(command, "-o", tmp_path / "none", "--config", file, "--print-config").stdout
    assert again == file.read_text()
    result = run(command, "-o", tmp_path, "--set", "optimiser.epoch=3")
    assert isinstance(result.exception, ConfigError) and "epochs" in str(result.exception)


def scene_set(path: Path, name: str, *, frame: str = "robot", truth: bool = True) -> Path:
    """A scene set of a made-up world."""
    _, clouds, poses = world(name, 3)
    count = len(clouds)
    SceneSet(
        name=name,
        stamps_ns=np.arange(count) * 10**9,
        numbers=np.arange(count),
        empty=np.zeros(count, bool),
        frame=frame,
        poses=poses if truth else None,
        clouds=CloudArray.of(clouds),
    ).save(path)
    return path


def compared(features: Path, *paths: Path) -> list[object]:
    weights = features / "features.safetensors"
    small = cli.settings("network.features=32", "network.hidden=8", "optimiser.epochs=2")
    return ["comparison", *paths, "--features", weights, *small]


def test_a_comparison_is_trained_on_scene_sets(features: Path, tmp_path: Path) -> None:
    paths = [scene_set(tmp_path / f"{name}.npz", name) for name in ("hall", "shop")]
    result = succeeds(*compared(features, *paths), "-o", tmp_path / "out")
    assert "2 epochs" in result.stdout
    card = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert card["data"] == "hall.npz, shop.npz"
    stage = SecondStage(features / "features.onnx", tmp_path / "out" / "comparison.onnx")
    row = stage.features(cloud(50, 1).points)
    assert 0 <= stage.probability(row, row) <= 1


@rows("how, words", [({"truth": False}, "no true poses"), ({"frame": "odometry"}, "odometry")])
def test_scene_sets_without_poses_or_in_another_frame_are_refused(
    features: Path, tmp_path: Path, how: dict[str, Any], words: str
) -> None:
    path = scene_set(tmp_path / "hall.npz", "hall", **how)
    result = run(*compared(features, path), "-o", tmp_path / "out")
    assert isinstance(result.exception, DataError) and words in str(result.exception)


def test_recordings_are_trained_on_as_they_are(features: Path, tmp_path: Path) -> None:
    path = tmp_path / "hall.npz"
    write_recording(path, LAPS)
    succeeds(*compared(features, path), "--shapes", "visual", "-o", tmp_path / "out")
    result = run(*compared(features, path), "--shapes", "collision", "-o", tmp_path / "out")
    assert isinstance(result.exception, DataError) and "collision" in str(result.exception)
