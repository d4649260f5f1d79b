# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Trains the comparison of two feature vectors on pairs of sights (Stastny 2022, 4.6.2)."""

from collections.abc import Iterator

import numpy as np

from fusionslam.base.arrays import Floats32
from fusionslam.config import Section, option
from fusionslam.errors import DataError
from fusionslam.learning.places import PairConfig, Places, make_pairs
from fusionslam.learning.pointnet import Comparison, PointNet
from fusionslam.learning.torch_extra import nn, torch
from fusionslam.learning.training_loop import OptimiserConfig, seed_torch
from fusionslam.views.second_stage.architecture import ComparisonConfig
from fusionslam.views.second_stage.inputs import network_input
from fusionslam.views.second_stage.scores import area_under_curve


class ComparisonTrainingConfig(Section):
    """Training of the comparison."""

    network: ComparisonConfig = option(ComparisonConfig(), "sizes of the network")
    optimiser: OptimiserConfig = option(OptimiserConfig(epochs=30, weight_decay=1e-3), "optimiser")
    pairs: PairConfig = option(PairConfig(), "pairs of sights")
    held_out: float = option(
        0.3, "share of each world, spatially apart from the rest, kept for test pairs", gt=0, lt=1
    )
    batch: int = option(256, "pairs per batch", ge=2)


def features_of(network: PointNet, places: Places) -> Floats32:
    """Floats32 of every sight, from all of its points: float32 (n, F)."""
    config = network.config
    network.eval()
    rows = np.empty((len(places), config.features), np.float32)
    with seed_torch(0), torch.no_grad():
        for index in range(len(places)):
            cloud = places[index]
            taken = network_input(cloud.points, cloud.colors, config)
            rows[index] = network(torch.from_numpy(taken)[None])[0][0].numpy()
    return rows


class ComparisonTask:
    """Mean squared error of the probability; evaluation on pairs of held-out places."""

    def __init__(
        self,
        train: tuple[Places, Floats32],
        test: tuple[Places, Floats32],
        config: ComparisonTrainingConfig,
    ) -> None:
        for places, rows in (train, test):
            if rows.shape != (len(places), config.network.features):
                raise DataError(
                    f"features have shape {rows.shape}, expected "
                    f"({len(places)}, {config.network.features})"
                )
        self.config = config
        rng = np.random.default_rng([config.optimiser.seed, 0xC0])
        self._pairs = make_pairs(train[0], config.pairs, rng)
        self._judged = make_pairs(test[0], config.pairs, rng)
        self._train, self._test = (torch.from_numpy(rows) for rows in (train[1], test[1]))
        with seed_torch(config.optimiser.seed):
            network = Comparison(config.network)
            network.standardise_as(self._train)
        self.network: nn.Module = network

    def losses(self, rng: np.random.Generator) -> Iterator[torch.Tensor]:
        """Batches of every pair once, in random order within the pair."""
        order = rng.permutation(len(self._pairs))
        for start in range(0, len(order), self.config.batch):
            chosen = order[start : start + self.config.batch]
            swapped = rng.random(len(chosen)) < 0.5
            first, second = self._pairs.first[chosen], self._pairs.second[chosen]
            a, b = np.where(swapped, second, first), np.where(swapped, first, second)
            same = torch.from_numpy(self._pairs.same[chosen].astype(np.float32))
            probability = self.network(self._train[a], self._train[b])
            yield nn.functional.mse_loss(probability, same)

    def scores(self) -> dict[str, float]:
        """Area under the curve and mean squared error on the test pairs."""
        with torch.no_grad():
            a, b = self._test[self._judged.first], self._test[self._judged.second]
            found = self.network(a, b).numpy()
        error = float(np.mean((found - self._judged.same) ** 2))
        return {"auc": area_under_curve(found, self._judged.same), "held_out_loss": error}
