# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds as registration needs them, computed once however many others they are compared with."""

import io
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam._core import (
    GroundSegmentsConfig,
    SurfaceCloud,
    nearest_ranges,
    remove_ground_segments,
    voxel_downsample,
)
from fusionslam.base.archive import load_arrays
from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Floats, Floats32, Image, Integers, Mask, Matrix, Points
from fusionslam.errors import DataError, FusionSlamError, ShapeError
from fusionslam.geometry.rigid import is_rigid
from fusionslam.registration.birds_eye import SearchImage, Spectra, coarse, draw_turned
from fusionslam.registration.config import RegistrationConfig
from fusionslam.registration.leveling import Level, find_level
from fusionslam.registration.map_extra import count_features
from fusionslam.registration.planar import build_planar
from fusionslam.sensors.frame import Cloud
from fusionslam.views.scenes import Scene

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

_MOST_UNPACKED, _EXPANSION = 16 << 20, 32
"""Bytes to which packed ones may expand, or how many times their number if that is more."""


class SearchedCloud(NamedTuple):
    """Points, float32 (N, 3), and how many of them surely have features."""

    points: Points
    features: int


View = tuple[Floats32, Matrix]
"""What a sensor saw from one place, as ``as_stored`` returns it, and view_from_cloud."""


@checked
class PreparedCloud:
    """A cloud that is registered with several others: what they all need is computed once.

    Its voxels and the range in each direction are kept, stored and sent between processes. They
    are levelled where ``gravity`` is "auto"; poses of registrations are those of the cloud given.

    Attributes:
        level: float64 (3, 3), the rotation that levels the cloud; None if it stays as it is.
        points: float32 (N, 3), levelled: one point for each voxel, to 8 mm.
        search_points: float32 (M, 3): one point for each voxel of the search by features, which is
            for clouds without ``gravity``; else empty.
        colors: uint8 (N, 3), sRGB, of the points; None if none has any.
        is_colored: bool (N,): points whose colours are known.
        scene: range image for method planar, which keeps nothing else; None for others.
        ranges: float32 (rows, columns): how far the sensor saw, as ``nearest_ranges`` returns.
        further: what it saw from other places, of a cloud that is joined of several scans; each
            with float64 (4, 4), view_from_cloud of the levelled cloud.
        moved: float64 (2, 6): motion while the cloud was taken, from its stamp to the first and the
            last point, as ``ScanMotion.within`` returns; None, as at first, if it is unknown.
            Covariances of poses grow with it.

    Args:
        cloud: a Cloud, or float32 (N, 3), metres, the sensor at the origin; may be empty.
        config: that of the registrations.
        colored: the part of a cloud without colours whose colours are known, as the camera's of a
            LiDAR's full circle; None if there is none.
        level: how it is levelled; None finds it by the ground alone.
        seen: float32 (M, 3), the scan that was taken at the origin, of a cloud that is joined of
            several; None is the cloud itself.
        further: the other scans' views.

    Raises:
        ShapeError: neither a cloud nor an array of points.
        DataError: no colours, which method planar needs (code "no-colors").
        DataError: NaN or infinity in a point; the message names it.
    """

    def __init__(
        self,
        cloud: Cloud | Points,
        config: RegistrationConfig | None = None,
        *,
        colored: Cloud | None = None,
        level: Level | None = None,
        seen: Points | None = None,
        further: Sequence[View] = (),
    ) -> None:
        self.config = config or RegistrationConfig()
        self.moved: Floats | None = None
        points = check_points(cloud.points if isinstance(cloud, Cloud) else cloud)
        self.scene = build_planar(cloud) if self.config.method == "planar" else None
        if self.scene is not None:
            points = points[:0]
        if level is None and self.config.gravity == "auto":
            level = find_level(points)
        self.level = None if level is None or self.scene is not None else level.level_from_cloud
        points = self._leveled(points)
        self.points = _round(_voxels(points, None, self.config.voxel)[0])
        # Of all points: voxels of voxels lose a part of the poses that features find.
        searched = points[:0] if self.config.gravity else points
        self.search_points = _round(_voxels(searched, None, self.config.search_voxel)[0])
        self.colors: Image | None = None
        self.is_colored: Mask = np.zeros(len(self.points), np.bool_)
        if colored is None and isinstance(cloud, Cloud):
            colored = cloud
        if colored is not None and colored.colors is not None:
            self._take_colors(self._leveled(check_points(colored.points)), colored.colors)
        near = points if seen is None else self._leveled(check_points(seen))
        self.ranges: Floats32 = as_stored(nearest_ranges(near, step=self.config.view_step))
        back = np.eye(4)  # cloud_from_level
        if self.level is not None:
            back[:3, :3] = self.level.T
        self.further = [(ranges, view @ back) for ranges, view in further]

    def _leveled(self, points: Points) -> Points:
        if self.level is None:
            return points
        return np.ascontiguousarray(points @ self.level.T, np.float32)

    @property
    def level_from_cloud(self) -> Matrix:
        """float64 (4, 4): the rotation that levels the cloud."""
        pose = np.eye(4)
        if self.level is not None:
            pose[:3, :3] = self.level
        return pose

    def _take_colors(self, points: Points, colors: Image) -> None:
        """Give each voxel the colour of the coloured voxel in its place."""
        from scipy.spatial import cKDTree

        voxels, voxel_colors = _voxels(points, colors, self.config.voxel)
        if voxel_colors is None or not len(voxels) or not len(self):
            return
        apart, nearest = cKDTree(voxels).query(
            self.points, distance_upper_bound=self.config.voxel / 2
        )
        self.is_colored = np.isfinite(apart)
        self.colors = voxel_colors[np.where(self.is_colored, nearest, 0)]

    def __len__(self) -> int:
        return len(self.points)

    def __getstate__(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in _KEPT}

    def to_bytes(self) -> bytes:
        """Compress what is kept, without the configuration, for ``from_bytes``."""
        arrays: dict[str, NDArray[Any]] = {
            "points": pack_points(self.points),
            "search_points": pack_points(self.search_points),
            "is_colored": np.packbits(self.is_colored),
            "ranges": self.ranges.astype(np.float16),
        }
        if self.colors is not None:
            arrays["colors"] = self.colors[self.is_colored]
        if self.scene is not None:
            arrays["scene"] = np.frombuffer(self.scene.to_bytes(), np.uint8)
        if self.moved is not None:
            arrays["moved"] = self.moved
        if self.level is not None:
            arrays["level"] = self.level
        if self.further:
            arrays["further"] = np.array([ranges for ranges, _ in self.further], np.float16)
            arrays["views"] = np.array([view for _, view in self.further])
        return pack_arrays(arrays)

    @classmethod
    def from_bytes(cls, packed: bytes, config: RegistrationConfig) -> "PreparedCloud":
        """Return the cloud that ``to_bytes`` packed, prepared with this configuration.

        Raises:
            DataError: the bytes are damaged.
        """
        cloud = cls.__new__(cls)
        cloud.config = config
        with unpacking(packed) as arrays:
            cloud._restore(arrays)
        return cloud

    def _restore(self, arrays: dict[str, NDArray[Any]]) -> None:
        self.points = unpack_points(arrays["points"])
        self.search_points = unpack_points(arrays["search_points"])
        self.ranges = arrays["ranges"].astype(np.float32)
        count = len(self.points)
        self.is_colored = np.unpackbits(arrays["is_colored"], count=count).astype(np.bool_)
        self.colors = None
        if "colors" in arrays:
            colors: Image = np.zeros((count, 3), np.uint8)
            colors[self.is_colored] = arrays["colors"]
            self.colors = colors
        scene = arrays.get("scene")
        self.scene = None if scene is None else Scene.from_bytes(scene.tobytes())
        self.level = arrays.get("level")
        further, views = arrays.get("further", ()), arrays.get("views", ())
        self.further = [
            (ranges.astype(np.float32), view) for ranges, view in zip(further, views, strict=True)
        ]
        poses = [self.level_from_cloud, *(view for _, view in self.further)]
        if not all(pose.shape == (4, 4) and is_rigid(pose) for pose in poses):
            raise ValueError("its level or a view is no rigid motion")
        self.moved = arrays.get("moved")
        if (moved := self.moved) is None:
            return
        if moved.shape != (2, 6) or moved.dtype != np.float64 or not np.isfinite(moved).all():
            raise ValueError(f"motion {moved.tolist()}: expected finite float64 (2, 6)")

    @cached_property
    def above_ground(self) -> Points:
        """float32 (M, 3): the voxels that can tell places apart; all without ``gravity``."""
        above: Points = self.points[self._above]
        return above

    @cached_property
    def colored_above(self) -> tuple[Points, Image]:
        """Coloured points above the ground, float32 (K, 3), and their colours, uint8 (K, 3)."""
        if self.colors is None:
            return self.points[:0], np.empty((0, 3), np.uint8)
        rows = self._above[self.is_colored[self._above]]
        return self.points[rows], self.colors[rows]

    @cached_property
    def colored_tree(self) -> "cKDTree":
        """Finds the nearest of ``colored_above``."""
        from scipy.spatial import cKDTree

        return cKDTree(self.colored_above[0])

    @cached_property
    def ground_level(self) -> float:
        """Height of the ground about the sensor; 0 without ``gravity``."""
        if not self.config.gravity or not len(self):
            return 0.0
        below = np.delete(self.points, self._above, axis=0)
        return float(np.median(below[:, 2]) if len(below) else self.points[:, 2].min())

    @cached_property
    def _above(self) -> Integers:
        """Indices of ``above_ground``."""
        if not self.config.gravity or not len(self):
            return np.arange(len(self))
        ground = GroundSegmentsConfig(distance=self.config.ground_height)
        kept: Integers = remove_ground_segments(self.points, config=ground)[0]
        return kept

    @cached_property
    def is_small_view(self) -> bool:
        """Whether it shows a room, or less than half of the circle."""
        return self.is_sector or self.shows_room

    @property
    def shows_room(self) -> bool:
        """Whether most of its voxels are less than ``ROOM_REACH`` away."""
        if not len(self.points):
            return True
        return bool(np.median(np.linalg.norm(self.points, axis=1)) < ROOM_REACH)

    @property
    def is_sector(self) -> bool:
        """Whether it shows less than half of the circle."""
        return self.view_degrees < 180

    @cached_property
    def view_degrees(self) -> float:
        """How much of the circle it shows, gaps of up to 10 degrees included."""
        circle = self.ranges.shape[1]
        columns = np.flatnonzero((self.ranges > 0).any(axis=0))
        if self.further:
            turns = np.arctan2(self.points[:, 1], self.points[:, 0]) / (2 * np.pi)
            columns = np.unique(np.floor(turns * circle).astype(np.int64) % circle)
        if not columns.size:
            return 0.0
        gaps = np.diff(columns, append=columns[:1] + circle) - 1
        outside = gaps[gaps > circle * _GAP_DEG / 360].sum()
        return float(360 * (circle - outside) / circle)

    @property
    def has_search_image(self) -> bool:
        """Whether poses are searched by its images from above."""
        return self.scene is None and bool(self.config.gravity)

    @cached_property
    def search_image(self) -> SearchImage:
        """Its images from above."""
        return SearchImage.of(self.above_ground, self.ground_level, self.config.search_cell)

    @cached_property
    def coarse_images(self) -> Spectra:
        """Low frequencies of ``turned_images``."""
        return coarse(self.turned_images)

    @cached_property
    def turned_images(self) -> Spectra:
        """Spectra of its images from above, turned in steps: 3 MB."""
        return draw_turned(self.above_ground, self.ground_level, self.config.search_cell)

    @cached_property
    def searched_clouds(self) -> tuple[SearchedCloud, SearchedCloud]:
        """Its points with features, without ``gravity``: the search points, then all."""
        voxel = self.config.search_voxel
        few, all_points = self.search_points, self.points
        return (
            SearchedCloud(few, count_features(few, voxel)),
            SearchedCloud(all_points, count_features(all_points, voxel)),
        )

    @cached_property
    def refined(self) -> SurfaceCloud:
        """Points with their normals, for the refinement."""
        return SurfaceCloud(self.points)

    @cached_property
    def moved_points(self) -> SurfaceCloud:
        """The same for the cloud that is moved: of a local map a part, which finds as much."""
        step = 1 + (len(self) - 1) // _MOST_MOVED if self.further else 1
        return self.refined if step == 1 else SurfaceCloud(self.points[::step])


