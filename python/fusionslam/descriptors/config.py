# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Configuration of all descriptors: common values, and a section for each that has its own."""

from typing import TYPE_CHECKING, Any, Literal

from pydantic import create_model

from fusionslam import _core
from fusionslam.config import Section, core_section, option
from fusionslam.descriptors.registry import SECTIONS

Preset = Literal["robust", "upright", "paper", "author"]


class CommonConfig(Section):
    """What several descriptors share."""

    preset: Preset = option(
        "robust",
        "M2DP and c-M2DP: robust (ours), upright (ours, for clouds whose z points up), paper (He "
        "2016) or author (Perdomo 2019)",
    )
    color_space: Literal["rgb", "hsv", "lab"] = option("rgb", "c-M2DP: which colours are counted")
    normal_radius: float | None = option(
        None,
        "SHOT and CSHOT: radius for normals; none is 5 x the resolution of the first cloud",
        unit="m",
        gt=0,
    )
    threads: int = option(1, "threads of one call; 0 is one a core", ge=0, le=1024)


def core_class(section: str) -> type[Any]:
    """Class of the core that defines a section: ``ScanContextConfig`` of "scan_context"."""
    name = "".join(part.capitalize() for part in section.split("_"))
    kind: type[Any] = getattr(_core, f"{name}Config")
    return kind


def _section_field(key: str) -> tuple[type[Section], Any]:
    core = core_class(key)
    name = core.__name__.removesuffix("Config") + "Section"
    # In this module, where pickle looks for it.
    kind: type[Section] = core_section(name, core, __name__, optional=True)
    globals()[name] = kind
    entries = {entry["name"]: entry for entry in core.options()}
    defaults = ", ".join(
        f"{name} {entry['default']:g}{' ' * bool(entry['unit'])}{entry['unit']}"
        for name, entry in entries.items()
        if entry["kind"] in ("int", "float")
    )
    kept = "the preset's" if key == "m2dp" else f"the defaults: {defaults}"
    return kind, option(kind(), f"single values instead of {kept}")


if TYPE_CHECKING:

    class DescriptorConfig(CommonConfig):
        def __getattr__(self, key: str) -> Section: ...

else:
    DescriptorConfig = create_model(
        "DescriptorConfig",
        __base__=CommonConfig,
        __module__=__name__,
        __doc__="Configuration of descriptors.",
        **{key: _section_field(key) for key in SECTIONS},
    )
