# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a target is, and what counts as an acceptable answer to hostile input."""

import math
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from fusionslam.errors import FusionSlamError


class SilentError(Exception):
    """Wrong data passed as right: other content than was stored, or a NaN."""


@dataclass(frozen=True)
class Target:
    """One thing that takes input from outside.

    Attributes:
        name: unique, such as "damaged/descriptor_run".
        seeds: valid inputs to start from.
        process: takes an input; True if it was accepted, False if it was refused as it should be,
            None if no value could be made of the bytes; any exception is a finding.
        largest: longest input in bytes; 0 for that of the longest seed and a half.
    """

    name: str
    seeds: Callable[[], list[bytes]]
    process: Callable[[bytes], bool | None]
    largest: int = 0


def scratch() -> Path:
    """A temporary folder that this process removes at its end."""
    return Path(_scratch().name)


@cache
def _scratch() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="fusionslam-fuzz-", ignore_cleanup_errors=True)


def refusing(action: Callable[[], object]) -> bool:
    """Run something on hostile input; False if it refused with one of the package's errors."""
    try:
        action()
    except FusionSlamError:
        return False
    return True


def check_numbers(value: Any, where: str = "result") -> None:
    """Raise ``SilentError`` if a float anywhere in a value is NaN.

    Infinity is no error by itself: it is the distance to a place that nothing resembles.
    """
    if isinstance(value, float | np.floating):
        if math.isnan(value):
            raise SilentError(f"{where} is NaN")
    elif isinstance(value, np.ndarray):
        if value.dtype.kind == "f" and np.isnan(value).any():
            raise SilentError(f"{where} holds NaN")
    elif isinstance(value, Mapping):
        for key, item in value.items():
            check_numbers(item, f"{where}[{key!r}]")
    elif isinstance(value, tuple | list):
        for index, item in enumerate(value):
            check_numbers(item, f"{where}[{index}]")
    elif is_dataclass(value) and not isinstance(value, type):
        for field in fields(value):
            check_numbers(getattr(value, field.name), f"{where}.{field.name}")


def split_name(targets: Mapping[str, Target]) -> Iterator[tuple[str, str]]:
    """Group and name of each target."""
    for name in targets:
        group, _, rest = name.partition("/")
        yield group, rest
