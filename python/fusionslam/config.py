# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Configuration: each value is defined once, with its default, unit, range and help.

Every stage has one ``Section``. Keyword arguments, YAML files, ``--set stage.key=value`` and
``fusionslam config`` are all derived from it. Sections of the C++ core are built from the
core's own tables, so their values are defined only once too.
"""

import difflib
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, Literal, Protocol, TypeVar, cast, get_args, get_origin

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    create_model,
    field_validator,
    model_validator,
)
from pydantic.fields import FieldInfo

from fusionslam.base.files import parse_yaml, read_yaml
from fusionslam.errors import ConfigError, reason_of


class Section(BaseModel):
    """Configuration of one stage: immutable, strictly typed, without unknown keys.

    Raises:
        ConfigError: unknown key (the message names the nearest), wrong type or out of range.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, validate_default=True)

    def __init__(self, **values: Any) -> None:
        for key in values:
            _check_key(type(self), key)
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise _first_problem(type(self), error) from error

    @model_validator(mode="before")
    @classmethod
    def _sequences_are_tuples(cls, values: Any) -> Any:
        """Turn lists into tuples, which YAML and JSON do not have."""
        return _as_tuples(values)

    @field_validator("*")
    @classmethod
    def _fits_64_bits(cls, value: Any) -> Any:
        """Refuse integers that neither the core nor an array can hold."""
        if isinstance(value, int) and not -(2**63) <= value < 2**63:
            raise ValueError("expected a number of at most 64 bits")
        return value


def _as_tuples(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(_as_tuples(item) for item in value)
    if isinstance(value, dict):
        return {key: _as_tuples(item) for key, item in value.items()}
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


def core_section(
    name: str, core: type[CoreConfig], module: str, *, optional: bool = False
) -> type[Section]:
    """Create the section that mirrors a C++ configuration.

    Args:
        name: of the new class.
        core: the bound C++ class.
        module: that holds the class by this name, so that values can be sent between processes.
        optional: every value may be None and is by default: the preset's value applies.
    """
    fields = {entry["name"]: _core_field(entry, optional) for entry in core.options()}
    return create_model(name, __base__=Section, __module__=module, **fields)  # type: ignore[call-overload, no-any-return]


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


def merged(
    section: S, changes: Mapping[str, Any], where: str = "", *, new_names: bool = False
) -> S:
    """Copy a section with some values changed; nested sections may be changed in part.

    Args:
        section: the one to start from.
        changes: values by key; a mapping for a nested section.
        where: prefix of the keys in messages.
        new_names: whether changes may add entries to fields that hold sections by name.

    Raises:
        ConfigError: unknown key or name (the message names the nearest), wrong type or out of
            range.
    """
    values = {name: getattr(section, name) for name in section.model_fields_set}
    for key, value in changes.items():
        path = f"{where}{key}"
        _check_key(type(section), key, where)
        current, kind = getattr(section, key), _named_sections(section, key)
        if isinstance(current, Section):
            values[key] = _merge_inner(current, value, path, new_names)
        elif kind is not None and isinstance(value, Mapping):
            for name in () if new_names else value:
                if name not in current:
                    raise ConfigError(
                        f"{path}: unknown name {name!r}; "
                        f"{_hint(name, current)}known: {', '.join(current) or 'none'}",
                        code="unknown-name",
                        fields=(path, name),
                    )
            values[key] = current | {
                name: _merge_inner(current.get(name, kind()), inner, f"{path}.{name}", new_names)
                for name, inner in value.items()
            }
        else:
            values[key] = value
    try:
        return type(section)(**values)
    except ConfigError as error:
        # Only here is the whole key known. The keys are checked, so it is a value that is wrong.
        cause = cast(ValidationError, error.__cause__)
        raise _first_problem(type(section), cause, where) from cause


def flatten(values: Mapping[str, Any], where: str = "") -> dict[str, Any]:
    """The values of nested mappings by dotted key; ``where`` is the prefix of the keys."""
    flat: dict[str, Any] = {}
    for key, value in values.items():
        inner = isinstance(value, Mapping)
        flat |= flatten(value, f"{where}{key}.") if inner else {f"{where}{key}": value}
    return flat


def _merge_inner(current: Section, value: Any, path: str, new_names: bool) -> Section:
    if not isinstance(value, Mapping):
        known = ", ".join(type(current).model_fields)
        raise ConfigError(f"{path} is {value!r}, expected keys of its own: {known}")
    return merged(current, value, f"{path}.", new_names=new_names)


def _named_sections(section: Section, key: str) -> type[Section] | None:
    """Class of the sections that a field maps names to; None for other fields."""
    kinds = get_args(type(section).model_fields[key].annotation)
    named = len(kinds) == 2 and isinstance(kinds[1], type) and issubclass(kinds[1], Section)
    return kinds[1] if named else None


def with_settings(section: S, settings: list[str]) -> S:
    """Apply settings such as ``fusion.voxel=0.2`` to a section (values are read as YAML)."""
    # All at once: values that depend on each other may be invalid one at a time.
    changes: dict[str, Any] = {}
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals:
            raise ConfigError(f"--set {setting}: expected stage.key=value")
        keys, place = key.strip().split("."), changes
        try:
            value = parse_yaml(text)
        except ValueError as error:
            raise ConfigError(f"--set {setting}: the value is no YAML: {error}") from error
        for outer in keys[:-1]:
            if not isinstance(place.get(outer), dict):
                place[outer] = {}
            place = place[outer]
        place[keys[-1]] = value
    return merged(section, changes)


def with_file(section: S, path: str | Path, *, new_names: bool = False) -> S:
    """Apply a YAML file to a section, as ``merged`` does.

    Raises:
        ConfigError: the file cannot be read (code "config-file"), or a key is wrong; the message
            names it.
    """
    named: dict[str, Any] = {"code": "config-file", "fields": (str(path),)}
    try:
        changes = read_yaml(path) or {}
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}", **named) from error
    except ValueError as error:
        raise ConfigError(f"{path}: cannot be read as YAML: {error}", **named) from error
    if not isinstance(changes, dict):
        found = type(changes).__name__
        raise ConfigError(f"{path}: expected stages with their keys, found {found}", **named)
    return merged(section, changes, new_names=new_names)


