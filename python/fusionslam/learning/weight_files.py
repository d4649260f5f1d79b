# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Weights as safetensors, with the metadata needed to rebuild the network."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fusionslam.config import Section
from fusionslam.errors import DataError, FusionSlamError
from fusionslam.learning.pointnet import Comparison, PointNet
from fusionslam.learning.torch_extra import nn, torch
from fusionslam.storage.files import atomic_path
from fusionslam.views.second_stage.architecture import ComparisonConfig, PointNetConfig
from fusionslam.views.second_stage.network_files import About, Kind, read_about

_MISSING = "weights need safetensors, which is not installed: pip install 'fusionslam[learn]'"


def save_weights(path: str | os.PathLike[str], network: nn.Module, about: About) -> None:
    """Write a network's weights atomically.

    Raises:
        DataError: the file cannot be written.
        FusionSlamError: safetensors is not installed.
    """
    try:
        from safetensors.torch import save
    except ImportError as error:
        raise FusionSlamError(_MISSING) from error
    # Without the batch counters of batch normalisation, which inference does not use.
    tensors = {
        name: tensor.contiguous()
        for name, tensor in network.state_dict().items()
        if not name.endswith("num_batches_tracked")
    }
    with atomic_path(path) as temporary:
        temporary.write_bytes(save(tensors, about.metadata()))


def load_pointnet(
    path: str | os.PathLike[str], expected: PointNetConfig | None = None
) -> tuple[PointNet, About]:
    """Load a feature network, ready for use.

    Args:
        path: a file written by ``save_weights``.
        expected: the sizes that it must have; None for any.

    Raises:
        DataError: the file is truncated, or has another kind of network or other sizes; the
            message names it and what was expected.
    """
    about, tensors = _read(Path(path), "pointnet", expected)
    assert isinstance(about.architecture, PointNetConfig)
    network = PointNet(about.architecture)
    _fill(Path(path), network, tensors)
    return network, about


def load_comparison(path: str | os.PathLike[str], features: int) -> tuple[Comparison, About]:
    """Load a comparison network.

    Args:
        path: a file written by ``save_weights``.
        features: length of the feature vectors to compare.

    Raises:
        DataError: as ``load_pointnet``; also for another number of features.
    """
    about, tensors = _read(Path(path), "comparison", None)
    assert isinstance(about.architecture, ComparisonConfig)
    check_features(Path(path), about.architecture.features, features)
    network = Comparison(about.architecture)
    _fill(Path(path), network, tensors)
    return network, about


def check_features(path: Path, found: int, expected: int) -> None:
    """Raise DataError unless a comparison takes feature vectors of the expected length."""
    if found != expected:
        raise DataError(f"{path} compares {found} features, expected {expected}")


def _read(path: Path, kind: Kind, expected: Section | None) -> tuple[About, Mapping[str, Any]]:
    try:
        from safetensors import SafetensorError, safe_open
    except ImportError as error:
        raise FusionSlamError(_MISSING) from error
    try:
        with safe_open(path, framework="pt") as stored:
            about = read_about(path, stored.metadata(), kind)
            tensors = {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118
    except (OSError, SafetensorError) as error:
        raise DataError(f"{path}: expected weights of a {kind} network: {error}") from error
    if expected is not None and about.architecture != expected:
        differing = [
            f"{name} is {getattr(about.architecture, name)!r}, expected {value!r}"
            for name, value in expected
            if getattr(about.architecture, name) != value
        ]
        raise DataError(f"{path} has another architecture: {'; '.join(differing)}")
    return about, tensors


def _fill(path: Path, network: nn.Module, tensors: Mapping[str, Any]) -> None:
    """Copy tensors into a network. Raises DataError for missing, extra or misshapen ones."""
    own = {
        name: tensor
        for name, tensor in network.state_dict().items()
        if not name.endswith("num_batches_tracked")
    }
    if missing := sorted(own.keys() - tensors.keys()):
        raise DataError(f"{path} lacks {', '.join(missing)}")
    if odd := sorted(tensors.keys() - own.keys()):
        raise DataError(f"{path} holds {', '.join(odd)}, which the network does not have")
    for name, tensor in own.items():
        if tensors[name].shape != tensor.shape:
            raise DataError(
                f"{path}: {name} has shape {tuple(tensors[name].shape)}, "
                f"expected {tuple(tensor.shape)}"
            )
        if not bool(torch.isfinite(tensors[name]).all()):
            raise DataError(f"{path}: {name} has values that are not finite")
    network.load_state_dict(dict(tensors), strict=False)
    network.eval()
