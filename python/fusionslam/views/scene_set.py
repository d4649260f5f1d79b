# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``SceneSet``: the recorded scans of a drive, reusable without the raw data (Stastny 2022, 5.1).

A set holds coloured clouds, their scenes, their descriptors, or several of these, with time stamps
and, if there is ground truth, poses. Matching, tuning, training and threshold sweeps start from it.
"""

import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.archive import format_of, join_parts, load_archive, part_of, save_archive
from fusionslam.base.progress import Progress, reported
from fusionslam.errors import DataError, ShapeError
from fusionslam.sensors.frame import Cloud
from fusionslam.views.scenes import Scene, SceneConfig, scene_of_cloud

FORMAT = "fusionslam.scene_set.1"


@dataclass(frozen=True, eq=False)
class CloudArray:
    """Concatenated clouds: points float32 (m, 3), colours uint8 (m, 3) or None, offsets (n + 1)."""

    points: NDArray[np.float32]
    colors: NDArray[np.uint8] | None
    offsets: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.offsets) - 1

    def __getitem__(self, index: int) -> Cloud:
        span = slice(*self.offsets[index : index + 2].tolist())
        return Cloud(self.points[span], None if self.colors is None else self.colors[span])

    @property
    def sizes(self) -> NDArray[np.int64]:
        """int64 (n), number of points of each cloud."""
        return np.diff(self.offsets)

    @classmethod
    def of(cls, clouds: Sequence[Cloud]) -> "CloudArray":
        """Concatenate copies of the clouds. Raises DataError if only some have colours."""
        lacking = [index for index, cloud in enumerate(clouds) if cloud.colors is None]
        if 0 < len(lacking) < len(clouds):
            raise DataError(
                f"cloud {lacking[0]} has no colours and others have",
                code="no-colors",
                fields=[str(lacking[0])],
            )
        offsets = np.cumsum([0, *map(len, clouds)]).astype(np.int64)
        points = [np.empty((0, 3), np.float32), *(cloud.points for cloud in clouds)]
        colors = [np.empty((0, 3), np.uint8), *(c.colors for c in clouds if c.colors is not None)]
        return cls(np.concatenate(points), None if lacking else np.concatenate(colors), offsets)

    def subset(self, indices: NDArray[np.int64]) -> "CloudArray":
        """Select the clouds with these indices."""
        return CloudArray.of([self[index] for index in indices.tolist()])


@dataclass(frozen=True, eq=False)
class SceneSet:
    """The n scans of one drive in time order, including empty ones.

    Attributes:
        name: human-readable name.
        stamps_ns: int64 (n), nanoseconds.
        numbers: int64 (n), frame numbers in the data.
        empty: bool (n), scans without points left (only floor, for example).
        frame: "robot", "odometry", ...: the frame of the clouds.
        poses: float64 (n, 3), true x, y in metres and yaw in radians; None if unknown.
        odometry: float64 (n, 3), the same as odometry measured it, in a frame of its own; NaN rows
            where it is unknown; None without odometry.
        clouds: without ground, coloured if the data have colours; None if only scenes or features
            were kept.
        scenes: the scenes of ``scene_config``; None if they have to be built from the clouds.
        scene_config: the configuration that ``scenes`` were built with.
        features: descriptors by name, float32 (n, D); NaN rows for scans that cannot be described.
        source: origin of the set: path, command, configuration.

    Raises:
        ShapeError: an array or list does not have n entries.
        DataError: stamps decrease, or poses are not finite.
    """

    name: str
    stamps_ns: NDArray[np.int64]
    numbers: NDArray[np.int64]
    empty: NDArray[np.bool_]
    frame: str = "robot"
    poses: NDArray[np.float64] | None = None
    odometry: NDArray[np.float64] | None = None
    clouds: CloudArray | None = None
    scenes: Sequence[Scene] | None = None
    scene_config: Mapping[str, Any] | None = None
    features: Mapping[str, NDArray[np.float32]] = field(default_factory=dict)
    source: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        count = len(self.stamps_ns)
        for name in ("numbers", "empty", "clouds", "scenes"):
            held = getattr(self, name)
            if held is not None and len(held) != count:
                raise ShapeError(f"{self.name}: {len(held)} {name} for {count} stamps")
        for name, places in (("poses", self.poses), ("odometry", self.odometry)):
            if places is not None and places.shape != (count, 3):
                raise ShapeError(f"{self.name}: {name} {places.shape}, expected {(count, 3)}")
        for name, rows in self.features.items():
            if rows.ndim != 2 or len(rows) != count:
                raise ShapeError(f"{self.name}: feature {name} {rows.shape}, expected ({count}, D)")
        if (np.diff(self.stamps_ns) < 0).any():
            raise DataError(f"{self.name}: stamps go back in time", code="stamps-decrease")
        if self.poses is not None and not np.isfinite(self.poses).all():
            row = int(np.flatnonzero(~np.isfinite(self.poses).all(axis=1))[0])
            raise DataError(
                f"{self.name}: pose {row} is not finite",
                code="not-finite",
                fields=["poses", str(row)],
            )

    def __len__(self) -> int:
        return len(self.stamps_ns)

    @property
    def seconds(self) -> NDArray[np.float64]:
        """float64 (n), time stamps in seconds."""
        return np.asarray(self.stamps_ns / 1e9, np.float64)

    @property
    def has_colors(self) -> bool:
        """Whether the clouds have colours; a set without clouds was made from coloured ones."""
        return self.clouds is None or self.clouds.colors is not None

    def true_poses(self) -> NDArray[np.float64]:
        """The true poses. Raises DataError if the set has none."""
        if self.poses is None:
            raise DataError(
                f"{self.name} has no true poses: it can be matched, but not judged or tuned on; "
                "name a file of poses (--gt), for a scene set when it is recorded",
                code="no-poses",
            )
        return self.poses

    def fits(self, config: SceneConfig) -> bool:
        """Whether the stored scenes were built with this configuration."""
        return self.scenes is not None and self.scene_config == scene_values(config)

    def scenes_with(self, config: SceneConfig, progress: Progress | None = None) -> list[Scene]:
        """Build the scenes of a configuration from the clouds, or return the stored ones that fit.

        Raises:
            DataError: the set has neither clouds nor scenes of that configuration, or the clouds
                have no colours.
        """
        if self.scenes is not None and self.fits(config):
            return list(self.scenes)
        if self.clouds is None:
            kept = "scenes of another configuration" if self.scenes else "no scenes"
            raise DataError(
                f"{self.name} holds {kept} and no clouds to build others from", code="no-clouds"
            )
        rows = reported(range(len(self)), progress, len(self))
        return [scene_of_cloud(self.clouds[index], config) for index in rows]

    def with_scenes(self, config: SceneConfig, progress: Progress | None = None) -> "SceneSet":
        """A copy with the scenes of a configuration, rounded as they are stored."""
        scenes = [Scene.from_bytes(s.to_bytes()) for s in self.scenes_with(config, progress)]
        return replace(self, scenes=scenes, scene_config=scene_values(config))

    def without_clouds(self) -> "SceneSet":
        """A copy without clouds, which makes a small file."""
        return replace(self, clouds=None)

    def subset(self, indices: NDArray[np.int64]) -> "SceneSet":
        """Select the scans with these indices, int64 (k,)."""
        scenes = None if self.scenes is None else [self.scenes[i] for i in indices.tolist()]
        return replace(
            self,
            stamps_ns=self.stamps_ns[indices],
            numbers=self.numbers[indices],
            empty=self.empty[indices],
            poses=None if self.poses is None else self.poses[indices],
            odometry=None if self.odometry is None else self.odometry[indices],
            clouds=None if self.clouds is None else self.clouds.subset(indices),
            scenes=scenes,
            features={name: rows[indices] for name, rows in self.features.items()},
        )

    def without_empty(self) -> "SceneSet":
        """A copy without empty scans."""
        return self.subset(np.flatnonzero(~self.empty)) if self.empty.any() else self

    def digest(self) -> str:
        """A hash of stamps, poses, cloud points and scenes that identifies this set."""
        found = hashlib.sha256()
        for array in (self.stamps_ns, self.poses, self.clouds and self.clouds.points):
            found.update(b"" if array is None else np.ascontiguousarray(array).tobytes())
        for scene in self.scenes or ():
            found.update(scene.to_bytes())
        return found.hexdigest()[:16]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write one ``.npz`` atomically. Raises DataError if that fails."""
        about = {
            "name": self.name,
            "frame": self.frame,
            "scene_config": self.scene_config,
            "source": self.source,
        }
        arrays: dict[str, NDArray[Any] | None] = {
            "stamps_ns": self.stamps_ns,
            "numbers": self.numbers,
            "empty": self.empty,
            "poses": self.poses,
            "odometry": self.odometry,
        }
        if self.clouds is not None:
            arrays |= vars(self.clouds)
        if self.scenes is not None:
            arrays["scene_bytes"], arrays["scene_offsets"] = pack_bytes(
                [scene.to_bytes() for scene in self.scenes]
            )
        arrays |= join_parts({"feature": self.features})
        save_archive(path, FORMAT, about, arrays, compress=True)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "SceneSet":
        """Read what ``save`` wrote.

        Raises:
            DataError: the file is missing, truncated, of another version or of another kind; the
                message names it.
        """
        with load_archive(path, FORMAT, "a scene set") as (about, arrays):
            return cls(**about, **_parse_arrays(arrays))


