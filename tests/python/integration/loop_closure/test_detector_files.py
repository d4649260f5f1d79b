# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""LoopDetector: goes on after it was saved or pickled, refuses damaged files."""

import pickle
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from detector_places import DRIVE, SECOND
from fusionslam import DataError, LoopDetector
from refusals import refuses
from rows import rows
from stored import change_archive


@rows("descriptor", ["m2dp", "cshot", "scan_context", "cscan_context", "bev_spectrum"])
def test_a_saved_or_pickled_detector_goes_on_exactly(tmp_path: Path, descriptor: str) -> None:
    whole = LoopDetector(descriptor, threshold=0.5, window=2, window_seconds=1.5)
    part = LoopDetector(descriptor, threshold=0.5, window=2, window_seconds=1.5)
    for number, cloud in enumerate(DRIVE):
        if number in (1, 6, 13):
            part.save(tmp_path / "loops")
            part = LoopDetector.load(tmp_path / "loops")
        if number in (0, 9):
            part = pickle.loads(pickle.dumps(part))
            assert part.nearest == whole.nearest
        assert len(part) == number
        stamp = number * SECOND
        assert part.add(cloud, stamp_ns=stamp) == whole.add(cloud, stamp_ns=stamp)
        assert part.nearest == whole.nearest
    assert part.config == whole.config and part.fusion_config == whole.fusion_config
    assert part.describe_config == whole.describe_config


@cache
def pickled_detector() -> bytes:
    detector = LoopDetector("m2dp", window=2)
    for cloud in DRIVE[:5]:
        detector.add(cloud)
    return pickle.dumps(detector)


def save_detector(folder: Path) -> Path:
    pickle.loads(pickled_detector()).save(folder)
    return folder


def test_a_save_that_is_cut_off_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = save_detector(tmp_path / "loops")
    before = LoopDetector.load(folder)
    before.add(DRIVE[7])

    def cut_off(*_: object, **__: object) -> str:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("fusionslam.base.archive.json.dumps", cut_off)
        with pytest.raises(KeyboardInterrupt):
            before.save(folder)
    after = LoopDetector.load(folder)
    assert len(after) == len(before) - 1
    before.save(folder)
    assert len(LoopDetector.load(folder)) == len(before)


def test_an_empty_detector_has_nothing_to_save(tmp_path: Path) -> None:
    with refuses("empty"):
        LoopDetector().save(tmp_path)


def test_an_output_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(DataError):
        save_detector(tmp_path / "file" / "loops")


def test_a_folder_that_is_no_detector_is_refused(tmp_path: Path) -> None:
    with refuses("missing-file", str(tmp_path / "nowhere/detector.npz")):
        LoopDetector.load(tmp_path / "nowhere")
    (tmp_path / "detector.npz").write_text("[1, 2]")
    with refuses("damaged-file", str(tmp_path / "detector.npz")):
        LoopDetector.load(tmp_path)


@rows(
    "changes, arrays",
    [
        ({"format": "fusionslam.loop_detector.99"}, {}),
        ({"descriptor": "m3dp"}, {}),
        *[({"loop_closure": value}, {}) for value in ({"windw": 3}, {"window": -1}, None)],
        ({"fusion": 3}, {}),
        ({"frames": 4}, {}),
        # Arrays that do not belong together.
        ({}, {"numbers": np.array([0, 1, 2, 2, 3])}),
        ({}, {"numbers": np.array([-1, 1, 2, 3, 4])}),
        ({}, {"stamps_ns": np.zeros(4, np.int64)}),
        ({}, {"descriptors": np.zeros((4, 192), np.float32)}),
        ({}, {"descriptors": np.full((5, 192), np.nan, np.float32)}),
    ],
)
def test_a_detector_of_another_version_or_kind_is_refused(
    tmp_path: Path, changes: Any, arrays: Any
) -> None:
    path = save_detector(tmp_path) / "detector.npz"
    change_archive(path, lambda about, _: about.update(changes), **arrays)
    with pytest.raises(DataError, match=r"detector\.npz"):
        LoopDetector.load(tmp_path)


def test_a_file_cut_in_half_is_refused(tmp_path: Path) -> None:
    path = save_detector(tmp_path) / "detector.npz"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with refuses("damaged-file", str(path)):
        LoopDetector.load(tmp_path)
