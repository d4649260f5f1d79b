# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The networks in torch: PointNet, its classifier, and the comparison of two feature vectors."""

from collections.abc import Iterable

from fusionslam.learning.torch_extra import nn, torch
from fusionslam.views.second_stage.architecture import ComparisonConfig, HeadConfig, PointNetConfig

Tensor = torch.Tensor


def _layers(sizes: Iterable[int]) -> nn.Sequential:
    """Linear layers, each followed by batch normalisation and ReLU."""
    steps: list[nn.Module] = []
    before, *after = sizes
    for size in after:
        steps += [nn.Linear(before, size), nn.BatchNorm1d(size), nn.ReLU()]
        before = size
    return nn.Sequential(*steps)


class _Pooled(nn.Module):
    """Shared layers for every point, then max pooling over the points."""

    def __init__(self, channels: int, sizes: Iterable[int]) -> None:
        super().__init__()
        self.layers = _layers((channels, *sizes))

    def forward(self, clouds: Tensor) -> Tensor:
        """Float32 (B, N, C) to (B, F)."""
        batch, count, channels = clouds.shape
        rows: Tensor = self.layers(clouds.reshape(batch * count, channels))
        return rows.reshape(batch, count, -1).amax(dim=1)


class InputTransform(nn.Module):
    """Predicts a 3 x 3 matrix per cloud, initially the identity (Qi et al. 2016, 3.3)."""

    def __init__(self, config: PointNetConfig) -> None:
        super().__init__()
        self.points = _Pooled(3, config.transform_points)
        self.head = _layers((config.transform_points[-1], *config.transform_head))
        self.matrix = nn.Linear((*config.transform_points, *config.transform_head)[-1], 9)
        nn.init.zeros_(self.matrix.weight)
        with torch.no_grad():
            self.matrix.bias.copy_(torch.eye(3).flatten())

    def forward(self, xyz: Tensor) -> Tensor:
        """Float32 (B, N, 3) to (B, 3, 3)."""
        matrix: Tensor = self.matrix(self.head(self.points(xyz)))
        return matrix.reshape(-1, 3, 3)


class PointNet(nn.Module):
    """From clouds to feature vectors, independent of the order of points."""

    def __init__(self, config: PointNetConfig) -> None:
        super().__init__()
        self.config = config
        self.transform = InputTransform(config)
        self.points = _Pooled(config.channels, config.points)
        size = config.embedding
        self.embedding = nn.Linear(config.points[-1], size) if size else None

    def forward(self, clouds: Tensor) -> tuple[Tensor, Tensor]:
        """Float32 (B, N, 3 or 6) to features (B, F) and input transforms (B, 3, 3)."""
        matrix = self.transform(clouds[..., :3])
        turned = torch.bmm(clouds[..., :3], matrix)
        if self.config.colors:
            turned = torch.cat([turned, clouds[..., 3:]], dim=2)
        features = self.points(turned)
        if self.embedding is not None:
            features = nn.functional.normalize(self.embedding(features), dim=1)
        return features, matrix


class Classifier(nn.Module):
    """PointNet with a classification head."""

    def __init__(self, network: PointNet, head: HeadConfig, classes: int) -> None:
        super().__init__()
        self.network = network
        self.hidden = _layers((network.config.features, *head.layers))
        self.dropout = nn.Dropout(head.dropout)
        self.classes = nn.Linear((network.config.features, *head.layers)[-1], classes)

    def forward(self, clouds: Tensor) -> tuple[Tensor, Tensor]:
        """Float32 (B, N, C) to logits (B, classes) and input transforms (B, 3, 3)."""
        features, matrix = self.network(clouds)
        return self.classes(self.dropout(self.hidden(features))), matrix


class Comparison(nn.Module):
    """The probability that two feature vectors show the same place."""

    mean: Tensor
    scale: Tensor

    def __init__(self, config: ComparisonConfig) -> None:
        super().__init__()
        self.config = config
        self.hidden = nn.Linear(2 * config.features, config.hidden)
        self.output = nn.Linear(config.hidden, 1)
        self.register_buffer("mean", torch.zeros(config.features))
        self.register_buffer("scale", torch.ones(config.features))

    def standardise_as(self, features: Tensor) -> None:
        """Standardise all inputs by the mean and standard deviation of features (n, F)."""
        if self.config.standardise:
            self.mean.copy_(features.mean(dim=0))
            self.scale.copy_(1 / features.std(dim=0).clamp(min=1e-3))

    def forward(self, current: Tensor, stored: Tensor) -> Tensor:
        """Float32 (B, F) each to (B,), 0 to 1."""
        pair = [(features - self.mean) * self.scale for features in (current, stored)]
        hidden = self.hidden(torch.cat(pair, dim=1))
        if self.config.activation == "relu":
            hidden = torch.relu(hidden)
        return torch.sigmoid(self.output(hidden))[:, 0]


def transform_penalty(matrix: Tensor) -> Tensor:
    """How far transforms (B, 3, 3) are from orthogonal: mean of |I - A A^T|^2 (Qi 2016, eq. 2)."""
    off = torch.eye(3) - matrix @ matrix.transpose(1, 2)
    return off.square().sum(dim=(1, 2)).mean()
