# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The two worlds of the test data, as glTF and as SDF: the same triangles, ranges and pictures."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("embreex", reason="the simulator is an extra")
pytest.importorskip("collada", reason="the simulator is an extra")

from benchmarks.accuracy.worlds import eyes, pictures, same_ranges
from fusionslam.sim.scene import RayCaster
from fusionslam.sim.world import World
from fusionslam.sim.worlds import load_world

COUNTS = {"small_house": (148_404, 6_689), "warehouse": (17_970, 938)}
PLACES = 6


@pytest.fixture(params=sorted(COUNTS))
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def pair(test_data: Path, name: str) -> tuple[World, World]:
    """A world from glTF and from SDF."""
    return loaded(test_data, name)


@cache
def loaded(test_data: Path, name: str) -> tuple[World, World]:
    folder = test_data / "worlds_sdf" / name
    if not folder.is_dir():
        pytest.skip(f"no {folder}")
    return load_world(test_data / "worlds" / f"{name}.glb"), load_world(folder)


@cache
def caster(test_data: Path, name: str, form: int, kind: str) -> RayCaster:
    """Of the visual or collision shapes of the world from glTF (form 0) or SDF (1)."""
    return RayCaster(getattr(loaded(test_data, name)[form], kind))


def test_triangles_are_all_there(pair: tuple[World, World], name: str) -> None:
    for world in pair:
        assert (len(world.visual.mesh), len(world.collision.mesh)) == COUNTS[name]
        assert world.unresolved == ()


def test_both_files_name_the_same_objects_and_the_same_ground(pair: tuple[World, World]) -> None:
    for first, second in ((w.visual, w.collision) for w in pair):
        assert any(first.ground) and any(second.ground)
    for kind in ("visual", "collision"):
        a, b = (getattr(world, kind) for world in pair)
        assert sorted(zip(a.names, a.ground, strict=True)) == sorted(
            zip(b.names, b.ground, strict=True)
        )


@pytest.mark.parametrize("kind", ["visual", "collision"])
def test_both_files_give_the_same_ranges(
    pair: tuple[World, World], test_data: Path, name: str, kind: str
) -> None:
    first, second = (caster(test_data, name, form, kind) for form in range(2))
    found = same_ranges(first, second, getattr(pair[0], kind), eyes(pair[0], 0.17, PLACES))
    assert found.counted.mean() > 0.98
    assert found.same[found.counted].mean() >= 0.999


def test_both_files_give_pictures_that_look_alike(
    pair: tuple[World, World], test_data: Path, name: str
) -> None:
    casters = [caster(test_data, name, form, "visual") for form in range(2)]
    for eye in eyes(pair[0], 0.103, PLACES):
        a, b = pictures(casters, eye)
        assert np.abs(a - b).mean() < 3  # the glTF files hold JPEG pictures, the models PNG
        np.testing.assert_allclose(a.mean(axis=0), b.mean(axis=0), atol=2)
        assert a.std() > 10  # there is something to be seen


@pytest.mark.parametrize("kind", ["visual", "collision"])
def test_ranges_agree_with_those_that_another_simulator_recorded(
    test_data: Path, name: str, kind: str
) -> None:
    recorded = np.load(test_data / "recordings" / f"{name}.npz")
    offsets = recorded[f"{kind}_offsets"]
    simulated = caster(test_data, name, 1, kind)
    gaps = []
    for scan in range(0, len(offsets) - 1, 100):
        x, y, yaw = recorded["poses"][scan]
        turn = np.array([(np.cos(yaw), -np.sin(yaw), 0), (np.sin(yaw), np.cos(yaw), 0), (0, 0, 1)])
        chosen = slice(offsets[scan], offsets[scan + 1])
        rays = (recorded["rays"][recorded[f"{kind}_ray"][chosen]] @ turn.T).astype(np.float32)
        origin = (turn @ recorded["lidar_xyz"] + [x, y, 0]).astype(np.float32)
        measured = recorded[f"{kind}_range_mm"][chosen] / 1000
        gaps.append(simulated.cast(origin, rays).distance - measured)
    gap = np.concatenate(gaps)
    near = np.abs(gap) < 0.04  # five sigma of its noise, 8 mm
    assert near.mean() > 0.998
    assert gap[near].std() == pytest.approx(0.008, abs=0.001)
    assert abs(gap[near].mean()) < 0.001
