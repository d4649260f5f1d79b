# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Small worlds: boxes, rooms of known ranges, a painted round room, posts in a field."""

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.geometry.trajectory import Trajectory
from fusionslam.sensors.frame import Cloud
from fusionslam.sim.lidar import LidarMount
from fusionslam.sim.mesh import Paint, box, panels
from fusionslam.sim.robot import FrameConfig, RobotConfig
from fusionslam.sim.scene import Light
from fusionslam.sim.world import Part, World, scene_of
from project import SMALL_DATA

ROOM = SMALL_DATA / "worlds/room"

PLAIN = np.full((4, 4, 4), 255, np.uint8)
# What is lit equally from all sides, without haze: a surface's tint is its colour.
EVEN = Light(sun=(0.0, 0.0, 0.0), ambient=(1.0, 1.0, 1.0), visibility_m=1e9)
HALL = ((-6.0, -4.0), (6.0, 4.0))


def copy_room(folder: Path) -> Path:
    """A copy of the room of the small data that a test may change."""
    return Path(shutil.copytree(ROOM, folder / "room"))


def floor(half_m: float = 6.0) -> Part:
    corners = [[(-half_m, -half_m, 0), (half_m, -half_m, 0), (half_m, half_m, 0)]]
    corners[0].append((-half_m, half_m, 0))
    return Part("floor", panels(corners, Paint(0, (0.5, 0.5, 0.5))), is_ground=True)


Triple = tuple[float, float, float]


def block(name: str, low: Triple, high: Triple, tint: Triple = (1.0, 1.0, 1.0)) -> Part:
    return Part(name, box(low, high, Paint(0, tint)))


def hall() -> World:
    """12 x 8 m inside, walls 0.2 m thick and 2 m high, a red pillar and a low blue one.

    The blue one is missing among the collision shapes.
    """
    (x0, y0), (x1, y1) = HALL
    walls = [
        block("south", (x0 - 0.2, y0 - 0.2, 0), (x1 + 0.2, y0, 2)),
        block("north", (x0 - 0.2, y1, 0), (x1 + 0.2, y1 + 0.2, 2)),
        block("west", (x0 - 0.2, y0, 0), (x0, y1, 2)),
        block("east", (x1, y0, 0), (x1 + 0.2, y1, 2)),
        block("red", (2, -0.5, 0), (3, 0.5, 1.5), (1.0, 0.0, 0.0)),
    ]
    blue = block("blue", (-3, 2, 0), (-2, 3, 1.0), (0.0, 0.0, 1.0))
    visual = scene_of([floor(), *walls, blue], [PLAIN], EVEN)
    return World(name="hall", visual=visual, collision=scene_of([floor(), *walls], [PLAIN], EVEN))


def straight(seconds: float = 4.0, speed: float = 0.5) -> Trajectory:
    """From (-4, 0) along x."""
    times = np.array([0.0, seconds])
    return Trajectory(times, -4 + speed * times, np.zeros(2), np.zeros(2))


def bare_robot(**lidar: Any) -> RobotConfig:
    """One LiDAR without errors, 0.5 m above the ground and 0.1 m in front of the base."""
    perfect: dict[str, Any] = {
        "noise_m": 0.0,
        "dropout": 0.0,
        "grazing_dropout": 0.0,
        "far_dropout": 0.0,
    }
    mount: dict[str, Any] = {"position_m": (0.1, 0.0, 0.2), "parent": "mast", "shapes": "collision"}
    return RobotConfig(
        frames={"mast": FrameConfig(position_m=(0.0, 0.0, 0.3))},
        lidars={"lidar": LidarMount(**(perfect | mount | lidar))},
    )


def two_scanners() -> RobotConfig:
    """One LiDAR looks ahead at 10 Hz, one back at 12.5 Hz, with errors of 1 cm."""
    sweep = {"rings": 4, "top_deg": 3, "bottom_deg": -3, "azimuths": 180, "scan_motion": True}
    robot = bare_robot(**sweep, topic="/front", noise_m=0.01, sector_rad=(1.6, -1.6))
    own = {"topic": "/rear", "frame_id": "rear", "tilt_deg": (0, 0, 180), "rate_hz": 12.5}
    rear = robot.lidars["lidar"].model_copy(update=own | {"position_m": (-0.4, 0.0, 0.2)})
    return robot.model_copy(update={"lidars": robot.lidars | {"rear": rear}})


def winding(seconds: float = 3.0) -> Trajectory:
    """From (-4, 0) along x at 0.5 m/s, turning by up to 1 rad/s."""
    times = np.linspace(0, seconds, round(100 * seconds) + 1)
    return Trajectory(times, -4 + 0.5 * times, 0 * times, 0.8 * np.sin(1.25 * times))


Array = NDArray[np.float64]
Pose = tuple[float, float, float]

SENSOR_M = 0.17
AHEAD = np.radians(np.arange(-60.0, 60.0, 1.0))
BEHIND = AHEAD + np.pi
AROUND = np.radians(np.arange(0.0, 360.0, 1.0))
ELEVATIONS = np.radians(np.arange(-7.0, 30.0, 2.0))


