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
    overlap: float,
    colors: ColorDifference | None,
    small: SmallView | None = None,
    *,
    mean_overlap: float | None = None,
) -> float:
    """Logistic regression, fitted to simulated and real drives (docs/stages/registration.md).

    Args:
        overlap, mean_overlap: of ``Registration``; the mean counts for full circles outdoors whose
            colours are unknown. None is the overlap: that of both clouds.
        colors: how the colours of points differ that the pose puts on each other; None if unknown.
        small: if one of the clouds is a small view (``PreparedCloud``); it counts where colours
            are unknown.
    """
    if colors is not None:
        kind = "colored"
        features = {"overlap": overlap, "color_ratio": colors.ratio}
    elif small is not None:
        kind = "small"
        log_agreeing = float(np.log(max(small.agreeing, 1)))
        features = {"overlap": overlap, "log_agreeing": log_agreeing}
        features["degenerate"] = small.degenerate
    else:
        kind = "plain"
        features = {"mean_overlap": overlap if mean_overlap is None else mean_overlap}
    model = _models()[kind]
    score = model["intercept"] + sum(model[name] * value for name, value in features.items())
    return float(1 / (1 + np.exp(-np.clip(score, -50, 50))))


@cache
def _models() -> Mapping[str, Mapping[str, float]]:
    import yaml

    models: Mapping[str, Mapping[str, float]] = yaml.safe_load(_FITTED.read_text(encoding="utf-8"))
    return models
