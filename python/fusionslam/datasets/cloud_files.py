# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Reads and writes point cloud files; reads image files."""

import logging
import struct
from collections.abc import Iterable, Mapping
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.argument_types import checked
from fusionslam.base.files import PathLike, check_pixels, reading, write_file
from fusionslam.base.texts import PER_FRAME
from fusionslam.errors import DataError, ShapeError
from fusionslam.sensors.frame import Cloud, require_cloud

logger = logging.getLogger(__name__)

CLOUD_SUFFIXES = (".bin", ".pcd", ".ply")
_LONGEST_HEADER = 200
"""In lines."""
_MOST_VALUES = 10_000
"""Numbers of a point of a PCD file; pypcd4 makes a column of each."""
_OTHER_KINDS = {
    b"\x93NUMPY": "an array of NumPy (.npy)",
    b"PK\x03\x04": "a zip archive (.npz)",
    b"ply\n": "a PLY file (.ply)",
    b"ply\r\n": "a PLY file (.ply)",
    b"# .PCD": "a PCD file (.pcd)",
    b"VERSION ": "a PCD file (.pcd)",
}
"""Kinds of files that records without a header are mistaken for, by their first bytes."""
_COLOR_FIELDS = (
    ("red", "green", "blue"),
    ("r", "g", "b"),
    ("diffuse_red", "diffuse_green", "diffuse_blue"),
)
"""Names that fields of separate colours have in PCD and PLY files."""
# KITTI's scans: little-endian float32 x, y, z, reflectance.
BIN_RECORD = np.dtype(("<f4", 4))


@checked
def read_cloud(path: PathLike) -> Cloud:
    """Read the points of a .bin, .pcd or .ply file, with colours and intensities if it has any.

    Raises:
        DataError: the suffix is another one, or the file is missing, truncated or malformed.
    """
    path = Path(path)
    readers = {".bin": read_bin, ".pcd": read_pcd, ".ply": read_ply}
    return readers[_cloud_suffix(path)](path)


@checked
def read_bin(path: PathLike) -> Cloud:
    """Read a KITTI scan: float32 x, y, z, reflectance, which become the intensities.

    Raises:
        DataError: the file is missing, or its size is not a multiple of 16 bytes.
    """
    rows = read_records(path, BIN_RECORD, "float32 x y z reflectance")
    if (rows[:, 3] < 0).any():
        said = "reflectance below 0: expected float32 x y z reflectance, has it other columns?"
        logger.warning("%s: %s", path, said, extra={PER_FRAME: said})
    return Cloud(_float32(rows[:, :3]), None, _float32(rows[:, 3]))


def read_records(path: PathLike, record: np.dtype[Any], expected: str) -> NDArray[Any]:
    """Read a file of records, one a point, without a header.

    Raises:
        DataError: the file is missing, is of a kind with a header (code "bad-header"), or its size
            is not a multiple of a record's ("truncated").
    """
    with reading(path, expected):
        data = Path(path).read_bytes()
    kind = next((kind for first, kind in _OTHER_KINDS.items() if data.startswith(first)), None)
    if kind is not None:
        raise DataError(
            f"{path} is {kind}, whatever its name says: expected {expected} and no header",
            code="bad-header",
            fields=(str(path), kind),
        )
    if len(data) % record.itemsize:
        raise DataError(
            f"{path} has {len(data)} bytes, expected a multiple of {record.itemsize} "
            f"({expected}): truncated?",
            code="truncated",
            fields=(str(path),),
        )
    return np.frombuffer(data, dtype=record)


@checked
def read_pcd(path: PathLike) -> Cloud:
    """Read a PCD file with fields x, y, z and, for colour, packed rgb or rgba.

    Without these, colours are read from fields of uint8 that are named as those of a PLY file;
    intensities from a field called intensity.
    Points with a NaN coordinate, PCL's mark of a ray without return, are left out.

    Raises:
        DataError: the file is missing, truncated or malformed, or holds more points than stated.
    """
    from pypcd4.pypcd4 import PointCloud

    path = Path(path)
    with reading(path, "a PCD file with fields x, y and z"):
        _check_header(path, b"DATA ", b"")
        header, begin = _pcd_header(path)
        try:
            cloud = PointCloud.from_path(path)
        except Exception as error:  # whatever numpy and lzf make of a part of the data
            if not _is_cut(header, path.read_bytes()[begin:]):
                raise
            message = "truncated: its last points are missing"
            raise DataError(message, code="truncated", fields=(str(path),)) from error
        rows = np.atleast_1d(cloud.pc_data)
        points = _float32(np.stack([rows[axis] for axis in "xyz"], axis=1))
        packed = next((rows[name] for name in ("rgb", "rgba") if name in cloud.fields), None)
        if packed is None:
            colors = _separate_colors(rows, cloud.fields)
        else:
            colors = PointCloud.decode_rgb(np.ascontiguousarray(packed))
        intensities = _intensities(rows, cloud.fields)
    _expect_points(path, len(points), cloud.points)
    valid = ~np.isnan(points).any(axis=1)
    return Cloud(
        points[valid],
        None if colors is None else colors[valid],
        None if intensities is None else intensities[valid],
    )


