# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Trains PointNet end to end to recognise places, with colours (NT-Xent, Chen 2020).

A batch consists of pairs of sights of the same place. Each sight has to find its partner among
the negatives; other sights of the same place, or nearly the same, are ignored.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Points
from fusionslam.config import Section, option
from fusionslam.errors import ConfigError, DataError
from fusionslam.learning.pair_comparison import features_of
from fusionslam.learning.places import PairConfig, Places, make_pairs, same_places
from fusionslam.learning.pointnet import PointNet, transform_penalty
from fusionslam.learning.torch_extra import nn, torch
from fusionslam.learning.training_loop import OptimiserConfig, seed_torch
from fusionslam.views.second_stage.architecture import PointNetConfig
from fusionslam.views.second_stage.inputs import network_input, resample
from fusionslam.views.second_stage.scores import area_under_curve


class SightAugmentConfig(Section):
    """Augmentation of sights; values per batch are the same for all sights in it."""

    jitter_m: float = option(0.01, "standard deviation of each coordinate", unit="m", ge=0)
    dropout: float = option(0.4, "largest share of points dropped from a sight", ge=0, lt=1)
    mirror: bool = option(True, "mirror left and right in every second batch")
    recolor: bool = option(True, "permute, invert or scale the colour channels of a batch")
    light: float = option(0.15, "largest relative change of a sight's brightness", ge=0, lt=1)


class MetricTrainingConfig(Section):
    """End-to-end training on places."""

    network: PointNetConfig = option(
        PointNetConfig(embedding=256, colors=True, normalisation="robot"), "sizes of the network"
    )
    optimiser: OptimiserConfig = option(OptimiserConfig(epochs=20), "optimiser")
    augment: SightAugmentConfig = option(SightAugmentConfig(), "augmentation of sights")
    pairs: PairConfig = option(PairConfig(), "limits of the same place, and test pairs")
    points: int = option(512, "points per sight given to the network", ge=1)
    batch: int = option(48, "pairs per batch", ge=2)
    worlds: int = option(3, "worlds per batch: the fewer, the more alike are the negatives", ge=1)
    batches: int = option(60, "batches per epoch", ge=1)
    temperature: float = option(0.1, "of the similarities", gt=0)
    penalty: float = option(0.001, "weight of the input transform's penalty (Qi 2016)", ge=0)


class MetricTask:
    """NT-Xent on augmented sights; evaluation on pairs of sights of other worlds."""

    def __init__(self, train: Places, test: Places, config: MetricTrainingConfig) -> None:
        if config.network.embedding is None:
            raise ConfigError(
                "network.embedding is null: metric learning needs features of length 1"
            )
        self.config, self.train, self.test = config, train, test
        rng = np.random.default_rng([config.optimiser.seed, 0x3E])
        self.judged = make_pairs(test, config.pairs, rng)
        self._partners = _find_partners(train, config)
        rows = np.array(sorted(self._partners))
        self._anchors = [rows[train.worlds[rows] == w] for w in np.unique(train.worlds[rows])]
        with seed_torch(config.optimiser.seed):
            self.network: nn.Module = PointNet(config.network)

    def losses(self, rng: np.random.Generator) -> Iterator[torch.Tensor]:
        """The losses of one epoch; each batch is from a few worlds."""
        for _ in range(self.config.batches):
            anchors = self._draw_anchors(rng)
            partners = [int(rng.choice(self._partners[int(anchor)])) for anchor in anchors]
            rows = np.concatenate([anchors, partners])
            clouds = torch.from_numpy(self._augment(rows, rng))
            features, matrix = self.network(clouds)
            loss = _nt_xent(features, self._ignored_pairs(rows), self.config.temperature)
            yield loss + self.config.penalty * transform_penalty(matrix)

    def _draw_anchors(self, rng: np.random.Generator) -> NDArray[np.int64]:
        worlds = rng.permutation(len(self._anchors))[: self.config.worlds]
        parts = np.array_split(np.arange(self.config.batch), len(worlds))
        return np.concatenate(
            [
                rng.choice(self._anchors[world], len(part))
                for world, part in zip(worlds, parts, strict=True)
            ]
        )

    def _ignored_pairs(self, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Bool (n, n): pairs of a batch that are neither partners nor negatives."""
        same, doubtful = same_places(
            self.train, rows[:, None], rows[None, :], self.config.pairs.place
        )
        ignored = same | doubtful
        index = np.arange(len(rows))
        ignored[index, (index + len(rows) // 2) % len(rows)] = False
        ignored[index, index] = True
        return ignored

    def _augment(self, rows: NDArray[np.int64], rng: np.random.Generator) -> Points:
        clouds = np.stack([self._sight(int(row), rng) for row in rows])
        if self.config.augment.mirror and rng.random() < 0.5:
            clouds[:, :, 1] *= -1
        if self.config.augment.recolor and self.config.network.colors:
            channels = 3 + rng.permutation(3)
            signs = np.where(rng.random(3) < 0.25, -1, 1) * rng.uniform(0.6, 1.0, 3)
            clouds[:, :, 3:] = clouds[:, :, channels] * signs.astype(np.float32)
        return clouds

    def _sight(self, row: int, rng: np.random.Generator) -> Points:
        cloud, network, augment = self.train[row], self.config.network, self.config.augment
        taken = network_input(cloud.points, cloud.colors, network)
        kept = rng.random(len(taken)) >= rng.uniform(0, augment.dropout)
        seen = resample(taken[kept] if kept.any() else taken, self.config.points, rng)
        length = network.range_m if network.normalisation == "robot" else 1.0
        noise = rng.standard_normal((len(seen), 3), np.float32)
        seen[:, :3] += noise * np.float32(augment.jitter_m / length)
        if network.colors:
            gain = np.float32(1 + rng.uniform(-augment.light, augment.light))
            seen[:, 3:] = ((seen[:, 3:] + 1) * gain - 1).clip(-1, 1)
        return seen

    def scores(self) -> dict[str, float]:
        """Area under the curve on the test pairs."""
        return {"auc": area_under_curve(-self.judge_distances(), self.judged.same)}

    def judge_distances(self) -> NDArray[np.float64]:
        """Feature distances of the test pairs, float64 (m,)."""
        assert isinstance(self.network, PointNet)
        rows = features_of(self.network, self.test)
        gap = rows[self.judged.first] - rows[self.judged.second]
        distances: NDArray[np.float64] = np.linalg.norm(gap.astype(np.float64), axis=1)
        return distances


def _find_partners(places: Places, config: MetricTrainingConfig) -> dict[int, NDArray[np.int64]]:
    """The other sights of the same place, for each sight that has any."""
    found: dict[int, NDArray[np.int64]] = {}
    for world in range(len(places.names)):
        rows = np.flatnonzero(places.worlds == world)
        same, _ = same_places(places, rows[:, None], rows[None, :], config.pairs.place)
        np.fill_diagonal(same, False)
        found |= {int(row): rows[mask] for row, mask in zip(rows, same, strict=True) if mask.any()}
    if not found:
        raise DataError(f"{', '.join(places.names)}: no two sights are the same place")
    return found


def _nt_xent(
    features: torch.Tensor, ignored: NDArray[np.bool_], temperature: float
) -> torch.Tensor:
    """Cross entropy of each row's partner, half a batch away, among all rows not ignored."""
    similar = features @ features.T / temperature
    similar = similar.masked_fill(torch.from_numpy(ignored), -torch.inf)
    half = len(features) // 2
    target = (torch.arange(len(features)) + half) % len(features)
    loss: torch.Tensor = nn.functional.cross_entropy(similar, target)
    return loss
