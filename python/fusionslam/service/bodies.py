# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Bodies of requests: clouds and vectors, read within limits."""

import asyncio
import io
import struct
import tempfile
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from fastapi import Request
from pydantic_core import from_json

from fusionslam.base.arrays import Floats32
from fusionslam.config import explain_choice
from fusionslam.datasets.cloud_files import read_cloud
from fusionslam.errors import DataError, FusionSlamError, ShapeError, one_line
from fusionslam.fleet.place_rows import check_vectors
from fusionslam.sensors.frame import Cloud
from fusionslam.service.config import ServiceConfig
from fusionslam.service.problems import RequestError

CLOUD_FORMATS = ("ply", "pcd", "npy", "bin")
VECTORS = "vectors"
"""Format of an array of vectors in a .npy file."""
_TYPES = {
    "model/ply": "ply",
    "application/ply": "ply",
    "application/x-ply": "ply",
    "application/x-pcd": "pcd",
    "application/x-npy": "npy",
    "application/json": "json",
}
_UNKNOWN_TYPES = ("", "application/octet-stream", "application/x-www-form-urlencoded")
_COLUMNS = (3, 4)
_LONGEST_HEADER = 200
"""Of a PCD file, in lines."""
_EXPANSION = 8
"""Most times that a compressed cloud is longer than a body may be."""
_LONGEST_NUMBER = 32
"""Characters of a number in JSON, with its comma."""


def choose_format(request: Request, named: str | None, formats: tuple[str, ...]) -> str:
    """Return the format of a body: the one that is named, or that of its content type.

    Raises:
        RequestError: 415, it is none of these.
    """
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    chosen = named if named is not None else _TYPES.get(kind, kind)
    if chosen in formats:
        return chosen
    if named is None and kind in _UNKNOWN_TYPES:
        problem = f"the body does not say what it is: expected ?format={'|'.join(formats)}"
    else:
        problem = f"format {chosen!r}: {explain_choice(chosen, formats)}"
    raise RequestError(415, problem, code="format", fields=(chosen, *formats))


@asynccontextmanager
async def body_file(request: Request, config: ServiceConfig, suffix: str) -> AsyncIterator[Path]:
    """Write the body of a request to a temporary file, which goes with the block.

    Raises:
        RequestError: 413, it is too long; 408, it takes too long.
    """
    with tempfile.TemporaryDirectory(prefix="fusionslam-") as folder:
        path = Path(folder) / f"cloud.{suffix}"
        with path.open("wb") as file:
            await _receive(request, config, file.write, config.max_bytes)
        yield path


async def read_body(request: Request, config: ServiceConfig, most: int) -> bytes:
    """Return the body of a request of at most so many bytes; errors as of ``body_file``."""
    buffer = io.BytesIO()
    await _receive(request, config, buffer.write, min(most, config.max_bytes))
    return buffer.getvalue()


def most_bytes(config: ServiceConfig, length: int) -> int:
    """Return the bytes that the most vectors of this length have, as long numbers in JSON."""
    return 4096 + _LONGEST_NUMBER * length * config.max_vectors


async def _receive(
    request: Request, config: ServiceConfig, write: Callable[[bytes], object], most: int
) -> None:
    """Pass a body on in parts, and stop as soon as it is longer than allowed."""
    stated = request.headers.get("content-length", "")
    if stated.isdecimal() and int(stated) > most:
        raise _too_long(most)
    received = 0
    try:
        async with asyncio.timeout(config.body_timeout_s):
            async for part in request.stream():
                received += len(part)
                if received > most:
                    raise _too_long(most)
                write(part)
    except TimeoutError as error:
        raise RequestError(
            408,
            f"the body did not come within {config.body_timeout_s:g} s",
            code="slow-body",
            fields=(f"{config.body_timeout_s:g}",),
            headers={"Connection": "close"},
        ) from error
    if not received:
        raise RequestError(422, "the request has no body", code="no-body")


def _too_long(most: int) -> RequestError:
    message = f"the body has more than {most} bytes"
    return RequestError(413, message, code="too-long", fields=(str(most),))


