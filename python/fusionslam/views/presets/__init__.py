# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Values that ``fusionslam tune`` found, as YAML that ``--config`` and ``--tuned`` read.

Each file says with what command, on what data and with what seed it was made.
"""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fusionslam._files import atomic_path
from fusionslam.errors import ConfigError

if TYPE_CHECKING:
    from fusionslam.views.matcher import ViewMatcherConfig
    from fusionslam.views.scene_sets import SceneSet
    from fusionslam.views.tuning import TuningConfig, TuningResult

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
    from fusionslam.views.matcher import ViewMatcherConfig

    values = yaml.safe_load(tuned_path(name).read_text(encoding="utf-8"))
    return merged(ViewMatcherConfig(), values["views"], "views.")


def write_tuned(
    path: str | os.PathLike[str],
    result: "TuningResult",
    config: "TuningConfig",
    sets: "Sequence[SceneSet]",
    command: str,
) -> None:
    """Write what was found as YAML, with all values of scenes and similarity.

    A comment says how it was made and how well it does.

    Raises:
        DataError: the file cannot be written.
    """
    import yaml

    settings = ", ".join(f"{key} {value}" for key, value in config.model_dump().items())
    lines = [f"# {command}", f"# {settings}", f"# value {result.value:.6f}"]
    for scenes, report in zip(sets, result.reports, strict=True):
        made = scenes.source.get("command")
        lines += [f"# {scenes.name}: {made}"] if made else []
        lines += [f"# {scenes.name}: {line.strip()}" for line in str(report).splitlines()]
    text = yaml.safe_dump({"views": _values(result.config)}, sort_keys=False)
    with atomic_path(path) as temporary:
        temporary.write_text("\n".join([*lines, text]), encoding="utf-8")


def _values(config: "ViewMatcherConfig") -> dict[str, Any]:
    """Everything that decides the ids: a later preset with other values does not change them."""
    from fusionslam.views.matcher import scene_config, similarity_config

    values = config.model_dump(mode="json", exclude_unset=True)
    for name, core in (("scene", scene_config(config)), ("similarity", similarity_config(config))):
        options = type(core).options()
        values[name] = {entry["name"]: getattr(core, entry["name"]) for entry in options}
    return {"preset": config.preset, "threshold": config.threshold, **values}
