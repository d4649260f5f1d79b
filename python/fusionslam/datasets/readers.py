# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Reading and writing single files: point clouds, images, poses and times."""

import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from decimal import Decimal
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from fusionslam._files import atomic_path
from fusionslam.errors import DataError, FusionSlamError, ShapeError
from fusionslam.sensors import Cloud

PathLike = str | os.PathLike[str]
Scalar = TypeVar("Scalar", bound=np.generic)

CLOUD_SUFFIXES = (".bin", ".pcd", ".ply")
# KITTI's scans: little-endian float32 x, y, z, reflectance.
BIN_RECORD = np.dtype(("<f4", 4))
# Poses stamped further than this from a frame are not its poses.
POSE_TOLERANCE_NS = 10_000_000
# Columns of TUM's quaternion in the order of trimesh's.
WXYZ = (7, 4, 5, 6)


@contextmanager
def reading(path: Path, expected: str) -> Iterator[None]:
    """Turn whatever a reader raises on a bad file into a ``DataError`` that names the file.

    Args:
        path: the file that is read.
        expected: what the file should be.
    """
    try:
        yield
    except FusionSlamError:
        raise
    except FileNotFoundError as error:
        raise DataError(f"{path} is missing: expected {expected}") from error
    except Exception as error:  # readers of other people raise anything on a corrupt file
        raise DataError(f"{path} cannot be read: expected {expected} ({error})") from error


def read_cloud(path: PathLike) -> Cloud:
    """The points of a .bin, .pcd or .ply file, with their colours if it has any.

    Raises:
        DataError: another suffix; a missing, truncated or malformed file.
    """
    path = Path(path)
    readers = {".bin": read_bin, ".pcd": read_pcd, ".ply": read_ply}
    return readers[_cloud_suffix(path)](path)


def read_bin(path: PathLike) -> Cloud:
    """A KITTI scan: float32 x, y, z, reflectance; the reflectance is dropped.

    Raises:
        DataError: missing, or the size is no multiple of 16 bytes.
    """
    path = Path(path)
    with reading(path, "float32 x y z reflectance"):
        data = path.read_bytes()
    if len(data) % BIN_RECORD.itemsize:
        raise DataError(
            f"{path} has {len(data)} bytes, expected a multiple of {BIN_RECORD.itemsize} "
            "(float32 x y z reflectance): truncated?"
        )
    return Cloud(_float32(np.frombuffer(data, dtype=BIN_RECORD)[:, :3]))


def read_pcd(path: PathLike) -> Cloud:
    """A PCD file with fields x, y, z and, for colour, packed rgb or rgba.

    Points with a NaN coordinate, PCL's mark of a ray without return, are left out.

    Raises:
        DataError: missing, truncated or malformed.
    """
    from pypcd4.pypcd4 import PointCloud

    path = Path(path)
    with reading(path, "a PCD file with fields x, y and z"):
        cloud = PointCloud.from_path(path)
        rows = np.atleast_1d(cloud.pc_data)
        points = _float32(np.stack([rows[axis] for axis in "xyz"], axis=1))
        packed = next((rows[name] for name in ("rgb", "rgba") if name in cloud.fields), None)
        colors = None if packed is None else PointCloud.decode_rgb(np.ascontiguousarray(packed))
    _expect_points(path, len(points), cloud.points)
    valid = ~np.isnan(points).any(axis=1)
    return Cloud(points[valid], None if colors is None else colors[valid])


