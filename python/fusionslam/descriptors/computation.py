# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Compute descriptors by name."""

from collections.abc import Iterable
from functools import lru_cache
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam import _core
from fusionslam._core import cloud_resolution
from fusionslam.base.argument_types import checked
from fusionslam.config import Section, explain_choice, merged, split_preset
from fusionslam.descriptors.config import DescriptorConfig, core_class
from fusionslam.descriptors.own import VARIABLE, check_name_length, find_own, is_own, let_count
from fusionslam.descriptors.registry import (
    DESCRIPTORS,
    FITTED_SECTIONS,
    POINT_DATA,
    Descriptor,
)
from fusionslam.errors import ConfigError, DataError, FusionSlamError
from fusionslam.fusion import FusionConfig, require_up
from fusionslam.sensors.frame import Cloud, Frame, require_cloud


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
            and missing, the cloud cannot be described (empty, NaN, all points equal, ...), or a
            descriptor of the user's own raises or returns something else (code "own-descriptor").
    """
    kind = find_descriptor(name)
    require_cloud(cloud)
    points = cloud.points
    some = points[:: 1 + len(points) // 4096]
    # As of a sensor that writes zeros for no return.
    if len(points) and (some == points[0]).all() and (points == points[0]).all():
        raise DataError("all points of the cloud are equal: it has no shape to describe")
    if (problem := missing_data(cloud, name)) is not None:
        raise problem
    settings = for_preset(config or DescriptorConfig(), name)
    per_point = (points, *(getattr(cloud, need) for need in kind.point_data))
    if kind.function is not None:
        return _describe_by_own(kind, *per_point)
    function = getattr(import_module(kind.module), kind.name)
    arguments = {key: getattr(settings, key) for key in kind.options if key != "preset"}
    if kind.section is not None:
        arguments["config"] = _core_config(kind, settings)
    if kind.threads:
        arguments["threads"] = settings.threads
    result: NDArray[np.float32] = function(*per_point, **arguments)
    return result


def describe_or_zeros(
    cloud: Cloud, name: str, config: DescriptorConfig
) -> tuple[NDArray[np.float32], DataError | None]:
    """Return a cloud's descriptor, or zeros, which are like nothing, and why it has none.

    Raises:
        ConfigError: unknown name or preset.
    """
    try:
        return describe(cloud, name, config), None
    except DataError as error:
        return np.zeros(length_of(name, config), np.float32), error


def _describe_by_own(kind: Descriptor, *per_point: NDArray[Any]) -> NDArray[np.float32]:
    """Call a user's function, which may do anything. Raises DataError."""
    assert kind.function is not None
    try:
        with np.errstate(over="ignore"):
            result = np.asarray(kind.function(*per_point), np.float32)
    except FusionSlamError:
        raise
    except Exception as error:
        raise _error_of_own(kind, f"raised {type(error).__name__}: {error}") from error
    if result.ndim != 1 or not len(result):
        raise _error_of_own(kind, f"returned shape {result.shape}, expected (D,)")
    if not np.isfinite(result).all():
        raise _error_of_own(kind, "returned values that are not finite")
    if len(result) != (length := _OWN_LENGTHS.setdefault(kind.name, len(result))):
        raise _error_of_own(
            kind,
            f"returned {len(result)} values, and {length} of another cloud: expected as many",
        )
    return result


_OWN_LENGTHS: dict[str, int] = {}
"""Lengths of users' descriptors, which their first clouds tell."""


def _error_of_own(kind: Descriptor, problem: str) -> DataError:
    return DataError(f"{kind.name} {problem}", code="own-descriptor", fields=(kind.name,))


def _core_config(kind: Descriptor, config: DescriptorConfig) -> Any:
    assert kind.section is not None
    preset = {"preset": config.preset} if kind.presets else {}
    values = getattr(config, kind.section).model_dump(exclude_none=True)
    return core_class(kind.section)(**preset, **values)


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
    kind = find_descriptor(name)
    plain = kind.extends or kind.name
    preset = split_preset(name)[1] if kind.presets else None
    return plain if preset is None else f"{plain}:{preset}"


