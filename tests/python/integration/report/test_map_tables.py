# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of the report of maps: refused loops, misfits of links, step times, configurations."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fusionslam.evaluation import judge_map
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.ratslam import RatSlamConfig
from fusionslam.report.maps.aligned_run import Scene, find_denied, measure_misfits, scene_of
from fusionslam.report.maps.config_table import config_table
from fusionslam.report.maps.sections import summarise_run
from fusionslam.report.maps.tables import error_table, joins_table, loop_table, refusals
from fusionslam.report.maps.times import busy_ms, cost_table, draw_step_times
from maps import CORNERS, alone, drifting_run, little_run, wrong_run

pytest.importorskip("matplotlib")


def scene(run: RatSlamRun) -> Scene:
    return scene_of(run, judge_map(run))


def agreed_run(**changes: Any) -> RatSlamRun:
    """The square; the loop to the first corner was refused, and linked when another agreed."""
    actions = [(1, max(k - 1, 0), k) for k in range(5)] + [(2, 4, 1), (2, 1, 2), (2, 2, 3)]
    nodes = [*CORNERS, CORNERS[0]]
    given: dict[str, Any] = {
        "actions": actions,
        "nodes": nodes,
        "links": [(0, 1), (1, 2), (2, 3), (3, 4), (3, 0), (4, 1)],
        "refused": [(120.0, 3, 0), (150.0, 4, 2)],
    }
    return drifting_run(**given | changes)


def test_a_refusal_is_judged_and_one_that_was_linked_later_is_not_held_against_the_map() -> None:
    run = agreed_run()
    assert find_denied(run).tolist() == [False, True]
    assert refusals(scene(run)) == ["linked later", "false: prevented"]
    lost = agreed_run(refused=[(180.0, 4, 2)])
    assert refusals(scene(lost)) == ["right: lost"]
    blind = agreed_run(truth=None)
    assert refusals(scene(blind)) == ["linked later", "\N{EN DASH}"]


def test_a_loop_that_was_linked_later_is_a_loop() -> None:
    found = scene(agreed_run())
    assert found.made.tolist() == [-1, -1, -1, -1, 4, 5] and not found.false.any()
    table = loop_table(found)
    assert table is not None
    verdicts = [(label, cells[-1].text) for label, cells in table.rows]
    assert verdicts == [("120.0 s", "right, refused at first"), ("150.0 s", "right")]


def test_links_that_fit_have_no_misfit_and_a_moved_node_has_its_own() -> None:
    assert np.allclose(measure_misfits(drifting_run()), 0, atol=1e-9)
    shifts = np.zeros((4, 3))
    shifts[2, :2] = (0.3, 0.4)
    run = replace(drifting_run(), nodes=drifting_run().nodes + shifts)
    assert measure_misfits(run) == pytest.approx([0, 0.5, 0.5, 0], abs=1e-9)
    table = joins_table(["moved"], [scene(run)])
    assert (table.heads[-1][0], table.rows[0][1][-1].text) == ("misfit of links, m", "0.354")


def test_terminal_and_page_count_the_same_by_the_same_words() -> None:
    start = [(0, 0, 0), (0, 0, 0), (1, 0, 0), (1, 0, 1), (1, 1, 2), (2, 2, 0)]
    truth = [CORNERS[0]] * 3 + [*CORNERS[1:3], CORNERS[2]]
    late = scene(little_run(truth, start, CORNERS[:3], [(0, 1), (1, 2), (2, 0)]))
    words = str(late.report)
    span = "90.0 s and 4 steps from the first node on, 4 looks"
    assert span in words and span in summarise_run(late)
    table = joins_table(["late"], [late])
    shown = {head: cell.text for (head, _), cell in zip(table.heads, table.rows[0][1], strict=True)}
    assert (shown["loops"], shown["arrivals"], shown["false arrivals"]) == ("1", "1", "1")
    assert (shown["right loops"], shown["refused"], shown["wrongly refused"]) == ("0.0%", "0", "0")
    lines = [line.split() for line in words.splitlines()]
    assert ["right", "loops", "0.0", "%", "0", "of", "1"] in [line[:7] for line in lines]
    assert ["false", "arrivals", "100.0", "%", "1", "of", "1,"] in [line[:7] for line in lines]
    assert "0 of 0 wrongly refused" in words
    blind = scene(drifting_run(truth=None))
    assert "4 arrivals at known nodes, 2 loops refused" in str(blind.report)


def test_without_truth_there_are_no_errors_and_fewer_columns() -> None:
    blind = scene(drifting_run(truth=None))
    assert error_table(["blind"], [blind.report]) is None
    heads = [name for name, _ in joins_table(["blind"], [blind]).heads]
    assert heads == ["loops", "arrivals", "refused", "nodes", "links", "misfit of links, m"]
    shown = joins_table(["blind", "wrong"], [blind, scene(wrong_run())])
    assert [cells[0].text for _, cells in shown.rows] == ["\N{EN DASH}", "0.0%"]


def test_step_times_are_of_the_steps_that_had_something_to_do() -> None:
    seconds = np.zeros((4, 3))
    seconds[:, 1] = 1e-3
    seconds[0, 0], seconds[:, 2] = 5e-3, (2e-3, 4e-3, 8e-3, 8e-3)
    actions = np.array([(1, 0, 0), (1, 0, 1), (0, 0, 0), (0, 0, 0)])
    run = alone(step_seconds=seconds, actions=actions, nodes=alone().nodes[:2], links=[])
    assert busy_ms(run, 0).tolist() == [5.0] and busy_ms(run, 2).tolist() == [2.0, 4.0]
    assert busy_ms(run).tolist() == pytest.approx([8.0, 5.0, 9.0, 9.0])
    table = cost_table(["a"], [run])
    assert table is not None
    shown = dict(zip((name for name, _ in table.heads), table.rows[0][1], strict=True))
    assert shown["map p50 ms"].text == "3" and shown["map p95 ms"].text == "3.9"
    assert shown["step p50 ms"].text == "8.5" and float(shown["times real time"].text) > 1e3
    figure = draw_step_times(run)
    assert figure is not None
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert words[2] == "map: p50 3, p95 3.9 ms"
    assert cost_table(["a"], [alone()]) is None and draw_step_times(alone()) is None


def test_configurations_that_are_equal_share_a_column() -> None:
    usual, other = RatSlamConfig().model_dump(mode="json"), {"gap": 2.0, "own": [1, 2]}
    runs = [alone(config=usual), alone(config=usual), alone(config=other)]
    table = config_table(["a", "b", "c"], runs)
    assert table is not None and table.heads == ["a; b", "c"]
    rows = {name: (values, meaning) for name, values, meaning in table.rows}
    meaning = RatSlamConfig.model_fields["gap"].description
    assert rows["gap"] == ([str(usual["gap"]), "2.0"], f"{meaning} (s)")
    assert rows["own"] == (["\N{EN DASH}", "[1, 2]"], "")
    assert rows["map.initial_heading"][1].endswith("(rad)")
    alike = config_table(["a", "b"], runs[:2])
    assert alike is not None and alike.heads == ["value"]
    assert config_table(["a"], [alone()]) is None
