# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Files of other programs: clouds, images, poses, calibrations, bags, worlds, meshes, networks."""

import io
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from PIL import Image

import bags
import fusionslam
import kitti
import scenes
from fusionslam.config import with_file
from fusionslam.datasets import (
    read_cloud,
    read_image,
    read_poses,
    read_times,
    read_timestamps,
    write_cloud,
)
from fusionslam.datasets.bags.reader import open_bag
from fusionslam.datasets.calibration import read_calib_yaml, read_calibration
from fusionslam.geometry.trajectory import read_trajectory
from fusionslam.pipelines.describe import PipelineConfig
from fusionslam.sensors.frame import Cloud
from fusionslam.sim.motion.map_files import read_map
from fusionslam.sim.worlds import load_world
from fusionslam.views import Scene
from fuzz import PROJECT
from fuzz.target import Target, check_numbers, refusing, scratch

POINTS, COLORS = kitti.POINTS, kitti.COLORS
Read = Callable[[Path], Any]


def foreign_file_targets() -> Iterator[Target]:
    """One target for each kind of file."""
    for suffix in (".ply", ".pcd", ".bin"):
        yield _file(f"cloud{suffix}", _cloud_seeds(suffix), _read_cloud)
    for suffix in (".png", ".jpg", ".pgm"):
        yield _file(f"image{suffix}", _image_seeds(suffix), read_image)
    yield _text("poses.txt", _POSES, read_poses)
    yield _text("times.txt", ["0.1\n0.2\n1317354879.229752001\n"], read_times)
    yield _text("timestamps.txt", ["2011-09-26 13:02:25.964389445\n"] * 2, read_timestamps)
    yield _text("calib.txt", [kitti.CALIB], read_calibration)
    yield _text("calib.yaml", [_CALIB_YAML], read_calib_yaml)
    yield _text("trajectory.csv", ["t,x,y,yaw\n0,0,0,0\n1,1,0,0.1\n2,2,0.1,0.2\n"], read_trajectory)
    yield _text(
        "configuration.yaml", ["fusion:\n  source: left\nm2dp:\n  planes: 64\n"], _configure
    )
    yield _file("map.yaml", _map_seeds, _read_map_yaml)
    yield _file("world.sdf", _sdf_seeds, load_world)
    yield _file("world.glb", _glb_seeds, load_world)
    for suffix in (".dae", ".obj", ".stl"):
        yield _file(f"mesh{suffix}", _mesh_seeds(suffix), _read_mesh(suffix))
    for suffix in (".bag", ".mcap"):
        yield _file(f"recording{suffix}", _bag_seeds(suffix), _read_bag)
        yield _file(f"dataset{suffix}", _bag_seeds(suffix), _read_dataset)
    yield _file("ranges.npz", _range_seeds, _read_dataset)
    yield Target("files/scene_bytes", _scene_bytes, _scene_from_bytes)
    yield Target("files/scene.json", _scene_json, _scene_from_json)


def _file(name: str, seeds: Callable[[Path], list[bytes]], read: Read) -> Target:
    def process(data: bytes) -> bool:
        path = scratch() / name
        path.write_bytes(data)
        return refusing(lambda: check_numbers(read(path)))

    return Target(f"files/{name}", lambda: seeds(scratch()), process)


def _text(name: str, texts: list[str], read: Read) -> Target:
    return _file(name, lambda folder: [text.encode() for text in texts], read)


def _cloud_seeds(suffix: str) -> Callable[[Path], list[bytes]]:
    def make(folder: Path) -> list[bytes]:
        path, found = folder / f"seed{suffix}", []
        for colors in (COLORS, None):
            write_cloud(path, Cloud(POINTS, colors))
            found.append(path.read_bytes())
        if suffix == ".pcd":
            from pypcd4.pypcd4 import Encoding, PointCloud

            for encoding in ("ascii", "binary_compressed"):
                PointCloud.from_xyzi_points(np.c_[POINTS, POINTS[:, 0]]).save(
                    path, Encoding(encoding)
                )
                found.append(path.read_bytes())
        return found

    return make


def _read_cloud(path: Path) -> None:
    cloud = read_cloud(path)
    fusionslam.drop_invalid(cloud.points)  # NaN marks a ray without return; fuse leaves it out
    check_numbers(cloud.colors)


