# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Places: sights (clouds at known poses), and which pairs of them show the same place."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Floats, Integers
from fusionslam.config import Section, option
from fusionslam.errors import DataError, ShapeError
from fusionslam.geometry.se2 import wrapped
from fusionslam.sensors.frame import Cloud
from fusionslam.views.scene_set import CloudArray

Sights = tuple[str, Sequence[Cloud], Floats | None]
"""A world's name, its clouds in the robot's frame without ground, and poses (n, 3): x, y, yaw."""


class SamePlaceConfig(Section):
    """Limits within which two sights are the same place (Stastny 2022, 4.6.2 and 5.2)."""

    radius_m: float = option(0.5, "positions are nearer than this", unit="m", gt=0)
    angle_deg: float = option(36.0, "headings are nearer than this", unit="deg", gt=0, le=180)
    doubt_m: float = option(
        1.0,
        "metric learning ignores other pairs nearer than this and rotated by less than twice "
        "angle_deg",
        unit="m",
        ge=0,
    )


@checked
@dataclass(frozen=True, eq=False)
class Places:
    """Sights of one or more worlds.

    Attributes:
        clouds: in the robot's frame, without ground.
        poses: float64 (n, 3), x, y in metres and yaw in radians in the frame of its world.
        worlds: int64 (n,), the world of each sight, an index into ``names``.
        names: names of the worlds.
    """

    clouds: CloudArray
    poses: Floats
    worlds: Integers
    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.poses)

    def __getitem__(self, index: int) -> Cloud:
        return self.clouds[index]

    @classmethod
    def of(cls, sources: Iterable[Sights], least: int = 1) -> "Places":
        """Collect the sights of worlds; those with fewer points than ``least`` are left out.

        Raises:
            DataError: a world without poses or colours, or no sight is left.
            ShapeError: not one pose per cloud.
        """
        clouds: list[Cloud] = []
        poses: list[Floats] = []
        worlds: list[int] = []
        names: list[str] = []
        for name, seen, where in sources:
            checked = _check_poses(name, seen, where)
            kept = [index for index, cloud in enumerate(seen) if len(cloud) >= least]
            clouds += [seen[index] for index in kept]
            poses.append(checked[kept])
            worlds += [len(names)] * len(kept)
            names.append(name)
        if not clouds:
            raise DataError(
                f"no sight of at least {least} points in {', '.join(names) or 'no world'}"
            )
        return cls(
            CloudArray.of(clouds), np.concatenate(poses), np.asarray(worlds, np.int64), tuple(names)
        )

    @checked
    def subset(self, indices: Integers) -> "Places":
        """Select the sights with these indices."""
        return Places(
            self.clouds.subset(indices), self.poses[indices], self.worlds[indices], self.names
        )


def _check_poses(name: str, clouds: Sequence[Cloud], poses: Floats | None) -> Floats:
    if poses is None:
        raise DataError(
            f"{name} has no true poses: they tell which sights are the same place", code="no-poses"
        )
    if poses.shape != (len(clouds), 3):
        raise ShapeError(
            f"{name}: poses have shape {poses.shape}, expected ({len(clouds)}, 3): x, y, yaw"
        )
    if any(cloud.colors is None for cloud in clouds):
        raise DataError(f"{name} has clouds without colours", code="no-colors")
    return poses


def measure_gaps(first: Floats, second: Floats) -> tuple[Floats, Floats]:
    """Distances in metres and angles in radians, 0 to pi, between poses (..., 3) of x, y, yaw."""
    gap = first - second
    return np.hypot(gap[..., 0], gap[..., 1]), np.abs(wrapped(gap[..., 2]))


def same_places(
    places: Places, first: Integers, second: Integers, config: SamePlaceConfig | None = None
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Label pairs of sights as same place, or as ambiguous.

    Args:
        places: the sights.
        first, second: int64, the sights of each pair; shapes that broadcast.
        config: the limits.

    Returns:
        bool arrays of the pairs' shape: same place; not the same, but near enough to look alike.
    """
    limits = config or SamePlaceConfig()
    distance, angle = measure_gaps(places.poses[first], places.poses[second])
    together = places.worlds[first] == places.worlds[second]
    most = np.deg2rad(limits.angle_deg)
    same = together & (distance < limits.radius_m) & (angle < most)
    doubtful = together & ~same & (distance < limits.doubt_m) & (angle < 2 * most)
    return same, doubtful


def split_places(places: Places, share: float) -> tuple[Places, Places]:
    """Split each world into two parts: the share with the largest coordinate is the second.

    The coordinate is x or y, whichever has the larger extent, so that no place is in both parts.
    """
    held = np.zeros(len(places), bool)
    for world in np.unique(places.worlds):
        rows = np.flatnonzero(places.worlds == world)
        where = places.poses[rows, :2]
        along = where[:, int(np.argmax(np.ptp(where, axis=0)))]
        held[rows] = along > np.quantile(along, 1 - share)
    return places.subset(np.flatnonzero(~held)), places.subset(np.flatnonzero(held))


class PairConfig(Section):
    """Selection of the pairs of sights for training and evaluation."""

    place: SamePlaceConfig = option(SamePlaceConfig(), "limits of the same place")
    most: int = option(20_000, "most pairs of the same place", ge=1)
    unlike: float = option(3.0, "pairs of different places for each pair of the same", gt=0)
    near_m: float = option(
        4.0, "half of the pairs of different places are nearer than this", unit="m", ge=0
    )


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs of sights: indices, int64 (m,), and whether they are the same place, bool (m,)."""

    first: Integers
    second: Integers
    same: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.first)


def make_pairs(places: Places, config: PairConfig, rng: np.random.Generator) -> Pairs:
    """Draw labelled pairs of sights at random from each world (Stastny 2022, 4.6.2).

    Raises:
        DataError: no two sights are the same place.
    """
    found = []  # every pair of different sights of the same world, once
    for world in range(len(places.names)):
        rows = np.flatnonzero(places.worlds == world)
        found.append(rows[np.stack(np.triu_indices(len(rows), 1))])
    first, second = np.concatenate(found, axis=1)
    same, _ = same_places(places, first, second, config.place)
    alike, unlike = np.flatnonzero(same), np.flatnonzero(~same)
    if not len(alike) or not len(unlike):
        raise DataError(
            f"{', '.join(places.names)}: {len(alike)} pairs of the same place and {len(unlike)} of "
            "different ones, expected some of both",
            code="no-pairs",
        )
    alike = rng.permutation(alike)[: config.most]
    distance, _ = measure_gaps(places.poses[first[unlike]], places.poses[second[unlike]])
    wanted = round(config.unlike * len(alike))
    near = rng.permutation(unlike[distance < config.near_m])[: wanted // 2]
    other = rng.permutation(unlike)[: wanted - len(near)]
    rows = np.concatenate([alike, near, other])
    return Pairs(first[rows], second[rows], same[rows])
