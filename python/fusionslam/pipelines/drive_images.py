# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The camera's images along a drive, recorded or rendered, and the templates' views of them."""

import hashlib
import json
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.config import merged
from fusionslam.errors import DataError
from fusionslam.sensors.frame import Camera
from fusionslam.storage.archive import load_arrays, save_arrays
from fusionslam.storage.arrays import Floats, Image
from fusionslam.storage.parallel import in_order
from fusionslam.storage.progress import Progress
from fusionslam.views.visual_templates import VisualTemplates, VisualTemplatesConfig

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset
    from fusionslam.geometry.trajectory import Trajectory
    from fusionslam.sim.camera import CameraMount


RATE_HZ = 10.0
"""Images a second that are rendered: those of the original's runs."""
# Part of the cache's key: raise it when the same key gives other bytes.
_FORMAT = 1
# Other values of VisualTemplatesConfig do not change what is kept of an image.
_OF_VIEWS = ("columns", "rows", "top", "bottom", "left", "right", "mean", "patch")


@dataclass(frozen=True, eq=False)
class Images:
    """Images of one camera in the order of time.

    Attributes:
        seconds: float64 (n), increasing, on the clock of the scans.
        poses: float64 (n, 3), true x, y in metres and yaw in radians; None where there is none.
        image: reads or renders the i-th, uint8 (H, W) or (H, W, 3); may be called by any thread.
        origin: where they come from, for people.
        key: what they are made of, for the cache; None for images that need not be kept.
        camera: of the whole images; None where nobody knows.
    """

    seconds: Floats
    poses: Floats | None
    image: Callable[[int], Image]
    origin: str
    key: str | None = None
    camera: Camera | None = None

    def __len__(self) -> int:
        return len(self.seconds)

    @property
    def rate_hz(self) -> float:
        """Images a second, the median; 0 where there are fewer than two."""
        return float(1 / np.median(np.diff(self.seconds))) if len(self) > 1 else 0.0


@dataclass(frozen=True, eq=False)
class TemplateViews:
    """What templates keep of a drive's images.

    Attributes:
        views: float32 (n, columns * rows).
        build_ms: median time to make one of an image.
    """

    views: NDArray[np.float32]
    build_ms: float


def recorded_images(dataset: "Dataset", seconds: Floats, poses: Floats | None) -> Images | None:
    """The images of a recording; None where it has none.

    Of a bag all images of the left camera while it was scanning, else one a scan.

    Args:
        dataset: the recording.
        seconds: float64 (m), times of its scans.
        poses: float64 (m, 3), the true places then, between which images are placed.
    """
    from fusionslam.datasets.bags.dataset import BagDataset

    if "left" not in dataset.sensors:
        return None
    camera = dataset.cameras.get("left")
    if isinstance(dataset, BagDataset):
        return replace(_bag_images(dataset, seconds, poses), camera=camera)
    origin = "images of the recording"
    return Images(seconds, poses, lambda i: dataset[i].images["left"], origin, camera=camera)


def _bag_images(dataset: Any, seconds: Floats, poses: Floats | None) -> Images:
    series, topic = dataset.source.series("left"), dataset.source.roles["left"]
    stamps = np.asarray(series.stamps_ns)
    # What is damaged in arrival order is put right: images in the order of their stamps.
    rows = np.argsort(stamps, kind="stable")
    times = stamps[rows] / 1e9
    inside = (times >= seconds[0]) & (times <= seconds[-1])
    rows, times = rows[inside], times[inside]

    def image(index: int) -> Image:
        message = dataset.source.bag.message(topic, *series.place(int(rows[index])))
        pixels: Image = message.image
        return pixels

    return Images(times, places_at(times, seconds, poses), image, "images of the bag")


def places_at(times: Floats, seconds: Floats, poses: Floats | None) -> Floats | None:
    """float64 (k, 3): places at times, straight between poses (n, 3) at increasing seconds (n)."""
    if poses is None:
        return None
    columns = (poses[:, 0], poses[:, 1], np.unwrap(poses[:, 2]))
    return np.stack([np.interp(times, seconds, values) for values in columns], axis=1)


def world_beside(recording: Path) -> Path | None:
    """The world that a recording is named after, in ``worlds`` beside its folder; None if none."""
    found = recording.resolve().parent.parent / "worlds" / f"{recording.stem}.glb"
    return found if found.is_file() else None


def rendered_images(
    world: Path,
    seconds: Floats,
    poses: Floats,
    *,
    bottom: int | None = None,
    robot: str = "turtlebot3_waffle_pi",
    rate_hz: float = RATE_HZ,
) -> Images:
    """What the robot's camera sees on its way through a world: rendered when it is asked for.

    Args:
        world: a file that ``load_world`` reads, with the drive beside it, if there is one.
        seconds: float64 (m), times of the scans, on the clock of that drive.
        poses: float64 (m, 3), true places then: the way, where there is no drive.
        bottom: the row after the last that is needed; what is below it is not rendered.
        robot: whose camera; the first one that it has.
        rate_hz: images a second.

    Raises:
        DataError: the world or its drive cannot be read.
        FusionSlamError: the simulator's extra is not installed.
    """
    from fusionslam.geometry.trajectory import Trajectory, read_trajectory
    from fusionslam.sim.robot import robot_named

    beside = world.with_suffix(".trajectory.csv")
    drive = Trajectory(seconds, poses[:, 0], poses[:, 1], np.unwrap(poses[:, 2]))
    if beside.is_file():
        drive = read_trajectory(beside)
    start, stop = float(seconds[0]), float(seconds[-1])
    times = start + np.arange(int(np.floor((stop - start) * rate_hz + 1e-6)) + 1) / rate_hz
    times = np.minimum(times, stop)
    camera = next(iter(robot_named(robot).cameras.values()))
    return Images(
        times,
        np.stack(drive.places(times), axis=1),
        _Renderer(world, drive, robot, _upper_part(camera, bottom), times),
        f"rendered in {world.name}",
        _key(world, robot, camera, drive, times),
        Camera(np.pad(camera.matrix(), ((0, 0), (0, 1))), size=(camera.width, camera.height)),
    )


