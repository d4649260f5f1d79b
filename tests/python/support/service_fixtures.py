# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Places that the tests of the service share."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from artefacts import artefact
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


@pytest.fixture
def made(tmp_path: Path) -> Path:
    """A folder of twenty places with made vectors, which a test may change."""
    folder = tmp_path / "places"
    make_folder(folder)
    add_places(folder, "monday", robot="red", site="depot", region="north")
    return folder