def scene_values(config: SceneConfig) -> dict[str, Any]:
    """The values of a scene configuration by key, as a set stores them."""
    return {option["name"]: getattr(config, option["name"]) for option in SceneConfig.options()}


def pack_bytes(texts: Sequence[bytes]) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """Concatenate byte strings, uint8 (m,), with their offsets, int64 (n + 1)."""
    offsets = np.cumsum([0, *map(len, texts)]).astype(np.int64)
    return np.frombuffer(b"".join(texts), np.uint8), offsets


def unpack_bytes(array: NDArray[np.uint8], offsets: NDArray[np.int64]) -> list[bytes]:
    """Split what ``pack_bytes`` joined. Raises DataError if bytes and offsets do not fit."""
    _check_offsets(offsets, len(array))
    whole = array.tobytes()
    return [whole[begin:end] for begin, end in pairwise(offsets.tolist())]


def _check_offsets(offsets: NDArray[np.int64], count: int) -> None:
    if not len(offsets) or offsets[0] != 0 or offsets[-1] != count or (np.diff(offsets) < 0).any():
        raise DataError(f"offsets do not fit the {count} entries they divide", code="wrong-offsets")


def is_scene_set(path: str | os.PathLike[str]) -> bool:
    """Whether a file declares itself a scene set of any version."""
    return (format_of(path) or "").startswith("fusionslam.scene_set.")


def _parse_arrays(arrays: dict[str, NDArray[Any]]) -> dict[str, Any]:
    """The arguments of a set from its arrays. Raises DataError if they do not fit together."""
    clouds = None
    if "points" in arrays:
        points, offsets = arrays.pop("points"), arrays.pop("offsets")
        clouds = CloudArray(points, arrays.pop("colors", None), offsets)
        _check_offsets(offsets, len(points))
        for name, rows in (("points", points), ("colors", clouds.colors)):
            if rows is not None and rows.shape != (len(points), 3):
                raise DataError(f"{name} has shape {rows.shape}, expected {(len(points), 3)}")
    scenes = None
    if "scene_bytes" in arrays:
        texts = unpack_bytes(arrays.pop("scene_bytes"), arrays.pop("scene_offsets"))
        scenes = [Scene.from_bytes(text) for text in texts]
    features = part_of(arrays, "feature")
    own = {name: rows for name, rows in arrays.items() if not name.startswith("feature.")}
    return {**own, "clouds": clouds, "scenes": scenes, "features": features}
