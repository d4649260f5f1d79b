# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Exports networks to ONNX, so that robots need no torch."""

import os
import warnings
from collections.abc import Mapping

from fusionslam.errors import FusionSlamError
from fusionslam.learning.pointnet import Comparison, PointNet
from fusionslam.learning.torch_extra import nn, torch
from fusionslam.storage.files import atomic_path
from fusionslam.views.second_stage.network_files import About

# Old enough for ONNX runtimes of 2022.
_OPSET = 17


class _Features(nn.Module):
    """From one cloud (N, C) to its features (1, F)."""

    def __init__(self, network: PointNet) -> None:
        super().__init__()
        self.network = network
        self.train(network.training)  # the exporter restores the mode of the outer module

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        features: torch.Tensor = self.network(points[None])[0]
        return features


class _Probability(nn.Module):
    """From pairs of features (M, F) to probabilities (M, 1)."""

    def __init__(self, network: Comparison) -> None:
        super().__init__()
        self.network = network
        self.train(network.training)  # the exporter restores the mode of the outer module

    def forward(self, current: torch.Tensor, stored: torch.Tensor) -> torch.Tensor:
        probability: torch.Tensor = self.network(current, stored)[:, None]
        return probability


def export_pointnet(path: str | os.PathLike[str], network: PointNet, about: About) -> None:
    """Export a network from "points" float32 (N, 3 or 6) to "features" float32 (1, F).

    Raises:
        DataError: the file cannot be written.
        FusionSlamError: onnx is not installed.
    """
    inputs = {"points": (network.config.channels, "N")}
    _export(path, _Features(network), inputs, "features", about)


def export_comparison(path: str | os.PathLike[str], network: Comparison, about: About) -> None:
    """Export a network from "current" and "stored", float32 (M, F), to "probability" (M, 1).

    Raises:
        DataError, FusionSlamError: as ``export_pointnet``.
    """
    inputs = {name: (network.config.features, "M") for name in ("current", "stored")}
    _export(path, _Probability(network), inputs, "probability", about)


def _export(
    path: str | os.PathLike[str],
    network: nn.Module,
    inputs: Mapping[str, tuple[int, str]],
    output: str,
    about: About,
) -> None:
    """Export a network; ``inputs`` give, by name, the number of columns and the row axis's name."""
    try:
        import onnx
    except ImportError as error:
        raise FusionSlamError(
            "exporting needs onnx, which is not installed: pip install 'fusionslam[learn]'"
        ) from error
    axes = {name: {0: rows} for name, (_, rows) in inputs.items()}
    if output == "probability":
        axes[output] = axes["current"]
    with atomic_path(path) as temporary:
        with warnings.catch_warnings():
            # torch's default exporter needs onnxscript and writes opset 18 or later.
            warnings.simplefilter("ignore")
            torch.onnx.export(
                network,
                tuple(torch.zeros(5, columns) for columns, _ in inputs.values()),
                temporary,
                input_names=list(inputs),
                output_names=[output],
                dynamic_axes=axes,
                opset_version=_OPSET,
                dynamo=False,
            )
        model = onnx.load(temporary)
        onnx.helper.set_model_props(model, about.metadata())
        onnx.checker.check_model(model)
        temporary.write_bytes(model.SerializeToString(deterministic=True))
