# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Exports networks to ONNX, so that robots need no torch."""

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.files import write_file
from fusionslam.errors import FusionSlamError
from fusionslam.learning.pointnet import Comparison, PointNet
from fusionslam.learning.torch_extra import nn
from fusionslam.views.second_stage.network_files import About

# Old enough for ONNX runtimes of 2022.
_OPSET, _IR = 17, 8

Weights = NDArray[np.float64]


def export_pointnet(path: str | os.PathLike[str], network: PointNet, about: About) -> None:
    """Export a network from "points" float32 (N, 3 or 6) to "features" float32 (1, F).

    Raises:
        DataError: the file cannot be written.
        FusionSlamError: onnx is not installed.
    """
    graph = _Graph()
    xyz = graph.add("Slice", "points", np.array([0]), np.array([3]), np.array([1]))
    transform = network.transform
    row = graph.layers(graph.pooled(xyz, transform.points.layers), transform.head)
    matrix = graph.add("Reshape", graph.linear(row, transform.matrix), np.array([3, 3]))
    turned = graph.add("MatMul", xyz, matrix)
    if network.config.colors:
        colors = graph.add("Slice", "points", np.array([3]), np.array([6]), np.array([1]))
        turned = graph.add("Concat", turned, colors, axis=1)
    features = graph.pooled(turned, network.points.layers)
    if network.embedding is not None:
        embedded = graph.linear(features, network.embedding)
        features = graph.add("LpNormalization", embedded, axis=1, p=2)
    inputs = {"points": ("N", network.config.channels)}
    graph.save(path, inputs, features, ("features", (1, network.config.features)), about)


def export_comparison(path: str | os.PathLike[str], network: Comparison, about: About) -> None:
    """Export a network from "current" and "stored", float32 (M, F), to "probability" (M, 1).

    Raises:
        DataError, FusionSlamError: as ``export_pointnet``.
    """
    graph = _Graph()
    weight, bias = _parameters(network.hidden)
    weight *= np.tile(_numbers(network.scale), 2)[:, None]
    bias -= np.tile(_numbers(network.mean), 2) @ weight
    hidden = graph.gemm(graph.add("Concat", "current", "stored", axis=1), weight, bias)
    if network.config.activation == "relu":
        hidden = graph.add("Relu", hidden)
    probability = graph.add("Sigmoid", graph.linear(hidden, network.output))
    inputs = {name: ("M", network.config.features) for name in ("current", "stored")}
    graph.save(path, inputs, probability, ("probability", ("M", 1)), about)


class _Graph:
    """A graph that ``onnx_graph.check_graph`` accepts: rows times stored matrices."""

    def __init__(self) -> None:
        try:
            import onnx
        except ImportError as error:
            raise FusionSlamError(
                "exporting needs onnx, which is not installed: pip install 'fusionslam[learn]'"
            ) from error
        self._onnx: Any = onnx
        self._nodes: list[Any] = []
        self._stored: list[Any] = []

    def add(self, operator: str, *inputs: str | NDArray[Any], **attributes: Any) -> str:
        """Add an operator on values of that name and stored arrays; returns its result's name."""
        names = []
        for value in inputs:
            names.append(value if isinstance(value, str) else f"c{len(self._stored)}")
            if not isinstance(value, str):
                numbers = value.astype(np.float32) if value.dtype.kind == "f" else value
                self._stored.append(self._onnx.numpy_helper.from_array(numbers, names[-1]))
        output = f"v{len(self._nodes)}"
        self._nodes.append(self._onnx.helper.make_node(operator, names, [output], **attributes))
        return output

    def gemm(self, rows: str, weight: Weights, bias: Weights) -> str:
        return self.add("Gemm", rows, weight, bias)

    def linear(self, rows: str, layer: nn.Module) -> str:
        return self.gemm(rows, *_parameters(layer))

    def layers(self, rows: str, layers: nn.Sequential) -> str:
        """Linear layers, each followed by batch normalisation and ReLU."""
        for weight, bias in _folded(layers):
            rows = self.add("Relu", self.gemm(rows, weight, bias))
        return rows

    def pooled(self, rows: str, layers: nn.Sequential) -> str:
        """``layers``, then the largest of all rows; the last bias waits until after that."""
        *_, (weight, bias) = _folded(layers)
        rows = self.layers(rows, nn.Sequential(*list(layers)[:-3]))
        largest = self.add("ReduceMax", self.add("MatMul", rows, weight), axes=[0], keepdims=1)
        return self.add("Relu", self.add("Add", largest, bias))

    def save(
        self,
        path: str | os.PathLike[str],
        inputs: dict[str, tuple[str, int]],
        result: str,
        output: tuple[str, tuple[str | int, int]],
        about: About,
    ) -> None:
        """Write the graph; ``inputs`` and ``output`` are names and shapes."""
        make, kind = self._onnx.helper, self._onnx.TensorProto.FLOAT
        graph = make.make_graph(
            [*self._nodes, make.make_node("Identity", [result], [output[0]])],
            about.kind,
            [make.make_tensor_value_info(name, kind, shape) for name, shape in inputs.items()],
            [make.make_tensor_value_info(output[0], kind, output[1])],
            self._stored,
        )
        opset = [make.make_opsetid("", _OPSET)]
        model = make.make_model(graph, opset_imports=opset, ir_version=_IR)
        make.set_model_props(model, about.metadata())
        self._onnx.checker.check_model(model)
        write_file(path, model.SerializeToString(deterministic=True))


def _folded(layers: nn.Sequential) -> list[tuple[Weights, Weights]]:
    """Weights (inputs, outputs) and bias of each linear layer with its batch normalisation."""
    steps: list[Any] = list(layers)
    found = []
    for linear, norm in zip(steps[::3], steps[1::3], strict=True):
        weight, bias = _parameters(linear)
        gain = _numbers(norm.weight) / np.sqrt(_numbers(norm.running_var) + norm.eps)
        shift = _numbers(norm.bias) - gain * _numbers(norm.running_mean)
        found.append((weight * gain, bias * gain + shift))
    return found


def _parameters(linear: nn.Module) -> tuple[Weights, Weights]:
    return _numbers(linear.weight).T.copy(), _numbers(linear.bias)


def _numbers(tensor: Any) -> Weights:
    numbers: Weights = tensor.detach().cpu().numpy().astype(np.float64)
    return numbers
