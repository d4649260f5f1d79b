# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Refuses arguments of another type where a public function is called, by its annotations."""

import inspect
import os
import types
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from typing import Any, Literal, TypeVar, Union, get_args, get_origin

import numpy as np

from fusionslam.errors import DataError

_Checked = TypeVar("_Checked", bound=Callable[..., Any])
_Types = tuple[type, ...]

# What stands for an annotated type besides its own objects.
_ALSO: Mapping[Any, _Types] = {
    bool: (np.bool_,),
    int: (float, np.integer, np.floating),  # who takes a number says which, and its range
    float: (int, np.integer, np.floating),
    Sequence: (np.ndarray,),
    tuple: (list, np.ndarray),
    list: (tuple, np.ndarray),
}


def checked(function: _Checked) -> _Checked:
    """Let a function, or a class when its objects are made, refuse arguments of another type.

    What is annotated as an array, which functions judge by shape, as ``Any`` or by a class that is
    imported for annotations alone is not looked at. A name that no file can have is refused, too.

    Raises:
        TypeError: an argument is of another type; the message names it and what was expected.
        DataError: no file can have the name (code "bad-path").
    """
    target: Any = function.__init__ if isinstance(function, type) else function  # type: ignore[misc]
    parameters = inspect.signature(target).parameters
    by_place = [name for name, each in parameters.items() if each.kind is not each.KEYWORD_ONLY]

    hints = {name: each.annotation for name, each in parameters.items()}
    expected = {name: kinds for name, hint in hints.items() if (kinds := _types(hint))}
    items = {name: kinds for name, hint in hints.items() if (kinds := _item_types(hint))}

    @wraps(target)
    def call(*args: Any, **kwargs: Any) -> Any:
        given = {**dict(zip(by_place, args, strict=False)), **kwargs}
        for name, kinds in expected.items():
            if name in given:
                _check(name, given[name], kinds)
        for name, kinds in items.items():
            value = given.get(name)
            if isinstance(value, np.ndarray):
                value = value.reshape(-1)
            if isinstance(value, np.ndarray | str | bytes | range):  # their items are of one type
                value = value[:1]
            for number, item in enumerate(
                value if isinstance(value, Sequence | np.ndarray) else ()
            ):
                _check(f"{name}[{number}]", item, kinds)
        return target(*args, **kwargs)

    if isinstance(function, type):
        function.__init__ = call  # type: ignore[misc]
        return function
    return call  # type: ignore[return-value]


def _check(name: str, value: Any, kinds: _Types) -> None:
    if not isinstance(value, kinds):
        wanted = " or ".join(dict.fromkeys(_name(kind) for kind in kinds))
        raise TypeError(f"{name} is of type {_name(type(value))}, expected {wanted}")
    if os.PathLike in kinds and isinstance(value, str | os.PathLike):
        try:
            os.stat(value)
        except FileNotFoundError:
            pass
        except (OSError, ValueError) as error:  # too long, links in a circle, a NUL
            if isinstance(error, NotADirectoryError | PermissionError):
                return
            reason = getattr(error, "strerror", None) or error
            raise DataError(
                f"{name} {os.fspath(value)[:200]!r} is no name of a file: {reason}",
                code="bad-path",
                fields=(name,),
            ) from error


def _name(kind: type) -> str:
    return "None" if kind is types.NoneType else kind.__name__


def _item_types(hint: Any) -> _Types | None:
    """The types of the items of a sequence; None if they are not to be checked."""
    parts = get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)
    found = [get_args(part)[:1] for part in parts if get_origin(part) in (Sequence, list)]
    return _types(found[0][0]) if len(found) == 1 and found[0] else None


def _types(hint: Any) -> _Types | None:
    """The types of the objects that an annotation allows; None if that is not to be checked."""
    origin = get_origin(hint) or hint
    if origin in (Union, types.UnionType):
        parts = [_types(part) for part in get_args(hint)]
        known = [part for part in parts if part is not None]
        return None if len(known) < len(parts) else tuple(kind for part in known for kind in part)
    if origin is Literal:
        return tuple({type(value) for value in get_args(hint)})
    if not isinstance(origin, type) or origin in (Any, np.ndarray, object, inspect.Parameter.empty):
        return None
    if getattr(origin, "_is_protocol", False) and not getattr(
        origin, "_is_runtime_protocol", False
    ):
        return None  # what is runtime_checkable is judged by its attributes
    return (origin, *_ALSO.get(origin, ()))
