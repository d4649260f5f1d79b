# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Handle failed and interrupted commands: one line, and a meaningful exit code."""

import os
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperGroup

from fusionslam.errors import ConfigError, FusionSlamError

DATA, USAGE, INTERRUPTED = 1, 2, 130
# Its module is private and differs between versions of typer.
UsageError: type[Exception] = typer.BadParameter.__bases__[0]
_KEPT = "fusionslam.kept"
COMMAND = "fusionslam.command"
"""Where the program's context holds that of the command that runs."""
RESUMES = "finished work is kept in {}; the same command resumes there"
STARTS_REST = "finished work is kept in {}; the same command starts the rest again"
WRITES_ALL = "{} may hold new and old files; the same command writes all of them"
PARTIAL = "{} is not complete"
_STAMPS = {"--stamps": "--stamps bag takes the times of arrival"}
_THRESHOLD = {"--threshold": "--threshold takes a number, too, and has a default"}
_CURES = {
    "no-calibration": {"--calib": "--calib FILE gives a calibration"},
    "no-camera-info": {
        "--calib": "--calib FILE gives a calibration",
        "--topic": "--topic camera_info=/NAME names a topic of it",
    },
    "no-camera-pose": {
        "--calib": "--calib FILE gives the camera's pose",
        "--source": "--source cloud takes the scans alone",
    },
    "no-transform": {"--calib": "--calib FILE gives transforms"},
    "equal-stamps": _STAMPS,
    "clock": _STAMPS,
    "no-revisits": _THRESHOLD,
    "no-threshold": _THRESHOLD,
    "port-in-use": {
        "--live": "--live ws://127.0.0.1:8766 takes another",
        "--port": "--port takes another",
    },
    "no-keys": {
        "--api-keys": "--api-keys FILE names them",
        "--without-keys": "--without-keys does without",
    },
}
"""What cures an error, by its code and option; only commands that have the option name it."""
_CAUSES = {
    "missing-sensor": ("source", "without --source the first that the data allow is taken"),
}
"""Options that cause an error, by its code: named only where they are given."""


