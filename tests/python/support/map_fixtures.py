# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of a made street, of which each test has its own copy."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from artefacts import artefact, copy_artefact
from fusionslam.mapping.map_writer import MapStep
from fusionslam.mapping.place_map import PlaceMap
from fusionslam.sensors.frame import Frame
from streets import OPTIONS, WAY, frames

FRAMES = frames(WAY)
STORED = 4
"""Keyframes of a short map."""


def build(
    path: Path, driven: Sequence[Frame] = FRAMES, session: str = "monday", **options: object
) -> list[MapStep]:
    """Drive a session, in a new map or in one that is there."""
    with PlaceMap.open(path, session, **OPTIONS | options) as site:
        return [site.add(frame) for frame in driven]


@pytest.fixture(scope="session")
def street_map() -> Path:
    """A map of the whole street, which tests only read."""
    return artefact("street-map", lambda folder: build(folder / "site.fsmap")) / "site.fsmap"


@pytest.fixture
def path(street_map: Path, tmp_path: Path) -> Path:
    return copy_artefact(street_map, tmp_path / "site.fsmap")


@pytest.fixture(scope="session")
def first_part() -> Path:
    """A map of the first frames, which tests only read."""
    made = artefact("short-map", lambda folder: build(folder / "site.fsmap", FRAMES[:STORED]))
    return made / "site.fsmap"


@pytest.fixture
def short(first_part: Path, tmp_path: Path) -> Path:
    return copy_artefact(first_part, tmp_path / "site.fsmap")


@pytest.fixture
def new(tmp_path: Path) -> Iterator[PlaceMap]:
    """A map without keyframes, open for a session."""
    with PlaceMap.open(tmp_path / "a.fsmap", "a", **OPTIONS) as site:
        yield site