def read_ply(path: PathLike) -> Cloud:
    """The vertices of a PLY file: x, y, z and, for colour, uchar red, green, blue.

    Raises:
        DataError: missing, truncated or malformed; colours that are not 8 bit.
    """
    from trimesh.exchange.ply import load_ply

    path = Path(path)
    with reading(path, "a PLY file with vertices x y z"), path.open("rb") as file:
        ply = load_ply(file, fix_texture=False, skip_materials=True)
        declared = ply["metadata"]["_ply_raw"]["vertex"]["length"]
        points = _float32(ply.get("vertices", np.empty((0, 3))))
    _expect_points(path, len(points), declared)
    colors = ply.get("vertex_colors")
    if colors is not None and colors.dtype != np.uint8:
        raise DataError(f"{path} has colours of type {colors.dtype}, expected uchar")
    return Cloud(points, None if colors is None else np.ascontiguousarray(colors[:, :3]))


def write_cloud(path: PathLike, cloud: Cloud) -> None:
    """Write a cloud as .ply (binary), .pcd (binary) or .bin (no colours, reflectance 0).

    Raises:
        DataError: another suffix, or the file cannot be written.
        ShapeError: points that are not (N, 3), or colours of another shape.
    """
    path = Path(path)
    encoders = {".bin": _encode_bin, ".pcd": _encode_pcd, ".ply": _encode_ply}
    encode = encoders[_cloud_suffix(path)]
    points = _float32(cloud.points)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ShapeError(f"points have shape {points.shape}, expected (N, 3)")
    if cloud.colors is not None and cloud.colors.shape != points.shape:
        raise ShapeError(f"colors have shape {cloud.colors.shape}, expected {points.shape}")
    data = encode(Cloud(points, cloud.colors))
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


def _encode_bin(cloud: Cloud) -> bytes:
    return np.pad(cloud.points, ((0, 0), (0, 1))).astype("<f4").tobytes()


def _encode_pcd(cloud: Cloud) -> bytes:
    import io

    from pypcd4.pypcd4 import Encoding, PointCloud

    columns, fields = list(cloud.points.T), ["x", "y", "z"]
    if cloud.colors is not None:
        columns.append(PointCloud.encode_rgb(cloud.colors))
        fields.append("rgb")
    buffer = io.BytesIO()
    pcd = PointCloud.from_points(columns, fields, [np.float32] * len(fields))
    pcd.save(buffer, Encoding.BINARY)
    return buffer.getvalue()


def _encode_ply(cloud: Cloud) -> bytes:
    from trimesh import PointCloud
    from trimesh.exchange.ply import export_ply

    # trimesh cannot write a cloud that has neither points nor colours.
    colors = cloud.colors if len(cloud) else np.empty((0, 3), dtype=np.uint8)
    data: bytes = export_ply(PointCloud(cloud.points, colors=colors))  # type: ignore[no-untyped-call]
    return data


def _cloud_suffix(path: Path) -> str:
    suffix = path.suffix.lower()
    if suffix not in CLOUD_SUFFIXES:
        raise DataError(f"{path} is no cloud file: expected one of {', '.join(CLOUD_SUFFIXES)}")
    return suffix


def _expect_points(path: Path, found: int, declared: int) -> None:
    if found != declared:
        raise DataError(f"{path} holds {found} points, its header says {declared}: truncated?")


def _float32(points: NDArray[Any]) -> NDArray[np.float32]:
    return np.ascontiguousarray(points, dtype=np.float32)


def read_image(path: PathLike) -> NDArray[np.uint8]:
    """An image: uint8 (H, W) if it is grey, else (H, W, 3) RGB; transparency is dropped.

    Raises:
        DataError: missing, truncated, no image, or not 8 bits a channel.
    """
    from PIL import Image

    path = Path(path)
    with reading(path, "an 8-bit grey or RGB image"), Image.open(path) as image:
        if image.mode[0] in "IF":
            raise DataError(f"{path} has pixels of mode {image.mode}, expected 8 bits a channel")
        return np.array(image.convert("L" if image.mode in ("1", "L", "LA") else "RGB"))


def image_size(path: PathLike) -> tuple[int, int]:
    """(width, height) of an image file, read from its header.

    Raises:
        DataError: missing or no image.
    """
    from PIL import Image

    path = Path(path)
    with reading(path, "an image"), Image.open(path) as image:
        return image.size


