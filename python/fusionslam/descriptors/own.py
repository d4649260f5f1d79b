# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Descriptors of users: functions of their modules, by name.

Files of maps and fleets hold names of descriptors, and must not choose what is imported: a name
"module:function" counts only if the user gave it (``load_descriptor``, the environment variable
``FUSIONSLAM_DESCRIPTORS``), and a plain name only if a package that is installed declares it as an
entry point of the group ``fusionslam.descriptors``.
"""

import os
import sys
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from fusionslam.config import suggest
from fusionslam.descriptors.registry import DESCRIPTORS, Descriptor
from fusionslam.errors import ConfigError

GROUP = "fusionslam.descriptors"
"""Entry points of installed packages."""
VARIABLE = "FUSIONSLAM_DESCRIPTORS"
"""Environment variable with the names "module:function" that count, with commas."""
LONGEST_NAME = 200
"""Characters of a descriptor's name."""


def check_name_length(name: str) -> None:
    """Raise ConfigError for a name that is too long: files have the names of descriptors."""
    if len(name) > LONGEST_NAME:
        raise ConfigError(
            f"unknown descriptor '{name[:40]}...': a name of {len(name)} characters, expected at "
            f"most {LONGEST_NAME}",
            code="unknown-name",
            fields=("descriptors", f"{name[:40]}..."),
        )


def let_count(name: str) -> None:
    """Let a name "module:function" count, here and in processes that this one starts."""
    os.environ[VARIABLE] = ",".join(dict.fromkeys([*filter(None, _given()), name]))


def is_own(name: str) -> bool:
    """Return whether a name has the form "module:function", and is none of ours with a preset."""
    module, colon, function = name.partition(":")
    words = [*module.split("."), *function.split(".")]
    return bool(colon) and module not in DESCRIPTORS and all(word.isidentifier() for word in words)


def find_own(name: str) -> Descriptor | None:
    """Return a descriptor that the user or an installed package gave; None if neither did.

    Raises:
        ConfigError: it cannot be imported (code "own-descriptor").
    """
    where = _place_of(name)
    return None if where is None else _import(name, where)


def own_files(names: Iterable[str]) -> list[Path]:
    """Return the files of the modules of those descriptors that are users' own, once imported."""
    places = [_place_of(name) for name in names if name.partition(":")[0] not in DESCRIPTORS]
    modules = [sys.modules.get(each.module) for each in places if each is not None]
    files = [getattr(module, "__file__", None) for module in modules]
    return [Path(file) for file in files if file is not None]


def _given() -> list[str]:
    return [name.strip() for name in os.environ.get(VARIABLE, "").split(",")]


def _place_of(name: str) -> EntryPoint | None:
    """Return where the function of a name that counts is; None for other names."""
    if is_own(name):
        return EntryPoint(name, name, GROUP) if name in _given() else None
    return _installed(name)


@lru_cache
def _installed(name: str) -> EntryPoint | None:
    return next(iter(entry_points(group=GROUP, name=name)), None)


@lru_cache
def _import(name: str, where: EntryPoint) -> Descriptor:
    if os.getcwd() not in sys.path:  # which programs that are installed do not have there
        sys.path.append(os.getcwd())
    try:
        found: Any = where.load()
    except (Exception, SystemExit) as error:
        reason = f"{type(error).__name__}: {error}"
        near = suggest(where.module, DESCRIPTORS)
        raise _error_of(name, f"{where.value} cannot be imported: {reason}{near}") from error
    if isinstance(found, Descriptor) and found.function is not None:
        return replace(found, name=name)
    if isinstance(found, Descriptor) or not isinstance(found, Callable):  # type: ignore[arg-type]
        raise _error_of(name, f"{where.value} is {found!r:.200}, expected a function of points")
    return Descriptor(name=name, length="", source="", function=found)


def _error_of(name: str, problem: str) -> ConfigError:
    return ConfigError(
        f"descriptor {name!r}: {problem}", code="own-descriptor", fields=("descriptors", name)
    )
