# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What an ONNX file may compute, judged before a runtime sees it.

A network may come from a stranger, and runtimes work out constants while they load it. Ours take
rows and multiply them by stored matrices. A file is refused if it holds anything else, so that no
tensor has more than twice as many rows as the input, or twice as many columns as a stored matrix.
"""

from fusionslam.errors import DataError

_OPERATORS = {
    *("Add", "Concat", "Gemm", "Identity", "LpNormalization", "MatMul"),
    *("ReduceMax", "Relu", "Reshape", "Sigmoid", "Slice"),
}  # those that learning.onnx_export writes

_MOST_PARTS = 1000  # operators and tensors; ours have 60
_MOST_FIELDS = 32  # of one of them
_MOST_RESHAPED = 64  # values of a tensor that gets another shape: ours has 9

# Field numbers of onnx.proto.
_GRAPH, _TRAINING, _FUNCTIONS = 7, 20, 25  # of a model
_NODE, _INITIALIZER, _SPARSE = 1, 5, 15  # of a graph
_INPUT, _OPERATOR, _DOMAIN = 1, 4, 7  # of a node
_DIMS, _NAME, _RAW, _EXTERNAL = 1, 8, 9, 13  # of a tensor

# Kinds of fields of protocol buffers, and the sizes of those that have one.
_OF_NUMBER, _OF_BYTES = 0, 2
_SIZES = {1: 8, 5: 4}


def check_graph(data: bytes) -> None:
    """Raise an error unless a file holds a network as ``learning.onnx_export`` writes it.

    Raises:
        DataError: another operator, or one that could make large tensors; code "other-operators".
        IndexError, KeyError, ValueError: no file in ONNX.
    """
    model = _fields(data)
    if any(field in (_TRAINING, _FUNCTIONS) for field, _ in model):
        raise _refusal("functions or training steps", "none")
    parts = _fields(dict(model)[_GRAPH], _MOST_PARTS)
    if any(field == _SPARSE for field, _ in parts):
        raise _refusal("sparse tensors", "none")
    stored = dict(_tensor(tensor) for field, tensor in parts if field == _INITIALIZER)
    nodes = [_node(node) for field, node in parts if field == _NODE]
    names = [operator for operator, _ in nodes]
    if other := sorted(set(names) - _OPERATORS):
        raise _refusal(", ".join(other), "only " + ", ".join(sorted(_OPERATORS)))
    if names.count("Concat") > 1:
        raise _refusal(f"Concat {names.count('Concat')} times", "once")
    for operator, inputs in nodes:
        _check_inputs(operator, inputs, stored)


def _check_inputs(operator: str, inputs: list[str], stored: dict[str, tuple[int, bytes]]) -> None:
    """The first input comes from the network's input, the others are stored: nothing multiplies."""
    may_compute = len(inputs) if operator == "Concat" else 2 if operator == "MatMul" else 1
    if inputs[0] in stored or not stored.keys() >= set(inputs[may_compute:]):
        raise _refusal(f"{operator} of {', '.join(inputs)}", "data first, then stored tensors")
    if operator == "Add" and stored[inputs[1]][0] != 1:
        raise _refusal("Add of a matrix", "a row")
    if operator == "Reshape":
        raw = stored[inputs[1]][1]
        shape = [int.from_bytes(raw[i : i + 8], "little") for i in range(0, len(raw), 8)]
        if len(shape) != 2 or not 0 < shape[0] * shape[1] <= _MOST_RESHAPED:
            raise _refusal(f"Reshape to {shape}", f"a matrix of up to {_MOST_RESHAPED} values")


def _tensor(data: bytes) -> tuple[str, tuple[int, bytes]]:
    """Name, rank and raw values of a stored tensor, of which none may lie in another file."""
    fields = _fields(data)
    found = dict(fields)
    # The numbers of the dimensions are in one field, or each in one of its own (empty here).
    dims = [value for field, value in fields if field == _DIMS]
    rank = sum(len(_varints(value)) or 1 for value in dims)
    name = found[_NAME].decode()
    if rank > 2 or _EXTERNAL in found:
        raise _refusal(f"tensor {name} of rank {rank}", "up to 2, in the file")
    return name, (rank, found.get(_RAW, b""))


def _node(data: bytes) -> tuple[str, list[str]]:
    """The operator of a node, with its domain if it is not ONNX's own, and its inputs."""
    fields = _fields(data)
    found = {field: value.decode() for field, value in fields if field in (_OPERATOR, _DOMAIN)}
    domain = found.get(_DOMAIN, "")
    operator = f"{domain}.{found[_OPERATOR]}" if domain else found[_OPERATOR]
    return operator, [value.decode() for field, value in fields if field == _INPUT]


def _fields(data: bytes, most: int = _MOST_FIELDS) -> list[tuple[int, bytes]]:
    """Fields of a message of protocol buffers: their number and bytes (none of plain numbers)."""
    fields: list[tuple[int, bytes]] = []
    start = 0
    while start < len(data):
        if len(fields) == most:
            raise _refusal(f"more than {most} parts of a part", "fewer")
        key, start = _varint(data, start)
        if key & 7 == _OF_BYTES:
            size, start = _varint(data, start)
            end = start + size
        elif key & 7 == _OF_NUMBER:
            _, end = _varint(data, start)
        else:
            end = start + _SIZES[key & 7]
        if end > len(data):
            raise ValueError("ends within a field")
        fields.append((key >> 3, data[start:end] if key & 7 == _OF_BYTES else b""))
        start = end
    return fields


def _varint(data: bytes, start: int) -> tuple[int, int]:
    """A number, and where the next one starts."""
    value = 0
    for place in range(start, start + 10):
        value |= (data[place] & 0x7F) << 7 * (place - start)
        if data[place] < 0x80:
            return value, place + 1
    raise ValueError("has a number of more than 10 bytes")


def _varints(data: bytes) -> list[int]:
    values, start = [], 0
    while start < len(data):
        value, start = _varint(data, start)
        values.append(value)
    return values


def _refusal(found: str, expected: str) -> DataError:
    return DataError(
        f"computes what none of our networks does: {found}, expected {expected}",
        code="other-operators",
    )