def check_points(points: Any) -> Points:
    array = np.asarray(points)
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind != "f":
        raise ShapeError(
            f"points: {array.dtype} {array.shape}, expected a Cloud or float32 (N, 3)",
            code="no-cloud",
        )
    if not np.isfinite(array).all():
        first = int(np.argmin(np.isfinite(array).all(axis=1)))
        raise DataError(
            f"point {first} is {array[first].tolist()}, expected finite numbers: "
            "drop such points first (drop_invalid)"
        )
    return array.astype(np.float32, copy=False)


_KEPT = (
    *("config", "level", "points", "search_points", "colors", "is_colored"),
    *("ranges", "further", "scene", "moved"),
)
ROOM_REACH = 12.0
"""Metres. Clouds of cars reach 15 and more, those in rooms 3 to 8."""
_GAP_DEG = 10
"""Wider gaps are out of the view, as they are for the overlap."""
_MOST_MOVED = 3000
"""Points of a local map that are refined against another one: more take time alone."""
_STEPS_PER_M = 128
"""Coordinates are multiples of this part of a metre: stored in 16 bits they stay as they are."""


def _round(points: Points) -> Points:
    rounded: Points = np.rint(points * np.float32(_STEPS_PER_M)) / np.float32(_STEPS_PER_M)
    return rounded


