# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``fusionslam ros launch bag`` finds the topics of a bag by type."""

from pathlib import Path

import pytest

from bags import drive, write_bag
from fusionslam.errors import DataError
from fusionslam.ros.ros1.files import guess_bag_topics


@pytest.fixture
def bag(tmp_path: Path) -> str:
    write_bag(tmp_path / "drive.bag", drive())
    return f"bag:={tmp_path / 'drive.bag'}"


def test_topics_with_other_names_are_guessed_by_type(bag: str) -> None:
    guessed = ["scan:=/points", "image:=/camera/image", "camera_info:=/camera/camera_info"]
    assert guess_bag_topics([bag, "rate:=2", "--screen"]) == guessed


def test_topics_that_are_given_are_left_as_they_are(bag: str) -> None:
    given = [bag, "scan:=points", "image:=/nope", "odom:=/no"]
    assert guess_bag_topics(given) == ["camera_info:=/camera/camera_info"]


def test_without_a_bag_nothing_is_guessed_and_a_missing_one_is_named(tmp_path: Path) -> None:
    assert guess_bag_topics(["scan:=/points"]) == []
    with pytest.raises(DataError, match=r"nothing\.bag"):
        guess_bag_topics([f"bag:={tmp_path / 'nothing.bag'}"])
