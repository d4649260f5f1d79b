# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Features of the learned second stage, and the comparison of two of them."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.speed.cases import Agreement, Bound, Case, agree
from benchmarks.speed.inputs import Inputs, Points, random_descriptors
from benchmarks.speed.settings import Settings
from benchmarks.speed.timing import timer
from fusionslam.views.second_stage import MODELS, SecondStage
from fusionslam.views.second_stage.inputs import network_input
from fusionslam.views.second_stage.network_files import SHIPPED

TORCH = "torch, eager"
POINTS = 2_000
_STORED = 1_000


def learning_cases(inputs: Inputs, settings: Settings) -> Iterator[Case]:
    """Features of a robot's scan by both networks that come with the package."""
    points, colors = inputs.sized(POINTS)
    for model in MODELS:
        stage, peer = SecondStage(model), _torch(model)
        yield Case(
            f"PointNet features ({model}), {POINTS:,} points",
            TORCH,
            timer(stage.features, points, colors),
            timer(peer, points, colors),
            lambda stage=stage, peer=peer: _same(  # type: ignore[misc]
                stage.features(points, colors), peer(points, colors)
            ),
            Bound("median", "<=", 7),
        )
        rows = random_descriptors(_STORED, stage.config.features)
        yield Case(
            f"probabilities ({model}), 1 sight against {_STORED:,} stored",
            "one by one",
            timer(stage.probabilities, rows[0], rows),
            timer(_one_by_one, stage, rows),
            lambda stage=stage, rows=rows: _same(  # type: ignore[misc]
                stage.probabilities(rows[0], rows), _one_by_one(stage, rows)
            ),
        )


def _one_by_one(stage: SecondStage, rows: Points) -> Points:
    return np.array([stage.probability(rows[0], row) for row in rows], np.float32)


def _torch(model: str) -> Callable[[Points, NDArray[np.uint8]], Points]:
    """The same network in torch, from the same weights, on one thread."""
    import torch

    from fusionslam.learning.weight_files import load_pointnet

    torch.set_num_threads(1)
    network, _ = load_pointnet((SHIPPED / MODELS[model][0]).with_suffix(".safetensors"))
    config = network.config

    def features(points: Points, colors: NDArray[np.uint8]) -> Points:
        taken = network_input(points, colors, config)
        with torch.no_grad():
            row: Any = network(torch.from_numpy(taken)[None])[0][0].numpy()
        return row  # type: ignore[no-any-return]

    return features


def _same(ours: Points, theirs: Points) -> Agreement:
    error = float(np.abs(ours - theirs).max()) / max(1.0, float(np.abs(theirs).max()))
    return agree("largest difference", error, 1e-5)
