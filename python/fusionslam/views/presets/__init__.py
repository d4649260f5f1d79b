# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Presets found by ``fusionslam tune``, as YAML for ``--config`` and ``--tuned``.

Each file names the command, data and seed that it was made with.
"""

from pathlib import Path
from typing import TYPE_CHECKING

from fusionslam.errors import ConfigError

if TYPE_CHECKING:
    from fusionslam.views.recognisers import ViewMatcherConfig

FOLDER = Path(__file__).parent


def preset_names() -> list[str]:
    """Names of the presets that come with fusionslam."""
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


def preset_path(name: str) -> Path:
    """The file of a preset. Raises ConfigError, which lists the presets, if it is unknown."""
    if name not in preset_names():
        known = ", ".join(preset_names()) or "none"
        raise ConfigError(f"unknown tuned values {name!r}; known: {known}")
    return FOLDER / f"{name}.yaml"


def load_preset(name: str) -> "ViewMatcherConfig":
    """The matcher configuration with the values of a preset. Raises ConfigError if unknown."""
    import yaml

    from fusionslam.config import merged
    from fusionslam.views.recognisers import ViewMatcherConfig

    values = yaml.safe_load(preset_path(name).read_text(encoding="utf-8"))
    return merged(ViewMatcherConfig(), values["views"], "views.")
