# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Expected errors, told apart by their codes."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from fusionslam.errors import DataError, FusionSlamError


@contextmanager
def refuses(code: str, *fields: str, error: type[FusionSlamError] = DataError) -> Iterator[None]:
    """Expect an error with this code and, if any are given, these fields."""
    with pytest.raises(error) as caught:
        yield
    assert caught.value.code == code
    assert not fields or caught.value.fields == fields
