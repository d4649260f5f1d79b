# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Values that ``fusionslam tune`` found, as YAML that ``--config`` and ``--tuned`` read.

Each file says with what command, on what data and with what seed it was made.
"""

from pathlib import Path
from typing import TYPE_CHECKING

from fusionslam.errors import ConfigError

if TYPE_CHECKING:
    from fusionslam.views.recognisers import ViewMatcherConfig

FOLDER = Path(__file__).parent


def tuned_names() -> list[str]:
    """The names of the files that come with fusionslam."""
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


def tuned_path(name: str) -> Path:
    """The file of that name. Raises ConfigError naming those there are."""
    if name not in tuned_names():
        known = ", ".join(tuned_names()) or "none"
        raise ConfigError(f"unknown tuned values {name!r}; known: {known}")
    return FOLDER / f"{name}.yaml"


def tuned_config(name: str) -> "ViewMatcherConfig":
    """The matcher's configuration with the values of that name. Raises ConfigError."""
    import yaml

    from fusionslam.config import merged
    from fusionslam.views.recognisers import ViewMatcherConfig

    values = yaml.safe_load(tuned_path(name).read_text(encoding="utf-8"))
    return merged(ViewMatcherConfig(), values["views"], "views.")
