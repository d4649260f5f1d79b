# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The errors that fusionslam raises on purpose.

The C++ core throws the same kinds but ``ClockError``; the bindings turn them into these classes.
"""


class FusionSlamError(Exception):
    """Base of every error that fusionslam raises on purpose."""


class DataError(FusionSlamError, ValueError):
    """The data cannot be used: the message names the file, line, offset or point."""


class ClockError(DataError):
    """A stamp lies before the last one: the clock went back, or a recording started anew."""


class ConfigError(FusionSlamError, ValueError):
    """A configuration value is wrong: the message names the key and what was expected."""


class ShapeError(FusionSlamError, ValueError):
    """An array has the wrong shape, length or dtype: the message names the argument."""


def one_line(error: Exception) -> str:
    """A message of several lines in one."""
    return "; ".join(line.strip() for line in str(error).splitlines())