@checked
def read_ply(path: PathLike) -> Cloud:
    """Read the vertices of a PLY file: x, y, z and, for colour, uchar red, green, blue.

    Colours may also be named r, g, b, or diffuse_red, diffuse_green, diffuse_blue; intensities are
    a property called intensity.

    Raises:
        DataError: the file is missing, truncated or malformed, or its colours are not 8 bit.
    """
    from trimesh.exchange.ply import load_ply

    path = Path(path)
    with reading(path, "a PLY file with vertices x y z"), path.open("rb") as file:
        _check_header(path, b"end_header", b"ply")
        ply = load_ply(file, fix_texture=False, skip_materials=True)
        vertex = ply["metadata"]["_ply_raw"]["vertex"]
        declared = vertex["length"]
        points = _float32(ply.get("vertices", np.empty((0, 3))))
        colors = ply.get("vertex_colors")
        if colors is None and declared:
            colors = _separate_colors(vertex["data"], vertex["properties"])
        intensities = _intensities(vertex["data"], vertex["properties"]) if declared else None
    _expect_points(path, len(points), declared)
    if colors is not None and colors.dtype != np.uint8:
        raise DataError(f"{path} has colours of type {colors.dtype}, expected uchar")
    colors = None if colors is None else np.ascontiguousarray(colors[:, :3])
    return Cloud(points, colors, intensities)


def _check_header(path: Path, last: bytes, first: bytes) -> None:
    """Raise DataError unless a header begins and ends as expected: the readers trust it."""
    with path.open("rb") as file:
        lines = list(islice(file, _LONGEST_HEADER))
    message, kind = None, path.suffix[1:].upper()
    if not lines or not lines[0].startswith(first):
        message = f"does not begin like a {kind} file"
    elif not any(line.startswith(last) for line in lines):
        end = last.decode().strip()
        message = f"has no line {end}: it is cut short in its header, or no {kind} file"
    if message:
        raise DataError(message, code="bad-header", fields=(str(path),))


def _pcd_header(path: Path) -> tuple[dict[bytes, list[bytes]], int]:
    """Values of a PCD file's header by key, and where its data begin.

    Raises:
        ValueError: a point has too many numbers.
    """
    header: dict[bytes, list[bytes]] = {}
    with path.open("rb") as file:
        for line in islice(file, _LONGEST_HEADER):
            key, *values = line[: 20 * _MOST_VALUES].split()[: _MOST_VALUES + 2] or [b""]
            count = sum(map(int, values)) if key == b"COUNT" else len(values)
            if count > _MOST_VALUES and key in (b"FIELDS", b"SIZE", b"TYPE", b"COUNT"):
                raise ValueError(f"{count} numbers a point, expected at most {_MOST_VALUES}")
            header[key] = values
            if key == b"DATA":
                break
        return header, file.tell()


def _is_cut(header: dict[bytes, list[bytes]], data: bytes) -> bool:
    """Whether the data of a PCD file that cannot be read lack their end."""
    with suppress(KeyError, IndexError, ValueError, struct.error):  # of a damaged header
        sizes = [int(size) for size in header[b"SIZE"]]
        counts = [int(count) for count in header.get(b"COUNT", [b"1"] * len(sizes))]
        points = int(header[b"POINTS"][0])
        if header[b"DATA"] == [b"ascii"]:
            lines = data.splitlines()
            return len(lines) <= points and len(lines[-1].split()) < sum(counts)
        if header[b"DATA"] == [b"binary"]:
            return len(data) < points * sum(map(int.__mul__, sizes, counts))
        return len(data) < 8 or len(data) < 8 + struct.unpack("<I", data[:4])[0]
    return False


def _separate_colors(
    columns: Mapping[str, NDArray[Any]] | NDArray[Any], names: Iterable[str]
) -> NDArray[np.uint8] | None:
    """Return the colours (N, 3) of fields that hold 8 bits each; None if there are none."""
    for fields in _COLOR_FIELDS:
        if set(fields) <= set(names) and all(columns[each].dtype == np.uint8 for each in fields):
            return np.column_stack([columns[each] for each in fields])
    return None


