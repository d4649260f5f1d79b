# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Visual templates against the original's run, a naive version, and pictures made on purpose."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.views.visual_templates import TemplateMatch, VisualTemplates
from rows import rows
from stored import change_archive, check_damaged_files

SMALL = {"columns": 12, "rows": 4, "bottom": None, "shift": 2}


def picture(seed: int, shape: tuple[int, ...] = (24, 48)) -> np.ndarray:
    """Blocks of 6x4 pixels of one brightness each, and some noise."""
    rng = np.random.default_rng(seed)
    blocks = rng.integers(20, 230, (4, 12)).repeat(6, axis=0).repeat(4, axis=1)
    pixels = blocks + rng.integers(-5, 6, (24, 48))
    return np.broadcast_to(pixels.reshape(24, 48, *[1] * (len(shape) - 2)), shape).astype(np.uint8)


def flat(value: int) -> np.ndarray:
    return np.full((24, 48), value, np.uint8)


def taught() -> VisualTemplates:
    """It knows the first picture."""
    templates = VisualTemplates(**SMALL)
    templates.process(picture(1))
    return templates


def naive_ids(images: np.ndarray, *, mean_margin: float | None) -> list[int]:
    """The page RATSLAM.md in loops and doubles; without the filter of means if that is None."""
    stored: list[np.ndarray] = []
    ids = []
    for image in images:
        view = np.empty((20, 60))
        for row in range(20):
            for column in range(60):
                block = image[row * 7 : row * 7 + 7, column * 6 : column * 6 + 6]
                view[row, column] = block.mean() / 255
        best, found = np.inf, -1
        for number, other in enumerate(stored):
            if mean_margin is not None and abs(other.mean() - view.mean()) > 0.03 + mean_margin:
                continue
            for shift in range(-4, 5):
                error = np.abs(view[:, 4:56] - other[:, 4 + shift : 56 + shift]).mean()
                if error < best:
                    best, found = error, number
        if best > 0.03:
            found = len(stored)
            stored.append(view)
        ids.append(found)
    return ids


@pytest.fixture(scope="module")
def original(ratslam_reference: Path) -> tuple[np.ndarray, list[int]]:
    """Images with the blocks of those of the original's run, and the template each got."""
    sums = np.load(ratslam_reference / "lv_blocks.npz")["sums"]
    pixels = (sums[..., None] + np.arange(42)) // 42  # whose sums these are
    blocks = pixels.reshape(-1, 20, 60, 7, 6).swapaxes(2, 3).reshape(-1, 140, 360)
    images = np.pad(blocks, ((0, 0), (0, 10), (0, 0))).astype(np.uint8)
    table = np.loadtxt(ratslam_reference / "lv_output.csv", delimiter=",", skiprows=1)
    return images, table[:, 1].astype(int).tolist()


def test_every_image_gets_the_template_that_the_original_gave_it(original: Any) -> None:
    images, expected = original
    templates = VisualTemplates()
    matches = [templates.process(image) for image in images]
    assert [match.id for match in matches] == expected
    assert len(templates) == max(expected) + 1
    assert {match.relative_rotation for match in matches} == {0.0}


def test_a_naive_version_agrees_with_and_without_the_filter_of_means(original: Any) -> None:
    images, expected = original
    for mean_margin in (0.005, None):
        assert naive_ids(images[:4], mean_margin=mean_margin) == expected[:4]
    open_filter = VisualTemplates(mean_margin=1.0)
    assert [open_filter.process(image).id for image in images] == expected


def test_the_first_image_is_new_and_the_same_one_again_is_found() -> None:
    templates = VisualTemplates(**SMALL)
    assert templates.process(picture(1)) == TemplateMatch(0, 0.0, True, np.inf)
    assert templates.process(picture(2)).is_new
    assert templates.process(picture(1)) == TemplateMatch(0, 0.0, False, 0.0)


@rows("blocks, found", [(1, True), (-2, True), (2, True), (3, False), (-3, False)])
def test_an_image_moved_aside_is_found_as_far_as_the_shift_reaches(
    blocks: int, found: bool
) -> None:
    wide = np.hstack([picture(1), picture(2), picture(3)])
    templates = VisualTemplates(**SMALL)
    templates.process(np.ascontiguousarray(wide[:, 48:96]))
    moved = np.ascontiguousarray(wide[:, 48 + 4 * blocks : 96 + 4 * blocks])
    assert templates.process(moved).is_new is not found


