# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What an ONNX file may compute, judged before a runtime sees it.

A network may come from a stranger, and runtimes work out constants while they load it. Ours take
rows and multiply them by stored matrices. A file is refused if it holds anything else, so that no
tensor has more than twice as many rows as the input, or twice as many columns as a stored matrix.
"""

from functools import cache
from typing import Any

from fusionslam.errors import DataError

_OPERATORS = {
    *("Add", "Concat", "Gemm", "Identity", "LpNormalization", "MatMul"),
    *("ReduceMax", "Relu", "Reshape", "Sigmoid", "Slice"),
}  # those that learning.onnx_export writes

_MOST_PARTS = 1000  # operators and tensors; ours have 60
_MOST_INPUTS = 32  # of an operator
_MOST_RESHAPED = 64  # values of a tensor that gets another shape: ours has 9

# What is looked at of onnx.proto: fields by message, with their numbers and types.
_SCHEMA = {
    "Model": {"graph": (7, "Graph"), "training": (20, "bytes"), "functions": (25, "bytes")},
    "Graph": {"node": (1, "Node"), "initializer": (5, "Tensor"), "sparse": (15, "bytes")},
    "Node": {"input": (1, "string"), "op_type": (4, "string"), "domain": (7, "string")},
    "Tensor": {"dims": (1, "int64"), "name": (8, "string"), "raw": (9, "bytes"),
               "external": (13, "bytes")},
}  # fmt: skip
_SINGLE = ("graph", "op_type", "domain", "name", "raw")


def check_graph(data: bytes) -> None:
    """Raise an error unless a file holds a network as ``learning.onnx_export`` writes it.

    Raises:
        DataError: another operator, or one that could make large tensors; code "other-operators".
        ValueError: no file in ONNX.
    """
    from google.protobuf.message import DecodeError

    try:
        model: Any = _model_class().FromString(data)
    except DecodeError as error:
        raise ValueError(str(error)) from error
    graph = model.graph
    if model.functions or model.training or graph.sparse:
        raise _refusal("functions, training steps or sparse tensors", "none")
    if len(graph.node) + len(graph.initializer) > _MOST_PARTS:
        raise _refusal(f"more than {_MOST_PARTS} operators and tensors", "fewer")
    stored = {tensor.name: tensor for tensor in graph.initializer}
    for tensor in graph.initializer:
        if len(tensor.dims) > 2 or tensor.external:
            raise _refusal(f"tensor {tensor.name} of rank {len(tensor.dims)}", "2, in the file")
    names = [".".join(filter(None, (node.domain, node.op_type))) for node in graph.node]
    if other := sorted(set(names) - _OPERATORS):
        raise _refusal(", ".join(other), "only " + ", ".join(sorted(_OPERATORS)))
    if names.count("Concat") > 1:
        raise _refusal(f"Concat {names.count('Concat')} times", "once")
    for node in graph.node:
        _check_inputs(node.op_type, list(node.input), stored)


def _check_inputs(operator: str, inputs: list[str], stored: dict[str, Any]) -> None:
    """The first input comes from the network's input, the others are stored: nothing multiplies."""
    may_compute = len(inputs) if operator == "Concat" else 2 if operator == "MatMul" else 1
    known = stored.keys() >= set(inputs[may_compute:])
    if not 0 < len(inputs) <= _MOST_INPUTS or inputs[0] in stored or not known:
        raise _refusal(f"{operator} of {', '.join(inputs)}", "data first, then stored tensors")
    if operator == "Add" and [len(stored[name].dims) for name in inputs[1:]] != [1]:
        raise _refusal("Add of a matrix", "a row")
    if operator == "Reshape":
        raw = b"".join(stored[name].raw for name in inputs[1:])
        shape = [int.from_bytes(raw[i : i + 8], "little") for i in range(0, len(raw), 8)]
        if len(shape) != 2 or not 0 < shape[0] * shape[1] <= _MOST_RESHAPED:
            raise _refusal(f"Reshape to {shape}", f"a matrix of up to {_MOST_RESHAPED} values")


@cache
def _model_class() -> Any:
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    kind = descriptor_pb2.FieldDescriptorProto
    file = descriptor_pb2.FileDescriptorProto(name="network.proto", package="network")
    for message, fields in _SCHEMA.items():
        made = file.message_type.add(name=message)
        for name, (number, of) in fields.items():
            label = kind.LABEL_OPTIONAL if name in _SINGLE else kind.LABEL_REPEATED
            field = made.field.add(name=name, number=number, label=label)
            if of in _SCHEMA:
                field.type, field.type_name = kind.TYPE_MESSAGE, f".network.{of}"
            else:
                field.type = getattr(kind, f"TYPE_{of.upper()}")
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("network.Model"))


def _refusal(found: str, expected: str) -> DataError:
    return DataError(
        f"computes what none of our networks does: {found}, expected {expected}",
        code="other-operators",
    )
