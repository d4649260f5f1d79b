# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Write the generated parts of the documentation: commands, configuration, public names.

MkDocs calls ``on_page_markdown`` for every page; a comment such as ``<!-- commands -->`` stands
where a generated part goes.
"""

import importlib
import re
from collections.abc import Callable, Iterator
from typing import Any

import typer

_MARK = re.compile(
    r"^<!-- (commands|options|configuration|names)(?: of ([\w.]+))? -->$", re.MULTILINE
)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Replace each mark of a page by what it stands for."""
    parts: dict[str, Callable[[str], Iterator[str]]] = {
        "commands": lambda _: describe_commands(),
        "options": lambda _: list_shared_options(),
        "configuration": lambda _: describe_configuration(),
        "names": list_public_names,
    }
    return _MARK.sub(lambda mark: "\n".join(parts[mark[1]](mark[2])), markdown)


def describe_commands() -> Iterator[str]:
    """Yield the lines of one section for each command, with a table of its options."""
    from fusionslam.cli import app

    for name, command in _walk_commands(typer.main.get_command(app), ""):
        arguments = [p for p in command.params if p.param_type_name == "argument"]
        options = [p for p in command.params if p.param_type_name == "option"]
        usage = " ".join(p.metavar or f"[{p.name.upper()}]..." for p in arguments)
        yield f"### {name}\n"
        yield f"```\nfusionslam {name} {usage} [OPTIONS]\n```\n".replace("  ", " ")
        yield f"{command.help}\n"
        yield "| argument or option | default | meaning |\n|---|---|---|"
        for parameter in [*arguments, *options]:
            yield _describe_parameter(parameter)
        yield ""


def list_shared_options() -> Iterator[str]:
    """Yield the lines of a table of commands and the options that several of them share.

    Options that the same commands have stand in one row.
    """
    from fusionslam.cli import app

    commands_of: dict[str, list[str]] = {}
    for name, command in _walk_commands(typer.main.get_command(app), ""):
        for parameter in command.params:
            if parameter.param_type_name == "option":
                # What options of one name and two meanings take differs.
                option = " ".join([", ".join(parameter.opts), parameter.metavar or ""]).strip()
                commands_of.setdefault(f"`{option}`", []).append(name)
    rows: dict[tuple[str, ...], list[str]] = {}
    for option, commands in commands_of.items():
        rows.setdefault(tuple(commands), []).append(option)
    yield "| options | commands |\n|---|---|"
    for commands, options in sorted(rows.items(), key=lambda row: -len(row[0])):
        if len(commands) > 1:
            yield _row("; ".join(options), ", ".join(commands))


def _walk_commands(group: Any, before: str) -> Iterator[tuple[str, Any]]:
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from _walk_commands(command, f"{before}{name} ")
        else:
            yield before + name, command


def _describe_parameter(parameter: Any) -> str:
    names = [parameter.metavar or parameter.name.upper()]
    if parameter.param_type_name == "option":
        names = [*sorted(parameter.opts, key=len, reverse=True), *parameter.secondary_opts]
        if parameter.metavar:
            names[0] += f" {parameter.metavar}"
    default = "required" if parameter.required else ""
    if parameter.default not in (None, False, (), []):
        default = f"`{parameter.default}`"
    return _row(", ".join(f"`{name}`" for name in names), default, _escape(parameter.help or ""))


def describe_configuration() -> Iterator[str]:
    """Yield the lines of one section for each stage's configuration, with a table of its keys."""
    from fusionslam.cli.info import list_values
    from fusionslam.cli.system_config import SystemConfig

    whole = SystemConfig()
    for stage, definition in type(whole).model_fields.items():
        yield f"\n## {stage}\n\n{definition.description}\n"
        yield "| key | default | unit | range | meaning |\n|---|---|---|---|---|"
        for key, value, unit, limits, meaning in list_values(whole, [stage]):
            yield _row(f"`{key}`", f"`{value}`", unit, _escape(limits), _escape(meaning))


def list_public_names(package: str) -> Iterator[str]:
    """Yield a directive of mkdocstrings for each public name of a package."""
    module = importlib.import_module(package)
    subpackages = getattr(module, "_PACKAGES", ())
    for name in sorted(module.__all__, key=lambda name: (not name[0].isupper(), name.lower())):
        if name not in subpackages and not name.startswith("__"):
            yield f"::: {package}.{name}\n"


def _row(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


def _escape(text: str) -> str:
    return text.replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*")
