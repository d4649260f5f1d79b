# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a command may replace with its output."""

from pathlib import Path

import numpy as np

from fusionslam.pipelines.results import check_output
from refusals import refuses
from rows import rows


@rows("name", ["drive.bag.npz", "drive.mcap.csv", "matches.csv"])
def test_results_named_after_a_recording_may_be_replaced(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    if path.suffix == ".npz":
        np.savez(path, ids=np.arange(3))
    else:
        path.write_text("id\n0\n")
    check_output(path, [tmp_path / "drive.bag"])


def test_the_input_is_not_replaced_even_through_a_link(tmp_path: Path) -> None:
    source, link = tmp_path / "poses.txt", tmp_path / "link.txt"
    source.write_text("0 0 0\n")
    link.symlink_to(source)
    with refuses("output-is-input"):
        check_output(link, [source])
    check_output(tmp_path / "other.txt", [source])


@rows("name", ["x" * 300, "~nobody_of_this_name/a.csv"])
def test_names_that_cannot_be_are_left_to_whoever_writes(name: str, tmp_path: Path) -> None:
    check_output(name, [tmp_path, name + "y"])
