# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The test data, which is no part of the project: FUSIONSLAM_TEST_DATA names its folder."""

import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
WORLDS = ("small_house", "warehouse")


def data_folder() -> Path:
    """For what makes no sense without it: ends the program where it is not there."""
    folder = find_folder()
    if not (folder / "kitti").is_dir():
        sys.exit(f"{folder} holds no kitti/: FUSIONSLAM_TEST_DATA must name the test data")
    return folder


def world_files() -> dict[str, Path]:
    """The worlds that are there, by name."""
    files = {name: find_folder() / "worlds" / f"{name}.glb" for name in WORLDS}
    return {name: file for name, file in files.items() if file.is_file()}


def find_folder() -> Path:
    """Return where the test data should be."""
    return Path(os.environ.get("FUSIONSLAM_TEST_DATA", ROOT.parent / "shared" / "data"))
