# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Training: what networks compute, and that a training can be stopped and gone on with."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from artefacts import artefact, copy_artefact
from fusionslam.config import merged
from fusionslam.errors import ConfigError, DataError
from learning import TINY, TINY_COLORED, TINY_COMPARISON, worlds
from refusals import refuses
from rows import rows

torch = pytest.importorskip("torch", reason="torch is not installed")
pytest.importorskip("safetensors", reason="safetensors is not installed")
pytest.importorskip("onnx", reason="onnx is not installed")
pytest.importorskip("matplotlib", reason="matplotlib is not installed")

from fusionslam.learning import train as runs  # noqa: E402
from fusionslam.learning.classification import ShapesTask, ShapesTrainingConfig  # noqa: E402
from fusionslam.learning.contrastive import MetricTask, MetricTrainingConfig  # noqa: E402
from fusionslam.learning.pair_comparison import ComparisonTrainingConfig  # noqa: E402
from fusionslam.learning.pointnet import Comparison, PointNet, transform_penalty  # noqa: E402
from fusionslam.learning.shape_sets import ProceduralConfig, ShapeSet, generate_shapes  # noqa: E402
from fusionslam.learning.train import Origin  # noqa: E402
from fusionslam.learning.training_loop import OptimiserConfig  # noqa: E402
from fusionslam.views.second_stage.architecture import HeadConfig  # noqa: E402

SHAPES_CONFIG = ShapesTrainingConfig(
    network=TINY,
    head=HeadConfig(layers=(16,)),
    optimiser=OptimiserConfig(epochs=3, seed=5),
    procedural=ProceduralConfig(train=2, test=1, points=48),
    points=32,
    batch=16,
)
METRIC_CONFIG = MetricTrainingConfig(
    network=TINY_COLORED, optimiser=OptimiserConfig(epochs=3), points=32, batch=12, batches=6
)
COMPARISON_CONFIG = ComparisonTrainingConfig(
    network=TINY_COMPARISON, optimiser=OptimiserConfig(epochs=4), batch=32
)

ORIGIN = Origin("fusionslam views train", "made up")


@cache
def shapes() -> tuple[ShapeSet, ShapeSet]:
    return generate_shapes(SHAPES_CONFIG.procedural)


@pytest.fixture(scope="session")
def features() -> Path:
    """What a training on shapes leaves."""
    return artefact(
        "trained_on_shapes",
        lambda folder: runs.train_shapes(shapes(), SHAPES_CONFIG, folder, ORIGIN),
    )


class Stopped(Exception):
    """As Ctrl-C comes: in the middle of things."""