def find_descriptor(name: str) -> Descriptor:
    """Look up a kind of descriptor; the name may end with a preset.

    Raises:
        ConfigError: an unknown name or preset; the message lists the known ones. Or a user's own
            that cannot be imported (code "own-descriptor").
    """
    first, preset = split_preset(name)
    if first not in DESCRIPTORS:
        check_name_length(name)
        if (given := find_own(name)) is not None:
            return given
        own = f"{VARIABLE}={name} imports your own; else " if is_own(name) else ""
        unknown = name if own else first
        raise ConfigError(
            f"unknown descriptor {unknown!r}: {own}{explain_choice(first, DESCRIPTORS)}",
            code="unknown-name",
            fields=("descriptors", unknown),
        )
    kind = DESCRIPTORS[first]
    if preset is not None and preset not in kind.presets:
        problem = explain_choice(preset, kind.presets) if kind.presets else "which has no presets"
        raise ConfigError(
            f"preset of {name!r}: {problem}", code="choice", fields=("descriptors", name)
        )
    return kind


def load_descriptor(name: str) -> Descriptor:
    """``find_descriptor``, which imports users' own as well: their names count from now on.

    Processes that this one starts know them, too (``FUSIONSLAM_DESCRIPTORS``).

    Args:
        name: "module:function", of a function (points) -> float32 (D,), or of a ``Descriptor`` that
            has one. Modules in the working folder are found. Any other name is looked up.

    Raises:
        ConfigError: an unknown name, or a module that cannot be imported (code "own-descriptor").
    """
    check_name_length(name)
    if is_own(name):
        let_count(name)
    return find_descriptor(name)


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
    preset = split_preset(name)[1] if find_descriptor(name).presets else None
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


def for_sequence(config: DescriptorConfig, names: Iterable[str], first: Cloud) -> DescriptorConfig:
    """Set what a sequence's first cloud fixes for descriptors, unless it is configured.

    The radius for normals is five times the cloud's resolution, the mean distance to the nearest
    neighbour (Perdomo 2019, 4.1.1). ``bev_spectrum`` has cells by how far the cloud reaches, and
    finds the ground (``fit_bev_spectrum``).

    Raises:
        DataError: too few points, or NaN.
    """
    kinds = [find_descriptor(name) for name in names]
    changes: dict[str, Any] = {}
    if config.normal_radius is None and any("normal_radius" in kind.options for kind in kinds):
        changes["normal_radius"] = 5 * cloud_resolution(first.points)
    for section in {kind.section for kind in kinds if kind.fits_first and kind.section}:
        fitted = getattr(_core, f"fit_{section}")(first.points)
        given: Section = getattr(config, section)
        values = {key: getattr(fitted, key) for key in type(given).model_fields}
        changes[section] = merged(given, values | given.model_dump(exclude_none=True))
    return config.model_copy(update=changes)


def without_fitted(
    config: DescriptorConfig, given: DescriptorConfig | None = None
) -> dict[str, Any]:
    """Return the values of a configuration but for those that ``for_sequence`` set.

    Args:
        config: of which they are returned.
        given: the configuration before; what it has was not fitted. None: it had nothing.
    """
    before = given or DescriptorConfig()
    values = config.model_dump()
    if before.normal_radius is None:
        del values["normal_radius"]
    for name in FITTED_SECTIONS:
        kept = getattr(before, name).model_dump(exclude_none=True)
        values[name] = {key: values[name][key] for key in kept}
    return values


def with_fitted(config: DescriptorConfig, stored: DescriptorConfig) -> DescriptorConfig:
    """Return a configuration with what was fitted to a stored sequence, unless it is configured."""
    changes: dict[str, Any] = {}
    if config.normal_radius is None:
        changes["normal_radius"] = stored.normal_radius
    for name in FITTED_SECTIONS:
        known, given = (
            getattr(each, name).model_dump(exclude_none=True) for each in (stored, config)
        )
        changes[name] = merged(getattr(config, name), known | given)
    return config.model_copy(update=changes)
