# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Complete trainings, from data to weights, ONNX, curves and a model card."""

import hashlib
import os
import platform
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fusionslam.base.archive import save_json
from fusionslam.config import Section, option
from fusionslam.errors import ConfigError
from fusionslam.learning.classification import ShapesTask, ShapesTrainingConfig
from fusionslam.learning.contrastive import MetricTask, MetricTrainingConfig
from fusionslam.learning.onnx_export import export_comparison, export_pointnet
from fusionslam.learning.pair_comparison import (
    ComparisonTask,
    ComparisonTrainingConfig,
    features_of,
)
from fusionslam.learning.places import Places, split_places
from fusionslam.learning.pointnet import Classifier, Comparison, PointNet
from fusionslam.learning.shape_sets import ShapeSet
from fusionslam.learning.torch_extra import torch
from fusionslam.learning.training_data import SimulatedConfig
from fusionslam.learning.training_loop import Progress, Trained, train
from fusionslam.learning.weight_files import load_pointnet, save_weights
from fusionslam.views.second_stage.architecture import PointNetConfig
from fusionslam.views.second_stage.network_files import (
    DIGESTS,
    About,
    Calibration,
    digest_files,
)
from fusionslam.views.second_stage.scores import calibrate


class PlacesTrainingConfig(MetricTrainingConfig):
    """End-to-end training and its simulated worlds."""

    simulated: SimulatedConfig = option(SimulatedConfig(), "simulated places")


FEATURES, COMPARISON = "features", "comparison"
"""Base names of the files of a training, with suffixes .safetensors, .onnx and .json."""


@dataclass(frozen=True)
class Origin:
    """The origin of weights, for their model card.

    Attributes:
        command: the command that trained them.
        data: the training data, in words.
    """

    command: str
    data: str


def train_shapes(
    data: tuple[ShapeSet, ShapeSet],
    config: ShapesTrainingConfig,
    folder: str | os.PathLike[str],
    origin: Origin,
    progress: Progress | None = None,
) -> Trained:
    """Train features on shapes and write features.* without the head.

    Args:
        data: training and test set.
        config: the whole configuration.
        folder: for all files; training resumes from a checkpoint in it.
        origin: for the model card.
        progress: as in ``train``.

    Raises:
        ConfigError, DataError: as ``train``; also for different classes, or too few shapes.
    """
    task = ShapesTask(*data, config)
    digest = _digest(*(array for part in data for array in (part.points, part.labels)))
    trained = _train(task, config, folder, origin, digest, progress)
    assert isinstance(task.network, Classifier)
    about = About("pointnet", config.network)
    _write_features(Path(folder), task.network.network, about)
    _write_card(Path(folder) / f"{FEATURES}.json", config, trained, origin)
    return trained


def train_comparison(
    places: Places,
    features: str | os.PathLike[str],
    config: ComparisonTrainingConfig,
    folder: str | os.PathLike[str],
    origin: Origin,
    progress: Progress | None = None,
) -> Trained:
    """Train the comparison on pairs of sights and write comparison.*.

    Args:
        places: the sights; a separate part of each world is held out.
        features: safetensors of the features.
        config, folder, origin, progress: as in ``train_shapes``.

    Raises:
        ConfigError, DataError: as ``train``; also for features of another length, or no pairs.
    """
    network, about = load_pointnet(features)
    assert isinstance(about.architecture, PointNetConfig)
    if config.network.features != about.architecture.features:
        raise ConfigError(
            f"network.features is {config.network.features}, but {features} gives "
            f"{about.architecture.features}"
        )
    parts = split_places(places, config.held_out)
    train_part, test_part = ((part, features_of(network, part)) for part in parts)
    task = ComparisonTask(train_part, test_part, config)
    digest = _digest(places.poses, train_part[1], test_part[1])
    trained = _train(task, config, folder, origin, digest, progress)
    assert isinstance(task.network, Comparison)
    own = About("comparison", config.network)
    place = Path(folder) / COMPARISON
    save_weights(place.with_suffix(".safetensors"), task.network, own)
    export_comparison(place.with_suffix(".onnx"), task.network, own)
    _write_card(place.with_suffix(".json"), config, trained, origin)
    return trained


def train_places(
    train_part: Places,
    test_part: Places,
    config: MetricTrainingConfig,
    folder: str | os.PathLike[str],
    origin: Origin,
    progress: Progress | None = None,
) -> Trained:
    """Train features end to end on places, calibrate their distances, and write features.*.

    Args:
        train_part: sights to train on.
        test_part: sights of other worlds, for evaluation and calibration.
        config, folder, origin, progress: as in ``train_shapes``.

    Raises:
        ConfigError, DataError: as ``train``; also if no two sights show the same place.
    """
    task = MetricTask(train_part, test_part, config)
    digest = _digest(
        *(p for part in (train_part, test_part) for p in (part.clouds.points, part.poses))
    )
    trained = _train(task, config, folder, origin, digest, progress)
    assert isinstance(task.network, PointNet)
    offset, slope = calibrate(task.judge_distances(), task.judged.same)
    about = About("pointnet", config.network, Calibration(offset, slope))
    _write_features(Path(folder), task.network, about)
    _write_card(Path(folder) / f"{FEATURES}.json", config, trained, origin)
    return trained


def _train(
    task: Any,
    config: Any,
    folder: str | os.PathLike[str],
    origin: Origin,
    digest: str,
    progress: Progress | None,
) -> Trained:
    # Simulated data are identified by their digest.
    settings = config.model_dump(mode="json", exclude={"simulated"})
    about = {"config": settings, "data": digest, "from": origin.data}
    return train(task, config.optimiser, folder, about, progress)


def _write_features(folder: Path, network: PointNet, about: About) -> None:
    save_weights(folder / f"{FEATURES}.safetensors", network, about)
    export_pointnet(folder / f"{FEATURES}.onnx", network, about)


def _write_card(path: Path, config: Section, trained: Trained, origin: Origin) -> None:
    """Write the model card: the origin of the weights, and their scores."""
    card = {
        "command": origin.command,
        "data": origin.data,
        "scores": {name: round(value, 6) for name, value in trained.scores.items()},
        "cpu_seconds": round(trained.cpu_seconds, 1),
        "config": config.model_dump(mode="json"),
        DIGESTS: digest_files(path),
        "versions": {"python": platform.python_version(), "torch": torch.__version__},
    }
    save_json(path, None, card, indent=2)


def _digest(*arrays: np.ndarray[Any, Any]) -> str:
    whole = hashlib.sha256()
    for array in arrays:
        whole.update(repr((array.shape, array.dtype)).encode())
        whole.update(np.ascontiguousarray(array).data)
    return whole.hexdigest()