def read_poses(path: PathLike) -> tuple[NDArray[np.int64] | None, NDArray[np.float64]]:
    """Poses in KITTI (12 columns) or TUM format (8 columns): stamps, if it has any, and poses.

    Returns:
        int64 (N) nanoseconds or None, and float64 (N, 4, 4) world_from_body.

    Raises:
        DataError: missing, empty, another number of columns, or no number.
    """
    path = Path(path)
    columns = _table(path, (8, 12), "poses, one a line").shape[1]
    return read_poses_tum(path) if columns == 8 else (None, read_poses_kitti(path))


def read_poses_kitti(path: PathLike) -> NDArray[np.float64]:
    """float64 (N, 4, 4) from lines of 12 numbers, the row-major 3x4 matrix [R t].

    Raises:
        DataError: missing, empty, another number of columns, or no number.
    """
    rows = _table(Path(path), (12,), "poses of 12 numbers (row-major 3x4), one a line")
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3] = rows.reshape(-1, 3, 4)
    return poses


def read_poses_tum(path: PathLike) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """int64 (N) nanoseconds and float64 (N, 4, 4) from lines ``t x y z qx qy qz qw``.

    Raises:
        DataError: missing, empty, another number of columns, no number, or a quaternion of zeros.
    """
    from trimesh.transformations import quaternion_matrix

    path = Path(path)
    rows = _table(path, (8,), "poses 't x y z qx qy qz qw', one a line")
    if (zero := np.flatnonzero(np.linalg.norm(rows[:, 4:], axis=1) < 1e-6)).size:
        raise DataError(f"{path}: row {zero[0] + 1} has a quaternion of zeros, expected a rotation")
    poses: NDArray[np.float64] = quaternion_matrix(  # type: ignore[no-untyped-call]
        rows[:, WXYZ]
    ).reshape(-1, 4, 4)
    poses[:, :3, 3] = rows[:, 1:4]
    return _exact_stamps(path), poses


def write_poses_tum(
    path: PathLike, stamps_ns: NDArray[np.int64], poses: NDArray[np.float64]
) -> None:
    """Write poses, float64 (N, 4, 4), and their stamps, int64 (N), as ``t x y z qx qy qz qw``.

    Times have all nine decimals, so that they are read back exactly.

    Raises:
        ShapeError: not one stamp per pose.
        DataError: the file cannot be written.
    """
    from trimesh.transformations import quaternion_from_matrix

    if poses.shape != (len(stamps_ns), 4, 4):
        raise ShapeError(f"poses have shape {poses.shape}, expected ({len(stamps_ns)}, 4, 4)")
    lines = []
    for stamp, pose in zip(stamps_ns, poses, strict=True):
        seconds = Decimal(int(stamp)).scaleb(-9)
        wxyz = quaternion_from_matrix(pose)  # type: ignore[no-untyped-call]
        values = [*pose[:3, 3], *np.roll(wxyz, -1)]
        lines.append(f"{seconds:f} " + " ".join(f"{value:.17g}" for value in values) + "\n")
    with atomic_path(path) as temporary:
        temporary.write_text("".join(lines), encoding="ascii")


def read_times(path: PathLike) -> NDArray[np.int64]:
    """int64 (N) nanoseconds from KITTI's times.txt: seconds, one a line.

    Raises:
        DataError: missing, empty, more than one column, or no number.
    """
    path = Path(path)
    _table(path, (1,), "times in seconds, one a line")
    return _exact_stamps(path)


def read_timestamps(path: PathLike) -> NDArray[np.int64]:
    """int64 (N) nanoseconds since 1970 from KITTI raw's timestamps.txt, taken as UTC.

    Raises:
        DataError: missing, empty, or a line that is no date and time.
    """
    path = Path(path)
    with reading(path, "dates and times such as 2011-09-26 13:02:25.964389445, one a line"):
        lines = path.read_text(encoding="ascii").strip().splitlines()
        stamps = np.array([line.strip() for line in lines], dtype="datetime64[ns]")
    if not len(stamps) or np.isnat(stamps).any():
        raise DataError(f"{path}: a line is empty, expected a date and time in each")
    return stamps.astype(np.int64)


