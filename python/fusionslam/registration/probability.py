# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How probable it is that a registered pose is right, by its overlap and colours."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np

from fusionslam.registration.colors import ColorDifference

_FITTED = Path(__file__).with_name("probability.yaml")


def pose_probability(overlap: float, colors: ColorDifference | None) -> float:
    """Logistic regression, fitted on simulated drives (docs/stages/registration.md).

    Args:
        overlap: of ``Registration``.
        colors: how the colours of points differ that the pose puts on each other; None if unknown.
    """
    model = _models()["plain" if colors is None else "colored"]
    score = model["intercept"] + model["overlap"] * overlap
    if colors is not None:
        score += model["color_ratio"] * colors.ratio
    return float(1 / (1 + np.exp(-np.clip(score, -50, 50))))


@cache
def _models() -> Mapping[str, Mapping[str, float]]:
    import yaml

    models: Mapping[str, Mapping[str, float]] = yaml.safe_load(_FITTED.read_text(encoding="utf-8"))
    return models
