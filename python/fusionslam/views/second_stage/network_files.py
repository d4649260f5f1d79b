# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What every file of a network says about itself, whether safetensors or ONNX."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from fusionslam.config import Section
from fusionslam.errors import DataError
from fusionslam.views.second_stage.architecture import ComparisonConfig, PointNetConfig

FORMAT = "fusionslam.network.1"
_KEY = "fusionslam"
Kind = Literal["pointnet", "comparison"]
_CONFIGS: Mapping[str, type[Section]] = {
    "pointnet": PointNetConfig,
    "comparison": ComparisonConfig,
}

SHIPPED = Path(__file__).parent / "weights"
"""The folder of the networks that come with the package."""


@dataclass(frozen=True)
class Calibration:
    """What distances of feature vectors mean: see ``scores.calibrated``."""

    offset: float
    slope: float


@dataclass(frozen=True)
class About:
    """Kind and sizes of a network.

    Attributes:
        kind: what it does.
        architecture: a PointNetConfig or a ComparisonConfig.
        calibration: of distances of features that were trained for it, else None.
    """

    kind: Kind
    architecture: Section
    calibration: Calibration | None = None

    def metadata(self) -> dict[str, str]:
        """As one text, which both kinds of file can hold; the order of several is not kept."""
        values: dict[str, Any] = {
            "format": FORMAT,
            "kind": self.kind,
            "architecture": self.architecture.model_dump(mode="json"),
        }
        if self.calibration is not None:
            values["calibration"] = vars(self.calibration)
        return {_KEY: json.dumps(values)}


def read_about(path: Path, metadata: Mapping[str, str] | None, kind: Kind) -> About:
    """What a file's metadata say.

    Raises:
        DataError: another format or kind of network, or sizes that make no sense.
    """
    try:
        values = json.loads((metadata or {}).get(_KEY, "{}"))
        found = values.get("format")
        if found != FORMAT:
            raise DataError(
                f"{path}: format is {found!r}, expected {FORMAT!r} with a {kind} network"
            )
        if values.get("kind") != kind:
            raise DataError(f"{path} holds a {values.get('kind')} network, expected {kind}")
        architecture = _CONFIGS[kind](**values["architecture"])
        stored = values.get("calibration")
        calibration = None if stored is None else Calibration(**stored)
    except DataError:
        raise
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise DataError(
            f"{path}: its metadata do not describe a {kind} network: {error}"
        ) from error
    return About(kind, architecture, calibration)