def walk(section: Section, where: str = "") -> Iterator[tuple[str, Any, FieldInfo]]:
    """Yield (dotted key, value, definition) of every field of a section and its nested ones."""
    for name, definition in type(section).model_fields.items():
        value = getattr(section, name)
        if isinstance(value, Section):
            yield from walk(value, f"{where}{name}.")
        else:
            yield f"{where}{name}", value, definition


def unit_of(definition: FieldInfo) -> str:
    """Return the unit in a value's definition; empty if it has none."""
    extra = definition.json_schema_extra
    return str(extra.get("unit", "")) if isinstance(extra, dict) else ""


def limits_of(definition: FieldInfo) -> dict[str, float]:
    """Return the limits in a number's definition by their kind: ge, gt, le, lt."""
    pairs = ((name, getattr(m, name, None)) for m in definition.metadata for name in _SIGNS)
    return {name: limit for name, limit in pairs if limit is not None}


def range_of(definition: FieldInfo) -> str:
    """Format the choices or limits in a value's definition."""
    if choices := _choices(definition):
        return ", ".join(map(str, choices))
    if bool in (definition.annotation, *get_args(definition.annotation)):
        return "true, false"
    return ", ".join(f"{_SIGNS[name]} {limit:g}" for name, limit in limits_of(definition).items())


_SIGNS = {"ge": ">=", "gt": ">", "le": "<=", "lt": "<"}


def as_yaml(section: Section, only: Collection[str] | None = None) -> str:
    """Format a section as YAML for ``with_file``, with units and help as comments.

    Args:
        section: the one to write.
        only: names of the fields to write; None for all.
    """
    return "".join(_yaml_lines(section.model_dump(mode="json"), section, only, ""))


