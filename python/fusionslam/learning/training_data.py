# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Sources of training data: shapes, recorded sights, and cached simulated places."""

import os
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from fusionslam.config import Section, option
from fusionslam.errors import ConfigError, DataError
from fusionslam.learning.modelnet import Part, read_modelnet, read_voxels
from fusionslam.learning.places import Places
from fusionslam.learning.shape_sets import ProceduralConfig, ShapeSet, joined, procedural_shapes
from fusionslam.learning.simulated_places import SimulatedPlacesConfig, simulate_places
from fusionslam.sensors.frame import Cloud
from fusionslam.storage.archive import load_archive, save_archive
from fusionslam.storage.arrays import Floats
from fusionslam.storage.progress import Progress


class Clouds(Protocol):
    """Coloured clouds by number."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int, /) -> Cloud: ...


class RecordedSights(Protocol):
    """The parts of a scene set used for training: coloured clouds and their poses."""

    @property
    def name(self) -> str:
        """Human-readable name."""

    @property
    def frame(self) -> str:
        """The frame of the clouds."""

    @property
    def poses(self) -> Floats | None:
        """Float64 (n, 3): x, y, yaw; None without ground truth."""

    @property
    def clouds(self) -> Clouds | None:
        """n coloured clouds without ground; None if only scenes were kept."""


FORMAT = "fusionslam.places.1"
LEAST_POINTS = 20
"""Fewest points of a sight used for training; fewer say nothing about a place."""
_VOXEL_TEST = 0.2


class SimulatedConfig(Section):
    """The simulated worlds for training, and other ones for evaluation."""

    train: SimulatedPlacesConfig = option(
        SimulatedPlacesConfig(seed=1, worlds=48), "worlds to train on"
    )
    judged: SimulatedPlacesConfig = option(
        SimulatedPlacesConfig(seed=101, worlds=9, places=10), "worlds to judge and calibrate on"
    )


def shape_data(
    config: ProceduralConfig,
    modelnet: str | os.PathLike[str] | None = None,
    voxels: Sequence[str | os.PathLike[str]] = (),
    procedural: bool = True,
) -> tuple[ShapeSet, ShapeSet, str]:
    """Load a training and a test set of shapes, and a description of them in words.

    Args:
        config: procedural shapes; its seed and number of points apply to all shapes.
        modelnet: folder of ModelNet40, in either layout.
        voxels: files of voxel grids; the file name up to the first dot is the class name. Every
            fifth shape of each goes to the test set.
        procedural: whether to include procedural shapes.

    Raises:
        ConfigError: no source is given.
        DataError: as the readers.
    """
    parts: list[tuple[ShapeSet, ShapeSet]] = []
    words: list[str] = []
    rng = np.random.default_rng([config.seed, 0x3D])
    if procedural:
        parts.append(procedural_shapes(config))
        words.append("procedural")
    if modelnet is not None:
        train, test = (read_modelnet(modelnet, part, config.points, rng) for part in _PARTS)
        parts.append((train, test))
        words.append(f"ModelNet40 ({Path(modelnet).name})")
    for file in voxels:
        whole = read_voxels(file, Path(file).name.split(".")[0], config.points, rng)
        parts.append(_divided(whole))
        words.append(f"voxels of {Path(file).name}")
    if not parts:
        raise ConfigError("no shapes: expected procedural ones, ModelNet40 or voxel grids")
    train, test = (joined([pair[part] for pair in parts]) for part in (0, 1))
    return train, test, ", ".join(words)


_PARTS: tuple[Part, ...] = ("train", "test")


def _divided(shapes: ShapeSet) -> tuple[ShapeSet, ShapeSet]:
    judged = np.arange(len(shapes)) % round(1 / _VOXEL_TEST) == 0
    if judged.all():
        raise DataError(f"{shapes.names[0]}: one object only, expected some to train on")
    train, test = (
        ShapeSet(shapes.points[rows], shapes.labels[rows], shapes.names)
        for rows in (~judged, judged)
    )
    return train, test


def recorded_places(scenes: Sequence[RecordedSights]) -> Places:
    """The sights of scene sets, each set a world of its own; nearly empty sights are left out.

    Raises:
        DataError: a set without clouds or poses, or clouds that are not in the robot's frame.
    """
    for one in scenes:
        if one.clouds is None:
            raise DataError(f"{one.name} holds no clouds: record it without --only-scenes")
        if one.frame != "robot":
            raise DataError(f"{one.name} has clouds in frame {one.frame}, expected robot")
    sources = [
        (one.name, [one.clouds[index] for index in range(len(one.clouds))], one.poses)
        for one in scenes
        if one.clouds is not None
    ]
    return Places.of(sources, least=LEAST_POINTS)


def simulated_places(
    config: SimulatedPlacesConfig,
    path: str | os.PathLike[str],
    progress: Progress | None = None,
) -> Places:
    """Simulate places, cached in a file so that a resumed training need not repeat it.

    Raises:
        ConfigError: the file has places of another configuration.
        DataError: the file is damaged or cannot be written.
    """
    about = {"config": config.model_dump(mode="json")}
    if Path(path).exists():
        return _load(Path(path), about)
    places = Places.of(simulate_places(config, progress), least=LEAST_POINTS)
    arrays = {field.name: np.asarray(getattr(places, field.name)) for field in fields(places)}
    save_archive(path, FORMAT, about, arrays)
    return places


def _load(path: Path, about: dict[str, Any]) -> Places:
    with load_archive(path, FORMAT, "simulated places") as (found, stored):
        arrays = {f.name: stored[f.name] for f in fields(Places) if f.name != "names"}
        places = Places(**arrays, names=tuple(stored["names"].tolist()))
    if found != about:
        raise ConfigError(f"{path} holds places of another configuration; take another folder")
    return places
