# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Trains PointNet to classify shapes (Qi et al. 2016); the head is dropped afterwards."""

from collections.abc import Iterator

import numpy as np

from fusionslam.base.arrays import Points
from fusionslam.config import Section, option
from fusionslam.errors import DataError
from fusionslam.learning.pointnet import Classifier, PointNet, transform_penalty
from fusionslam.learning.shape_sets import ProceduralConfig, ShapeSet
from fusionslam.learning.torch_extra import nn, torch
from fusionslam.learning.training_loop import OptimiserConfig, seed_torch
from fusionslam.views.second_stage.architecture import HeadConfig, PointNetConfig
from fusionslam.views.second_stage.inputs import AugmentConfig, augment, scale_to_sphere


class ShapesTrainingConfig(Section):
    """Training of the features on shapes."""

    network: PointNetConfig = option(PointNetConfig(), "sizes of the network")
    head: HeadConfig = option(HeadConfig(), "the classifier")
    optimiser: OptimiserConfig = option(OptimiserConfig(epochs=12), "optimiser")
    augment: AugmentConfig = option(AugmentConfig(), "augmentation of shapes")
    procedural: ProceduralConfig = option(ProceduralConfig(), "procedural shapes")
    points: int = option(512, "points per shape given to the network", ge=1)
    batch: int = option(32, "shapes per batch", ge=2)
    penalty: float = option(0.001, "weight of the input transform's penalty (Qi 2016)", ge=0)


class ShapesTask:
    """Cross entropy on augmented shapes; evaluation on shapes without augmentation."""

    def __init__(self, train: ShapeSet, test: ShapeSet, config: ShapesTrainingConfig) -> None:
        if train.names != test.names:
            raise DataError("the shapes to train on and to judge on have different classes")
        if config.network.colors:
            raise DataError("network.colors is true, and shapes have no colours")
        if len(train) < config.batch:
            raise DataError(f"{len(train)} shapes to train on, expected at least {config.batch}")
        self.config, self.train, self.test = config, train, test
        with seed_torch(config.optimiser.seed):
            self.network: nn.Module = Classifier(
                PointNet(config.network), config.head, len(train.names)
            )

    def losses(self, rng: np.random.Generator) -> Iterator[torch.Tensor]:
        """Batches of every shape once, shuffled and augmented anew each time."""
        order = rng.permutation(len(self.train))
        for start in range(0, len(order) - self.config.batch + 1, self.config.batch):
            chosen = order[start : start + self.config.batch]
            clouds = np.stack([self._augment(self.train.points[row], rng) for row in chosen])
            logits, matrix = self.network(torch.from_numpy(clouds))
            labels = torch.from_numpy(self.train.labels[chosen])
            loss: torch.Tensor = nn.functional.cross_entropy(logits, labels)
            yield loss + self.config.penalty * transform_penalty(matrix)

    def _augment(self, points: Points, rng: np.random.Generator) -> Points:
        # Shapes have no pose in a robot's frame, so they are always scaled to the unit sphere.
        some = scale_to_sphere(points[rng.permutation(len(points))[: self.config.points]])
        return scale_to_sphere(augment(some, self.config.augment, rng))

    def scores(self) -> dict[str, float]:
        """Accuracy on the test shapes."""
        right = 0
        with torch.no_grad():
            for start in range(0, len(self.test), self.config.batch):
                part = slice(start, start + self.config.batch)
                shapes = self.test.points[part, : self.config.points]
                clouds = np.stack([scale_to_sphere(points) for points in shapes])
                logits, _ = self.network(torch.from_numpy(clouds))
                right += int((logits.argmax(dim=1).numpy() == self.test.labels[part]).sum())
        return {"accuracy": right / len(self.test)}
