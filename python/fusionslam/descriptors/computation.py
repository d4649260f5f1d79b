# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Compute descriptors by name."""

import logging
from functools import lru_cache
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam._core import cloud_resolution
from fusionslam.argument_types import checked
from fusionslam.config import Section, explain_choice, merged, split_preset
from fusionslam.descriptors.config import DescriptorConfig, core_class
from fusionslam.descriptors.registry import DESCRIPTORS, POINT_DATA, Descriptor
from fusionslam.errors import ConfigError, DataError
from fusionslam.fusion import FusionConfig, require_up
from fusionslam.help_texts import PER_FRAME
from fusionslam.sensors.frame import Cloud, Frame, require_cloud

logger = logging.getLogger(__name__)


@checked
def describe(
    cloud: "Cloud",  # by name, since require_cloud says more of what is none
    name: str,
    config: DescriptorConfig | None = None,
) -> NDArray[np.float32]:
    """Compute the named descriptor of a cloud, float32 (D,).

    Raises:
        ConfigError: unknown name or preset.
        ShapeError: not a cloud.
        DataError: colours (code "no-colors") or intensities (code "no-intensities") are needed
            and missing, or the cloud cannot be described (empty, NaN, all points equal, ...).
    """
    kind = find_descriptor(name)
    require_cloud(cloud)
    _require_extent(cloud)
    if (problem := missing_data(cloud, name)) is not None:
        raise problem
    settings = for_preset(config or DescriptorConfig(), name)
    if needs_up(name, settings):
        _warn_unless_upright(cloud, name)
    per_point = (cloud.points, *(getattr(cloud, need) for need in kind.point_data))
    function = getattr(import_module(kind.module), kind.name)
    result: NDArray[np.float32] = function(*per_point, **_arguments(kind, settings))
    return result


def _arguments(kind: Descriptor, config: DescriptorConfig) -> dict[str, Any]:
    """Return the keyword arguments of a descriptor's function."""
    given = {key: getattr(config, key) for key in kind.options if key != "preset"}
    if kind.section is not None:
        given["config"] = _core_config(kind, config)
    if kind.threads:
        given["threads"] = config.threads
    return given


def _core_config(kind: Descriptor, config: DescriptorConfig) -> Any:
    assert kind.section is not None
    preset = {"preset": config.preset} if kind.presets else {}
    values = getattr(config, kind.section).model_dump(exclude_none=True)
    return core_class(kind.section)(**preset, **values)


def _require_extent(cloud: Cloud) -> None:
    """Reject a cloud whose points are all equal, as of a sensor that writes zeros for no return."""
    points = cloud.points
    if len(points) and (_sample(points) == points[0]).all() and (points == points[0]).all():
        raise DataError("all points of the cloud are equal: it has no shape to describe")


