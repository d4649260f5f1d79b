# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Table of the configurations of RatSLAM runs."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fusionslam.config import walk
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.ratslam.slam import RatSlamConfig
from fusionslam.report.page.tables import DASH


@dataclass(frozen=True)
class ConfigTable:
    """Values of configurations; each row has a dotted name, a value per head, and a meaning."""

    heads: list[str]
    rows: list[tuple[str, list[str], str]]


def config_table(labels: Sequence[str], runs: Sequence[RatSlamRun]) -> ConfigTable | None:
    """Build one column for each distinct configuration; None if none is known."""
    groups: dict[tuple[tuple[str, str], ...], list[str]] = {}
    for label, run in zip(labels, runs, strict=True):
        groups.setdefault(tuple(_flatten(run.config)), []).append(label)
    columns = [dict(values) for values in groups]
    names = list(dict.fromkeys(name for values in columns for name in values))
    if not names:
        return None
    meanings = _collect_meanings()
    return ConfigTable(
        ["value"] if len(groups) == 1 else ["; ".join(group) for group in groups.values()],
        [
            (name, [values.get(name, DASH) for values in columns], meanings.get(name, ""))
            for name in names
        ],
    )


def _flatten(config: Mapping[str, Any], where: str = "") -> Iterator[tuple[str, str]]:
    """Dotted names and values as text."""
    for name, value in config.items():
        if isinstance(value, Mapping):
            yield from _flatten(value, f"{where}{name}.")
        else:
            yield f"{where}{name}", "null" if value is None else str(value)


def _collect_meanings() -> dict[str, str]:
    """Return the meaning of each value with its unit, by dotted name."""
    meanings = {}
    for name, _, definition in walk(RatSlamConfig()):
        extra = definition.json_schema_extra
        unit = extra.get("unit") if isinstance(extra, dict) else ""
        meanings[name] = f"{definition.description}{f' ({unit})' if unit else ''}"
    return meanings