@dataclass(frozen=True)
class Room:
    """Walls from ``first`` (w, 2) to ``last`` (w, 2) in metres, as high as ``height`` (w), of
    colour (w, 3)."""

    first: Array
    last: Array
    height: Array
    color: NDArray[np.uint8]


def room(seed: int, half: tuple[float, float] = (4.0, 3.0), boxes: int = 9) -> Room:
    """A rectangle with boxes along its walls, at least 1.5 m from the middle."""
    rng = np.random.default_rng([29, seed])
    rectangles = [(np.zeros(2), np.array(half), 2.5, rng.integers(0, 256, 3))]
    while len(rectangles) <= boxes:
        center = rng.uniform(-1, 1, 2) * half
        if np.hypot(*center) > 1.5:
            size, height = rng.uniform(0.15, 0.5, 2), rng.uniform(0.4, 2.0)
            rectangles.append((center, size, height, rng.integers(0, 256, 3)))
    around = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    corners = np.concatenate([center + around * size for center, size, _, _ in rectangles])
    after = np.concatenate([center + np.roll(around, -1, 0) * s for center, s, _, _ in rectangles])
    heights = np.repeat([height for *_, height, _ in rectangles], 4)
    colors = np.repeat([color for *_, color in rectangles], 4, axis=0)
    return Room(corners, after, heights, colors.astype(np.uint8))


def scan(
    where: Room, pose: Pose, azimuths: Array = AHEAD, *, seed: int = 0, noise_m: float = 0.005
) -> Cloud:
    """What a robot at x, y, yaw sees of a room: a cloud in its frame, the floor not in it."""
    azimuth, elevation = (part.ravel() for part in np.meshgrid(azimuths, ELEVATIONS))
    level, wall = _nearest(where, pose, azimuth, np.tan(elevation))
    seen = np.isfinite(level)
    azimuth, elevation = azimuth[seen], elevation[seen]
    noise = np.random.default_rng([31, seed]).normal(0, noise_m, len(azimuth))
    level = level[seen] + noise * np.cos(elevation)
    place = [level * np.cos(azimuth), level * np.sin(azimuth)]
    points = np.stack([*place, SENSOR_M + level * np.tan(elevation)], axis=1)
    return Cloud(points.astype(np.float32), where.color[wall[seen]])


def _nearest(
    where: Room, pose: Pose, azimuth: Array, slope: Array
) -> tuple[Array, NDArray[np.int64]]:
    """How far in plan the first wall of each ray is, infinite for none, and which it is."""
    x, y, yaw = pose
    ray = np.stack([np.cos(azimuth + yaw), np.sin(azimuth + yaw)], axis=1)[:, None]
    along = (where.last - where.first)[None]
    to_wall = (where.first - [x, y])[None]

    def cross(a: Array, b: Array) -> Array:
        return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0], np.float64)

    with np.errstate(divide="ignore", invalid="ignore"):
        far = cross(to_wall, along) / cross(ray, along)
        share = cross(to_wall, ray) / cross(ray, along)
        height = SENSOR_M + far * slope[:, None]
        met = (far > 0) & (share >= 0) & (share <= 1) & (height > 0.1) & (height <= where.height)
    far = np.where(met, far, np.inf)
    return far.min(axis=1), far.argmin(axis=1)


def seen_from(stored: Pose, current: Pose) -> Pose:
    """The current pose in the frame of the stored one."""
    dx, dy = current[0] - stored[0], current[1] - stored[1]
    c, s = np.cos(stored[2]), np.sin(stored[2])
    return float(c * dx + s * dy), float(c * dy - s * dx), current[2] - stored[2]


ROOM_WIDTH, ROOM_HEIGHT, VIEW = 320, 24, 1.0
RADIUS_M = 3.0


def room_image(x: float = 0.0, yaw: float = 0.0, view: float = VIEW, seed: int = 5) -> np.ndarray:
    """uint8 (24, 320), seen from (x, 0)."""
    focal = ROOM_WIDTH / 2 / np.tan(view / 2)
    # The optical frame has x to the right: a column left of the centre looks counter-clockwise.
    ray = yaw - np.arctan((np.arange(ROOM_WIDTH) - (ROOM_WIDTH - 1) / 2) / focal)
    along = x * np.cos(ray)
    far = -along + np.sqrt(along**2 + RADIUS_M**2 - x**2)
    on_wall = np.arctan2(far * np.sin(ray), x + far * np.cos(ray))
    rng = np.random.default_rng(seed)
    waves, phases = np.arange(1, 90), rng.uniform(0, 2 * np.pi, 89)
    paint = (np.cos(np.outer(on_wall, waves) + phases) * rng.uniform(0.3, 1, 89)).sum(1)
    rows = rng.uniform(0.9, 1.1, (ROOM_HEIGHT, 1))
    return np.asarray(((120 + 9 * paint) * rows).clip(0, 255).round(), np.uint8)
