# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Sources of training data: shapes, recorded sights, and cached simulated places."""

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fusionslam.base.archive import load_archive, save_archive
from fusionslam.base.progress import Progress
from fusionslam.config import Section, option
from fusionslam.errors import ConfigError, DataError
from fusionslam.learning.modelnet import read_modelnet, read_voxels
from fusionslam.learning.places import Places, Sights
from fusionslam.learning.shape_sets import ProceduralConfig, ShapeSet, generate_shapes, join_sets
from fusionslam.learning.simulated_places import SimulatedPlacesConfig, simulate_places
from fusionslam.views.scene_set import CloudArray, SceneSet

FORMAT = "fusionslam.places.1"
LEAST_POINTS = 20
"""Fewest points of a sight used for training; fewer say nothing about a place."""
_VOXEL_TEST = 5


class SimulatedConfig(Section):
    """The simulated worlds for training, and other ones for evaluation."""

    train: SimulatedPlacesConfig = option(
        SimulatedPlacesConfig(seed=1, worlds=48), "training worlds"
    )
    judged: SimulatedPlacesConfig = option(
        SimulatedPlacesConfig(seed=101, worlds=9, places=10),
        "worlds for evaluation and calibration",
    )


def load_shapes(
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
        parts.append(generate_shapes(config))
        words.append("procedural")
    if modelnet is not None:
        train = read_modelnet(modelnet, "train", config.points, rng)
        parts.append((train, read_modelnet(modelnet, "test", config.points, rng)))
        words.append(f"ModelNet40 ({Path(modelnet).name})")
    for file in voxels:
        whole = read_voxels(file, Path(file).name.split(".")[0], config.points, rng)
        judged = np.arange(len(whole)) % _VOXEL_TEST == 0
        if judged.all():
            raise DataError(f"{whole.names[0]}: one object only, expected some to train on")
        parts.append((whole.subset(~judged), whole.subset(judged)))
        words.append(f"voxels of {Path(file).name}")
    if not parts:
        raise ConfigError("no shapes: expected procedural ones, ModelNet40 or voxel grids")
    train_sets, test_sets = zip(*parts, strict=True)
    return join_sets(train_sets), join_sets(test_sets), ", ".join(words)


def collect_places(sets: Sequence[SceneSet]) -> Places:
    """The sights of scene sets, each set a world of its own; nearly empty sights are left out.

    Raises:
        DataError: a set without clouds or poses, or clouds that are not in the robot's frame.
    """
    return Places.of((_sights_of(scenes) for scenes in sets), least=LEAST_POINTS)


def _sights_of(scenes: SceneSet) -> Sights:
    if scenes.clouds is None:
        raise DataError(f"{scenes.name} holds no clouds: record it without --only-scenes")
    if scenes.frame != "robot":
        raise DataError(f"{scenes.name} has clouds in frame {scenes.frame}, expected robot")
    clouds = [scenes.clouds[index] for index in range(len(scenes))]
    return scenes.name, clouds, scenes.poses


def load_simulated_places(
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
    if not Path(path).exists():
        places = Places.of(simulate_places(config, progress), least=LEAST_POINTS)
        parts = {"poses": places.poses, "worlds": places.worlds, "names": np.array(places.names)}
        save_archive(path, FORMAT, about, {**vars(places.clouds), **parts})
        return places
    with load_archive(path, FORMAT, "simulated places") as (found, stored):
        clouds = CloudArray(stored["points"], stored["colors"], stored["offsets"])
        names = tuple(stored["names"].tolist())
        places = Places(clouds, stored["poses"], stored["worlds"], names)
    if found != about:
        raise ConfigError(
            f"{path} holds places of another configuration; take another folder",
            code="other-settings",
            fields=(str(path),),
        )
    return places
