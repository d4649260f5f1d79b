# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Configuration of work on many recordings, and what all places of one folder share."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fusionslam import _core
from fusionslam.base.archive import load_json, save_json
from fusionslam.config import Section, merged, option
from fusionslam.descriptors import DescriptorConfig, with_preset
from fusionslam.errors import ConfigError
from fusionslam.fusion import FusionConfig
from fusionslam.loop_closure.observation import FrameObserver
from fusionslam.registration import RegistrationConfig

FORMAT = "fusionslam.fleet.1"
FILE = "fleet.json"


class FleetConfig(Section):
    """How recordings are cut into work, and what is kept of them."""

    chunk: int = option(50, "frames of a recording that are described together", ge=1, le=100_000)
    keyframe_distance: float = option(
        0.0,
        "distance between the frames that become places; 0 takes every frame",
        unit="m",
        ge=0,
        allow_inf_nan=False,
    )
    keyframe_turn: float = option(30.0, "turn between them", unit="deg", gt=0, le=360)
    clouds: bool = option(True, "keep the clouds of places, which prove what a query finds")
    tries: int = option(3, "times that work is tried before it counts as failed", ge=1, le=100)


_SECTIONS: dict[str, type[Section]] = {
    "fusion": FusionConfig,
    "descriptors": DescriptorConfig,
    "registration": RegistrationConfig,
    "fleet": FleetConfig,
}


@dataclass(frozen=True)
class FleetSettings:
    """What all places of one folder share, so that they can be compared.

    Attributes:
        names: descriptors, each with its preset; the first is that of the database.
        fusion, descriptors, registration, fleet: sections of the configuration.
    """

    names: tuple[str, ...]
    fusion: FusionConfig
    descriptors: DescriptorConfig
    registration: RegistrationConfig
    fleet: FleetConfig

    @classmethod
    def of(cls, names: tuple[str, ...], config: Any, fleet: FleetConfig) -> "FleetSettings":
        """Make settings of the sections of a ``PipelineConfig``; presets are written out."""
        full = tuple(with_preset(name, config.descriptors) for name in names)
        return cls(full, config.fusion, config.descriptors, config.registration, fleet)

    def observer(self, names: Sequence[str], *, verifies: bool) -> FrameObserver:
        """Return what describes frames by some of the descriptors, and may prepare their clouds."""
        sections = self.descriptors, self.fusion, self.registration
        return FrameObserver({name: name for name in names}, *sections, verifies=verifies)

    @classmethod
    def load(cls, folder: Path) -> "FleetSettings":
        """Read the settings of a folder.

        Raises:
            DataError: it has none, or they are damaged or of another format.
        """
        with load_json(folder / FILE, FORMAT, "a folder of fleet describe") as values:
            sections: dict[str, Any] = {
                name: merged(kind(), values[name], f"{name}.") for name, kind in _SECTIONS.items()
            }
            return cls(tuple(map(str, values["names"])), **sections)

    def save(self, folder: Path) -> None:
        """Write the settings of a new folder.

        Raises:
            DataError: it cannot be written.
        """
        save_json(folder / FILE, FORMAT, self.dump())

    def dump(self) -> dict[str, Any]:
        """Return everything as values for JSON."""
        sections = {name: getattr(self, name).model_dump(mode="json") for name in _SECTIONS}
        return {"names": list(self.names), **sections}

    def check_same(self, other: "FleetSettings", folder: Path) -> None:
        """Raise ConfigError (code "other-configuration") where others would make other places."""
        ours, theirs = self._decisive(), other._decisive()
        for name, value in ours.items():
            if theirs[name] != value:
                raise ConfigError(
                    f"{folder} was made with {name} {value!r}, not {theirs[name]!r}: expected the "
                    "same, or another folder (--output)",
                    code="other-configuration",
                    fields=(str(folder), name),
                )

    @property
    def digest(self) -> str:
        """A name of all that decides the content of a chunk; the version is a part of it."""
        text = json.dumps([_core.__version__, self._decisive()], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    def _decisive(self) -> dict[str, Any]:
        """Return the values that results depend on, by their full keys."""
        dumped = self.dump()
        values = {"names": dumped["names"]}
        for name in _SECTIONS:
            values |= {f"{name}.{key}": value for key, value in dumped[name].items()}
        for name in ("fleet.tries", "descriptors.threads"):
            values.pop(name, None)
        return values
