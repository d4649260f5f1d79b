# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Networks as ONNX, so that robots need no torch.

The graph is written node by node with batch normalisation folded into the layers before it. Bias
and ReLU of the layer that is pooled come after pooling: they keep the order of values.
"""

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.errors import FusionSlamError
from fusionslam.learning.pointnet import Comparison, PointNet
from fusionslam.learning.torch_extra import nn
from fusionslam.storage.files import atomic_path
from fusionslam.views.second_stage.network_files import About

Array = NDArray[np.float32]

# Old enough for runtimes of 2022; ReduceMax takes its axes as an attribute.
_OPSET, _IR = 17, 8


class _Graph:
    """Nodes in order, and the constants that they use."""

    def __init__(self) -> None:
        try:
            import onnx
        except ImportError as error:
            raise FusionSlamError(
                "exporting needs onnx, which is not installed: pip install 'fusionslam[learn]'"
            ) from error
        self.onnx: Any = onnx
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def constant(self, value: NDArray[Any]) -> str:
        """A constant's name."""
        name = f"c{len(self.constants)}"
        array = np.ascontiguousarray(value)
        self.constants.append(self.onnx.numpy_helper.from_array(array, name))
        return name

    def add(self, operator: str, *inputs: str, **attributes: Any) -> str:
        """The name of what a new node gives."""
        output = f"v{len(self.nodes)}"
        node = self.onnx.helper.make_node(operator, list(inputs), [output], **attributes)
        self.nodes.append(node)
        return output

    def write(
        self,
        path: str | os.PathLike[str],
        inputs: dict[str, list[int | str]],
        output: tuple[str, str, list[int | str]],
        about: About,
    ) -> None:
        """The model, whole or not at all; ``output`` is a value, its new name and its shape."""
        value, name, shape = output
        self.nodes.append(self.onnx.helper.make_node("Identity", [value], [name]))
        kind = self.onnx.TensorProto.FLOAT
        describe = self.onnx.helper.make_tensor_value_info
        graph = self.onnx.helper.make_graph(
            self.nodes,
            about.kind,
            [describe(key, kind, size) for key, size in inputs.items()],
            [describe(name, kind, shape)],
            self.constants,
        )
        opset = self.onnx.helper.make_opsetid("", _OPSET)
        model = self.onnx.helper.make_model(
            graph, opset_imports=[opset], ir_version=_IR, producer_name="fusionslam"
        )
        self.onnx.helper.set_model_props(model, about.metadata())
        self.onnx.checker.check_model(model)
        with atomic_path(path) as temporary:
            temporary.write_bytes(model.SerializeToString(deterministic=True))


def export_pointnet(path: str | os.PathLike[str], network: PointNet, about: About) -> None:
    """Write "points" float32 (N, 3 or 6) to "features" float32 (1, F).

    Raises:
        DataError: the file cannot be written.
        FusionSlamError: onnx is not installed.
    """
    graph, config = _Graph(), network.config
    points = "points"
    xyz = _columns(graph, points, 0, 3) if config.colors else points
    matrix = _pooled(graph, xyz, network.transform.points.layers)
    matrix = _dense(graph, matrix, network.transform.head)
    matrix = _linear(graph, matrix, *_numbers(network.transform.matrix))
    matrix = graph.add("Reshape", matrix, graph.constant(np.array([3, 3], np.int64)))
    turned = graph.add("MatMul", xyz, matrix)
    if config.colors:
        turned = graph.add("Concat", turned, _columns(graph, points, 3, 6), axis=1)
    features = _pooled(graph, turned, network.points.layers)
    if network.embedding is not None:
        features = _linear(graph, features, *_numbers(network.embedding))
        features = graph.add("LpNormalization", features, axis=1, p=2)
    inputs: dict[str, list[int | str]] = {"points": ["N", config.channels]}
    graph.write(path, inputs, (features, "features", [1, config.features]), about)


def export_comparison(path: str | os.PathLike[str], network: Comparison, about: About) -> None:
    """Write "current" and "stored", float32 (M, F) each, to "probability" float32 (M, 1).

    Raises:
        DataError, FusionSlamError: as ``export_pointnet``.
    """
    graph, size = _Graph(), network.config.features
    weight, bias = _numbers(network.hidden)
    mean, scale = (np.tile(value.numpy(), 2) for value in (network.mean, network.scale))
    # (x - mean) * scale is one more linear step before the first layer.
    weight, bias = weight * scale, bias - (weight * scale) @ mean
    hidden = _linear(graph, graph.add("Concat", "current", "stored", axis=1), weight, bias)
    if network.config.activation == "relu":
        hidden = graph.add("Relu", hidden)
    found = graph.add("Sigmoid", _linear(graph, hidden, *_numbers(network.output)))
    inputs: dict[str, list[int | str]] = {"current": ["M", size], "stored": ["M", size]}
    graph.write(path, inputs, (found, "probability", ["M", 1]), about)


def _columns(graph: _Graph, value: str, first: int, last: int) -> str:
    bounds = (graph.constant(np.array([n], np.int64)) for n in (first, last, 1))
    return graph.add("Slice", value, *bounds)


def _numbers(layer: nn.Linear) -> tuple[Array, Array]:
    return layer.weight.detach().numpy(), layer.bias.detach().numpy()


def _folded(layers: nn.Sequential) -> list[tuple[Array, Array]]:
    """Weight and bias of each linear layer with its batch normalisation."""
    linear = [layer for layer in layers if isinstance(layer, nn.Linear)]
    normal = [layer for layer in layers if isinstance(layer, nn.BatchNorm1d)]
    return [_without_normal(*pair) for pair in zip(linear, normal, strict=True)]


def _without_normal(layer: nn.Linear, normal: nn.BatchNorm1d) -> tuple[Array, Array]:
    assert normal.running_mean is not None and normal.running_var is not None
    weight, bias = _numbers(layer)
    spread = np.sqrt(normal.running_var.numpy() + np.float32(normal.eps))
    gain = (normal.weight.detach().numpy() / spread).astype(np.float32)
    shift = normal.bias.detach().numpy() - gain * normal.running_mean.numpy()
    return weight * gain[:, None], bias * gain + shift


def _linear(graph: _Graph, value: str, weight: Array, bias: Array) -> str:
    constants = (graph.constant(weight.T), graph.constant(bias))
    return graph.add("Gemm", value, *constants)


def _dense(graph: _Graph, value: str, layers: nn.Sequential) -> str:
    for weight, bias in _folded(layers):
        value = graph.add("Relu", _linear(graph, value, weight, bias))
    return value


def _pooled(graph: _Graph, value: str, layers: nn.Sequential) -> str:
    *before, (weight, bias) = _folded(layers)
    for inner in before:
        value = graph.add("Relu", _linear(graph, value, *inner))
    largest = graph.add("MatMul", value, graph.constant(weight.T))
    largest = graph.add("ReduceMax", largest, axes=[0], keepdims=1)
    return graph.add("Relu", graph.add("Add", largest, graph.constant(bias)))
