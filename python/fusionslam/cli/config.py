# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command config: every value of the configuration."""

from collections.abc import Collection
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import print_table

if TYPE_CHECKING:
    from fusionslam.config import Section


def config(
    stage: Annotated[
        str | None,
        typer.Argument(
            metavar="[STAGE]",
            autocompletion=opt.completed_from(lambda: type(opt.read_config()).model_fields),
            help="Print only this stage.",
        ),
    ] = None,
    yaml: Annotated[bool, typer.Option("--yaml", help="Print YAML that --config reads.")] = False,
    settings: opt.Settings = None,
    file: opt.ConfigFile = None,
) -> None:
    """Print every value of the configuration with its unit, range and help."""
    from fusionslam.config import as_yaml

    whole = opt.read_config(settings, file)
    opt.check_choice("stage", stage, tuple(type(whole).model_fields))
    stages = [stage] if stage else list(type(whole).model_fields)
    if yaml:
        print(as_yaml(whole, stages), end="")
        return
    print_table(["key", "value", "unit", "range", "help"], list_values(whole, stages))


def list_values(whole: "Section", stages: Collection[str]) -> list[list[str]]:
    """Return key, value, unit, range and help of every value of the given stages."""
    from fusionslam.config import range_of, unit_of, walk

    return [
        [
            key,
            _value(value),
            unit_of(definition),
            range_of(definition),
            definition.description or "",
        ]
        for key, value, definition in walk(whole)
        if key.partition(".")[0] in stages
    ]


def _value(value: Any) -> str:
    if value is None:
        return "none"
    return str(value).lower() if isinstance(value, bool) else str(value)