def _image_seeds(suffix: str) -> Callable[[Path], list[bytes]]:
    def make(folder: Path) -> list[bytes]:
        noise = np.random.default_rng(0).integers(0, 256, (6, 8, 3), dtype=np.uint8)
        found = []
        for pixels in (noise, noise[..., 0]):
            stream = io.BytesIO()
            kind = {".png": "PNG", ".jpg": "JPEG", ".pgm": "PPM"}[suffix]
            Image.fromarray(pixels).save(stream, kind)
            found.append(stream.getvalue())
        return found

    return make


_POSES = [
    "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 1 0 1 0 0 0 0 1 2\n",
    "0.5 1 2 3 0 0 0 1\n0.6 1 2 3 0 0 0.7071 0.7071\n",
]
_CALIB_YAML = """\
left:
  projection: [[30, 0, 32, 0], [0, 30, 24, 0], [0, 0, 1, 0]]
  rectified_from_points: [[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]]
"""


def _configure(path: Path) -> None:
    with_file(PipelineConfig(), path)


def _map_seeds(folder: Path) -> list[bytes]:
    values = {
        "image": "map.pgm",
        "resolution": 0.05,
        "origin": [-1.0, -1.0, 0.0],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    }
    return [yaml.safe_dump(values).encode()]


def _read_map_yaml(path: Path) -> object:
    image = path.with_name("map.pgm")
    if not image.exists():
        Image.fromarray(np.full((40, 40), 254, np.uint8)).save(image)
    return read_map(path)


WORLD = PROJECT / "tests" / "data" / "worlds" / "room"


def _sdf_seeds(folder: Path) -> list[bytes]:
    if not (folder / "models").exists():
        shutil.copytree(WORLD / "models", folder / "models")
    return [path.read_bytes() for path in (WORLD / "worlds").iterdir() if path.is_file()]


def _glb_seeds(folder: Path) -> list[bytes]:
    import trimesh

    box = trimesh.creation.box((2, 2, 1))
    return [bytes(trimesh.Scene([box]).export(file_type="glb"))]  # type: ignore[no-untyped-call]


def _mesh_seeds(suffix: str) -> Callable[[Path], list[bytes]]:
    def make(folder: Path) -> list[bytes]:
        import trimesh

        found = [path.read_bytes() for path in WORLD.rglob(f"*{suffix}")]
        made = trimesh.creation.box((2, 2, 1)).export(file_type=suffix[1:])
        return [*found, made.encode() if isinstance(made, str) else made]

    return make


def _read_mesh(suffix: str) -> Read:
    text = (
        '<sdf version="1.6"><world name="w"><model name="m"><link name="l"><visual name="v">'
        f"<geometry><mesh><uri>mesh{suffix}</uri></mesh></geometry></visual></link></model>"
        "</world></sdf>"
    )

    def read(path: Path) -> object:
        world = path.with_name("with_mesh.sdf")
        world.write_text(text, encoding="utf-8")
        return load_world(world)

    return read


def _bag_seeds(suffix: str) -> Callable[[Path], list[bytes]]:
    def make(folder: Path) -> list[bytes]:
        path = folder / f"seed{suffix}"
        path.unlink(missing_ok=True)
        bags.write_bag(path, bags.drive(0.3))
        return [path.read_bytes()]

    return make


def _read_bag(path: Path) -> None:
    with open_bag(path) as bag:
        for event in bag.events():
            assert event.topic


def _read_dataset(path: Path) -> None:
    dataset = fusionslam.open_dataset(path)
    for index in range(min(len(dataset), 3)):
        frame = dataset[index]
        if frame.points is not None:
            fusionslam.drop_invalid(frame.points)
        check_numbers(frame.images)


def _range_seeds(folder: Path) -> list[bytes]:
    path = folder / "seed.npz"
    scenes.write_recording(path, (0, 1, 0))
    return [path.read_bytes()]


def _scene() -> Scene:
    return scenes.random_scene(np.random.default_rng(0), 5)


def _scene_bytes() -> list[bytes]:
    cloud = scenes.place(0)
    with_image = fusionslam.views.build_scene(cloud.points, cloud.colors)
    return [_scene().to_bytes(), with_image.to_bytes()]


def _use(scene: Scene) -> None:
    check_numbers(fusionslam.views.scene_similarity(scene, scene))
    scene.to_json()


def _scene_from_bytes(data: bytes) -> bool:
    return refusing(lambda: _use(Scene.from_bytes(data)))


def _scene_json() -> list[bytes]:
    return [_scene().to_json().encode()]


def _scene_from_json(data: bytes) -> bool:
    return refusing(lambda: _use(Scene.from_json(data.decode("utf-8", "replace"))))
