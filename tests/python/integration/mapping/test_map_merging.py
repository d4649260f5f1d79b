# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Two maps become one if they show the same places."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from artefacts import artefact
from fusionslam import ConfigError, DescriptorConfig
from fusionslam.config import merged
from fusionslam.loop_closure.observation import name_voter
from fusionslam.mapping.place_map import PlaceMap
from fusionslam.registration import RegistrationConfig, without_lengths
from map_fixtures import FRAMES, build
from refusals import refuses
from rows import rows
from streets import RETURN, WAY, frames

pytest.importorskip("gtsam", reason="the library of pose graphs is an extra")

TUESDAY = frames(RETURN, 200, day=1)


def assert_merged(site: PlaceMap) -> None:
    poses = site.trajectory("tuesday")[1]
    truth = np.array([np.linalg.inv(WAY[0]) @ pose for pose in RETURN[: len(poses)]])
    off = poses[:, :3, 3] - truth[:, :3, 3]
    assert np.linalg.norm(off, axis=1).max() < 0.6


@pytest.fixture(scope="module")
def other() -> Path:
    """A map of the next day, which tests only read."""
    folder = artefact("next-day", lambda made: build(made / "a.fsmap", TUESDAY, "tuesday"))
    return folder / "a.fsmap"


@pytest.mark.slow
def test_two_maps_become_one_that_can_be_undone(path: Path, other: Path) -> None:
    with PlaceMap.open(path) as site:
        before = site.trajectory("monday")[1]
        merge = site.merge(other)
        assert merge.sessions == ("tuesday",) and merge.reason is None
        assert len(merge.believed) >= 3
        assert [each.parts for each in site.sessions] == [(0,), (0,)]
        assert_merged(site)
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
    lengths = {name: getattr(config, name) for name in fitted if name != "local_map"}
    return merged(config, {name: factor * length for name, length in lengths.items()})


@pytest.mark.slow
def test_maps_whose_lengths_are_similar_are_merged(path: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.fsmap"
    build(other, TUESDAY[:5], "tuesday", registration=with_lengths(0.7))
    with PlaceMap.open(path) as site:
        assert len(site.merge(other).believed) >= 3
        assert_merged(site)


@pytest.mark.slow
def test_what_another_map_fitted_otherwise_is_described_anew(path: Path, tmp_path: Path) -> None:
    same, other = tmp_path / "same.fsmap", tmp_path / "other.fsmap"
    build(same, TUESDAY[:5], "tuesday")
    fitted = merged(DescriptorConfig(), {"bev_spectrum": {"cell": 1.1}})
    build(other, TUESDAY[:5], "tuesday", describe=fitted)
    voting = name_voter("bev_spectrum")

    def vectors(of: PlaceMap) -> NDArray[np.float32]:
        rows: NDArray[np.float32] = of.file.vectors()[voting][1][-5:]
        return rows / np.linalg.norm(rows, axis=1, keepdims=True)

    with PlaceMap.open(same, read_only=True) as site:
        expected = vectors(site)
    with PlaceMap.open(other, read_only=True) as site:
        assert (vectors(site) * expected).sum(axis=1).max() < 0.5
    with PlaceMap.open(path) as site:
        assert len(site.merge(other).believed) >= 3
        # Of voxels, which are all that is stored of a cloud.
        assert (vectors(site) * expected).sum(axis=1).min() > 0.8


@rows(
    "options, fields",
    [
        ({"registration": with_lengths(0.4)}, ("registration.voxel", "0.2")),
        ({"descriptor": "scan_context"}, ("descriptor",)),
    ],
)
def test_maps_of_other_configurations_are_not_merged(
    path: Path, tmp_path: Path, options: dict[str, object], fields: tuple[str, ...]
) -> None:
    other = tmp_path / "other.fsmap"
    build(other, FRAMES[:1], "tuesday", **options)
    refused = refuses("other-configuration", *fields, error=ConfigError)
    with PlaceMap.open(path) as site, refused:
        site.merge(other)


@pytest.mark.slow
def test_maps_of_different_places_are_not_merged(path: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.fsmap"
    build(other, frames(RETURN[:5], 200, place=13), "elsewhere")
    with PlaceMap.open(path) as site:
        merge = site.merge(other)
        assert merge.sessions == () and not merge.believed
        assert merge.reason is not None and merge.reason.code == "few-merges"
        assert [each.name for each in site.sessions] == ["monday"]
