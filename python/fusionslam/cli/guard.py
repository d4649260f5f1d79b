# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What happens when a command fails or is interrupted: one line, and a telling exit code."""

import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperGroup

from fusionslam.errors import ConfigError, FusionSlamError

DATA, USAGE, INTERRUPTED = 1, 2, 130
_KEPT = "fusionslam.kept"
_EXTRAS = {"sim": ("embreex",), "report": ("jinja2", "matplotlib")}


class Guarded(TyperGroup):
    """Commands whose known errors are one line; others keep their traceback."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        try:
            return super().invoke(ctx)
        except FusionSlamError as error:
            print(f"error: {_one_line(error)}", file=sys.stderr)
            raise typer.Exit(USAGE if isinstance(error, ConfigError) else DATA) from error
        except KeyboardInterrupt as error:
            print(_interrupted(ctx.meta.get(_KEPT)), file=sys.stderr)
            raise typer.Exit(INTERRUPTED) from error


def keep(ctx: typer.Context, folder: Path) -> None:
    """Remember where finished work lies, to say so when the command is interrupted."""
    ctx.meta[_KEPT] = folder


def needs_extra(extra: str) -> None:
    """Find out at the start, not after an hour, that an optional package is missing.

    Raises:
        FusionSlamError: with the line that installs it.
    """
    for module in _EXTRAS[extra]:
        if find_spec(module) is None:
            raise FusionSlamError(
                f"this needs {module}, which is not installed: pip install 'fusionslam[{extra}]'"
            )


def missing_extras() -> list[str]:
    """The extras of which something is not installed."""
    return [
        extra
        for extra, modules in _EXTRAS.items()
        if any(find_spec(module) is None for module in modules)
    ]


def _interrupted(kept: Path | None) -> str:
    if kept is None:
        return "interrupted: nothing was written"
    return f"interrupted: what is finished is kept in {kept}; the same command goes on from there"


def _one_line(error: Exception) -> str:
    first, *others = str(error).splitlines() or [""]
    rest = "; ".join(line.strip() for line in others)
    return f"{first}: {rest}" if rest else first
