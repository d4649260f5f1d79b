# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A fleet and its results, which tests do not change; they copy what they do."""

import shutil
from pathlib import Path

import pytest

from fleets import describe_fleet, write_fleet


@pytest.fixture(scope="session")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recordings of two sites, three robots."""
    return write_fleet(tmp_path_factory.mktemp("fleet"))


@pytest.fixture(scope="session")
def described(fleet: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What one process makes of them."""
    folder = tmp_path_factory.mktemp("described") / "places"
    assert describe_fleet(fleet, folder) == []
    return folder


@pytest.fixture
def own_fleet(fleet: Path, tmp_path: Path) -> Path:
    """A copy of the recordings that a test may damage; times of files are kept."""
    shutil.copytree(fleet, tmp_path / "fleet")
    return tmp_path / "fleet"


@pytest.fixture
def own_places(described: Path, tmp_path: Path) -> Path:
    """A copy of the results that a test may damage."""
    shutil.copytree(described, tmp_path / "places")
    return tmp_path / "places"
