# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""No command uses the network, and no page that one writes loads anything from elsewhere."""

import re
import socket
from pathlib import Path
from typing import Any

import pytest

from cli import NO_WINDOW, TINY_TOWN, settings, succeeds
from fusionslam import _core
from pages import read_page
from scenes import LAPS, drive, write_recording


@pytest.fixture
def attempts(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The attempts to reach another machine, each of which fails."""
    found: list[str] = []

    def refuse(name: str) -> Any:
        def attempt(*arguments: Any, **more: Any) -> None:
            found.append(f"{name}{arguments[-1:]}")
            raise OSError(f"{name}: there is no network here")

        return attempt

    for name in ("connect", "connect_ex", "sendto", "bind"):
        monkeypatch.setattr(socket.socket, name, refuse(name), raising=False)
    for name in ("getaddrinfo", "gethostbyname", "create_connection"):
        monkeypatch.setattr(socket, name, refuse(name))
    return found


@pytest.mark.parametrize(
    ("words", "page"),
    [
        pytest.param(("demo", *settings(*TINY_TOWN)), "report.html", marks=pytest.mark.nightly),
        pytest.param(("views", "match", "SCENES"), "views.html", marks=pytest.mark.slow),
        pytest.param(("ratslam", "RANGES"), "ratslam.html", marks=pytest.mark.nightly),
    ],
    ids=["demo", "views match", "ratslam"],
)
def test_pages_are_written_without_a_network(
    words: tuple[str, ...], page: str, tmp_path: Path, attempts: list[str]
) -> None:
    pytest.importorskip("matplotlib")
    if words[0] == "demo":
        pytest.importorskip("embreex")
    data = {"SCENES": tmp_path / "s.npz", "RANGES": tmp_path / "r.npz"}
    drive((*LAPS, -1)).save(data["SCENES"])
    write_recording(data["RANGES"], LAPS)
    succeeds(*(data.get(word, word) for word in words), "-o", tmp_path / "out")
    if page == "report.html":
        succeeds("report", tmp_path / "out")
    assert attempts == []
    assert read_page(tmp_path / "out" / page).text  # refuses addresses outside of the page


def test_commands_work_without_a_network(kitti: Path, tmp_path: Path, attempts: list[str]) -> None:
    for command in ("describe", "loops"):
        succeeds(command, kitti, *NO_WINDOW, "-o", tmp_path / command)
    succeeds("info", kitti)
    succeeds("doctor")
    assert attempts == []


def test_the_core_calls_nothing_of_the_network() -> None:
    names = set(re.findall(rb"[\w@.]+", Path(_core.__file__).read_bytes()))
    assert b"strlen" in names and not names & {b"connect", b"getaddrinfo", b"gethostbyname"}