def interrupt_in_epoch(task: Any, epoch: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C at the second batch of an epoch."""
    losses, count = task.losses, [0]

    def interrupted(self: Any, rng: np.random.Generator) -> Any:
        count[0] += 1
        for number, loss in enumerate(losses(self, rng)):
            if count[0] == epoch and number == 1:
                raise KeyboardInterrupt
            yield loss

    monkeypatch.setattr(task, "losses", interrupted)


def test_features_do_not_depend_on_the_order_of_the_points() -> None:
    network = PointNet(TINY_COLORED).eval()
    clouds = torch.randn(2, 40, 6, generator=torch.Generator().manual_seed(0))
    mixed = clouds[:, torch.randperm(40, generator=torch.Generator().manual_seed(1))]
    with torch.no_grad():
        first, second = network(clouds)[0], network(mixed)[0]
    assert first.shape == (2, 12)
    torch.testing.assert_close(first, second, atol=1e-6, rtol=0)
    torch.testing.assert_close(first.norm(dim=1), torch.ones(2), atol=1e-6, rtol=0)


def test_the_input_transform_begins_as_the_identity_and_is_kept_near_a_rotation() -> None:
    network = PointNet(TINY).eval()
    with torch.no_grad():
        matrix = network(torch.randn(3, 20, 3))[1]
    torch.testing.assert_close(matrix, torch.eye(3).expand(3, 3, 3))
    assert float(transform_penalty(matrix)) == 0
    # |I - 4 I|^2 = 27
    assert float(transform_penalty(2 * torch.eye(3)[None])) == pytest.approx(27)


def test_the_thesis_s_comparison_is_one_linear_step_and_ours_is_not() -> None:
    rows = 10 * torch.randn(3, 1, 32, generator=torch.Generator().manual_seed(0))
    a, b, c = rows

    def bend(activation: str) -> float:
        torch.manual_seed(0)
        network = Comparison(TINY_COMPARISON.model_copy(update={"activation": activation}))
        with torch.no_grad():
            logits = [torch.logit(network(x, c)) for x in (a, b, (a + b) / 2)]
        return float((logits[0] + logits[1] - 2 * logits[2]).abs())

    assert bend("none") < 1e-3 < 1e-2 < bend("relu")


@pytest.mark.nightly
@rows("kind", ["shapes", "places", "comparison"])
def test_a_training_that_was_interrupted_ends_the_same(
    kind: str, features: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(folder: Path, progress: Any = None) -> None:
        if kind == "shapes":
            runs.train_shapes(shapes(), SHAPES_CONFIG, folder, ORIGIN, progress)
        elif kind == "places":
            runs.train_places(worlds(2), worlds(1, 50), METRIC_CONFIG, folder, ORIGIN, progress)
        else:
            path = features / "features.safetensors"
            runs.train_comparison(worlds(2), path, COMPARISON_CONFIG, folder, ORIGIN, progress)

    def stop(done: int, *_: object) -> None:
        if done == 1:
            raise Stopped

    whole, parts = tmp_path / "whole", tmp_path / "parts"
    run(whole)
    with pytest.raises(Stopped):
        run(parts, stop)
    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        task = {"shapes": "ShapesTask", "places": "MetricTask", "comparison": "ComparisonTask"}
        interrupt_in_epoch(getattr(runs, task[kind]), 2, patched)
        run(parts)
    run(parts)
    name = "comparison" if kind == "comparison" else "features"
    for file in (f"{name}.safetensors", f"{name}.onnx", "curves.csv", "curves.png"):
        assert (whole / file).read_bytes() == (parts / file).read_bytes(), file
    assert not list(parts.glob(".*"))


@pytest.mark.slow
def test_places_are_learned_and_torch_s_state_is_left_alone(tmp_path: Path) -> None:
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    torch.manual_seed(77)
    expected = torch.get_rng_state()
    config = merged(METRIC_CONFIG, {"optimiser": {"epochs": 6, "learning_rate": 0.003}})
    trained = runs.train_places(worlds(3), worlds(1, 50), config, tmp_path, ORIGIN)
    assert torch.equal(torch.get_rng_state(), expected)
    assert torch.get_num_threads() == 2
    torch.set_num_threads(before)
    assert trained.rows[-1]["loss"] < trained.rows[0]["loss"]
    assert trained.scores["auc"] > 0.8


def test_a_checkpoint_of_other_settings_is_refused(features: Path, tmp_path: Path) -> None:
    folder = copy_artefact(features, tmp_path / "run")
    other = merged(SHAPES_CONFIG, {"optimiser": {"seed": 6}})
    with pytest.raises(ConfigError, match=r"optimiser\.seed .*5.*6"):
        runs.train_shapes(shapes(), other, folder, ORIGIN)


def test_a_damaged_checkpoint_is_named(features: Path, tmp_path: Path) -> None:
    folder = copy_artefact(features, tmp_path / "run")
    (folder / "checkpoint.pt").write_bytes((folder / "checkpoint.pt").read_bytes()[:200])
    with pytest.raises(DataError, match=r"checkpoint\.pt"):
        runs.train_shapes(shapes(), SHAPES_CONFIG, folder, ORIGIN)


def test_a_loss_that_is_no_number_ends_the_training(tmp_path: Path) -> None:
    config = merged(SHAPES_CONFIG, {"optimiser": {"learning_rate": 1e30}})
    with refuses("not-finite"):
        runs.train_shapes(shapes(), config, tmp_path, ORIGIN)


@rows(
    "changes, words", [({"network": {"colors": True}}, "network.colors"), ({"batch": 500}, "500")]
)
def test_shapes_that_do_not_fit_are_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises((ConfigError, DataError), match=words):
        ShapesTask(*shapes(), merged(SHAPES_CONFIG, changes))


def test_classes_to_train_on_and_to_judge_on_are_the_same() -> None:
    train_set, test_set = shapes()
    other = ShapeSet(test_set.points, test_set.labels, test_set.names[::-1])
    with pytest.raises(DataError):
        ShapesTask(train_set, other, SHAPES_CONFIG)


def test_metric_learning_needs_features_of_length_one() -> None:
    config = merged(METRIC_CONFIG, {"network": {"embedding": None}})
    with pytest.raises(ConfigError, match=r"network\.embedding"):
        MetricTask(worlds(1), worlds(1), config)


def test_a_comparison_of_other_features_is_refused(features: Path, tmp_path: Path) -> None:
    config, path = merged(COMPARISON_CONFIG, {"network": {"features": 16}}), "features.safetensors"
    with pytest.raises(ConfigError, match=r"network\.features .*16.*32"):
        runs.train_comparison(worlds(2), features / path, config, tmp_path, ORIGIN)
