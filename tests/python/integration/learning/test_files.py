# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Weights and ONNX: both hold the same network, and files that do not fit are named."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from artefacts import artefact, copy_artefact
from fusionslam.errors import DataError, ShapeError
from fusionslam.views.second_stage.architecture import PointNetConfig
from fusionslam.views.second_stage.inputs import network_input
from fusionslam.views.second_stage.model import SecondStage
from fusionslam.views.second_stage.network_files import About, Calibration
from fuzz.crafted_files import NETWORKS, write_graph
from learning import TINY, TINY_COLORED, TINY_COMPARISON, cloud
from refusals import refuses
from rows import rows
from stored import check_damaged_files

torch = pytest.importorskip("torch", reason="torch is not installed")
onnx = pytest.importorskip("onnx", reason="onnx is not installed")
pytest.importorskip("onnxruntime", reason="onnxruntime is not installed")
pytest.importorskip("safetensors", reason="safetensors is not installed")

from fusionslam.learning.onnx_export import export_comparison, export_pointnet  # noqa: E402
from fusionslam.learning.pointnet import Comparison, PointNet  # noqa: E402
from fusionslam.learning.weight_files import load_pointnet, save_weights  # noqa: E402

CALIBRATED = Calibration(4.0, 8.0)


def randomize(network: Any) -> Any:
    """As after some training: no bias, scale or mean is 0 or 1 any more."""
    generator = torch.Generator().manual_seed(3)
    for name, value in network.state_dict().items():
        if value.dtype == torch.float32:
            noise = torch.rand(value.shape, generator=generator)
            positive = name.endswith(("running_var", "scale"))
            value.copy_(0.5 + noise if positive else value + 0.4 * (noise - 0.5))
    return network.eval()


def pointnet(folder: Path, config: PointNetConfig, calibration: Calibration | None = None) -> Any:
    network = randomize(PointNet(config))
    about = About("pointnet", config, calibration)
    save_weights(folder / "features.safetensors", network, about)
    export_pointnet(folder / "features.onnx", network, about)
    return network


def comparison(folder: Path, **changes: Any) -> Any:
    config = TINY_COMPARISON.model_copy(update=changes)
    network = randomize(Comparison(config))
    save_weights(folder / "comparison.safetensors", network, About("comparison", config))
    export_comparison(folder / "comparison.onnx", network, About("comparison", config))
    return network


def make_networks(folder: Path) -> None:
    pointnet(folder, TINY, CALIBRATED)
    comparison(folder)
    for name, config, calibration in (
        ("uncalibrated", TINY, None),
        ("colored", TINY_COLORED, CALIBRATED),
    ):
        (folder / name).mkdir()
        pointnet(folder / name, config, calibration)


@pytest.fixture(scope="session")
def networks() -> Path:
    """Features with calibration, without one and of colours, and a comparison."""
    return artefact("tiny_networks", make_networks)


@pytest.fixture
def colored(networks: Path) -> SecondStage:
    return SecondStage(networks / "colored" / "features.onnx")


@rows("config", [TINY, TINY_COLORED, PointNetConfig()])
def test_onnxruntime_and_torch_give_the_same_features(
    config: PointNetConfig, tmp_path: Path
) -> None:
    network = pointnet(tmp_path, config, CALIBRATED)
    stage = SecondStage(tmp_path / "features.onnx")
    for size in (1, 7, 2000):
        seen = cloud(size, size)
        found = stage.features(seen.points, seen.colors)
        taken = network_input(seen.points, seen.colors, config)
        with torch.no_grad():
            expected = network(torch.from_numpy(taken)[None])[0][0].numpy()
        assert found.shape == (config.features,) and found.dtype == np.float32
        np.testing.assert_allclose(found, expected, atol=1e-5 * max(1, np.abs(expected).max()))
        assert expected.std() > 1e-3


@rows("activation", ["relu", "none"])
def test_onnxruntime_and_torch_give_the_same_odds(
    activation: str, networks: Path, tmp_path: Path
) -> None:
    network = comparison(tmp_path, activation=activation)
    stage = SecondStage(networks / "features.onnx", tmp_path / "comparison.onnx")
    table = np.random.default_rng(0).normal(size=(9, 32)).astype(np.float32)
    with torch.no_grad():
        expected = network(torch.from_numpy(table[:1]).expand(8, -1), torch.from_numpy(table[1:]))
    np.testing.assert_allclose(stage.probabilities(table[0], table[1:]), expected, atol=1e-5)
    assert stage.probability(table[0], table[3]) == pytest.approx(float(expected[2]), abs=1e-5)
    assert np.ptp(expected.numpy()) > 0.01


def test_weights_come_back_as_they_were_saved(tmp_path: Path) -> None:
    network = pointnet(tmp_path, TINY, CALIBRATED)
    loaded, about = load_pointnet(tmp_path / "features.safetensors")
    assert about == About("pointnet", TINY, CALIBRATED)
    taken = torch.from_numpy(cloud(50, 0).points)[None]
    assert torch.equal(loaded(taken)[0], network(taken)[0])


