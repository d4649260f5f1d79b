# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of scans that were taken for another place."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from fusionslam.errors import DataError, ShapeError
from fusionslam.evaluation import JudgedView, RunningViews
from fusionslam.report import write_false_positive
from fusionslam.report.views.thumbnails import HEIGHT, image_preview
from rows import rows

Pixels = NDArray[np.uint8]
RED, GREEN, DARK = (220, 20, 20), (20, 200, 20), (21, 24, 29)


def image(color: tuple[int, int, int], height: int = 48, width: int = 64) -> Pixels:
    return np.tile(np.array(color, np.uint8), (height, width, 1))


def wrong() -> JudgedView:
    running = RunningViews()
    running.add(1_000_000_000, 6, (0, 0, 0))
    judged = running.add(43_500_000_000, 6, (3, 4, np.radians(100)))
    assert judged.false_positive
    return judged


def write_pair(path: Path, image: Pixels | None, matched: Pixels | bytes | None) -> Pixels:
    write_false_positive(path, wrong(), image, matched)
    with Image.open(path) as picture:
        assert picture.format == "JPEG"
        return np.asarray(picture.convert("RGB"))


def is_near(pixel: Pixels, color: tuple[int, int, int]) -> bool:
    return bool(np.abs(pixel.astype(int) - color).max() < 12)


def test_both_images_stand_side_by_side_above_a_caption(tmp_path: Path) -> None:
    pixels = write_pair(tmp_path / "new" / "pair.jpg", image(RED), image(GREEN))
    width = round(64 * HEIGHT / 48)
    assert is_near(pixels[HEIGHT // 2, width // 2], RED)
    assert is_near(pixels[HEIGHT // 2, 12 + width + width // 2], GREEN)
    caption = pixels[HEIGHT + 4 :]
    assert caption.shape[0] >= 45 and (caption < 90).all(axis=2).sum() > 300
    assert [file.name for file in (tmp_path / "new").iterdir()] == ["pair.jpg"]


def test_the_caption_tells_which_scans_match(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []

    def record_text(self: Any, place: Any, text: str, *more: Any, **options: Any) -> None:
        said.append(text)

    monkeypatch.setattr("PIL.ImageDraw.ImageDraw.text", record_text)
    write_pair(tmp_path / "pair.jpg", image(RED), None)
    assert said == [
        "no image of scan 0",
        "left: scan 1 at 43.50 s, recognised as view 6",
        "right: scan 0 at 1.00 s, the first of view 6",
        "5.00 m, 100 degrees and 42.5 s apart",
    ]


@rows("images", [(None, image(GREEN)), (image(RED), None), (None, None)])
def test_an_image_that_is_missing_is_said_to_be(
    images: tuple[Pixels | None, Pixels | None], tmp_path: Path
) -> None:
    pixels = write_pair(tmp_path / "pair.jpg", *images)
    right = 12 + (300 if images[0] is None else round(64 * HEIGHT / 48))
    for start, shown, color in ((0, images[0], RED), (right, images[1], GREEN)):
        half = pixels[:HEIGHT, start : start + 200]
        assert is_near(half[9, 9], DARK if shown is None else color)
        words = half[HEIGHT // 2 - 8 : HEIGHT // 2 + 8]
        assert ((words > 130).all(axis=2).sum() > 30) == (shown is None)


def test_previews_stand_for_the_images_they_were_made_of(tmp_path: Path) -> None:
    kept = image_preview(image(GREEN))
    assert len(kept) < image(GREEN).nbytes
    whole = write_pair(tmp_path / "whole.jpg", image(RED), image(GREEN))
    assert np.array_equal(write_pair(tmp_path / "kept.jpg", image(RED), kept), whole)


@rows("shape", [(48, 64), (1, 1, 3), (1, 9000), (9000, 1, 3), (480, 640, 3)])
def test_grey_small_and_odd_images_are_shown(shape: tuple[int, ...], tmp_path: Path) -> None:
    odd = np.full(shape, 128, np.uint8)
    pixels = write_pair(tmp_path / "pair.JPG", odd, np.asfortranarray(odd[::-1]))
    assert pixels.shape[0] > HEIGHT and pixels.shape[1] < 6000


@rows(
    "odd",
    [
        np.zeros((4, 4)),
        np.zeros((4, 4, 4), np.uint8),
        np.zeros(4, np.uint8),
        np.zeros((0, 4, 3), np.uint8),
    ],
)
def test_what_is_no_image_is_refused_and_nothing_written(odd: Any, tmp_path: Path) -> None:
    with pytest.raises(ShapeError, match="matched_image"):
        write_false_positive(tmp_path / "pair.jpg", wrong(), image(RED), odd)
    assert not list(tmp_path.iterdir())


def test_scans_without_a_match_and_bad_paths_are_refused(tmp_path: Path) -> None:
    alone = replace(wrong(), matched=None, matched_stamp_ns=None)
    with pytest.raises(DataError, match="scan 1"):
        write_false_positive(tmp_path / "pair.jpg", alone, None, None)
    with pytest.raises(DataError, match=r"pair\.gif"):
        write_false_positive(tmp_path / "pair.gif", wrong(), None, None)
    (tmp_path / "file").write_text("")
    with pytest.raises(DataError, match=str(tmp_path / "file")):
        write_false_positive(tmp_path / "file" / "pair.jpg", wrong(), None, None)