def match_poses(
    path: PathLike, numbers: NDArray[np.int64], stamps_ns: NDArray[np.int64]
) -> NDArray[np.float64]:
    """The poses of these frames: KITTI lines by frame number, TUM lines by time.

    Args:
        path: file in KITTI or TUM format.
        numbers: int64 (N), ascending.
        stamps_ns: int64 (N).

    Returns:
        float64 (N, 4, 4) world_from_body.

    Raises:
        DataError: the file cannot be read, is too short, or has no pose within 10 ms of a frame.
    """
    path = Path(path)
    pose_stamps, poses = read_poses(path)
    if pose_stamps is None:
        return pick(poses, numbers, path)
    nearest = _nearest(pose_stamps, stamps_ns)
    distance = np.abs(pose_stamps[nearest] - stamps_ns)
    if (far := np.flatnonzero(distance > POSE_TOLERANCE_NS)).size:
        raise DataError(
            f"{path} has no pose within 10 ms of {far.size} of {len(numbers)} frames; the first "
            f"is frame {numbers[far[0]]} at {stamps_ns[far[0]] / 1e9:.9f} s"
        )
    return poses[nearest]


def pick(values: NDArray[Scalar], numbers: NDArray[np.int64], path: Path) -> NDArray[Scalar]:
    """The rows of a file that belong to these frames: row n, counted from 0, is frame n.

    Raises:
        DataError: the file is too short.
    """
    needed = int(numbers[-1]) + 1
    if len(values) < needed:
        raise DataError(f"{path} has {len(values)} lines, frame {numbers[-1]} needs {needed}")
    return values[numbers]


def _nearest(stamps: NDArray[np.int64], wanted: NDArray[np.int64]) -> NDArray[np.intp]:
    """For each wanted stamp the index of the nearest one, whatever their order."""
    order = np.argsort(stamps)
    after = np.searchsorted(stamps, wanted, sorter=order).clip(0, len(stamps) - 1)
    before = (after - 1).clip(0)
    earlier, later = stamps[order[before]], stamps[order[after]]
    return order[np.where(wanted - earlier < later - wanted, before, after)]


def _table(path: Path, columns: tuple[int, ...], expected: str) -> NDArray[np.float64]:
    """A file of numbers separated by blanks, float64 (N, columns), N > 0, all finite."""
    with reading(path, expected), warnings.catch_warnings():
        # An empty file is an error below.
        warnings.filterwarnings("ignore", "loadtxt: input contained no data", UserWarning)
        rows = np.loadtxt(path, dtype=np.float64, ndmin=2, encoding="utf-8")
    if not rows.size:
        raise DataError(f"{path} is empty: expected {expected}")
    if rows.shape[1] not in columns:
        raise DataError(f"{path} has {rows.shape[1]} columns: expected {expected}")
    if (bad := np.flatnonzero(~np.isfinite(rows).all(axis=1))).size:
        raise DataError(f"{path}: row {bad[0] + 1} has NaN or infinity: expected {expected}")
    return rows


def _exact_stamps(path: Path) -> NDArray[np.int64]:
    """int64 (N) nanoseconds of the first column, seconds; float64 would lose digits of them."""
    with reading(path, "times in seconds that fit 64 bits as nanoseconds"):
        stamps = np.loadtxt(
            path, dtype=object, usecols=0, ndmin=1, encoding="utf-8", converters=_nanoseconds
        )
        return stamps.astype(np.int64)


def _nanoseconds(seconds: str) -> int:
    return round(Decimal(seconds).scaleb(9))
