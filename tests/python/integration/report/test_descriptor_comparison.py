# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Descriptors side by side: presets, verification and cost in one table, over recordings."""

import csv
import itertools
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from descriptor_runs import descriptor_run
from fusionslam.evaluation import DescriptorRun, Evaluation, evaluate, evaluate_verified
from fusionslam.report.loops.comparison import (
    comparison_table,
    draw_costs,
    mean_and_range,
    pair_up,
    table_over,
    tables_over,
    write_comparison,
    write_several,
)
from fusionslam.report.page.figures import use_style
from pages import read_page
from verified import PLACES, verified_run

PRESETS = ("robust", "author")


def described(preset: str, *, seed: int = 0, poses: bool = True, **change: Any) -> DescriptorRun:
    """c-M2DP of the nine frames; of one preset the place itself, of the other noise."""
    verified, count = verified_run(), len(PLACES)
    vectors = np.random.default_rng(seed).normal(size=(count, 4))
    if preset == "robust":
        vectors[:, :2] = [place[:2] for place in PLACES]
        vectors[:, 2:] = 0.1
    fields: dict[str, Any] = {
        "descriptor": "cm2dp",
        "dataset": "nine frames",
        "stamps_ns": verified.stamps_ns,
        "poses": verified.poses if poses else None,
        "seconds": {"describe": np.full(count, 0.02), "match": np.full(count, 0.001)},
        "points": verified.points,
        "config": {"descriptors": {"preset": preset}},
    }
    return descriptor_run(vectors, **(fields | change))


def evaluated(seed: int = 0) -> list[Evaluation]:
    """Both presets, and the verified loops of each of them and of a detector with voters."""
    plain = [evaluate(described(preset, seed=seed), window=0) for preset in PRESETS]
    names = (("cm2dp",), ("cm2dp:author",), ("cm2dp", "scan_context"))
    proven = [evaluate_verified(verified_run(descriptors=each), window=0) for each in names]
    return [*plain, *proven]


def cells(table: Any) -> dict[str, dict[str, str]]:
    """Texts by row and column."""
    heads = [title for title, _ in table.heads]
    return {
        label: dict(zip(heads, (cell.text for cell in row), strict=True))
        for label, row in table.rows
    }


def test_presets_stand_side_by_side_with_the_loops_of_each_alone() -> None:
    found = cells(comparison_table(pair_up(evaluated()), "revisit"))
    assert [*found] == ["cm2dp robust", "cm2dp author"]
    robust = found["cm2dp robust"]
    assert robust["top-1"] == "1.000"
    assert robust["opposite"] == robust["same way"] == "1.000"
    assert (robust["bytes"], robust["make ms"], robust["compare ms"]) == ("16", "20.0", "1.00")
    assert robust["MiB"] == "3.0"
    # The same loops were verified whoever proposed them.
    for row in found.values():
        assert (row["loops"], row["wrong"]) == ("3", "1")
        assert row["top-1 ver."] == "1.000"
    both = pair_up(evaluated())
    names = [each.verified.run.name for each in both if each.verified is not None]
    assert names == ["verified cm2dp", "verified cm2dp:author"]
    voted = pair_up([*evaluated()[:2], evaluated()[-1]])
    assert [each.verified for each in voted] == [None, None]
    assert "loops" not in dict(comparison_table(voted, "revisit").heads)


def test_a_cell_over_recordings_is_the_mean_of_those_there_are_and_the_range() -> None:
    assert mean_and_range([0.5]) == "0.500"
    assert mean_and_range([0.2, 0.7, 0.3]) == "0.400 (0.200 to 0.700)"
    assert mean_and_range([768.0, 768.0], "{:,.0f}") == "768"
    first, second = pair_up(evaluated(0)), pair_up(evaluated(1))
    tops = [each[1].plain.curves["revisit"].top1 for each in (first, second)]
    assert None not in tops and tops[0] != tops[1]
    found = cells(table_over([first, second], "revisit"))
    assert found["cm2dp author"]["top-1"] == mean_and_range([float(str(top)) for top in tops])
    assert found["cm2dp robust"]["top-1"] == "1.000"
    whole, part = pair_up(evaluated()), pair_up(evaluated())[:1]
    found = cells(table_over([part, whole], "revisit"))
    assert [*found] == ["cm2dp robust", "cm2dp author"]
    assert "to" not in found["cm2dp author"]["top-1"]


def test_the_csv_holds_one_line_per_recording_and_descriptor(tmp_path: Path) -> None:
    recordings = {f"town {seed}": pair_up(evaluated(seed)) for seed in (1, 2)}
    path = write_comparison(tmp_path, recordings, "revisit")
    rows = list(csv.DictReader(path.open()))
    keys = [(row["recording"], row["source"], row["descriptor"]) for row in rows]
    named = itertools.product(("town 1", "town 2"), ("lidar",), ("cm2dp", "cm2dp:author"))
    assert keys == list(named)
    top = recordings["town 2"][1].plain.curves["revisit"].top1
    assert float(rows[3]["top-1"]) == top


def test_the_picture_has_a_mark_for_each_descriptor_of_each_figure() -> None:
    with use_style():
        figure = draw_costs([pair_up(evaluated())], "revisit")
        assert len(figure.axes) == 3
        for axis in figure.axes:
            assert [text.get_text() for text in axis.texts] == ["cm2dp robust", "cm2dp author"]
            assert axis.collections[0].get_offsets()[0][0] == pytest.approx(21)
        untrue = evaluate(described("robust", poses=False), window=0)
        assert draw_costs([pair_up([untrue])], "revisit") is None


def test_the_page_over_recordings_has_a_table_for_each_source(
    tmp_path: Path, unrendered: None
) -> None:
    recordings = {}
    for seed in (1, 2):
        cloud = evaluate(replace(described("robust", seed=seed), source="cloud"), window=0)
        recordings[f"town {seed}"] = [*evaluated(seed), cloud]
    assert [*tables_over(recordings, "revisit")] == ["LiDAR-camera", "LiDAR, full circle"]
    page = write_several(tmp_path, recordings, protocol="revisit", command="bench", config={})
    assert page.name == "comparison.html"
    assert "cm2dp author" in page.read_text() and read_page(page)
    assert (tmp_path / "accuracy_cost.png").exists() and (tmp_path / "comparison.csv").exists()
    plain = write_several(
        tmp_path / "csv", recordings, protocol="revisit", command="", config={}, page=False
    )
    assert [path.name for path in plain.parent.iterdir()] == ["comparison.csv"]