def test_a_distance_becomes_the_probability_of_its_calibration(colored: SecondStage) -> None:
    first, second = np.eye(12, dtype=np.float32)[:2]
    expected = 1 / (1 + np.exp(8 * np.sqrt(2) - 4))
    assert colored.probability(first, second) == pytest.approx(expected, rel=1e-5)
    assert colored.probability(first, first) == pytest.approx(1 / (1 + np.exp(-4)), rel=1e-5)


@rows("suffix, read", [("safetensors", load_pointnet), ("onnx", SecondStage)])
def test_damaged_files_are_named(suffix: str, read: Any, networks: Path, tmp_path: Path) -> None:
    path = copy_artefact(networks / f"features.{suffix}", tmp_path / f"features.{suffix}")
    check_damaged_files(path, read)


@rows("suffix, read", [("safetensors", load_pointnet), ("onnx", SecondStage)])
def test_a_comparison_is_not_taken_for_features(suffix: str, read: Any, networks: Path) -> None:
    with refuses("other-kind"):
        read(networks / f"comparison.{suffix}")


def test_a_comparison_of_other_features_is_refused(networks: Path, tmp_path: Path) -> None:
    comparison(tmp_path, features=30)
    with pytest.raises(DataError, match=r"30.*32"):
        SecondStage(networks / "features.onnx", tmp_path / "comparison.onnx")


@rows(
    "change, named",
    [
        ({"points": (8, 16, 33)}, r"points\.layers\.6\.weight"),
        ({"embedding": 4}, r"embedding\.bias"),
    ],
)
def test_tensors_that_do_not_fit_are_named(change: Any, named: str, tmp_path: Path) -> None:
    path, said = tmp_path / "odd.safetensors", TINY.model_copy(update=change)
    save_weights(path, PointNet(TINY), About("pointnet", said))
    with pytest.raises(DataError, match=named):
        load_pointnet(path)


def test_weights_that_are_not_finite_are_refused(tmp_path: Path) -> None:
    network = PointNet(TINY)
    network.state_dict()["points.layers.0.bias"][0] = torch.nan
    save_weights(tmp_path / "odd.safetensors", network, About("pointnet", TINY))
    with refuses("not-finite"):
        load_pointnet(tmp_path / "odd.safetensors")


@rows("values", [{}, {"format": "fusionslam.network.9"}, {"format": "fusionslam.network.1"}])
def test_onnx_of_another_version_is_refused(values: Any, networks: Path, tmp_path: Path) -> None:
    model = onnx.load(networks / "uncalibrated" / "features.onnx")
    onnx.helper.set_model_props(model, {"fusionslam": json.dumps(values)})
    onnx.save(model, tmp_path / "odd.onnx")
    with pytest.raises(DataError, match=r"odd\.onnx"):
        SecondStage(tmp_path / "odd.onnx")


def test_a_graph_that_takes_other_rows_than_it_says_is_refused(tmp_path: Path) -> None:
    network = randomize(PointNet(TINY))
    export_pointnet(tmp_path / "odd.onnx", network, About("pointnet", TINY_COLORED, CALIBRATED))
    with pytest.raises(DataError, match=r"'points': 3.*'points': 6"):
        SecondStage(tmp_path / "odd.onnx")


@rows("name", NETWORKS)
def test_a_network_that_is_more_than_a_graph_of_ours_is_refused(name: str, tmp_path: Path) -> None:
    path = tmp_path / "odd.onnx"
    NETWORKS[name](path)
    with refuses("other-operators"):
        SecondStage(path)


def test_a_graph_that_gives_no_features_is_refused(tmp_path: Path) -> None:
    write_graph(tmp_path / "odd.onnx", [("Relu", "points", "features")])
    with pytest.raises(DataError, match=r"\(2, 3\).*\(1, "):
        SecondStage(tmp_path / "odd.onnx")


def test_a_folder_in_the_place_of_a_network_is_named(networks: Path, tmp_path: Path) -> None:
    (tmp_path / "odd.onnx").mkdir()
    (tmp_path / "odd.json").write_text(json.dumps({"sha256": {".onnx": "0" * 64}}))
    with pytest.raises(DataError, match=r"odd\.onnx"):
        SecondStage(tmp_path / "odd.onnx")


def test_features_without_calibration_need_a_comparison(networks: Path) -> None:
    with refuses("no-calibration"):
        SecondStage(networks / "uncalibrated" / "features.onnx")


def test_features_that_cannot_be_compared_are_refused(colored: SecondStage) -> None:
    with pytest.raises(ShapeError, match=r"\(11,\)"):
        colored.probability(np.zeros(11, np.float32), np.zeros(12, np.float32))
    with refuses("not-finite"):
        colored.probability(np.full(12, np.nan, np.float32), np.zeros(12, np.float32))


def test_clouds_without_points_or_colours_have_no_features(colored: SecondStage) -> None:
    with refuses("no-points"):
        colored.features(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8))
    with refuses("no-colors"):
        colored.features(np.zeros((5, 3), np.float32))
