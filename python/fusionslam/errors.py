# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The errors that fusionslam raises on purpose.

The C++ core throws the same kinds except ``ClockError``; the bindings turn them into these classes.
Messages are for people and may be reworded: programs decide by class, ``code`` and ``fields``.
"""

import copyreg
import errno
import os
import socket
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any


class FusionSlamError(Exception):
    """Base of every error that fusionslam raises on purpose.

    Attributes:
        code: kind of problem, in kebab-case; the class's own unless one is passed.
        fields: values that distinguish problems of the same code, such as frame names.
    """

    code = "error"

    def __init__(
        self, message: str = "", *, code: str | None = None, fields: Sequence[str] = ()
    ) -> None:
        super().__init__(message)
        self.code = code or type(self).code
        self.fields = tuple(fields)

    def __reduce__(self) -> Any:
        # Not by calling the class, whose arguments may be others: errors come from other processes.
        return copyreg.__newobj__, (type(self), *self.args), vars(self)  # type: ignore[attr-defined]


class DataError(FusionSlamError, ValueError):
    """The data cannot be used: the message names the file, line, offset or point."""

    code = "data"


class ClockError(DataError):
    """A stamp is earlier than the last one: the clock jumped back, or a recording restarted."""

    code = "clock"


class ConfigError(FusionSlamError, ValueError):
    """A configuration value is wrong: the message names the key and what was expected."""

    code = "config"


class ShapeError(FusionSlamError, ValueError):
    """An array has the wrong shape, length or dtype: the message names the argument."""

    code = "shape"


_CODES_OF_CLASSES = {each.code for each in (FusionSlamError, DataError, ConfigError, ShapeError)}


@contextmanager
def naming(subject: object) -> Iterator[None]:
    """Put the file or topic that errors in the block are about before their messages.

    They become a ``DataError`` with the same fields and, unless it is a class's own, the same code.
    """
    try:
        yield
    except FusionSlamError as error:
        code = None if error.code in _CODES_OF_CLASSES else error.code
        raise DataError(f"{subject}: {error}", code=code, fields=error.fields) from error


@contextmanager
def needing(extra: str, need: str) -> Iterator[None]:
    """Say what to install if an import in the block fails.

    Args:
        extra: name of the extra that brings the package.
        need: what needs which package, such as "pose graphs need GTSAM".

    Raises:
        FusionSlamError: code "missing-extra".
    """
    try:
        yield
    except ImportError as error:
        raise FusionSlamError(
            f"{need}, which is not installed ({error}): pip install 'fusionslam[{extra}]'",
            code="missing-extra",
            fields=(extra,),
        ) from error


@contextmanager
def listening(who: str, host: str, port: int) -> Iterator[None]:
    """Say why a socket that is made in the block cannot listen.

    Raises:
        ConfigError: the port is in use (code "port-in-use") or not allowed ("no-port"), or there
            is no such host ("no-host").
    """
    try:
        yield
    except OSError as error:
        code, reason = "no-port", os.strerror(error.errno or 0)
        if isinstance(error, socket.gaierror):
            code, reason = "no-host", "there is no such host; 127.0.0.1 is this machine alone"
        elif error.errno == errno.EADDRINUSE:
            code, reason = "port-in-use", "it is in use; take another port"
        elif error.errno == errno.EADDRNOTAVAIL:
            code = "no-host"
        message = f"{who} cannot listen on port {port} of {host!r}: {reason}"
        raise ConfigError(message, code=code, fields=(host, str(port))) from error


def cause_of(error: BaseException) -> tuple[str, ...]:
    """Identify the cause of an error: two errors with equal causes are the same problem.

    Errors with their own code are identified by code and fields, others by the class and raising
    line of the first error in their chain; never by the message, which contains numbers.
    """
    while True:
        if isinstance(error, FusionSlamError) and error.code != type(error).code:
            return error.code, *error.fields
        if error.__cause__ is None:
            break
        error = error.__cause__
    place, trace = "", error.__traceback__
    while trace is not None:
        place, trace = (
            f"{trace.tb_frame.f_globals.get('__name__')}:{trace.tb_lineno}",
            trace.tb_next,
        )
    return type(error).__name__, place


def reason_of(problem: Mapping[str, Any]) -> str:
    """What is wrong, in our words, of a problem that pydantic found."""
    if limit := _LIMITS.get(problem["type"]):
        name, words = limit
        return f"expected {words} {problem['ctx'][name]:.15g}"
    reason = str(problem["msg"]).removeprefix("Value error, ")
    return reason.replace("Input should be", "expected", 1)


_LIMITS = {
    "greater_than_equal": ("ge", "at least"),
    "greater_than": ("gt", "more than"),
    "less_than_equal": ("le", "at most"),
    "less_than": ("lt", "less than"),
}
# By kind of pydantic's problem: the limit that was broken, and our words for it.


def one_line(error: Exception) -> str:
    """The error's message with its lines joined by semicolons."""
    return "; ".join(line.strip() for line in str(error).splitlines())
