# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The page around every report: templates, file names, and what it says about its origin."""

import re
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from fusionslam.errors import FusionSlamError
from fusionslam.storage.machine import machine, versions

if TYPE_CHECKING:
    from jinja2 import Environment


def file_name(*parts: str) -> str:
    """A file's name made of names that people gave."""
    return "_".join(re.sub(r"[^\w.-]+", "-", part).strip("-") or "x" for part in parts)


def check_extra() -> None:
    """Raise FusionSlamError if what reports need is not installed."""
    for module in ("jinja2", "matplotlib"):
        if find_spec(module) is None:
            raise FusionSlamError("the report needs: pip install 'fusionslam[report]'")


def about_report(dataset: str, command: str, config: Mapping[str, Any]) -> dict[str, Any]:
    """What every report says of itself: data, command, date, versions, machine."""
    return {
        "dataset": dataset,
        "command": command,
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "versions": versions(),
        "machine": machine(),
        "config": dict(config),
    }


def environment() -> "Environment":
    """The templates of reports; an unknown name in one is an error."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    return Environment(
        loader=PackageLoader("fusionslam", "report/page/templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