def load_cloud(path: Path, config: ServiceConfig) -> Cloud:
    """Read the cloud of a body, whose format is the suffix.

    Raises:
        RequestError: 422, it cannot be read; 413, it has too many points, or would unpack to too
            many bytes.
    """
    if path.suffix == ".pcd":
        _check_unpacked(path, _EXPANSION * config.max_bytes)
    most_points = config.max_points
    try:
        cloud = _load_npy(path) if path.suffix == ".npy" else read_cloud(path)
    except FusionSlamError as error:
        # The name of the temporary file means nothing to the client.
        message = one_line(error).replace(str(path), path.name)
        fields = [field.replace(str(path), path.name) for field in error.fields]
        raise RequestError(422, message, code=error.code, fields=fields) from error
    if not len(cloud):
        raise RequestError(422, "the cloud has no points", code="no-points")
    if len(cloud) > most_points:
        raise RequestError(
            413,
            f"the cloud has {len(cloud)} points, expected at most {most_points}",
            code="too-many-points",
            fields=(str(len(cloud)), str(most_points)),
        )
    return cloud


def _check_unpacked(path: Path, most: int) -> None:
    """Raise RequestError (413) if the compressed data of a PCD file are said to be longer."""
    with path.open("rb") as file:
        for line in islice(file, _LONGEST_HEADER):
            if line.split() == [b"DATA", b"binary_compressed"]:
                _, unpacked = struct.unpack("<2I", file.read(8).ljust(8, b"\0"))
                if unpacked > most:
                    raise _too_long(most)


def _load_npy(path: Path) -> Cloud:
    """Read points (N, 3), or (N, 4) with intensities."""
    values = _read_array(path.read_bytes(), "float (N, 3) or (N, 4)")
    if values.ndim != 2 or values.shape[1] not in _COLUMNS:
        raise ShapeError(f"points have shape {values.shape}, expected (N, 3) or (N, 4)")
    intensities = np.ascontiguousarray(values[:, 3]) if values.shape[1] == 4 else None
    return Cloud(np.ascontiguousarray(values[:, :3]), None, intensities)


def parse_vectors(body: bytes, form: str, length: int, most: int) -> Floats32:
    """Read vectors: JSON ``{"vectors": [[...], ...]}`` or ``{"vector": [...]}``, or a .npy file.

    Returns:
        float32 (n, D).

    Raises:
        DataError, ShapeError: they are no finite numbers, too large for distances in float32, or
            not of this length.
        RequestError: 413, there are too many.
    """
    values = _read_array(body, "float (D,) or (n, D)") if form == VECTORS else _parse_json(body)
    vectors = np.atleast_2d(values)
    if vectors.ndim != 2 or vectors.shape[1] != length or not len(vectors):
        raise ShapeError(
            f"vectors have shape {values.shape}, expected (n, {length}) or ({length},)",
            fields=("vectors", str(length)),
        )
    if len(vectors) > most:
        message = f"{len(vectors)} vectors in one request, expected at most {most}"
        fields = (str(len(vectors)), str(most))
        raise RequestError(413, message, code="too-many-vectors", fields=fields)
    return check_vectors("vectors", vectors, length)


def _parse_json(body: bytes) -> Floats32:
    try:
        content = from_json(body)
    except ValueError as error:
        raise DataError(f"the body is no JSON: {error}", code="not-json") from error
    keys = list(content) if isinstance(content, dict) else []
    if keys not in (["vector"], ["vectors"]):
        message = 'expected {"vector": [...]} or {"vectors": [[...], ...]} as JSON'
        raise DataError(message, code="not-vectors", fields=tuple(map(str, keys)))
    return _as_floats(content[keys[0]])


def _as_floats(values: Any) -> Floats32:
    """Return numbers as float32; texts that look like numbers are none."""
    try:
        array = np.array(values)
    except ValueError as error:  # lists of different lengths
        raise ShapeError(f"vectors: {error}", fields=("vectors",)) from error
    return _checked(array)


def _read_array(data: bytes, expected: str) -> Floats32:
    """Read a .npy file without pickled objects."""
    try:
        array = np.load(io.BytesIO(data), allow_pickle=False)
    except Exception as error:  # whatever NumPy makes of a damaged header
        message = f"the body is no .npy file of {expected}, or is cut short: {error}"
        raise DataError(message, code="not-npy") from error
    if not isinstance(array, np.ndarray):
        raise DataError(f"the body is an archive, expected a .npy file of {expected}", code="npz")
    return _checked(array)


def _checked(array: Any) -> Floats32:
    if array.dtype.kind not in "fiu":
        message = f"the values are of type {array.dtype}, expected numbers"
        raise ShapeError(message, code="not-numbers", fields=(str(array.dtype),))
    with np.errstate(over="ignore"):
        floats: Floats32 = array.astype(np.float32)
    return floats