def pack_arrays(arrays: dict[str, NDArray[Any]]) -> bytes:
    """Compress arrays by name: zlib of a ``.npz``; ``unpacking`` is the inverse."""
    stream = io.BytesIO()
    np.savez(stream, **arrays)  # type: ignore[arg-type]
    whole = stream.getvalue()
    packed = zlib.compress(whole, level=1)
    if len(whole) > _most_unpacked(packed):  # points of one plane, as of a made world
        return zlib.compress(whole, level=0)
    return packed


@contextmanager
def unpacking(packed: bytes) -> Iterator[dict[str, NDArray[Any]]]:
    """Yield the arrays that ``pack_arrays`` packed.

    Raises:
        DataError: the bytes are damaged, or expand to more than ``pack_arrays`` lets them; or the
            block cannot make a cloud of the arrays (code "damaged").
    """
    try:
        stream = zlib.decompressobj()
        whole = stream.decompress(packed, _most_unpacked(packed))
        if not stream.eof:
            raise ValueError(f"{len(packed)} bytes are cut off, or expand to over {len(whole)}")
        with zipfile.ZipFile(io.BytesIO(whole)) as archive:
            sizes = [(info.file_size, info.compress_size) for info in archive.infolist()]
        if any(size != stored for size, stored in sizes):
            raise ValueError("its arrays are compressed twice")
        with load_arrays(io.BytesIO(whole), "arrays of a cloud") as arrays:
            yield arrays
    except (zlib.error, zipfile.BadZipFile, ValueError, FusionSlamError) as error:
        raise DataError(f"a stored cloud is damaged: {error}", code="damaged") from error