@rows("step, found", [(1, True), (2, False)])
def test_steps_leave_out_the_shifts_between(step: int, found: bool) -> None:
    wide = np.hstack([picture(1), picture(2)])
    templates = VisualTemplates(**SMALL, step=step)
    templates.process(np.ascontiguousarray(wide[:, :48]))
    assert templates.process(np.ascontiguousarray(wide[:, 4:52])).is_new is not found


def test_the_first_of_equally_near_templates_matches() -> None:
    templates = VisualTemplates(**SMALL, threshold=0.01, mean_margin=1.0)
    for value in (100, 110, 105):
        match = templates.process(flat(value))
    assert match == TemplateMatch(2, 0.0, True, pytest.approx(5 / 255))
    between = VisualTemplates(**SMALL, threshold=5.5 / 255, mean_margin=1.0)
    assert [between.process(flat(value)).id for value in (100, 110, 105)] == [0, 1, 0]


def test_a_match_is_an_error_up_to_the_threshold_and_not_above() -> None:
    error = float(np.float32(0.2))
    for threshold, found in ((error, True), (float(np.nextafter(error, 0)), False)):
        templates = VisualTemplates(**SMALL, threshold=threshold)
        templates.process(flat(0))
        assert templates.process(flat(51)).is_new is not found


def test_a_template_of_another_mean_is_passed_over() -> None:
    templates = VisualTemplates(**SMALL, mean_margin=0.0)
    templates.process(flat(0))
    assert templates.process(flat(51)).error == np.inf
    assert VisualTemplates(**SMALL, mean_margin=1.0).process(flat(0)).error == np.inf


def test_only_the_crop_counts() -> None:
    changed = picture(1)
    changed[20:], changed[:, 44:] = 0, 255
    templates = VisualTemplates(columns=11, rows=5, bottom=20, right=44, shift=1)
    templates.process(picture(1))
    assert templates.process(changed).error == 0


def test_colours_count_by_their_luminance() -> None:
    red, grey = np.zeros((24, 48, 3), np.uint8), flat(76)
    red[..., 0] = 255
    templates = VisualTemplates(**SMALL)
    templates.process(red)
    assert templates.process(grey).error == pytest.approx(0.299 - 76 / 255, abs=1e-6)


@rows("blocks, radians", [(0, 0), (3, np.pi / 2), (-3, -np.pi / 2)])
def test_a_panorama_tells_how_far_the_robot_turned_left(blocks: Any, radians: Any) -> None:
    templates = VisualTemplates(**SMALL, panoramic=True)
    templates.process(picture(1))
    match = templates.process(np.roll(picture(1), 4 * blocks, axis=1))
    assert (match.id, match.is_new, match.error) == (0, False, 0.0)
    assert match.relative_rotation == pytest.approx(radians)


def test_scaling_the_mean_takes_away_differences_of_exposure() -> None:
    dark = picture(1) // 2
    plain, scaled = VisualTemplates(**SMALL), VisualTemplates(**SMALL, mean=0.3)
    for templates, is_new in [(plain, True), (scaled, False)]:
        templates.process(picture(1))
        assert templates.process(dark).is_new is is_new
    assert scaled.templates.mean() == pytest.approx(0.3, abs=1e-3)
    assert not VisualTemplates(**SMALL, mean=0.3).process(flat(0)).relative_rotation


