# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of the benchmarks of loops, against figures counted by hand."""

from benchmarks.accuracy.verified_loops import ALL, HEADER, figures_of, rows
from fusionslam.evaluation import evaluate_verified
from verified import verified_run


def test_figures_are_the_mean_and_range_over_towns_by_direction() -> None:
    town = evaluate_verified(verified_run(), window=0)
    # Another town, without the crossing revisit, whose last loop is wrong by pose, too.
    poses = verified_run().match_from_query.copy()
    poses[8, 0, 3] += 3
    other = verified_run(match_from_query=poses).only(town.run.frames[[0, 1, 2, 3, 4, 5, 6, 8]])
    towns = [[town], [evaluate_verified(other, window=0)]]
    shown = {(row[2], row[3]): dict(zip(HEADER[4:], row[4:], strict=True)) for row in rows(towns)}
    full = shown["pose-2m-5deg", "recall at 100 % precision"]
    assert full[ALL] == "0.250 (0.000 to 0.500)"
    assert full["opposite"] == "0.500 (0.000 to 1.000)"
    assert full["crossing"] == "0.000"  # of the first town alone
    assert shown["pose-2m-5deg", "top-1"]["opposite"] == "1.000 (1.000 to 1.000)"
    assert shown["pose-2m-5deg", "wrong ones accepted"] == {
        ALL: "0.500 (0.000 to 1.000)",
        **dict.fromkeys(("same", "opposite", "crossing"), ""),
    }
    assert figures_of(town)["pose-1m-5deg", "recall of the accepted"] == {
        ALL: 0.25,
        "same": 0,
        "opposite": 0.5,
        "crossing": 0,
    }
