# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What tests expect of errors, whose wording may change."""

from collections.abc import Callable
from os import PathLike

from fusionslam.errors import FusionSlamError


def has_code(code: str, *fields: str | int | PathLike[str]) -> Callable[[BaseException], bool]:
    """For ``pytest.raises(DataError, check=...)``: an error's code, and its first fields."""

    def check(error: BaseException) -> bool:
        assert isinstance(error, FusionSlamError)
        assert (error.code, *error.fields[: len(fields)]) == (code, *map(str, fields)), error
        return True

    return check
