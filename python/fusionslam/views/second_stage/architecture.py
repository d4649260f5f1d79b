# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Sizes of the networks, as a weights file declares them."""

from typing import Annotated, Literal

from pydantic import Field

from fusionslam.config import Section, option

Sizes = tuple[Annotated[int, Field(ge=1, le=65536)], ...]


class PointNetConfig(Section):
    """A small PointNet (Qi et al. 2016; sizes of Stastny 2022, 4.6.1)."""

    transform_points: Sizes = option(
        (64, 128, 256), "input transform: layers per point", min_length=1
    )
    transform_head: Sizes = option((128, 64), "input transform: layers after pooling")
    points: Sizes = option((64, 128, 256), "layers per point; the last is pooled", min_length=1)
    embedding: int | None = option(
        None,
        "size of a linear layer after pooling, whose output gets length 1; null for none",
        ge=1,
    )
    colors: bool = option(False, "whether points have colours")
    normalisation: Literal["sphere", "robot"] = option(
        "sphere", "fit clouds into the unit sphere, or keep the robot's frame"
    )
    range_m: float = option(5.0, "normalisation robot: length that becomes 1", unit="m", gt=0)

    @property
    def channels(self) -> int:
        """Number of values per point."""
        return 6 if self.colors else 3

    @property
    def features(self) -> int:
        """Length of the feature vector."""
        return self.embedding or self.points[-1]


class HeadConfig(Section):
    """The classifier head, needed only for training."""

    layers: Sizes = option((128, 64), "hidden layers")
    dropout: float = option(0.3, "of the last hidden layer, in training", ge=0, lt=1)


class ComparisonConfig(Section):
    """From two feature vectors to the probability of the same place (Stastny 2022, 4.6.1)."""

    features: int = option(256, "length of a feature vector", ge=1)
    hidden: int = option(256, "neurons of the hidden layer", ge=1)
    activation: Literal["relu", "none"] = option(
        "relu",
        "between the layers; none as in the thesis's program, where two linear layers act as one",
    )
    standardise: bool = option(
        True, "standardise features by the training set; false as in the thesis"
    )
