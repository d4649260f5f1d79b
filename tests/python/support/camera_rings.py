# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras all round a scanner, and what they see of a coloured world around it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image

from bags import SECOND, START, static
from fusionslam import Camera
from fusionslam.sensors.messages import CameraInfo, Event, FrameTransforms, Picture, Scan

Matrix = NDArray[np.float64]
SIZE = (80, 60)
FOCAL = 33.0
"""Half the width of the image over it is the tangent of 50.5 degrees."""
RING = {"left": 0.0, "side_left": 90.0, "rear": 180.0, "side_right": -90.0}
"""Yaw of each camera, degrees."""
_OPTICAL = np.array([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])


def camera_at(yaw_deg: float, size: tuple[int, int] = SIZE) -> Camera:
    """A camera at the scanner, turned to the left by an angle."""
    c, s = np.cos(np.deg2rad(yaw_deg)), np.sin(np.deg2rad(yaw_deg))
    turn = np.eye(4)
    turn[:2, :2] = [[c, s], [-s, c]]
    width, height = size
    focal = FOCAL * width / SIZE[0]
    projection = np.array(
        [[focal, 0, (width - 1) / 2, 0], [0, focal, (height - 1) / 2, 0], [0, 0, 1, 0]]
    )
    return Camera(projection, _OPTICAL @ turn, size)


def ring() -> dict[str, Camera]:
    return {name: camera_at(yaw) for name, yaw in RING.items()}


def points_around(count: int = 20_000, seed: int = 4) -> NDArray[np.float32]:
    """Points on a cylinder around the scanner, 5 m away."""
    rng = np.random.default_rng(seed)
    angle, z = rng.uniform(-np.pi, np.pi, count), rng.uniform(-2, 2, count)
    return np.stack([5 * np.cos(angle), 5 * np.sin(angle), z], axis=1).astype(np.float32)


def world_colors(points: NDArray[np.floating]) -> Matrix:
    """Smooth colours of directions, 60 to 120: float64 (N, 3)."""
    angle = np.arctan2(points[:, 1], points[:, 0])
    waves = [np.sin(k * angle + k * k) for k in (1, 2, 3)]
    return 90 + 30 * np.stack(waves, axis=1)


def picture(camera: Camera, gain: NDArray[np.float64] | float = 1.0) -> NDArray[np.uint8]:
    """What a camera sees of the world, times gains of red, green and blue."""
    assert camera.size is not None
    width, height = camera.size
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    rays = np.linalg.inv(camera.projection[:, :3]) @ np.stack([u, v, np.ones_like(u)]).reshape(
        3, -1
    )
    directions = camera.points_from_rectified[:3, :3] @ rays
    seen = world_colors(directions.T) * gain
    return np.rint(seen).clip(0, 255).astype(np.uint8).reshape(height, width, 3)


def write_ring_folder(root: Path, frames: int = 3, names: Mapping[str, str] | None = None) -> Path:
    """A plain folder of scans and images of the ring; ``names`` gives cameras other names."""
    called = {name: (names or {}).get(name, name) for name in RING}
    (root / "clouds").mkdir(parents=True)
    for number in range(frames):
        points = points_around(2000, seed=number)
        cloud = np.column_stack([points, np.zeros(len(points), np.float32)])
        cloud.astype("<f4").tofile(root / "clouds" / f"{number:03d}.bin")
        for name, camera in ring().items():
            path = root / called[name] / f"{number:03d}.png"
            path.parent.mkdir(exist_ok=True)
            Image.fromarray(picture(camera)).save(path)
    (root / "calib.yaml").write_text(yaml.safe_dump(calibration(called), sort_keys=False))
    return root


def calibration(called: Mapping[str, str]) -> dict[str, Any]:
    """The content of a calib.yaml."""
    return {
        called[name]: {
            "projection": camera.projection.ravel().tolist(),
            "rectified_from_points": camera.rectified_from_points.ravel().tolist(),
            "size": list(SIZE),
        }
        for name, camera in ring().items()
    }


def ring_events(seconds: float = 1.0) -> list[Event]:
    """Scans at 5 Hz and images at 10 Hz of a robot that stands; /NAME/image and /NAME/info."""
    links = [static("base", "scanner", np.eye(4))]
    links += [static("scanner", name, c.points_from_rectified) for name, c in ring().items()]
    events = [Event("/tf_static", START, FrameTransforms(transforms=tuple(links)))]
    for k in range(round(10 * seconds) + 1):
        stamp_ns = START + k * SECOND // 10
        for name, camera in ring().items():
            info = CameraInfo(
                stamp_ns=stamp_ns,
                frame_id=name,
                size=SIZE,
                camera_matrix=camera.projection[:, :3],
                projection=camera.projection,
            )
            image = Picture(stamp_ns=stamp_ns, frame_id=name, image=picture(camera))
            events += [Event(f"/{name}/info", stamp_ns, info)]
            events += [Event(f"/{name}/image", stamp_ns, image)]
        if k % 2 == 0:
            points = points_around(2000, seed=k)
            scan = Scan(stamp_ns=stamp_ns, frame_id="scanner", points=points)
            events.append(Event("/points", stamp_ns, scan))
    return events
