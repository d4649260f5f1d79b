# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Fixtures that several test files share."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

from artefacts import artefact, copy_artefact
from cli import FRAMES
from kitti import write_sequence
from project import PROJECT
from ros_master import PlayedBag, find_played_bag, lacking

# Time says nothing on a busy machine, and the same examples each time fail or pass each time.
settings.register_profile(
    "same", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("same")


@pytest.fixture(scope="session", autouse=True)
def interrupts() -> Iterator[None]:
    """Let SIGINT do its work here and in processes that tests start.

    Shells have what runs in the background ignore it.
    """
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def pytest_report_header() -> list[str]:
    """Say which tests are left out, and why."""
    return [f"without the tests of a live ROS 1, which make test-ros runs: {lacking}"] * bool(
        lacking
    )


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out the tests of ROS where there is none; mark them, and those that need data."""
    if lacking:
        config.hook.pytest_deselected(items=[each for each in items if _needs_ros(each)])
        items[:] = [each for each in items if not _needs_ros(each)]
    for item in items:
        if item.path.parent.name in ("ros", "ros2"):
            item.add_marker("ros")
        if "test_data" in getattr(item, "fixturenames", ()):
            item.add_marker("data")


def _needs_ros(item: pytest.Item) -> bool:
    return item.get_closest_marker("needs_ros") is not None


DATA = Path(os.environ.get("FUSIONSLAM_TEST_DATA", PROJECT / ".." / "shared" / "data"))


@pytest.fixture(scope="session")
def test_data() -> Path:
    """The folder of real and simulated test data, which is not part of the project."""
    if not DATA.is_dir() or not any(DATA.iterdir()):
        pytest.skip("no test data: set FUSIONSLAM_TEST_DATA to their folder")
    return DATA


@pytest.fixture(scope="session")
def ratslam_reference() -> Path:
    """The drive through OpenRatSLAM and what the original programs gave, part of the project."""
    return PROJECT / "tests" / "data" / "ratslam"


@pytest.fixture(scope="session")
def played_bag() -> PlayedBag:
    """A robot's drive for a live ROS, with or without test data."""
    return find_played_bag(DATA)


@pytest.fixture(scope="session")
def offline(played_bag: PlayedBag) -> Any:
    """What the commands make of that drive, an ``Offline``."""
    from live_results import run_offline

    return run_offline(played_bag)


@pytest.fixture(scope="session")
def kitti() -> Path:
    """A drive along z and back to its start, in KITTI odometry's layout, colours and all."""
    places = [min(n, FRAMES - n) for n in range(FRAMES)]
    folder = artefact(
        "kitti", lambda base: write_sequence(base, places, [500] * FRAMES, metres=20, width=128)
    )
    return folder / "sequences" / "03"


@pytest.fixture
def recording(kitti: Path, tmp_path: Path) -> Path:
    """A copy of the drive that a test may damage."""
    copy_artefact(kitti.parent.parent, tmp_path / "data")
    return tmp_path / "data" / "sequences" / "03"
