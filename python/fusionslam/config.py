# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Configuration: each value is defined once, with its default, unit, range and help.

Every stage has one ``Section``. Keyword arguments, YAML files, ``--set stage.key=value`` and
``fusionslam config`` are all derived from it. Sections of the C++ core are built from the
core's own tables, so their values stand once too.
"""

import difflib
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, Literal, Protocol, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model, model_validator
from pydantic.fields import FieldInfo

from fusionslam.errors import ConfigError


class Section(BaseModel):
    """A stage's configuration: immutable, no unknown keys, no types but the stated."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, validate_default=True)

    @model_validator(mode="before")
    @classmethod
    def _sequences_are_tuples(cls, values: Any) -> Any:
        """YAML and JSON know lists only."""
        return _tupled(values)


def _tupled(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(_tupled(item) for item in value)
    if isinstance(value, dict):
        return {key: _tupled(item) for key, item in value.items()}
    return value


def option(default: Any, help: str, *, unit: str = "", **limits: Any) -> Any:
    """A field of a ``Section``: its default, help, unit and limits (``ge``, ``le``, ``gt``, ..)."""
    return Field(default, description=help, json_schema_extra={"unit": unit}, **limits)


S = TypeVar("S", bound=Section)


class CoreConfig(Protocol):
    """A configuration class of the C++ core."""

    @staticmethod
    def options() -> list[Any]:
        """Every option as a dictionary: name, kind, default, help, unit, range or choices."""


def core_section(name: str, core: type[CoreConfig], *, optional: bool = False) -> type[Section]:
    """The section that mirrors a C++ configuration.

    Args:
        name: of the new class.
        core: the bound C++ class.
        optional: every value may be None, for "as the preset says", and is so by default.
    """
    fields = {entry["name"]: _core_field(entry, optional) for entry in core.options()}
    return create_model(name, __base__=Section, **fields)  # type: ignore[call-overload, no-any-return]


_KINDS = {"bool": bool, "int": int, "float": float}


def _core_field(entry: Mapping[str, Any], optional: bool) -> tuple[Any, FieldInfo]:
    kind: Any = (
        Literal[tuple(entry["choices"])] if entry["kind"] == "choice" else _KINDS[entry["kind"]]
    )
    limits = {"ge": entry["minimum"], "le": entry["maximum"]} if "minimum" in entry else {}
    if entry["kind"] == "int":
        limits = {key: int(limit) for key, limit in limits.items()}
    default = None if optional else entry["default"]
    return (kind | None if optional else kind), option(
        default, entry["help"], unit=entry["unit"], **limits
    )


def merged(section: S, changes: Mapping[str, Any], where: str = "") -> S:
    """The section with some values changed; sections in it may be changed in part.

    Raises:
        ConfigError: unknown key (the message names the nearest), wrong type or out of range.
    """
    known = list(type(section).model_fields)
    values = {name: getattr(section, name) for name in section.model_fields_set}
    for key, value in changes.items():
        path = f"{where}{key}"
        if key not in known:
            raise ConfigError(_unknown(path, key, known))
        current, kind = getattr(section, key), _named_sections(section, key)
        if isinstance(current, Section):
            values[key] = _inner(current, value, path)
        elif kind is not None and isinstance(value, Mapping):
            values[key] = current | {
                name: _inner(current.get(name, kind()), inner, f"{path}.{name}")
                for name, inner in value.items()
            }
        else:
            values[key] = value
    try:
        return type(section)(**values)
    except ValidationError as error:
        raise ConfigError(_first_problem(error, where)) from error


def _inner(current: Section, value: Any, path: str) -> Section:
    if not isinstance(value, Mapping):
        raise ConfigError(f"{path} is {value!r}, expected keys of its own: {_names(current)}")
    return merged(current, value, f"{path}.")


def _named_sections(section: Section, key: str) -> type[Section] | None:
    """The kind of section that a field holds by name, if it does."""
    kinds = get_args(type(section).model_fields[key].annotation)
    named = len(kinds) == 2 and isinstance(kinds[1], type) and issubclass(kinds[1], Section)
    return kinds[1] if named else None


def with_settings(section: S, settings: list[str]) -> S:
    """The section changed by texts such as ``fusion.voxel=0.2`` (values are read as YAML)."""
    # All at once: values that belong together may be wrong one by one.
    changes: dict[str, Any] = {}
    for setting in settings:
        keys, value = _setting(setting)
        place = changes
        for key in keys[:-1]:
            if not isinstance(place.get(key), dict):
                place[key] = {}
            place = place[key]
        place[keys[-1]] = value
    return merged(section, changes)


def _setting(text: str) -> tuple[list[str], Any]:
    """The parts of the key, and the value."""
    import yaml

    key, equals, value = text.partition("=")
    if not equals:
        raise ConfigError(f"--set {text}: expected stage.key=value")
    try:
        return key.strip().split("."), yaml.safe_load(value)
    except yaml.YAMLError as error:
        raise ConfigError(f"--set {text}: the value is no YAML: {error}") from error


def with_file(section: S, path: str | Path) -> S:
    """The section changed by a YAML file. Raises ConfigError naming the file or the key."""
    import yaml

    try:
        changes = yaml.safe_load(Path(path).read_text(encoding="utf-8")) or {}
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ConfigError(f"{path}: cannot be read as YAML: {error}") from error
    if not isinstance(changes, dict):
        found = type(changes).__name__
        raise ConfigError(f"{path}: expected stages with their keys, found {found}")
    return merged(section, changes)


def walk(section: Section, where: str = "") -> Iterator[tuple[str, Any, FieldInfo]]:
    """Every (dotted key, value, definition) of a section and the sections in it."""
    for name, definition in type(section).model_fields.items():
        value = getattr(section, name)
        if isinstance(value, Section):
            yield from walk(value, f"{where}{name}.")
        else:
            yield f"{where}{name}", value, definition


def as_yaml(section: Section, only: Collection[str] | None = None) -> str:
    """The section as a YAML file that ``with_file`` reads, with units and help as comments.

    Args:
        section: with its values.
        only: names of the fields to write; None for all.
    """
    return "".join(_yaml_lines(section.model_dump(mode="json"), section, only, ""))


def _yaml_lines(
    values: Mapping[str, Any], section: Section, only: Collection[str] | None, indent: str
) -> Iterator[str]:
    import yaml

    for name, definition in type(section).model_fields.items():
        if only is not None and name not in only:
            continue
        extra = definition.json_schema_extra
        unit = extra.get("unit") if isinstance(extra, dict) else ""
        yield f"{indent}# {definition.description}{f' [{unit}]' if unit else ''}\n"
        inner = getattr(section, name)
        if isinstance(inner, Section):
            yield f"{indent}{name}:\n"
            yield from _yaml_lines(values[name], inner, None, indent + "  ")
        else:
            text = yaml.safe_dump(values[name], default_flow_style=True, width=10**6)
            yield f"{indent}{name}: {text.removesuffix('...' + chr(10)).strip()}\n"


def _names(section: Section) -> str:
    return ", ".join(type(section).model_fields)


def _unknown(path: str, key: str, known: list[str]) -> str:
    near = difflib.get_close_matches(str(key), known, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]!r}? " if near else ""
    return f"unknown configuration key {path!r}; {hint}known: {', '.join(known)}"


def _first_problem(error: ValidationError, where: str) -> str:
    first = error.errors()[0]
    key = where + ".".join(str(part) for part in first["loc"])
    reason = str(first["msg"]).removeprefix("Value error, ")
    if first["type"] == "value_error" and isinstance(first["input"], Mapping):
        # Values that do not go together: the reason names them, all of them would hide it.
        return f"{key.rstrip('.')}: {reason}" if key else reason
    return f"{key.rstrip('.')} is {first['input']!r}: {reason}"
