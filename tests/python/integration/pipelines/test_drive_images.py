# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Images along a drive: rendered in the world beside a recording, and kept as templates' views."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from fusionslam.errors import ShapeError
from fusionslam.geometry.trajectory import Trajectory, write_trajectory
from fusionslam.pipelines.drive_images import template_views
from fusionslam.pipelines.drives import places_at, world_beside
from fusionslam.sensors.image_series import ImageSeries
from fusionslam.sim.rendered_images import rendered_images
from fusionslam.views.visual_templates import VisualTemplates, VisualTemplatesConfig
from rows import rows

SECONDS = np.array([0.0, 0.5, 1.0])
POSES = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.1], [0.6, 0.1, 0.2]])
SMALL = VisualTemplatesConfig(columns=12, rows=4, bottom=None, shift=2)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("FUSIONSLAM_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def house(tmp_path: Path) -> Path:
    """A room of coloured boxes, stacked and standing around, in the folder beside recordings."""
    (tmp_path / "worlds").mkdir()
    (tmp_path / "recordings").mkdir()
    rng = np.random.default_rng(1)
    room = trimesh.Scene()

    def add(low: list[float], high: list[float]) -> None:
        box = trimesh.creation.box(bounds=[low, high])
        color = [*rng.integers(0, 256, 3).tolist(), 255]
        material = trimesh.visual.material.PBRMaterial(baseColorFactor=color)
        box.visual = trimesh.visual.TextureVisuals(material=material)
        room.add_geometry(box)

    add([-6, -6, -0.1], [6, 6, 0])
    for angle in np.linspace(0, 2 * np.pi, 24, endpoint=False):
        x, y = 4 * np.cos(angle), 4 * np.sin(angle)
        for height in np.arange(0, 4, 0.25):
            add([x - 0.4, y - 0.4, height], [x + 0.4, y + 0.4, height + 0.25])
    room.export(tmp_path / "worlds" / "warehouse.glb")
    return tmp_path / "worlds" / "warehouse.glb"


def given(count: int = 5, key: str | None = "some") -> ImageSeries:
    """Images of one brightness each."""
    seconds = np.arange(count) / 10
    shades = [np.full((24, 48), 40 * i, np.uint8) for i in range(count)]
    return ImageSeries(seconds, None, shades.__getitem__, "nowhere", key)


def test_a_world_is_found_beside_the_folder_of_the_recording(house: Path) -> None:
    recordings = house.parent.parent / "recordings"
    assert world_beside(recordings / "warehouse.npz") == house.resolve()
    assert world_beside(recordings / "other.npz") is None


def test_images_are_rendered_ten_times_a_second_along_the_poses(house: Path) -> None:
    images = rendered_images(house, SECONDS, POSES)
    assert np.allclose(images.seconds, np.arange(11) / 10)
    assert images.poses is not None
    assert np.allclose(images.poses[[0, 5, 10]], POSES)
    assert images.rate_hz == pytest.approx(10)
    assert images.image(3).shape == (480, 640, 3)


def test_the_drive_beside_the_world_is_followed_between_the_scans(house: Path) -> None:
    bend = Trajectory(np.array([0.0, 0.2, 1.0]), *np.array([[0, 0.5, 0.6], [0, 0, 0], [0, 0, 0.0]]))
    write_trajectory(house.with_suffix(".trajectory.csv"), bend)
    images = rendered_images(house, SECONDS, POSES)
    assert images.poses is not None
    assert images.poses[2] == pytest.approx([0.5, 0, 0])


def test_the_upper_part_alone_shows_what_the_whole_image_shows_there(house: Path) -> None:
    whole, upper = (rendered_images(house, SECONDS, POSES, bottom=b) for b in (None, 60))
    seen, part = whole.image(4).astype(int), upper.image(4).astype(int)
    assert part.shape == (60, 640, 3)
    # All but the camera's noise is the same.
    assert np.abs(seen[:60] - part).mean() < 2.5
    assert np.abs(seen[60:120] - part).mean() > 5


def test_rendered_views_do_not_depend_on_the_number_of_threads(house: Path, cache: Path) -> None:
    images = rendered_images(house, SECONDS, POSES, bottom=60, rate_hz=4)
    config = VisualTemplatesConfig(bottom=60)
    one = template_views(replace(images, key=None), config, jobs=1)
    three = template_views(replace(images, key=None), config, jobs=3)
    assert np.array_equal(one.views, three.views)
    expected = VisualTemplates(config).view(images.image(2))
    assert np.array_equal(one.views[2], expected)


def test_views_of_rendered_images_are_kept_and_taken_again(cache: Path) -> None:
    told: list[tuple[int, int]] = []
    made = template_views(given(), SMALL, progress=lambda done, total: told.append((done, total)))
    assert told == [(n, 5) for n in range(1, 6)]

    def lost(index: int) -> np.ndarray:
        raise AssertionError("it was kept")

    kept = template_views(replace(given(), image=lost), SMALL)
    assert np.array_equal(kept.views, made.views)
    assert kept.build_ms == made.build_ms


def test_another_threshold_uses_the_kept_views_and_other_blocks_do_not(cache: Path) -> None:
    template_views(given(), SMALL)
    for changes, files in [({"threshold": 0.2}, 1), ({"rows": 6}, 2), ({"left": 4}, 3)]:
        template_views(given(), SMALL.model_copy(update=changes))
        assert len(list(cache.glob("template-views-*.npz"))) == files


def test_recorded_images_are_not_kept(cache: Path) -> None:
    template_views(given(key=None), SMALL)
    assert not cache.exists()


@rows("damage", ["cut", "text", "other"])
def test_a_damaged_file_in_the_cache_is_made_anew(cache: Path, damage: str) -> None:
    made = template_views(given(), SMALL)
    (path,) = cache.glob("*.npz")
    whole = path.read_bytes()
    if damage == "other":
        np.savez(path, views=made.views[1:], build_ms=np.array(1.0))
    else:
        path.write_bytes(whole[: len(whole) // 2] if damage == "cut" else b"no archive")
    again = template_views(given(), SMALL)
    assert np.array_equal(again.views, made.views)
    with np.load(path) as stored:
        assert np.array_equal(stored["views"], made.views)


def test_an_image_that_cannot_become_a_template_stops_the_work(cache: Path) -> None:
    tiny = replace(given(), image=lambda index: np.zeros((2, 48), np.uint8))
    with pytest.raises(ShapeError, match=r"\b48x2\b"):
        template_views(tiny, SMALL)
    assert not cache.exists()


def test_places_between_poses_turn_the_short_way() -> None:
    poses = np.array([[0, 0, np.pi - 0.1], [1, 2, -np.pi + 0.1]])
    places = places_at(np.array([0.5]), np.array([0.0, 1.0]), poses)
    assert places is not None
    assert places[0] == pytest.approx([0.5, 1.0, np.pi])
    assert places_at(np.array([0.5]), np.array([0.0, 1.0]), None) is None
