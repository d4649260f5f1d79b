# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A fleet and its results, which tests do not change; they copy what they do."""

from pathlib import Path

import pytest

from artefacts import artefact, copy_artefact
from fleets import describe_fleet, describe_with_database, write_fleet


@pytest.fixture(scope="session")
def fleet() -> Path:
    """Recordings of two sites, three robots."""
    return artefact("fleet", write_fleet)


@pytest.fixture(scope="session")
def described(fleet: Path) -> Path:
    """What one process makes of them."""

    def describe(folder: Path) -> None:
        assert describe_fleet(fleet, folder) == []

    return artefact("fleet-described", describe)


@pytest.fixture
def own_fleet(fleet: Path, tmp_path: Path) -> Path:
    """A copy of the recordings that a test may damage; times of files are kept."""
    return copy_artefact(fleet, tmp_path / "fleet")


@pytest.fixture
def own_places(described: Path, tmp_path: Path) -> Path:
    """A copy of the results that a test may damage."""
    return copy_artefact(described, tmp_path / "places")


@pytest.fixture(scope="session")
def with_database(fleet: Path) -> Path:
    """The results with their database, which tests only read."""
    pytest.importorskip("lancedb", reason="the table of places is an extra")

    def describe(folder: Path) -> None:
        assert describe_with_database(fleet, folder / "places")[0] == []

    return artefact("fleet-with-database", describe) / "places"


@pytest.fixture
def places(with_database: Path, tmp_path: Path) -> Path:
    """A copy of the results with their database that a test may change."""
    return copy_artefact(with_database, tmp_path / "places")
