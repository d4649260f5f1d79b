# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How probable it is that a registered pose is right, by what both clouds show."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fusionslam.registration.colors import ColorDifference

_FITTED = Path(__file__).with_name("probability.yaml")


class SmallView(NamedTuple):
    """What a pose of small views is judged by beside its overlap: a few surfaces fit by chance.

    Attributes:
        agreeing: of ``Registration``.
        degenerate: number of directions along which the clouds can slide on each other.
    """

    agreeing: int
    degenerate: int


def pose_probability(
    overlap: float, colors: ColorDifference | None, small: SmallView | None = None
) -> float:
    """Logistic regression, fitted on simulated drives (docs/stages/registration.md).

    Args:
        overlap: of ``Registration``.
        colors: how the colours of points differ that the pose puts on each other; None if unknown.
        small: if one of the clouds is a small view (``PreparedCloud``); it counts where colours
            are unknown.
    """
    features = {"overlap": overlap}
    if colors is not None:
        kind = "colored"
        features["color_ratio"] = colors.ratio
    elif small is not None:
        kind = "small"
        features["log_agreeing"] = float(np.log(max(small.agreeing, 1)))
        features["degenerate"] = small.degenerate
    else:
        kind = "plain"
    model = _models()[kind]
    score = model["intercept"] + sum(model[name] * value for name, value in features.items())
    return float(1 / (1 + np.exp(-np.clip(score, -50, 50))))


@cache
def _models() -> Mapping[str, Mapping[str, float]]:
    import yaml

    models: Mapping[str, Mapping[str, float]] = yaml.safe_load(_FITTED.read_text(encoding="utf-8"))
    return models
