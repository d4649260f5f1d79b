# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Two maps become one if they show the same places."""

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fusionslam import ConfigError
from fusionslam.config import merged
from fusionslam.mapping.place_map import PlaceMap
from fusionslam.registration import RegistrationConfig, without_lengths
from fusionslam.sensors.frame import Frame
from refusals import refuses
from streets import OPTIONS, RETURN, WAY, frames

pytest.importorskip("small_gicp", reason="the libraries of registration are an extra")
pytest.importorskip("gtsam", reason="the library of pose graphs is an extra")


def build(path: Path, driven: Sequence[Frame], session: str, **options: Any) -> None:
    with PlaceMap.open(path, session, **OPTIONS | options) as site:
        for frame in driven:
            site.add(frame)


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("map") / "site.fsmap"
    build(path, frames(WAY), "monday")
    return path


@pytest.fixture
def path(built: Path, tmp_path: Path) -> Path:
    return Path(shutil.copy(built, tmp_path / "site.fsmap"))


def test_two_maps_become_one_that_can_be_undone(path: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.fsmap"
    build(other, frames(RETURN, 200, day=1), "tuesday")
    with PlaceMap.open(path) as site:
        before = site.trajectory("monday")[1]
        merge = site.merge(other)
        assert merge.sessions == ("tuesday",) and merge.reason is None
        assert len(merge.believed) >= 3
        assert [each.parts for each in site.sessions] == [(0,), (0,)]
        truth = [np.linalg.inv(WAY[0]) @ pose for pose in RETURN]
        off = site.trajectory("tuesday")[1][:, :3, 3] - np.array(truth)[:, :3, 3]
        assert np.linalg.norm(off, axis=1).max() < 0.6
        assert site.check() == []
        with refuses("same-session", "session", "tuesday", error=ConfigError):
            site.merge(other)
        site.forget("tuesday")
        np.testing.assert_allclose(site.trajectory("monday")[1], before, atol=1e-6)
    with PlaceMap.open(other, read_only=True) as unchanged:
        assert [each.name for each in unchanged.sessions] == ["tuesday"]


def with_lengths(factor: float) -> RegistrationConfig:
    """All lengths that are fitted to rooms, in this proportion."""
    config = RegistrationConfig()
    fitted = config.model_dump().keys() - without_lengths(config).keys()
    return merged(config, {name: factor * getattr(config, name) for name in fitted})


def test_maps_whose_lengths_are_similar_are_merged(path: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.fsmap"
    build(other, frames(RETURN, 200, day=1), "tuesday", registration=with_lengths(0.7))
    with PlaceMap.open(path) as site:
        assert len(site.merge(other).believed) >= 3
        truth = [np.linalg.inv(WAY[0]) @ pose for pose in RETURN]
        off = site.trajectory("tuesday")[1][:, :3, 3] - np.array(truth)[:, :3, 3]
        assert np.linalg.norm(off, axis=1).max() < 0.6


def test_maps_whose_lengths_differ_are_not_merged(path: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.fsmap"
    build(other, frames(WAY)[:1], "tuesday", registration=with_lengths(0.4))
    with (
        PlaceMap.open(path) as site,
        refuses("other-configuration", "registration.voxel", "0.2", error=ConfigError),
    ):
        site.merge(other)


def test_maps_of_different_places_are_not_merged(path: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.fsmap"
    build(other, frames(RETURN, 200, place=13), "elsewhere")
    with PlaceMap.open(path) as site:
        merge = site.merge(other)
        assert merge.sessions == () and not merge.believed
        assert merge.reason is not None and merge.reason.code == "few-merges"
        assert [each.name for each in site.sessions] == ["monday"]


def test_maps_of_other_configurations_are_not_merged(path: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.fsmap"
    with PlaceMap.open(other, "a", **(OPTIONS | {"descriptor": "scan_context"})) as site:
        site.add(frames(WAY)[0])
    with (
        PlaceMap.open(path) as site,
        refuses("other-configuration", "descriptor", error=ConfigError),
    ):
        site.merge(other)