class Guarded(TyperGroup):
    """Group of commands that print known errors in one line; others keep their traceback."""

    def make_context(self, *args: Any, **more: Any) -> Any:
        """Parse the options before the command."""
        try:
            return super().make_context(*args, **more)
        except UsageError as error:
            raise _report_usage(error) from error

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Allow command names of two words: "bench views" beside "bench"."""
        _refuse_empty(args)
        two = " ".join(args[:2])
        if two in self.commands:
            return two, self.commands[two], args[2:]
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        try:
            result = super().invoke(ctx)
            sys.stdout.flush()
            return result
        except BrokenPipeError as error:
            # The reader, such as head, has enough; the files are written before the tables.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            raise typer.Exit(0) from error
        except UsageError as error:
            raise _report_usage(error) from error
        except FusionSlamError as error:
            cure = _cure_of(error, ctx.meta.get(COMMAND))
            print(f"error: {_one_line(str(error))}{cure}", file=sys.stderr)
            raise typer.Exit(USAGE if isinstance(error, ConfigError) else DATA) from error
        except ImportError as error:
            from fusionslam.doctor import core_error

            if core_error() is None:
                raise
            print(
                f"error: the compiled core cannot be loaded ({_one_line(str(error))}); "
                "fusionslam doctor says what to install",
                file=sys.stderr,
            )
            raise typer.Exit(DATA) from error
        except KeyboardInterrupt as error:
            print(ctx.meta.get(_KEPT, "interrupted: nothing was written"), file=sys.stderr)
            raise typer.Exit(INTERRUPTED) from error


def keep(ctx: typer.Context, path: Path, text: str = RESUMES) -> None:
    """Remember where finished work is kept, to say so if the command is interrupted.

    Args:
        ctx: of the command.
        path: what it writes.
        text: what the same command does then, with the path; for a recording, whose writer says
            where it keeps the part written, that it is not complete.
    """
    ctx.meta[_KEPT] = f"interrupted: {text.format(path)}"


def needs_extra(extra: str, *, module: str | None = None, unless: str = "") -> None:
    """Find out at the start, not after an hour, that an optional package is missing.

    Args:
        extra: name of the extra.
        module: the one module that is needed of it; None for all.
        unless: the option with which the command can do without it.

    Raises:
        FusionSlamError: with the line that installs it.
    """
    from fusionslam.doctor import EXTRAS

    for needed in [module] if module else EXTRAS[extra].modules.values():
        if find_spec(needed) is None:
            other = f"; {unless} does without it" if unless else ""
            raise FusionSlamError(
                f"this needs {needed}, which is not installed: "
                f"pip install 'fusionslam[{extra}]'{other}",
                code="missing-extra",
                fields=(extra,),
            )


def missing_extras() -> list[str]:
    """Return the extras that are not completely installed."""
    from fusionslam.doctor import EXTRAS

    return [
        extra
        for extra, each in EXTRAS.items()
        if any(find_spec(module) is None for module in each.modules.values())
    ]


def _refuse_empty(args: list[str]) -> None:
    """Raise UsageError for an empty argument, such as an unset variable of the shell.

    Empty paths would be the working folder.
    """
    for before, argument in zip(["DATA", *args], args, strict=False):
        name = argument.removesuffix("=")
        is_option = argument.startswith("--") and argument.endswith("=") and "=" not in name
        if not argument or is_option:
            option = name if is_option else before
            hint = option if option.startswith("-") else "an argument"
            raise typer.BadParameter("it is empty, expected a value", param_hint=hint)


def _report_usage(error: Any) -> Exception:
    """Return the exception to raise for a wrong option, after naming it."""
    if type(error).__name__ == "NoArgsIsHelpError":
        return error  # type: ignore[no-any-return]
    command = error.ctx.command_path if error.ctx else "fusionslam"
    problem = _one_line(error.format_message()).rstrip(".")
    if settings := _settings_of(error):
        problem = f"No such option: {error.option_name}; {' or '.join(settings)} sets it"
    see = " See" if problem.endswith("?") else "; see"
    print(f"error: {problem}{see} {command} --help", file=sys.stderr)
    return typer.Exit(USAGE)


def _settings_of(error: Any) -> list[str]:
    """Return the settings of the keys that end with the name of an unknown option."""
    if type(error).__name__ != "NoSuchOption" or error.ctx is None:
        return []
    if not any("--set" in each.opts for each in error.ctx.command.params):
        return []
    from fusionslam.cli.system_config import SystemConfig
    from fusionslam.config import walk

    name = error.option_name.lstrip("-").replace("-", "_")
    keys = [key for key, _, _ in walk(SystemConfig()) if key.rpartition(".")[2] == name]
    if any("--map" in each.opts for each in error.ctx.command.params):
        keys = [key for key in keys if not key.startswith("fusion.")]  # the map has its own
    return [f"--set {key}=VALUE" for key in keys]


def _cure_of(error: FusionSlamError, command: Any) -> str:
    """Name the option that cures an error, as the end of its line.

    Args:
        error: of the command.
        command: its context; None if the error came before.
    """
    if command is None:
        return ""
    name, cause = _CAUSES.get(error.code, ("", ""))
    if name and command.params.get(name) is not None:
        return f"; {cause}"
    from fusionslam.pipelines.recording import FrameError

    known = {name for each in command.command.params for name in each.opts}
    lacks = "--descriptors" if "--descriptors" in known else "--descriptor"
    instead = f"{lacks} {error.fields[-1]} takes clouds without" if error.fields else ""
    if isinstance(error, FrameError):
        skip = "; --skip-bad-frames leaves such frames out" if "--skip-bad-frames" in known else ""
        if error.code == "no-colors":
            # The cloud is whole: info has nothing to list.
            return f"{skip}; {instead}" if instead and lacks in known else skip
        return f"{skip}{',' if skip else ';'} info --all lists them"
    if error.code == "no-colors" and instead and lacks in known:
        return f"; {instead}"
    cures = [cure for option, cure in _CURES.get(error.code, {}).items() if option in known]
    return f"; {', '.join(cures)}" if cures else ""


def _one_line(text: str) -> str:
    first, *others = text.strip().splitlines() or [""]
    rest = "; ".join(line.strip() for line in others)
    return f"{first}: {rest}" if rest else first