def _sample(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Take at most some thousand points of a cloud, evenly."""
    return points[:: 1 + len(points) // 4096]


def _warn_unless_upright(cloud: Cloud, name: str) -> None:
    """Warn of a cloud that is taller than wide: its z axis hardly points up."""
    if len(cloud) < 2:
        return
    x, y, z = _sample(cloud.points).std(axis=0, dtype=np.float64)
    if z > np.hypot(x, y):
        text = (
            f"{name} needs clouds whose z axis points up, and the spread along z is larger than "
            "across it"
        )
        logger.warning(text, extra={PER_FRAME: text})


def missing_data(cloud: Cloud, name: str) -> DataError | None:
    """Return the error of a cloud that lacks colours or intensities which a descriptor needs."""
    for need in find_descriptor(name).point_data:
        if getattr(cloud, need) is not None:
            continue
        instead = without_colors(name)
        cure = f"; {instead} needs none" if instead != name else ""
        return DataError(
            f"{name} needs {POINT_DATA[need]} and the cloud has none{cure}",
            code=f"no-{need}",
            fields=(name, instead),
        )
    return None


def without_colors(name: str) -> str:
    """Return the descriptor that a coloured one extends, with the same preset; others as given."""
    first, preset = split_preset(name)
    plain = find_descriptor(first).extends or first
    return plain if preset is None else f"{plain}:{preset}"


def find_descriptor(name: str) -> Descriptor:
    """Look up a kind of descriptor; the name may end with a preset.

    Raises:
        ConfigError: an unknown name or preset; the message lists the known ones.
    """
    first, preset = split_preset(name)
    if first not in DESCRIPTORS:
        raise ConfigError(
            f"unknown descriptor {first!r}: {explain_choice(first, DESCRIPTORS)}",
            code="unknown-name",
            fields=("descriptors", first),
        )
    kind = DESCRIPTORS[first]
    if preset is not None and preset not in kind.presets:
        problem = explain_choice(preset, kind.presets) if kind.presets else "which has no presets"
        raise ConfigError(
            f"preset of {name!r}: {problem}", code="choice", fields=("descriptors", name)
        )
    return kind


def needs_up(name: str, config: DescriptorConfig) -> bool:
    """Return whether a descriptor needs clouds whose z axis points up.

    Those of its kind do, or its preset, which the name may end with, does.

    Raises:
        ConfigError: an unknown name or preset.
    """
    kind = find_descriptor(name)
    if not kind.presets:
        return "up" in kind.needs
    return bool(_core_config(kind, for_preset(config, name)).axes == "upright")


def for_preset(config: DescriptorConfig, name: str) -> DescriptorConfig:
    """Return the configuration with the preset that a descriptor's name ends with, if it does."""
    _, preset = split_preset(name)
    return config if preset is None else merged(config, {"preset": preset})


def with_preset(name: str, config: DescriptorConfig) -> str:
    """Return a descriptor's name with its preset, if it has any: "cm2dp:robust".

    Raises:
        ConfigError: an unknown name or preset.
    """
    kind = find_descriptor(name)
    return f"{kind.name}:{for_preset(config, name).preset}" if kind.presets else kind.name


def in_file_names(name: str) -> str:
    """Return a descriptor's name as files contain it: cm2dp-author."""
    return name.replace(":", "-")


def length_of(name: str, config: DescriptorConfig) -> int:
    """Length D of a descriptor, found by describing a small cloud: only the core knows it.

    Raises:
        ConfigError: unknown name, or values that exclude each other.
    """
    return _length_of(find_descriptor(name).name, for_preset(config, name))


@lru_cache(maxsize=256)
def _length_of(name: str, config: DescriptorConfig) -> int:
    kind = find_descriptor(name)
    changes: dict[str, Any] = {"normal_radius": None}
    if kind.section is not None:
        section = getattr(config, kind.section)
        # The length does not depend on these, which may leave none of this cloud.
        options = core_class(kind.section).options()
        names = (entry["name"] for entry in options if entry["unit"] or entry["name"] in _LIMITS)
        free = dict.fromkeys(names)
        changes[kind.section] = section.model_copy(update=free)
    return len(describe(_courtyard(), name, config.model_copy(update=changes)))


_LIMITS = {"max_curvature", "min_points"}


def _courtyard() -> Cloud:
    """A cloud that every descriptor can describe: a floor with walls and a shed."""
    across = np.arange(-10, 10, 0.25)
    up = np.arange(-1.5, 3, 0.25)
    floor = [(x, y, -1.5) for x in across for y in across]
    walls = [(x, y, z) for x in across for z in up for y in (-10.0, 9.0)]
    walls += [(x, y, z) for y in across for z in up for x in (-10.0, 8.0)]
    shed = [(x, 4.0, z) for x in np.arange(2, 5, 0.25) for z in np.arange(-1.5, 1, 0.25)]
    points = np.array(floor + walls + shed, np.float32)
    shades = np.linspace(0, 1, len(points), dtype=np.float32)
    colors = (np.column_stack([shades, 1 - shades, shades**2]) * 255).astype(np.uint8)
    return Cloud(points, colors, shades + 0.5)


def for_clouds(
    config: DescriptorConfig, name: str, fusion: FusionConfig, frame: Frame | None = None
) -> DescriptorConfig:
    """Set what follows from the frame that clouds are in, unless it is configured.

    Args:
        config: of the descriptor.
        name: of the descriptor.
        fusion: how clouds are made.
        frame: that a cloud is made of; None for a cloud made elsewhere.

    Raises:
        ConfigError, DataError: as ``require_up``, for a descriptor that needs z to point up.
    """
    if needs_up(name, config):
        require_up(fusion, frame)
    kind = find_descriptor(name)
    if fusion.frame != "robot" or kind.section is None or not kind.in_robot_frame:
        return config
    given: Section = getattr(config, kind.section)
    values = {**kind.in_robot_frame, **given.model_dump(exclude_none=True)}
    return merged(config, {kind.section: values})


def for_sequence(config: DescriptorConfig, first: Cloud) -> DescriptorConfig:
    """Set the radius for normals from a sequence's first cloud, unless it is configured.

    Five times its resolution, the mean distance to the nearest neighbour (Perdomo 2019, 4.1.1).
    """
    if config.normal_radius is not None:
        return config
    radius = 5 * cloud_resolution(first.points)
    return config.model_copy(update={"normal_radius": radius})
