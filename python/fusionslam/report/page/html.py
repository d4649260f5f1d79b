# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The HTML frame of every report: templates, file names, and the origin of the data."""

import hashlib
import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence, Sized
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar

from fusionslam.base.archive import save_json
from fusionslam.base.files import write_file
from fusionslam.base.machine import machine, versions
from fusionslam.base.texts import counted
from fusionslam.errors import DataError, FusionSlamError

T = TypeVar("T")
K = TypeVar("K")

_LONGEST_PART = 58
"""In bytes: names of four parts, a suffix and those of temporary files have at most 255."""


def file_name(*parts: str) -> str:
    """Make a file name from names given by users; only very long parts are cut."""
    return "_".join(
        _fit(re.sub(r"[^\w.-]+", "-", part).strip("-") or "x", _LONGEST_PART) for part in parts
    )


def _fit(part: str, most: int) -> str:
    """Cut a part of more bytes than this; a digest tells equal beginnings apart."""
    data = part.encode()
    if len(data) <= most:
        return part
    digest = hashlib.sha256(data).hexdigest()[:8]
    return data[: most - 9].decode(errors="ignore") + "-" + digest


def picture_name(*parts: str) -> str:
    """As ``file_name``, but short: long parts are cut, and a digest tells them apart."""
    return "_".join(_shorten(file_name(part)) for part in parts)


def _shorten(name: str, most: int = 20) -> str:
    if len(name) <= most:
        return name
    digest = hashlib.sha256(name.encode()).hexdigest()[:4]
    return f"{name[: most - 5].rstrip('-._')}-{digest}"


def check_extra() -> None:
    """Raise FusionSlamError if a package that reports need is not installed."""
    for module in ("jinja2", "matplotlib"):
        if find_spec(module) is None:
            problem = "the report needs: pip install 'fusionslam[report]'"
            raise FusionSlamError(problem, code="missing-extra", fields=("report",))


def about_report(dataset: str, command: str, config: Mapping[str, Any]) -> dict[str, Any]:
    """Collect the origin of a report: data, command, date, versions, machine."""
    return {
        "dataset": dataset,
        "command": command,
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "versions": versions(),
        "machine": machine(),
        "config": dict(config),
    }


def write_page(path: Path, template: str, about: Mapping[str, Any], **parts: Any) -> Path:
    """Write an HTML page that opens offline, whole or not at all.

    Args:
        path: file of the page.
        template: name of a template in this package, or the text of one that extends them.
        about: from ``about_report``.
        parts: contents of the template's blocks; all templates have ``title`` and ``notes``.

    Raises:
        DataError: the folder cannot be written.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    pages = Environment(
        loader=PackageLoader("fusionslam", "report/page/templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    pages.globals["counted"] = counted
    is_name = template.endswith(".j2")
    page = pages.get_template(template) if is_name else pages.from_string(template)
    common = {"about": about, "notes": (), "config": json.dumps(about["config"], indent=2)}
    write_file(path, page.render(common | parts))
    return path


def write_figures(path: Path, about: Mapping[str, Any], runs: Sequence[Mapping[str, Any]]) -> None:
    """Write the JSON beside a page: its origin and, under "runs", its figures. Raises DataError."""
    save_json(path, None, {**about, "runs": list(runs)}, indent=2)


def check_runs(runs: Sequence[Sized], labels: Sequence[str], files: Sequence[str]) -> None:
    """Raise DataError if there are no runs, one is empty, or two share a file name.

    Args:
        runs, labels, files: each run of the page, its label for messages, and its file's name.
    """
    if not runs:
        raise DataError("report: there are no runs to write about", code="no-runs")
    for run, label, file in zip(runs, labels, files, strict=True):
        if not len(run):
            raise DataError(f"report: the run {label} is empty", code="empty-run", fields=(label,))
        if files.count(file) > 1:
            problem = f"report: two runs are called {label}"
            raise DataError(problem, code="same-name", fields=(label,))


def group_by(items: Iterable[T], key: Callable[[T], K]) -> dict[K, list[T]]:
    """Group the items by key, keys in the order of their first item."""
    groups: dict[K, list[T]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return groups