def _intensities(
    columns: Mapping[str, NDArray[Any]] | NDArray[Any], names: Iterable[str]
) -> NDArray[np.float32] | None:
    """Return the intensities (N,) of a field of numbers, one a point; None if there is none."""
    if "intensity" not in names:
        return None
    values = np.asarray(columns["intensity"])
    is_column = values.ndim == 1 or values.shape[1:] == (1,)
    return _float32(values.reshape(-1)) if is_column and values.dtype.kind in "fiu" else None


def write_cloud(path: PathLike, cloud: Cloud) -> None:
    """Write a cloud as .ply (binary), .pcd (binary) or .bin (no colours).

    Intensities are written to .bin files, whose reflectance is 0 without them.

    Raises:
        DataError: the suffix is another one, or the file cannot be written.
        ShapeError: not a cloud, the points are not (N, 3), or the colours have another shape.
    """
    require_cloud(cloud)
    path = Path(path)
    suffix = _cloud_suffix(path)
    points = _float32(cloud.points)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ShapeError(f"points have shape {points.shape}, expected (N, 3)")
    if cloud.colors is not None and cloud.colors.shape != points.shape:
        raise ShapeError(f"colors have shape {cloud.colors.shape}, expected {points.shape}")
    if cloud.intensities is not None and cloud.intensities.shape != points.shape[:1]:
        found = cloud.intensities.shape
        raise ShapeError(f"intensities have shape {found}, expected {points.shape[:1]}")
    if suffix == ".bin":
        last = np.zeros(len(points)) if cloud.intensities is None else cloud.intensities
        data = np.column_stack([points, last]).astype("<f4").tobytes()
    else:
        encode = _encode_pcd if suffix == ".pcd" else _encode_ply
        data = encode(points, cloud.colors)
    write_file(path, data, durable=False)


def _encode_pcd(points: NDArray[np.float32], colors: NDArray[np.uint8] | None) -> bytes:
    import io

    from pypcd4.pypcd4 import Encoding, PointCloud

    columns, fields = list(points.T), ["x", "y", "z"]
    if colors is not None:
        columns.append(PointCloud.encode_rgb(colors))
        fields.append("rgb")
    buffer = io.BytesIO()
    pcd = PointCloud.from_points(columns, fields, [np.float32] * len(fields))
    pcd.save(buffer, Encoding.BINARY)
    return buffer.getvalue()


def _encode_ply(points: NDArray[np.float32], colors: NDArray[np.uint8] | None) -> bytes:
    from trimesh import PointCloud
    from trimesh.exchange.ply import export_ply

    # trimesh cannot write a cloud that has neither points nor colours.
    colors = colors if len(points) else np.empty((0, 3), dtype=np.uint8)
    data: bytes = export_ply(PointCloud(points, colors=colors))  # type: ignore[no-untyped-call]
    return data


def _cloud_suffix(path: Path) -> str:
    suffix = path.suffix.lower()
    if suffix not in CLOUD_SUFFIXES:
        raise DataError(f"{path} is no cloud file: expected one of {', '.join(CLOUD_SUFFIXES)}")
    return suffix


def _expect_points(path: Path, found: int, declared: int) -> None:
    if found < declared:
        message = f"{path} is truncated: it holds {found} points, its header says {declared}"
        raise DataError(message, code="truncated", fields=(str(path),))
    if found > declared:
        message = f"{path} holds {found} points, more than the {declared} of its header"
        raise DataError(message, code="more-points", fields=(str(path),))


def _float32(points: NDArray[Any]) -> NDArray[np.float32]:
    return np.ascontiguousarray(points, dtype=np.float32)


@checked
def read_image(path: PathLike) -> NDArray[np.uint8]:
    """Read an image: uint8 (H, W) if it is grey, else (H, W, 3) RGB; transparency is dropped.

    Raises:
        DataError: the file is missing, truncated, not an image, or not 8 bits per channel.
    """
    from PIL import Image

    path = Path(path)
    with reading(path, "an 8-bit grey or RGB image"), Image.open(path) as image:
        if image.mode[0] in "IF":
            raise DataError(f"pixels of mode {image.mode}, expected 8 bits a channel")
        check_pixels(image)
        return np.array(image.convert("L" if image.mode in ("1", "L", "LA") else "RGB"))


def image_size(path: PathLike) -> tuple[int, int]:
    """(width, height) of an image file, read from its header.

    Raises:
        DataError: the file is missing or not an image.
    """
    from PIL import Image

    path = Path(path)
    with reading(path, "an image"), Image.open(path) as image:
        return image.size
