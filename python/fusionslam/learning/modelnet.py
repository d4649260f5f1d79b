# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Reads ModelNet40 in its published layouts, and ModelNet's voxel grids.

Two layouts of ModelNet40: ``modelnet40_ply_hdf5_2048`` (Qi et al. 2016: HDF5 files of 2,048 points
each, listed in train_files.txt and test_files.txt) and the meshes of Wu et al. 2015
(ModelNet40/<class>/train|test/*.off).
"""

import gzip
import os
from pathlib import Path
from typing import Any, Literal

import numpy as np
import trimesh
from numpy.typing import NDArray

from fusionslam.base.archive import parse_array
from fusionslam.base.files import EXPANSION, MOST_EXPANDED, check_expansion, reading
from fusionslam.errors import DataError, FusionSlamError
from fusionslam.learning.procedural_shapes import sample_points
from fusionslam.learning.shape_sets import ShapeSet

Part = Literal["train", "test"]

# ModelNet's up axis is y in the published HDF5 files and z in the meshes.
_Z_UP = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], np.float32)


def read_modelnet(
    folder: str | os.PathLike[str], part: Part, points: int, rng: np.random.Generator
) -> ShapeSet:
    """Read ModelNet40 from a folder in either layout.

    Args:
        folder: the one with train_files.txt, or the one with a folder for each class.
        part: "train" or "test".
        points: number of points per object.
        rng: chooses the points, or their positions on the surface.

    Raises:
        DataError: neither layout, or a damaged file; the message names it.
        FusionSlamError: h5py is not installed.
    """
    base = Path(folder)
    if (base / f"{part}_files.txt").is_file():
        return _read_hdf5(base, part, points, rng)
    return _read_off(base, part, points, rng)


def _read_hdf5(base: Path, part: Part, points: int, rng: np.random.Generator) -> ShapeSet:
    names = tuple(_read_lines(base / "shape_names.txt"))
    clouds, labels = [], []
    for line in _read_lines(base / f"{part}_files.txt"):
        # The lists contain paths of the authors' folder.
        data, label = _read_arrays(base / Path(line).name)
        if data.ndim != 3 or data.shape[2] != 3 or len(label) != len(data):
            raise DataError(
                f"{base / Path(line).name}: data {data.shape} and label {label.shape}, expected "
                "(n, points, 3) and (n, 1)"
            )
        if label.max(initial=0) >= len(names) or data.shape[1] < points:
            raise DataError(
                f"{base / Path(line).name}: labels up to {label.max(initial=0)} and "
                f"{data.shape[1]} points, expected below {len(names)} and at least {points}"
            )
        kept = rng.permutation(data.shape[1])[:points]
        clouds.append(data[:, kept] @ _Z_UP)
        labels.append(label)
    return ShapeSet(np.concatenate(clouds), np.concatenate(labels), names)


def _read_lines(path: Path) -> list[str]:
    with reading(path, "names, one a line"):
        found = path.read_text(encoding="utf-8").splitlines()
        lines = [line.strip() for line in found if line.strip()]
        if not lines:
            raise DataError("is empty")
    return lines


def _read_arrays(path: Path) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    try:
        import h5py
    except ImportError as error:
        raise FusionSlamError(
            "ModelNet40's HDF5 files need h5py, which is not installed: "
            "pip install 'fusionslam[learn]'"
        ) from error
    with reading(path, "HDF5 with data and label"), h5py.File(path, "r") as stored:
        size = path.stat().st_size
        data = np.asarray(_own_data(stored, "data", size), np.float32)
        label = np.asarray(_own_data(stored, "label", size), np.int64).reshape(-1)
        if not np.isfinite(data).all():
            raise DataError("data has values that are not finite", code="not-finite")
    return data, label


def _own_data(stored: Any, name: str, size: int) -> Any:
    """A data set stored in this HDF5 file of ``size`` bytes. Raises ValueError for any other."""
    import h5py

    if not isinstance(stored.get(name, getlink=True), h5py.HardLink):
        raise ValueError(f"{name} is in another file")
    found = stored[name]
    if found.external or found.is_virtual:
        raise ValueError(f"{name} is in another file")
    check_expansion(found.size * max(found.dtype.itemsize, 8), size)
    return found


def _read_off(base: Path, part: Part, points: int, rng: np.random.Generator) -> ShapeSet:
    files = sorted(base.glob(f"*/{part}/*.off"))
    if not files:
        raise DataError(
            f"{base}: expected {part}_files.txt with HDF5 files (modelnet40_ply_hdf5_2048) or "
            f"<class>/{part}/*.off (ModelNet40)"
        )
    # Classes of both parts, so that train and test have the same numbering.
    names = tuple(sorted({path.parent.parent.name for path in base.glob("*/*/*.off")}))
    clouds = [sample_points(_read_mesh(path), points, rng) for path in files]
    labels = [names.index(path.parent.parent.name) for path in files]
    return ShapeSet(np.stack(clouds), np.asarray(labels, np.int64), names)


def _read_mesh(path: Path) -> trimesh.Trimesh:
    with reading(path, "a mesh in OFF"):
        mesh = trimesh.load_mesh(path, process=False)
        triangles = np.asarray(mesh.triangles, np.float64)
        if not len(triangles) or not np.isfinite(triangles).all():
            raise DataError(f"expected finite triangles, found {len(triangles)}")
    return mesh


def read_voxels(
    path: str | os.PathLike[str], name: str, points: int, rng: np.random.Generator
) -> ShapeSet:
    """Read objects of one class from voxel grids, as points on the occupied surface.

    Empty grids and duplicates of earlier ones are left out.

    Args:
        path: .npy or .npy.gz of (n, 32, 32, 32) or (n, 1, 32, 32, 32), 1 where occupied.
        name: name of the class.
        points: number of points per object, spread evenly over the voxels, anywhere inside them.
        rng: chooses the positions.

    Raises:
        DataError: not such a file, or no occupied voxels.
    """
    grids = _read_grids(Path(path))
    filled = np.flatnonzero(grids.any(axis=(1, 2, 3)))
    if not len(filled):
        raise DataError(f"{path}: nothing is occupied in any of {len(grids)} grids")
    rows = grids[filled].reshape(len(filled), -1)
    _, first = np.unique(np.packbits(rows, axis=1), axis=0, return_index=True)
    kept = filled[np.sort(first)]
    clouds = np.stack([_sample_surface(grids[index], points, rng) for index in kept])
    return ShapeSet(clouds, np.zeros(len(kept), np.int64), (name,))


def _read_grids(path: Path) -> NDArray[np.bool_]:
    open_file = gzip.open if path.suffix == ".gz" else open
    with reading(path, "an array of voxels"), open_file(path, "rb") as stream:
        size = path.stat().st_size
        data = bytearray(stream.read(max(MOST_EXPANDED, EXPANSION * size) + 1))
        check_expansion(len(data), size)
        values = parse_array(data, path.name)
    if values.ndim == 5 and values.shape[1] == 1:
        values = values[:, 0]
    if values.ndim != 4 or 0 in values.shape:
        raise DataError(f"{path} has shape {values.shape}, expected (n, 32, 32, 32)")
    occupied: NDArray[np.bool_] = values > 0.5
    return occupied


def _sample_surface(
    grid: NDArray[np.bool_], points: int, rng: np.random.Generator
) -> NDArray[np.float32]:
    from scipy import ndimage

    inside = ndimage.binary_erosion(grid)
    cells = np.argwhere(grid & ~inside)
    chosen = cells[rng.integers(len(cells), size=points)]
    return (chosen + rng.random(chosen.shape)).astype(np.float32)