class _Renderer:
    """Renders the i-th image; the world is read when the first one is asked for."""

    def __init__(
        self, world: Path, drive: "Trajectory", robot: str, camera: "CameraMount", times: Floats
    ) -> None:
        from fusionslam.sim.robot import base_from_camera, robot_named

        self._world, self._camera = world, camera
        self._poses = drive.at(times) @ base_from_camera(robot_named(robot), camera)
        self._caster: Any = None
        self._loading = threading.Lock()

    def __call__(self, index: int) -> Image:
        from fusionslam.sim.camera import photograph

        noise = np.random.default_rng([0, index])
        pose = self._poses[index]
        return photograph(self._loaded(), self._camera, pose, (1.0, 1.0, 1.0), noise)

    def _loaded(self) -> Any:
        from fusionslam.sim.scene import RayCaster
        from fusionslam.sim.worlds import load_world

        with self._loading:
            if self._caster is None:
                self._caster = RayCaster(load_world(self._world).visual)
            return self._caster


def _upper_part(camera: "CameraMount", bottom: int | None) -> "CameraMount":
    """The camera with fewer rows: each pixel of those that are left sees what it saw."""
    matrix = camera.matrix()
    rows = camera.height if bottom is None else min(bottom, camera.height)
    changes = {
        "view_rad": None,
        "focal_px": float(matrix[0, 0]),
        "centre_px": (float(matrix[0, 2]), float(matrix[1, 2])),
        "height": rows,
    }
    return merged(camera, changes)


def _key(world: Path, robot: str, camera: "CameraMount", drive: "Trajectory", times: Floats) -> str:
    hashed = hashlib.sha256(world.read_bytes())
    for values in (times, *drive.places(times)):
        hashed.update(np.ascontiguousarray(values).tobytes())
    hashed.update(f"{_FORMAT} {robot} {camera.model_dump_json()}".encode())
    return hashed.hexdigest()


def template_views(
    images: Images,
    config: VisualTemplatesConfig,
    *,
    jobs: int = 1,
    progress: Progress | None = None,
) -> TemplateViews:
    """What templates keep of each image; of rendered ones it is kept in the user's cache.

    Args:
        images: of the drive.
        config: of the templates.
        jobs: images read or rendered at a time; the result does not depend on it.
        progress: called with (images done, images in all).

    Raises:
        DataError: an image that cannot be read or rendered, or the cache cannot be written.
        ShapeError: an image that cannot become a template.
    """
    path = None if images.key is None else _cache_path(images.key, config)
    kept = None if path is None else _kept(path, images, config)
    if kept is not None:
        return kept
    made = _made(images, config, jobs, progress)
    if path is not None:
        save_arrays(path, {"views": made.views, "build_ms": np.array(made.build_ms)})
    return made


def _made(
    images: Images, config: VisualTemplatesConfig, jobs: int, progress: Progress | None
) -> TemplateViews:
    templates = VisualTemplates(config)
    views = np.empty((len(images), config.columns * config.rows), np.float32)
    spent = np.empty(len(images))
    with ThreadPoolExecutor(max(jobs, 1)) as pool:
        try:
            loaded = in_order(pool, images.image, range(len(images)), 4 * max(jobs, 1))
            for index, image in enumerate(loaded):
                begin = time.perf_counter()
                views[index] = templates.view(image)
                spent[index] = time.perf_counter() - begin
                if progress is not None:
                    progress(index + 1, len(images))
        except BaseException:
            pool.shutdown(wait=True, cancel_futures=True)
            raise
    return TemplateViews(views, float(np.median(spent) * 1e3) if len(images) else 0.0)


def _cache_path(key: str, config: VisualTemplatesConfig) -> Path:
    from fusionslam.storage.cache import cache_folder

    blocks = {name: getattr(config, name) for name in _OF_VIEWS}
    text = json.dumps([key, blocks], sort_keys=True)
    return cache_folder() / f"template-views-{hashlib.sha256(text.encode()).hexdigest()[:12]}.npz"


def _kept(path: Path, images: Images, config: VisualTemplatesConfig) -> TemplateViews | None:
    """What the cache has; None for nothing, or for a file that is none of ours."""
    try:
        with load_arrays(path, "template views") as stored:
            views, build_ms = stored["views"], float(stored["build_ms"])
    except DataError:
        return None
    fits = views.dtype == np.float32 and views.shape == (len(images), config.columns * config.rows)
    return TemplateViews(views, build_ms) if fits else None