def _most_unpacked(packed: bytes) -> int:
    return max(_MOST_UNPACKED, _EXPANSION * len(packed))


def pack_points(points: Points) -> NDArray[np.signedinteger[Any]]:
    """Round coordinates to 8 mm, in 16 bits where they fit; ``unpack_points`` is the inverse."""
    steps = np.rint(points * np.float32(_STEPS_PER_M))
    small = not steps.size or np.abs(steps).max() < 2**15
    whole: NDArray[np.signedinteger[Any]] = steps.astype(np.int16 if small else np.int64)
    return whole


def unpack_points(steps: NDArray[np.signedinteger[Any]]) -> Points:
    """Return float32 (N, 3), metres, of what ``pack_points`` returned; ValueError of others."""
    if steps.ndim != 2 or steps.shape[1] != 3 or steps.dtype not in (np.int16, np.int64):
        raise ValueError(f"points of shape {steps.shape}, {steps.dtype}: expected integers (N, 3)")
    return (steps / np.float32(_STEPS_PER_M)).astype(np.float32)


def as_stored(ranges: Floats32) -> Floats32:
    """Round what ``nearest_ranges`` returned, as it is stored."""
    rounded: Floats32 = ranges.astype(np.float16).astype(np.float32)
    return rounded


def _voxels(points: Points, colors: Image | None, size: float) -> tuple[Points, Image | None]:
    if not len(points):
        return points, colors
    voxels, voxel_colors, _ = voxel_downsample(points, colors, size=size)
    return voxels, None if colors is None else voxel_colors
