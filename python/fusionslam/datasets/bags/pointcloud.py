# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Converts PointCloud2 messages and scans: any field order, step, endianness, organised or not."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.errors import DataError
from fusionslam.sensors.messages import Scan

# Type codes of sensor_msgs/PointField.
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
_CODES = {np.dtype(name): code for code, name in _TYPES.items()}
_AXES = ("x", "y", "z")
# PCL packs three bytes into a number of four, 0x00RRGGBB, usually declared as float.
_PACKED = ("rgb", "rgba")
_SHIFTS = np.array([16, 8, 0], dtype=np.uint32)


def scan_from(message: Any, stamp_ns: int, frame_id: str) -> Scan:
    """Convert a sensor_msgs/PointCloud2 to a scan.

    A field with several values per point becomes several, ``name_0``, ``name_1``, ...; fields
    named "_" are padding.

    Raises:
        DataError: the data is shorter than the message says, a field lies outside its point or
            has an unknown type, or x, y, z are missing or not floating point.
    """
    cells = _cells(message)
    names = cells.dtype.names or ()
    for axis in _AXES:
        if axis not in names:
            raise DataError(f"point fields are {', '.join(names) or 'none'}, expected x, y, z")
        if cells[axis].dtype.kind != "f" or cells[axis].ndim != 1:
            raise DataError(
                f"point field '{axis}' is {cells.dtype[axis]}, expected float32 or float64"
            )
    points = np.stack([cells[axis].astype(np.float32) for axis in _AXES], axis=1)
    packed, colors = next((name for name in _PACKED if name in names), None), None
    if packed is not None:
        values = cells[packed]
        if values.dtype.itemsize != 4 or values.ndim != 1:
            raise DataError(f"point field '{packed}' is {values.dtype}, expected four packed bytes")
        # Reinterpret the bits: as floats some colours are NaN.
        bits = values.astype(values.dtype.newbyteorder("=")).view(np.uint32)
        colors = ((bits[:, None] >> _SHIFTS) & 255).astype(np.uint8)
    return Scan(
        stamp_ns=stamp_ns,
        frame_id=frame_id,
        points=points,
        fields=dict(_others(cells, packed)),
        colors=colors,
        width=int(message.width) if message.height > 1 else 0,
    )


def check_scan(message: Any) -> None:
    """Raise DataError if the data of a sensor_msgs/PointCloud2 do not fit its size and fields."""
    _cells(message)


def _cells(message: Any) -> NDArray[Any]:
    """View the points as (N,) records, without a copy."""
    dtype = _record(message)
    height, width, step = int(message.height), int(message.width), int(message.point_step)
    row = width * step if height == 1 else int(message.row_step)
    if row < width * step:
        raise DataError(f"field 'row_step' is {row}, expected at least {width} points x {step}")
    data = np.frombuffer(message.data, dtype=np.uint8)
    needed = (height - 1) * row + width * step if height and width else 0
    if len(data) < needed:
        raise DataError(
            f"field 'data' has {len(data)} bytes, expected {needed} for "
            f"{width} x {height} points of {step}"
        )
    if not needed:
        return np.zeros(0, dtype)
    return np.ndarray((height, width), dtype, data, strides=(row, step)).reshape(-1)


def _record(message: Any) -> np.dtype[Any]:
    """Memory layout of one point."""
    order, step = "><"[not message.is_bigendian], int(message.point_step)
    fields = [field for field in message.fields if field.name != "_"]
    for field in fields:
        if field.datatype not in _TYPES:
            raise DataError(f"point field '{field.name}' has the unknown type {field.datatype}")
        size = np.dtype(_TYPES[field.datatype]).itemsize * max(field.count, 1)
        if field.offset + size > step:
            raise DataError(
                f"point field '{field.name}' ends at byte {field.offset + size}, "
                f"expected it within 'point_step' of {step}"
            )
    names = [field.name for field in fields]
    if len(set(names)) < len(names):
        raise DataError(f"point fields are {', '.join(names)}, expected each name once")
    formats = [(order + _TYPES[field.datatype], (max(field.count, 1),)) for field in fields]
    single = [form if form[1] != (1,) else form[0] for form in formats]
    offsets = [field.offset for field in fields]
    return np.dtype(
        {"names": names, "formats": single, "offsets": offsets, "itemsize": max(step, 1)}
    )


def _others(cells: NDArray[Any], packed: str | None) -> Iterator[tuple[str, NDArray[Any]]]:
    for name in cells.dtype.names or ():
        if name in _AXES or name == packed:
            continue
        values = cells[name]
        native = np.ascontiguousarray(values.astype(values.dtype.newbyteorder("=")))
        if native.ndim == 1:
            yield name, native
        else:
            yield from ((f"{name}_{k}", native[:, k].copy()) for k in range(native.shape[1]))


def cloud_parts(scan: Scan) -> dict[str, Any]:
    """Fields of a PointCloud2 except its header; its ``fields`` are (name, offset, type).

    Points come first, then the other fields in their order, then the colours as "rgb".

    Raises:
        DataError: a field has a length, name or type that a PointCloud2 cannot have, or the width
            does not divide the number of points.
    """
    count, columns = len(scan.points), dict(_columns(scan))
    if scan.width and count % scan.width:
        raise DataError(f"{count} points, expected rows of width {scan.width}")
    dtype = np.dtype([(name, values.dtype) for name, values in columns.items()])
    cells = np.empty(count, dtype)
    for name, values in columns.items():
        cells[name] = values
    width = scan.width or count
    about: Mapping[str, Any] = dtype.fields or {}
    return {
        "height": count // width if width else 1,
        "width": width,
        "fields": [(name, about[name][1], _CODES[about[name][0]]) for name in columns],
        "is_bigendian": False,
        "point_step": dtype.itemsize,
        "row_step": dtype.itemsize * width,
        "data": np.frombuffer(cells.tobytes(), dtype=np.uint8),
        "is_dense": bool(np.isfinite(scan.points).all()),
    }


def _columns(scan: Scan) -> Iterator[tuple[str, NDArray[Any]]]:
    yield from zip(_AXES, np.asarray(scan.points, dtype=np.float32).T, strict=True)
    for name, values in scan.fields.items():
        if name in _AXES or (name in _PACKED and scan.colors is not None):
            raise DataError(f"field '{name}' of the scan is what the points or colours are called")
        if values.dtype not in _CODES:
            raise DataError(
                f"field '{name}' of the scan is {values.dtype}, expected an integer of up to 32 "
                "bits, float32 or float64"
            )
        if values.shape != (len(scan.points),):
            raise DataError(
                f"field '{name}' of the scan has shape {values.shape}, "
                f"expected ({len(scan.points)},)"
            )
        yield name, values
    if scan.colors is not None:
        bits = (scan.colors.astype(np.uint32) << _SHIFTS).sum(axis=1, dtype=np.uint32)
        yield "rgb", bits.view(np.float32)
