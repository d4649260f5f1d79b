# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Configuration of the reproduction: worlds, place recognition methods, data."""

from fusionslam.config import Section, option
from fusionslam.errors import ConfigError
from fusionslam.evaluation.views.published import WORLDS
from fusionslam.pipelines.methods import find_method, method_names

PARTS = ("views", "maps", "descriptors")
"""Views and maps are chapter 5 of Stastny 2022, descriptors chapter 4 of Perdomo 2019."""
VIEWS = ("objects:author", "two_stages:author", "visual_templates", "alignment")
"""The thesis's two approaches, its rival (the original RatSLAM's templates), and our method."""
OURS = "alignment"
"""Our method among these."""
WITHOUT_SENSOR = "every_3rd"
"""A method without a sensor, shown for comparison because accuracy alone says little."""
QUICK_EACH = 4
"""A quick run uses one scan in this many."""
QUICK_M = 100.0
"""Distance of a quick run through a simulated world, metres."""
KITTI_SEQUENCES = ("06", "05", "00", "07")
"""The sequences of tables 4.4 and 4.5, in their order."""


class ReproduceConfig(Section):
    """Settings of ``reproduce``. The same values and folder resume an earlier run."""

    worlds: tuple[str, ...] = option(WORLDS, "worlds of chapter 5 of Stastny 2022")
    views: tuple[str, ...] = option(VIEWS, "ways to recognise views, as fusionslam bench views")
    parts: tuple[str, ...] = option(PARTS, "what is reproduced")
    data: str | None = option(
        None,
        "folder with recordings/<world>.npz and with descriptors/, reference/, kitti/ of their "
        "authors, any of them; null, and what is not there: worlds that are made, nothing stored",
    )
    kitti: str | None = option(
        None, "folder of KITTI odometry for the descriptors; null: the simulated town"
    )
    quick: bool = option(
        False, f"one scan of {QUICK_EACH}, short drives through made worlds, no stereo, no CSHOT"
    )


def check_config(config: ReproduceConfig) -> ReproduceConfig:
    """Return the configuration if all its names are known.

    Raises:
        ConfigError: an unknown name, or no name at all.
    """
    known = {"worlds": WORLDS, "views": None, "parts": PARTS}
    for key, names in known.items():
        given = getattr(config, key)
        if not given:
            raise ConfigError(
                f"{key}: expected some of {', '.join(names or method_names())}",
                code="empty",
                fields=(key,),
            )
        for name in given:
            if names is None:
                find_method(name, key)
            elif name not in names:
                raise ConfigError(f"{key} is {name!r}, expected some of {', '.join(names)}")
    return config
