# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Descriptors by name, all with the same configuration.

A name may end with a preset, "cm2dp:author", which then replaces that of the configuration.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from fusionslam._core import (
    BevSpectrumConfig,
    M2dpConfig,
    ScanContextConfig,
    bev_spectrum,
    cloud_resolution,
    cm2dp,
    cscan_context,
    cshot,
    m2dp,
    scan_context,
    shot,
)
from fusionslam.config import Section, core_section, explain_choice, merged, option, split_preset
from fusionslam.errors import ConfigError, DataError
from fusionslam.fusion import FusionConfig, require_up
from fusionslam.help_texts import PER_FRAME
from fusionslam.sensors.frame import Cloud, Frame, require_cloud

if TYPE_CHECKING:

    class M2dpSection(Section): ...

    class ScanContextSection(Section): ...

    class BevSpectrumSection(Section): ...

else:
    M2dpSection = core_section("M2dpSection", M2dpConfig, __name__, optional=True)
    ScanContextSection = core_section(
        "ScanContextSection", ScanContextConfig, __name__, optional=True
    )
    BevSpectrumSection = core_section(
        "BevSpectrumSection", BevSpectrumConfig, __name__, optional=True
    )
logger = logging.getLogger(__name__)

Metric = Literal["l2", "scan_context"]

_ROBOTS = {"scan_context": {"height": 0.0}, "bev_spectrum": {"height": 0.0, "cell": 0.4}}
"""Options in the robot's frame, which is taken to lie on the ground: of a small robot's scanner,
nothing may be higher than the ground of wide cells."""
Preset = Literal["robust", "upright", "paper", "author"]
PRESETS: tuple[str, ...] = get_args(Preset)


class DescriptorConfig(Section):
    """Configuration of descriptors."""

    preset: Preset = option(
        "robust",
        "M2DP and c-M2DP: robust (ours), upright (ours, for clouds whose z points up), paper (He "
        "2016) or author (Perdomo 2019)",
    )
    color_space: Literal["rgb", "hsv", "lab"] = option("rgb", "c-M2DP: which colours are counted")
    m2dp: M2dpSection = option(M2dpSection(), "single values instead of the preset's")
    scan_context: ScanContextSection = option(
        ScanContextSection(),
        "single values instead of the defaults: 20 rings, max_range 80 m, height 2 m in the scan's "
        "frame (a car's), 0 m in the robot's",
    )
    bev_spectrum: BevSpectrumSection = option(
        BevSpectrumSection(),
        "single values instead of the defaults: cell 2 m, height 2 m in the scan's frame (a "
        "car's), 0.4 m and 0 m in the robot's",
    )
    normal_radius: float | None = option(
        None,
        "SHOT and CSHOT: radius for normals; none is 5 x the resolution of the first cloud",
        unit="m",
        gt=0,
    )
    threads: int = option(1, "threads of one call; 0 is one a core", ge=0, le=1024)


@dataclass(frozen=True)
class Descriptor:
    """A kind of descriptor.

    Attributes:
        name: of the registry.
        compute: the function that computes it.
        options: keys of ``DescriptorConfig`` that change it.
        needs_colors: of the points.
        needs_normals: whose radius the first cloud of a sequence may fix.
        needs_up: clouds whose z axis points up and whose origin is the scanner or the robot; of
            those with presets see ``needs_up``.
        metric: how two are compared, as ``DescriptorIndex`` takes it.
        presets: those it has, the default first.
    """

    name: str
    compute: Callable[[Cloud, DescriptorConfig], NDArray[np.float32]]
    options: tuple[str, ...]
    needs_colors: bool = False
    needs_normals: bool = False
    needs_up: bool = False
    metric: Metric = "l2"
    presets: tuple[str, ...] = ()


def describe(
    cloud: Cloud, name: str, config: DescriptorConfig | None = None
) -> NDArray[np.float32]:
    """Compute the named descriptor of a cloud, float32 (D,).

    Raises:
        ConfigError: unknown name or preset.
        ShapeError: not a cloud.
        DataError: colours are needed and missing, or the cloud cannot be described (empty, NaN,
            all points equal, ...).
    """
    kind = find_descriptor(name)
    require_cloud(cloud)
    if kind.needs_colors and cloud.colors is None:
        raise no_colors(name)
    settings = for_preset(config or DescriptorConfig(), name)
    if needs_up(name, settings):
        _warn_unless_upright(cloud, name)
    return kind.compute(cloud, settings)


def _warn_unless_upright(cloud: Cloud, name: str) -> None:
    """Warn of a cloud that is taller than wide: its z axis hardly points up."""
    if len(cloud) < 2:
        return
    x, y, z = cloud.points.std(axis=0, dtype=np.float64)
    if z > np.hypot(x, y):
        text = (
            f"{name} needs clouds whose z axis points up, and the spread along z is larger than "
            "across it"
        )
        logger.warning(text, extra={PER_FRAME: text})


