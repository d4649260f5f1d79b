# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Codes of errors: programs decide by them, never by messages."""

import errno
import pickle
import socket
from importlib import import_module
from pathlib import Path

import pytest

from fusionslam.base.files import reading
from fusionslam.errors import (
    ClockError,
    ConfigError,
    DataError,
    FusionSlamError,
    cause_of,
    listening,
    naming,
    needing,
)
from refusals import refuses
from rows import rows


def raised(number: int, code: str | None = None, name: str = "left") -> FusionSlamError:
    try:
        raise DataError(f"{number} of 5 {name}", code=code, fields=(name,))
    except DataError as error:
        return error


def test_an_error_has_the_code_of_its_class_unless_it_was_given_one() -> None:
    assert [error("").code for error in (DataError, ClockError, ConfigError)] == [
        "data",
        "clock",
        "config",
    ]
    again = pickle.loads(pickle.dumps(raised(1, "few-points")))
    assert (again.code, again.fields, str(again)) == ("few-points", ("left",), "1 of 5 left")


def test_what_needs_a_package_names_the_extra() -> None:
    with (
        pytest.raises(FusionSlamError, match=r"fusionslam\[fleet\]") as caught,
        needing("fleet", "this needs something"),
    ):
        import_module("no_such_module")
    assert (caught.value.code, caught.value.fields) == ("missing-extra", ("fleet",))


@rows(
    "error, code",
    [
        (OSError(errno.EADDRINUSE, ""), "port-in-use"),
        (OSError(errno.EADDRNOTAVAIL, ""), "no-host"),
        (socket.gaierror(socket.EAI_NONAME, ""), "no-host"),
        (PermissionError(errno.EACCES, ""), "no-port"),
    ],
)
def test_why_a_port_cannot_be_listened_on(error: OSError, code: str) -> None:
    with refuses(code, "here", "80", error=ConfigError), listening("it", "here", 80):
        raise error


def test_causes_differ_by_code_fields_and_place_but_not_by_message() -> None:
    assert cause_of(raised(1, "few")) == cause_of(raised(2, "few")) == ("few", "left")
    assert cause_of(raised(1, "few")) != cause_of(raised(1, "few", "right"))
    assert cause_of(raised(1)) == cause_of(raised(2)) != cause_of(DataError("1 of 5 left"))


def test_naming_a_file_keeps_code_and_fields(tmp_path: Path) -> None:
    path = tmp_path / "file"
    for block in (naming(path), reading(path, "points")):
        with pytest.raises(DataError, match=f"^{path}: ") as caught, block:
            raise raised(3, "few")
        assert (caught.value.code, caught.value.fields) == ("few", ("left",))
        assert cause_of(caught.value) == ("few", "left")


def test_naming_a_file_makes_other_kinds_of_errors_data_errors() -> None:
    for error, code in ((ConfigError(""), "data"), (ClockError(""), "clock")):
        with pytest.raises(DataError) as caught, naming("file"):
            raise error
        assert type(caught.value) is DataError and caught.value.code == code