def _yaml_lines(
    values: Mapping[str, Any], section: Section, only: Collection[str] | None, indent: str
) -> Iterator[str]:
    for name, definition in type(section).model_fields.items():
        if only is not None and name not in only:
            continue
        unit = unit_of(definition)
        yield f"{indent}# {definition.description}{f' [{unit}]' if unit else ''}\n"
        inner = getattr(section, name)
        if isinstance(inner, Section) and type(inner).model_fields:
            yield f"{indent}{name}:\n"
            yield from _yaml_lines(values[name], inner, None, indent + "  ")
        elif _named_sections(section, name) and inner:
            yield f"{indent}{name}:\n"
            for own, held in inner.items():
                yield f"{indent}  {_yaml_text(own)}:\n"
                yield from _yaml_lines(values[name][own], held, None, indent + "    ")
        else:
            yield f"{indent}{name}: {_yaml_text(values[name])}\n"


def _yaml_text(value: Any) -> str:
    """Format a value on one line."""
    import yaml

    text = yaml.safe_dump(value, default_flow_style=True, width=10**6)
    return text.removesuffix("...\n").strip()


def split_preset(name: str) -> tuple[str, str | None]:
    """Split a name with an optional preset, such as "cm2dp:author"."""
    first, colon, preset = str(name).partition(":")
    return first, preset if colon else None


def explain_choice(value: str, choices: Collection[str]) -> str:
    """Explain why a value is not a valid choice: the choices, and the one nearest to it."""
    return f"expected one of {', '.join(choices)}{suggest(value, choices)}"


def suggest(value: str, choices: Collection[str]) -> str:
    """Return "; did you mean 'm2dp'?" with the choice most like the value; empty if none is."""
    near = nearest_name(value, choices)
    return f"; did you mean {near!r}?" if near else ""


def nearest_name(value: str, choices: Collection[str]) -> str | None:
    """Return the choice that is spelled most like the value; None if none is like it."""
    near = difflib.get_close_matches(str(value), choices, n=1, cutoff=0.5)
    return near[0] if near else None


def _check_key(kind: type[Section], key: str, where: str = "") -> None:
    """Raise ConfigError unless a section has this key; ``where`` is the prefix in the message."""
    path, known = f"{where}{key}", list(kind.model_fields)
    if key in known:
        return
    reason = "; there is nothing to configure"
    if known:
        reason = f"; {_hint(key, known)}known: {', '.join(known)}"
    raise ConfigError(
        f"unknown configuration key {path!r}{reason}", code="unknown-key", fields=(path,)
    )


def _hint(name: str, known: Collection[str]) -> str:
    near = nearest_name(name, known)
    return f"did you mean {near!r}? " if near else ""


def _first_problem(kind: type[Section], error: ValidationError, where: str = "") -> ConfigError:
    first = error.errors()[0]
    key = (where + ".".join(str(part) for part in first["loc"])).rstrip(".")
    reason, cause = reason_of(first), first.get("ctx", {}).get("error")
    if first["type"] == "literal_error" and len(first["loc"]) == 1:
        reason += suggest(first["input"], _choices(kind.model_fields[str(first["loc"][0])]))
    if first["type"] == "value_error" and isinstance(first["input"], Mapping):
        # Values that contradict each other: the reason names them; listing all would hide it.
        message = f"{key}: {reason}" if key else reason
    else:
        message = f"{key} is {first['input']!r}: {reason}"
    if isinstance(cause, ConfigError):
        return ConfigError(message, code=cause.code, fields=cause.fields)
    return ConfigError(message, fields=(key,) if key else ())


def _choices(definition: FieldInfo) -> list[Any]:
    """The values that a field accepts; empty if it is no choice."""
    kinds = (definition.annotation, *get_args(definition.annotation))
    return [text for kind in kinds if get_origin(kind) is Literal for text in get_args(kind)]