def no_colors(name: str) -> DataError:
    """Return the error of a cloud without colours, which a descriptor needs."""
    return DataError(
        f"{name} needs colours and the cloud has none; {without_colors(name)} needs none",
        code="no-colors",
        fields=(name, without_colors(name)),
    )


def without_colors(name: str) -> str:
    """Return the descriptor that a coloured one extends, with the same preset; others as given."""
    first, preset = split_preset(name)
    plain = _EXTENDED.get(first, first)
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
        return kind.needs_up
    return _m2dp_settings(for_preset(config, name)).axes == "upright"


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
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (64, 3)).astype(np.float32)
    cloud = Cloud(points, np.full((64, 3), 128, np.uint8))
    # The length does not depend on these, which may leave none of this cloud.
    others = {"normal_radius": None, "bev_spectrum": BevSpectrumSection()}
    return len(describe(cloud, name, config.model_copy(update=others)))


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
    if not needs_up(name, config):
        return config
    require_up(fusion, frame)
    if fusion.frame == "scan":
        return config
    options = [key for key in find_descriptor(name).options if key in _ROBOTS]
    given = {key: getattr(config, key).model_dump(exclude_none=True) for key in options}
    return merged(config, {key: _ROBOTS[key] | values for key, values in given.items()})


def for_sequence(config: DescriptorConfig, first: Cloud) -> DescriptorConfig:
    """Set the radius for normals from a sequence's first cloud, unless it is configured.

    Five times its resolution, the mean distance to the nearest neighbour (Perdomo 2019, 4.1.1).
    """
    if config.normal_radius is not None:
        return config
    radius = 5 * cloud_resolution(first.points)
    return config.model_copy(update={"normal_radius": radius})


def _m2dp_settings(config: DescriptorConfig) -> M2dpConfig:
    return M2dpConfig(preset=config.preset, **config.m2dp.model_dump(exclude_none=True))


def _m2dp_options(config: DescriptorConfig) -> dict[str, Any]:
    return {"config": _m2dp_settings(config), "threads": config.threads}


def _normal_options(config: DescriptorConfig) -> dict[str, Any]:
    return {"normal_radius": config.normal_radius, "threads": config.threads}


def _m2dp(cloud: Cloud, config: DescriptorConfig) -> NDArray[np.float32]:
    return m2dp(cloud.points, **_m2dp_options(config))


def _scan_context_options(config: DescriptorConfig) -> dict[str, Any]:
    return {"config": ScanContextConfig(**config.scan_context.model_dump(exclude_none=True))}


def _scan_context(cloud: Cloud, config: DescriptorConfig) -> NDArray[np.float32]:
    return scan_context(cloud.points, **_scan_context_options(config))


def _cscan_context(cloud: Cloud, config: DescriptorConfig) -> NDArray[np.float32]:
    assert cloud.colors is not None  # checked by describe()
    return cscan_context(cloud.points, cloud.colors, **_scan_context_options(config))


def _bev_spectrum(cloud: Cloud, config: DescriptorConfig) -> NDArray[np.float32]:
    settings = BevSpectrumConfig(**config.bev_spectrum.model_dump(exclude_none=True))
    return bev_spectrum(cloud.points, config=settings)


def _cm2dp(cloud: Cloud, config: DescriptorConfig) -> NDArray[np.float32]:
    assert cloud.colors is not None  # checked by describe()
    options = _m2dp_options(config)
    return cm2dp(cloud.points, cloud.colors, color_space=config.color_space, **options)


def _shot(cloud: Cloud, config: DescriptorConfig) -> NDArray[np.float32]:
    return shot(cloud.points, **_normal_options(config))


def _cshot(cloud: Cloud, config: DescriptorConfig) -> NDArray[np.float32]:
    assert cloud.colors is not None  # checked by describe()
    return cshot(cloud.points, cloud.colors, **_normal_options(config))


DESCRIPTORS = {
    kind.name: kind
    for kind in (
        Descriptor("m2dp", _m2dp, ("preset", "m2dp"), presets=PRESETS),
        Descriptor(
            "cm2dp",
            _cm2dp,
            ("preset", "m2dp", "color_space"),
            needs_colors=True,
            presets=PRESETS,
        ),
        Descriptor("shot", _shot, ("normal_radius",), needs_normals=True),
        Descriptor("cshot", _cshot, ("normal_radius",), needs_colors=True, needs_normals=True),
        Descriptor(
            "scan_context",
            _scan_context,
            ("scan_context",),
            needs_up=True,
            metric="scan_context",
        ),
        Descriptor(
            "cscan_context",
            _cscan_context,
            ("scan_context",),
            needs_colors=True,
            needs_up=True,
            metric="scan_context",
        ),
        Descriptor(
            "bev_spectrum",
            _bev_spectrum,
            ("bev_spectrum",),
            needs_up=True,
            metric="scan_context",
        ),
    )
}
_EXTENDED = {"cm2dp": "m2dp", "cshot": "shot", "cscan_context": "scan_context"}
# The descriptor without colours that one with colours extends.
