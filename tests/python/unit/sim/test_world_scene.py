# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What loaded worlds ask of the ray caster: objects, textures of any size or none, even light."""

import numpy as np
import pytest

pytest.importorskip("embreex", reason="the simulator is an extra")

from fusionslam.sim.mesh import Mesh, Paint, panels
from fusionslam.sim.mipmaps import MipMaps
from fusionslam.sim.scene import INDOOR_LIGHT, RayCaster, Scene
from fusionslam.sim.world import Part, scene_of

DOWN = np.array([[0, 0, -1]], np.float32)


def tile(x: float, z: float = 0.0, texture: int = 0, tint: tuple[float, ...] = (1, 1, 1)) -> Mesh:
    """A level square metre whose lower left corner is at (x, 0, z)."""
    corners = [[(x, 0, z), (x + 1, 0, z), (x + 1, 1, z), (x, 1, z)]]
    return panels(corners, Paint(texture, tint))


def look_down(caster: RayCaster, *x: float, height: float = 5.0) -> np.ndarray:
    """Colours seen from above each x, (N, 3)."""
    return np.concatenate(
        [
            caster.colors(caster.cast(np.array([at, 0.4, height], np.float32), DOWN), DOWN, 1e-3)
            for at in x
        ]
    )


def test_every_ray_knows_the_object_that_it_hits() -> None:
    parts = [Part("left", tile(0)), Part("right", tile(1), is_ground=True)]
    caster = RayCaster(scene_of(parts, [], INDOOR_LIGHT))
    rays = np.array([(0.5, 0, -1), (1.5, 0, -1), (5, 0, -1), (0, 0, 1)], np.float32)
    found = caster.part_of(caster.cast(np.array([0, 0.5, 1], np.float32), rays))
    assert found.dtype == np.int32
    assert found.tolist() == [0, 1, -1, -1]
    caster = RayCaster(Scene(tile(0), []))
    hits = caster.cast(np.array([0.5, 0.5, 1], np.float32), DOWN)
    assert hits.triangle[0] >= 0 and caster.part_of(hits).tolist() == [-1]


def test_textures_of_any_size_or_none_keep_their_colours() -> None:
    white, strip, large = (
        np.full((*size, 4), 255, np.uint8) for size in ((1, 1), (1, 64), (64, 64))
    )
    strip[..., 1:3] = 0
    large[..., 0] = 0
    parts = [Part(str(number), tile(number, texture=number)) for number in range(3)]
    caster = RayCaster(scene_of(parts, [white, strip, large], INDOOR_LIGHT))
    for height in (2.0, 200.0):  # the finest texels, and past the last halving of each texture
        seen = look_down(caster, 0.5, 1.5, 2.5, height=height) > 0.5
        assert seen.tolist() == [[True] * 3, [True, False, False], [False, True, True]]
    images = [np.zeros((1024, 1024, 4), np.uint8), *[np.zeros((1, 512, 4), np.uint8)] * 50]
    whole = sum(1024 * 1024 // 4**level for level in range(11)) + 50 * 512
    assert len(MipMaps(images)._packed) == whole
    parts = [Part("red", tile(0, tint=(1, 0, 0))), Part("blue", tile(1, tint=(0, 0, 0.5)))]
    caster = RayCaster(scene_of(parts, [], INDOOR_LIGHT))
    red, blue = look_down(caster, 0.5, 1.5)
    assert red[0] > 0.9 and red[1:].max() == 0
    assert blue[2] == pytest.approx(0.5, abs=0.06) and blue[:2].max() == 0


def test_light_indoors_has_no_haze_and_an_even_sky() -> None:
    caster = RayCaster(scene_of([Part("tile", tile(0))], [], INDOOR_LIGHT))
    near, far = look_down(caster, 0.5, height=1.0), look_down(caster, 0.5, height=500.0)
    np.testing.assert_array_equal(near, far)
    rays = np.array([(0, 0, 1), (1, 0, 0.1), (0, -1, 0.5)], np.float32)
    sky = caster.colors(caster.cast(np.array([0.5, 0.5, 1], np.float32), rays), rays, 1e-3)
    np.testing.assert_allclose(sky, 0.7)


def test_indoors_no_side_is_dark_and_walls_at_right_angles_differ() -> None:
    walls = [
        ((0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)),
        ((0, 0, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1)),
    ]
    seen = []
    for wall, ray in zip(walls, ((0, 1, 0), (1, 0, 0)), strict=True):
        for side in (1.0, -1.0):
            caster = RayCaster(scene_of([Part("w", panels([wall], Paint(0)))], [], INDOOR_LIGHT))
            rays = np.array([ray], np.float32) * np.float32(side)
            origin = (np.full(3, 0.5) * (np.array(ray) == 0) - rays[0]).astype(np.float32)
            seen.append(float(caster.colors(caster.cast(origin, rays), rays, 1e-3).mean()))
    assert min(seen) > 0.6 and max(seen) <= 1.0
    assert len({round(value, 2) for value in seen}) == 3  # two face away from the lamps' tilt
