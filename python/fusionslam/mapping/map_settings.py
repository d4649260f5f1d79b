# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The configuration that all keyframes of a map share."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, cast

from fusionslam.base.arrays import Matrix
from fusionslam.config import Section, merged
from fusionslam.descriptors import DescriptorConfig, without_fitted
from fusionslam.errors import ConfigError
from fusionslam.fusion import FusionConfig, require_up, robot_from_cloud
from fusionslam.loop_closure.config import LoopConfig
from fusionslam.loop_closure.detector import LoopDetector
from fusionslam.mapping.config import MapConfig
from fusionslam.registration import RegistrationConfig, without_lengths
from fusionslam.sensors.frame import Frame

_SECTIONS: dict[str, tuple[str, type[Section]]] = {
    "loops": ("loop_closure", LoopConfig),
    "describe": ("descriptors", DescriptorConfig),
    "fusion": ("fusion", FusionConfig),
    "registration": ("registration", RegistrationConfig),
    "map": ("mapping", MapConfig),
}
"""Names of the configuration's sections, and their kinds, by attribute."""
_CHOSEN = (
    *("loop_closure.max_frames=", "loop_closure.verify=", "loop_closure.window="),
    *("fusion.source=", "fusion.frame=", "fusion.up="),
)
"""What a map or a command chooses itself, so that other values need not have been asked for."""
LONGEST_SESSION_NAME = 200
"""Bytes of UTF-8."""
_COMPARED = ("descriptor", "descriptors", "fusion", "registration")


@dataclass(frozen=True)
class MapSettings:
    """All that keyframes of one map share."""

    descriptor: str
    loops: LoopConfig
    describe: DescriptorConfig
    fusion: FusionConfig
    registration: RegistrationConfig
    map: MapConfig

    def __post_init__(self) -> None:
        for field in fields(self):
            value, expected = getattr(self, field.name), cast("type", field.type)
            if not isinstance(value, expected):
                raise TypeError(f"{field.name}: {value!r}, expected a {expected.__name__}")

    def dump(self) -> dict[str, Any]:
        """Return what the file of a map holds of them, ready for JSON."""
        sections = {name: getattr(self, key).model_dump() for key, (name, _) in _SECTIONS.items()}
        return {"descriptor": self.descriptor, **sections}

    @classmethod
    def load(cls, values: Mapping[str, Any]) -> "MapSettings":
        """Make settings of what ``dump`` returned."""
        sections: dict[str, Any] = {
            key: merged(kind(), values[name], f"{name}.") for key, (name, kind) in _SECTIONS.items()
        }
        return cls(str(values["descriptor"]), **sections)

    def list_differences(self, descriptor: str | None, **given: Section | None) -> list[str]:
        """Return what was given explicitly and is otherwise here, such as "mapping.voxel=0.4".

        Args:
            descriptor: None if it was not given.
            given: by the names of attributes.
        """
        found = []
        if descriptor is not None and descriptor != self.descriptor:
            found.append(f"descriptor={descriptor} (the map has {self.descriptor})")
        for name, section in given.items():
            known = getattr(self, name)
            if section is None:
                continue
            if not isinstance(section, type(known)):
                raise TypeError(f"{name}: {section!r}, expected a {type(known).__name__}")
            found += _differences(_SECTIONS[name][0], section, known)
        return [each for each in found if not each.startswith(_CHOSEN)]

    @property
    def keyframe_distance(self) -> float:
        """Metres between keyframes."""
        distance = self.map.keyframe_distance
        return 4 * self.registration.voxel if distance is None else distance

    @property
    def comparable(self) -> dict[str, Any]:
        """What maps must have in common for their keyframes to be compared, but for lengths."""
        values = {key: value for key, value in self.dump().items() if key in _COMPARED}
        values["descriptors"] = without_fitted(self.describe)
        registration = without_lengths(self.registration)
        registration.pop("local_map", None)
        return values | {"registration": registration}

    @property
    def lengths(self) -> dict[str, float]:
        """Metres that are fitted to the first cloud of a map: of one building, they are similar."""
        given = {
            "registration.voxel": self.registration.voxel,
            "descriptors.normal_radius": self.describe.normal_radius,
            "descriptors.bev_spectrum.cell": self.describe.bev_spectrum.model_dump()["cell"],
        }
        return {key: length for key, length in given.items() if length is not None}

    def robot_from_cloud(self, frame: Frame) -> Matrix:
        """Return the pose of a frame's cloud on the robot, float64 (4, 4).

        Raises:
            DataError: the transform is not known, or z does not point up in the cloud (code
                "not-up"), so that it could be registered with no other.
        """
        needs_up = self.registration.gravity and self.registration.method != "planar"
        if needs_up and self.fusion.frame == "scan" and self.fusion.up == "z":
            require_up(self.fusion, frame)
        return robot_from_cloud(frame, self.fusion)

    def new_detector(self) -> LoopDetector:
        """Make the detector of loops, without keyframes.

        It has no window, which counts keyframes of one stretch of odometry.
        """
        return LoopDetector(
            self.descriptor,
            config=merged(self.loops, {"window": 0, "window_seconds": 0.0}),
            describe=self.describe,
            fusion=self.fusion,
            registration=self.registration,
        )


def _differences(name: str, given: Section, known: Section) -> list[str]:
    """Keys of a section that were set to something else than what is known."""
    found = []
    for key in sorted(given.model_fields_set):
        value, other = getattr(given, key), getattr(known, key)
        if isinstance(value, Section) and isinstance(other, Section):
            found += _differences(f"{name}.{key}", value, other)
        elif value != other:
            found.append(f"{name}.{key}={value} (the map has {other})")
    return found


def check_session_name(session: str) -> None:
    """Raise ConfigError for a name that is empty, not printable or too long (code "session-name").

    Files of an export have the names of sessions.
    """
    is_name = isinstance(session, str) and session.strip() and session.isprintable()
    if not is_name or len(session.encode()) > LONGEST_SESSION_NAME:
        shown = repr(session)
        shown = shown if len(shown) <= 2 * LONGEST_SESSION_NAME else f"{shown[:40]}..."
        raise ConfigError(
            f"session is {shown}: expected a name of printable characters, at most "
            f"{LONGEST_SESSION_NAME} bytes long",
            code="session-name",
            fields=("session", shown),
        )