def test_patches_are_normalised_as_in_plain_loops() -> None:
    templates = VisualTemplates(**SMALL, patch=3)
    templates.process(picture(1))
    blocks = picture(1).reshape(4, 6, 12, 4).mean(axis=(1, 3)) / 255
    for row in range(4):
        for column in range(12):
            patch = blocks[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
            expected = ((blocks[row, column] - patch.mean()) / patch.std() + 3) / 6
            assert templates.templates[0, row, column] == pytest.approx(expected, abs=1e-6)
    without_contrast = VisualTemplates(**SMALL, patch=3)
    without_contrast.process(flat(33))
    assert np.all(without_contrast.templates == 0.5)


@rows("half", [0, 20])
def test_a_saved_run_goes_on_as_if_it_had_never_stopped(half: int, tmp_path: Path) -> None:
    images = [picture(seed % 30) for seed in range(50)]
    whole, parts = VisualTemplates(**SMALL), VisualTemplates(**SMALL)
    expected = [whole.process(image) for image in images]
    first = [parts.process(image) for image in images[:half]]
    parts.save(tmp_path / "templates.npz")
    restored = VisualTemplates.load(tmp_path / "templates.npz")
    assert first + [restored.process(image) for image in images[half:]] == expected
    assert np.array_equal(restored.templates, whole.templates)
    assert restored.config == whole.config
    assert restored.bytes_per_view == 12 * 4 * 4


@rows(
    "image, message",
    [
        (np.zeros((24, 48), np.float32), r"float32 \(24, 48\)"),
        (np.zeros((24, 48, 4), np.uint8), r"\(24, 48, 4\)"),
        (np.zeros((24,), np.uint8), r"\(24,\)"),
        (np.zeros((3, 48), np.uint8), "48x3.*12x4"),
        (np.zeros((0, 0), np.uint8), "0x0"),
    ],
)
def test_images_that_cannot_become_templates_are_refused(image: Any, message: str) -> None:
    templates = VisualTemplates(**SMALL)
    with pytest.raises(ShapeError, match=message):
        templates.process(image)
    assert templates.process(picture(1)).is_new


def test_images_of_another_size_than_before_or_than_the_crop_are_refused() -> None:
    templates = taught()
    with pytest.raises(ShapeError, match=r"48x23.*48x24"):
        templates.process(picture(1)[:23])
    assert templates.process(picture(1)).id == 0
    with pytest.raises(ShapeError, match=r"48x24.*48x150"):
        VisualTemplates().process(picture(1))


@rows(
    "changes, message",
    [
        ({"columns": 8, "shift": 4}, r"shift .*\b4"),
        ({"patch": 4}, r"patch .*\b4"),
        ({"threshold": 2.0}, "threshold"),
        ({"treshold": 0.1}, "treshold"),
    ],
)
def test_a_configuration_without_sense_is_refused(changes: Any, message: Any) -> None:
    with pytest.raises(ConfigError, match=message):
        VisualTemplates(**changes)


@rows(
    "change, arrays, message",
    [
        ({"format": "fusionslam.visual_templates.0"}, {}, "visual_templates.0"),
        ({"config": {"columns": 13}}, {}, "float32"),
        ({"config": {"colums": 12}}, {}, "colums"),
        ({"image_shape": "large"}, {}, "templates.npz"),
        ({}, {"templates": np.full((1, 48), np.nan, np.float32)}, "finite"),
    ],
)
def test_files_that_do_not_fit_are_refused(
    change: Any, arrays: Any, message: str, tmp_path: Path
) -> None:
    path = tmp_path / "templates.npz"
    taught().save(path)
    change_archive(path, lambda about, _: about.update(change), **arrays)
    with pytest.raises(DataError, match=message):
        VisualTemplates.load(path)


def test_files_that_are_no_templates_are_refused_by_name(tmp_path: Path) -> None:
    taught().save(tmp_path / "templates.npz")
    check_damaged_files(tmp_path / "templates.npz", VisualTemplates.load)


def test_the_view_of_an_image_can_be_recognised_later() -> None:
    whole, parts = VisualTemplates(**SMALL), VisualTemplates(**SMALL)
    images = [picture(seed % 3) for seed in range(6)]
    views = [parts.view(image) for image in images]
    assert len(parts) == 0
    assert [parts.recognise(view) for view in views] == [whole.process(i) for i in images]
    with pytest.raises(ShapeError, match=r"\(47,\).*\(48,\)"):
        parts.recognise(views[0][1:])


@rows("panoramic", [False, True])
def test_comparing_what_may_be_nearest_finds_the_nearest(panoramic: bool) -> None:
    rng = np.random.default_rng(5)
    base = [picture(seed) for seed in range(6)]
    turned = [np.roll(base[rng.integers(6)], 4 * rng.integers(-3, 4), axis=1) for _ in range(30)]
    templates = VisualTemplates(**SMALL, panoramic=panoramic, mean_margin=1.0, threshold=0.02)
    for image in turned:
        image += np.uint8(rng.integers(9))
        expected = nearest(templates.view(image), templates, panoramic)
        assert templates.process(image).error == pytest.approx(expected, abs=1e-7)


def nearest(view: np.ndarray, templates: VisualTemplates, panoramic: bool) -> float:
    """The least error over all templates and shifts, each compared in full."""
    current, best = view.reshape(12, 4).T, np.inf
    for stored in templates.templates:
        for moved in range(12) if panoramic else range(-2, 3):
            if panoramic:
                apart = np.roll(current, -moved, axis=1) - stored
            else:
                apart = current[:, 2:10] - stored[:, 2 - moved : 10 - moved]
            best = min(best, np.abs(apart).mean())
    return best
