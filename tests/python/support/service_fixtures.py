# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Places that the tests of the service share."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from artefacts import artefact, copy_artefact
from fleet_service import add_places, describe_fleet, make_folder, serving

pytest.importorskip("fastapi", reason="the extra fleet is missing")
pytest.importorskip("lancedb", reason="the extra fleet is missing")


@pytest.fixture(scope="session")
def fleet() -> Path:
    """A folder of places of two sites, with their clouds; tests only read it."""
    return artefact("service-fleet", describe_fleet) / "places"


@pytest.fixture(scope="module")
def client(fleet: Path) -> Iterator[Any]:
    """A client of a service of the fleet without keys."""
    with serving(fleet, requests_per_minute=0) as client:
        yield client


@pytest.fixture(scope="session")
def twenty() -> Path:
    """A folder of twenty places with made vectors; tests only read it."""

    def make(folder: Path) -> None:
        make_folder(folder / "places")
        add_places(folder / "places", "monday", robot="red", site="depot", region="north")

    return artefact("service-twenty", make) / "places"


@pytest.fixture(scope="module")
def small(twenty: Path) -> Iterator[Any]:
    """A client of a service of the twenty places without keys."""
    with serving(twenty, requests_per_minute=0) as client:
        yield client


@pytest.fixture
def made(twenty: Path, tmp_path: Path) -> Path:
    """Twenty places that a test may change."""
    return copy_artefact(twenty, tmp_path / "places")
