# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``SceneRecorder``: records a ``SceneSet`` online, as ``record_scenes`` does from data."""

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.evaluation.views.judge import validate_poses
from fusionslam.sensors.frame import Cloud
from fusionslam.sensors.messages import next_stamp
from fusionslam.views.scene_set import CloudArray, SceneSet, scene_values
from fusionslam.views.scenes import Scene, SceneConfig


class SceneRecorder:
    """Collects coloured clouds, or only scenes, with their time stamps and true poses.

    Scans without a true pose are left out. Memory grows with the scans kept (15 bytes per cloud
    point). Once ``max_scans`` are kept, further scans are dropped. Scan numbers count all scans,
    including those not kept.

    Args:
        name: human-readable name.
        frame: frame of the clouds or scenes.
        scene_config: None keeps clouds; a configuration keeps the scenes built with it instead.
        max_scans: the most scans to keep; 0 means no limit.
        source: origin of the scans, as JSON values.

    Attributes:
        without_pose: number of scans left out because they had no pose.
        dropped: number of scans that arrived after ``max_scans`` were kept.

    Raises:
        ConfigError: a negative ``max_scans``.
    """

    def __init__(
        self,
        name: str,
        *,
        frame: str = "robot",
        scene_config: SceneConfig | None = None,
        max_scans: int = 0,
        source: Mapping[str, Any] | None = None,
    ) -> None:
        if max_scans < 0:
            raise ConfigError(f"max_scans is {max_scans}, expected at least 0")
        self.name, self.frame, self.source = name, frame, dict(source or {})
        self._config, self._most = scene_config, max_scans
        self.without_pose = self.dropped = 0
        self._last_ns: int | None = None
        self._kept: list[tuple[int, int, Cloud | Scene]] = []
        self._poses: list[NDArray[np.float64]] = []
        self._odometry: list[NDArray[np.float64]] = []

    def __len__(self) -> int:
        """Number of scans kept."""
        return len(self._kept)

    def add(
        self,
        stamp_ns: int,
        item: Cloud | Scene,
        pose: ArrayLike | None,
        odometry: ArrayLike | None = None,
    ) -> None:
        """Record the next scan.

        Args:
            stamp_ns: its time stamp, not earlier than the previous scan's.
            item: its coloured cloud without ground, which is copied; or its scene, which is rounded
                to the precision in which sets store scenes.
            pose: its true x, y in metres and yaw in radians; None if unknown.
            odometry: the same as odometry measured it, in a frame of its own; None if unknown.

        Raises:
            ClockError: a stamp earlier than the previous scan's: a set holds one drive.
            DataError: no colours, or values that are not finite. ShapeError: arrays of another
                shape, or no cloud although clouds are kept. Nothing is kept or counted on an error.
        """
        stamp = next_stamp(stamp_ns, self._last_ns)
        if self._config is None:
            held: Cloud | Scene = _copy_cloud(item)
        elif isinstance(item, Scene):
            held = Scene.from_bytes(item.to_bytes())
        else:
            raise ShapeError(f"expected a Scene, got {type(item).__name__}")
        poses = None if pose is None else validate_poses([pose])
        moved = np.full((1, 3), np.nan) if odometry is None else validate_poses([odometry])
        number = len(self._kept) + self.without_pose + self.dropped
        self._last_ns = stamp
        if poses is None:
            self.without_pose += 1
        elif 0 < self._most <= len(self._kept):
            self.dropped += 1
        else:
            self._kept.append((stamp, number, held))
            self._poses.append(poses[0])
            self._odometry.append(moved[0])

    def scene_set(self) -> SceneSet:
        """All scans kept so far."""
        clouds = [item for *_, item in self._kept if isinstance(item, Cloud)]
        scenes = [item for *_, item in self._kept if isinstance(item, Scene)]
        empty = [
            not len(item) and (isinstance(item, Cloud) or not len(item.image))
            for *_, item in self._kept
        ]
        config = self._config
        odometry = np.array(self._odometry).reshape(-1, 3)
        return SceneSet(
            name=self.name,
            stamps_ns=np.array([stamp for stamp, *_ in self._kept], np.int64),
            numbers=np.array([number for _, number, _ in self._kept], np.int64),
            empty=np.array(empty, np.bool_),
            frame=self.frame,
            poses=np.array(self._poses).reshape(-1, 3),
            odometry=None if np.isnan(odometry).all() else odometry,
            clouds=CloudArray.of(clouds) if config is None else None,
            scenes=None if config is None else scenes,
            scene_config=None if config is None else scene_values(config),
            source=self.source,
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Save all scans kept so far, as ``SceneSet.save``; recording may continue."""
        self.scene_set().save(path)


def _copy_cloud(item: Cloud | Scene) -> Cloud:
    if not isinstance(item, Cloud):
        raise ShapeError(f"expected a Cloud, got {type(item).__name__}")
    if item.colors is None:
        raise DataError("the cloud has no colours, which scenes need", code="no-colors")
    for name, array, dtype in (
        ("points", item.points, np.float32),
        ("colors", item.colors, np.uint8),
    ):
        if array.shape != (len(item.points), 3) or array.dtype != dtype:
            expected = f"{np.dtype(dtype)} ({len(item.points)}, 3)"
            raise ShapeError(f"{name} are {array.dtype} {array.shape}, expected {expected}")
    if not np.isfinite(item.points).all():
        raise DataError("the cloud holds NaN or infinity", code="not-finite")
    return Cloud(item.points.copy(), item.colors.copy())
