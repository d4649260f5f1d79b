# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Metadata of network files, both safetensors and ONNX."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from fusionslam.base.archive import load_json
from fusionslam.base.files import reading
from fusionslam.config import Section
from fusionslam.errors import DataError
from fusionslam.views.second_stage.architecture import ComparisonConfig, PointNetConfig

FORMAT = "fusionslam.network.1"
DIGESTS = "sha256"
"""Key of the digests in a model card."""

_KEY = "fusionslam"
_SUFFIXES = (".onnx", ".safetensors")
Kind = Literal["pointnet", "comparison"]
_CONFIGS: Mapping[str, type[Section]] = {
    "pointnet": PointNetConfig,
    "comparison": ComparisonConfig,
}

SHIPPED = Path(__file__).parent / "weights"
"""The folder of the networks that come with the package."""


@dataclass(frozen=True)
class Calibration:
    """Converts feature distances to probabilities: see ``scores.calibrate``."""

    offset: float
    slope: float


@dataclass(frozen=True)
class About:
    """Kind and sizes of a network.

    Attributes:
        kind: the task of the network.
        architecture: a PointNetConfig or a ComparisonConfig.
        calibration: of feature distances, if the features were trained for it, else None.
    """

    kind: Kind
    architecture: Section
    calibration: Calibration | None = None

    def metadata(self) -> dict[str, str]:
        """The metadata as a single entry, since files do not keep the order of several."""
        values: dict[str, Any] = {
            "format": FORMAT,
            "kind": self.kind,
            "architecture": self.architecture.model_dump(mode="json"),
        }
        if self.calibration is not None:
            values["calibration"] = vars(self.calibration)
        return {_KEY: json.dumps(values)}


def digest_files(card: Path) -> dict[str, str]:
    """SHA-256 of the network files beside a model card, by suffix."""
    files = (card.with_suffix(suffix) for suffix in _SUFFIXES)
    return {f.suffix: hashlib.sha256(f.read_bytes()).hexdigest() for f in files if f.is_file()}


def check_digest(path: Path) -> None:
    """Raise DataError if a network file is not the one that the card beside it describes.

    Cards of version 0.1 have no digests.
    """
    card = path.with_suffix(".json")
    if not card.exists() or not path.is_file():
        return
    with load_json(card, None, "a model card") as values:
        expected = values.get(DIGESTS, {}).get(path.suffix)
    if expected is not None and expected != digest_files(card)[path.suffix]:
        raise DataError(
            f"{path} was changed after it was written: it does not fit its digest in "
            f"{card.name} (remove both digests there if the change was intended)",
            code="wrong-digest",
            fields=(str(path),),
        )


def read_about(path: Path, metadata: Mapping[str, str] | None, kind: Kind) -> About:
    """Parse a file's metadata.

    Raises:
        DataError: another format or kind of network, or invalid sizes.
    """
    with reading(path, f"a {kind} network"):
        values = json.loads((metadata or {}).get(_KEY, "{}"))
        if values.get("format") != FORMAT:
            raise DataError(f"is of format {values.get('format')}, expected {FORMAT}")
        if values.get("kind") != kind:
            raise DataError(
                f"holds a {values.get('kind')} network, expected {kind}", code="other-kind"
            )
        stored = values.get("calibration")
        return About(
            kind,
            _CONFIGS[kind](**values["architecture"]),
            None if stored is None else Calibration(**stored),
        )
