# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Small files that ask for gigabytes or lead elsewhere: refused by name, in no time."""

import gzip
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from error_codes import has_code
from fusionslam.base import files
from fusionslam.config import with_file, with_settings
from fusionslam.datasets import read_cloud, read_image
from fusionslam.datasets.calibration import read_calib_yaml
from fusionslam.errors import ConfigError, DataError
from fusionslam.pipelines.describe import PipelineConfig
from rows import rows


def pcd(path: Path, extra: int, fields: int = 1) -> Path:
    """One point of x, y, z, and more fields with ``extra`` numbers each."""
    names = " ".join(f"n{k}" for k in range(fields))
    ones, counts = " ".join(["4"] * fields), " ".join([str(extra)] * fields)
    path.write_text(
        f"VERSION 0.7\nFIELDS x y z {names}\nSIZE 4 4 4 {ones}\nTYPE F F F {'F ' * fields}\n"
        f"COUNT 1 1 1 {counts}\nWIDTH 1\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 1\n"
        f"DATA ascii\n1 2 3 {' '.join(['0'] * min(extra * fields, 1000))}\n"
    )
    return path


@rows("extra, fields", [(900_000_000, 1), (20_000, 1), (1, 20_000)])
def test_a_pcd_point_of_too_many_numbers_is_none(tmp_path: Path, extra: int, fields: int) -> None:
    path = pcd(tmp_path / "a.pcd", extra, fields)
    with pytest.raises(DataError, check=has_code("damaged-file", path)):
        read_cloud(path)
    assert read_cloud(pcd(path, 352)).points.tolist() == [[1, 2, 3]]  # a descriptor


def png(path: Path, width: int, height: int) -> Path:
    def chunk(kind: bytes, data: bytes) -> bytes:
        checksum = struct.pack(">I", zlib.crc32(kind + data))
        return struct.pack(">I", len(data)) + kind + data + checksum

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    content = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(bytes(100)))
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + content + chunk(b"IEND", b""))
    return path


@pytest.mark.filterwarnings("ignore:Image size")
@rows("side", [9_500, 13_000, 30_000, 2**31 - 1])
def test_an_image_of_too_many_pixels_is_refused(tmp_path: Path, side: int) -> None:
    path = png(tmp_path / "a.png", side, side)
    with pytest.raises(DataError, check=has_code("damaged-file", path)):
        read_image(path)


BOMB = "b0: &b0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
    f"b{k}: &b{k} [{', '.join([f'*b{k - 1}'] * 10)}]\n" for k in range(1, 12)
)
YAML: dict[str, str] = {
    "aliases that expand": BOMB,
    "a list in itself": "left: &x [*x]",
    "a mapping in itself": "left: &x {projection: *x}",
    "nested lists": "left: " + "[" * 100_000,
    "nested mappings": "{left: " * 100_000,
    "more than settings": "left: [" + "1, " * 200_000 + "1]",
    "a tag": "left: !!python/object/apply:os.getcwd []",
    "a number of 5,000 digits": "left: " + "9" * 5000,
    "a day that is none": "left: 2001-99-99",
}


@rows("content", YAML)
def test_yaml_beyond_settings_is_refused(tmp_path: Path, content: str) -> None:
    path = tmp_path / "a.yaml"
    path.write_text(YAML[content])
    with pytest.raises(ConfigError, check=has_code("config-file", path)):
        with_file(PipelineConfig(), path)
    with pytest.raises(DataError, check=has_code("damaged-file", path)):
        read_calib_yaml(path)


@rows("value", ["[" * 100_000, "2001-99-99", "&x [*x]", "9" * 5000])
def test_a_setting_that_is_no_yaml_is_refused(value: str) -> None:
    with pytest.raises(ConfigError, match=r"fusion\.voxel"):
        with_settings(PipelineConfig(), [f"fusion.voxel={value}"])
    with pytest.raises(ConfigError, check=has_code("config-file", "/dev/zero")):
        with_file(PipelineConfig(), "/dev/zero")


def test_yaml_may_use_aliases(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(
        "fusion: {voxel: &size 0.25}\ndescriptors: &same {preset: paper}\nloop_closure: {}\n"
        "evaluation: {radius: *size}\n"
    )
    config = with_file(PipelineConfig(), tmp_path / "a.yaml")
    assert (config.fusion.voxel, config.evaluation.radius) == (0.25, 0.25)


def test_numbers_without_a_point_before_the_power_are_numbers() -> None:
    assert files.parse_yaml("[2e-5, 2.0e-5, 1E3, 0x10]") == [2e-5, 2e-5, 1000.0, 16]


def test_voxels_that_expand_beyond_the_limit_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("torch")
    from fusionslam.learning.modelnet import read_voxels

    grids = np.zeros((8, 32, 32, 32), np.uint8)
    grids[:, 3:9, 3:9, 3:9] = 1
    with gzip.open(tmp_path / "a.npy.gz", "wb") as stream:
        np.save(stream, grids)
    rng = np.random.default_rng(0)
    assert len(read_voxels(tmp_path / "a.npy.gz", "box", 10, rng)) == 1
    monkeypatch.setattr("fusionslam.learning.modelnet.MOST_EXPANDED", 1 << 16)
    monkeypatch.setattr(files, "MOST_EXPANDED", 1 << 16)
    with pytest.raises(DataError, check=has_code("damaged-file", tmp_path / "a.npy.gz")):
        read_voxels(tmp_path / "a.npy.gz", "box", 10, rng)


@rows("case", ["huge", "link", "external", "soft"])
def test_hdf5_that_is_huge_or_in_other_files_is_refused(tmp_path: Path, case: str) -> None:
    pytest.importorskip("torch")
    h5py = pytest.importorskip("h5py")
    from fusionslam.learning import modelnet

    path, secret = tmp_path / "a.h5", tmp_path / "secret"
    secret.write_bytes(bytes(99))
    with h5py.File(tmp_path / "other.h5", "w") as stored:
        stored["data"] = np.zeros((1, 11, 3), np.uint8)
    with h5py.File(path, "w") as stored:
        stored["label"] = np.zeros(1)
        if case == "huge":
            stored.create_dataset("data", (10**6, 2048, 3), "f4", chunks=(9, 2048, 3))
        elif case == "external":
            stored.create_dataset("data", (1, 11, 3), "u1", external=[(str(secret), 0, 33)])
        else:
            link = h5py.ExternalLink("other.h5", "data"), h5py.SoftLink("/label")
            stored["data"] = link[case == "soft"]
    with pytest.raises(DataError, check=has_code("damaged-file", path)):
        modelnet._read_arrays(path)
