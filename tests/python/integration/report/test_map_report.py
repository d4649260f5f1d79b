# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The report of maps opens offline, has the judge's figures, and says what it cannot show."""

import io
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from error_codes import has_code
from fusionslam.errors import DataError
from fusionslam.evaluation import judge_map
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.ratslam import RatSlamConfig
from fusionslam.report import map_figure, write_ratslam_report
from fusionslam.report.maps.aligned_run import (
    DrawnTime,
    Scene,
    find_denied,
    measure_misfits,
    new_views,
    scene_of,
)
from fusionslam.report.maps.map_figures import draw_map
from fusionslam.report.maps.page import MISSING, answer, run_labels, summarise_run
from fusionslam.report.maps.plots import (
    draw_activity,
    draw_errors,
    draw_step_times,
    draw_views,
)
from fusionslam.report.maps.tables import (
    MOST,
    busy_ms,
    config_table,
    cost_table,
    error_table,
    joins_table,
    look_table,
    loop_table,
    refusals,
    refused_table,
)
from maps import CORNERS, HALL, alone, drifting_run, little_run, nodeless, wrong_run
from pages import Page, read_page
from rows import rows

image = pytest.importorskip("PIL.Image")
pytest.importorskip("matplotlib")
pytestmark = pytest.mark.usefixtures("unrendered")
Written = tuple[Path, Page]


def judged(run: RatSlamRun) -> Scene:
    return scene_of(run, judge_map(run))


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Written:
    folder = tmp_path_factory.mktemp("maps") / "new"
    runs = [drifting_run(), wrong_run()]
    path = write_ratslam_report(folder, runs, command="ratslam <x>", notes=["A <note>."])
    page = read_page(path)
    assert page.ids and "ratslam <x>" in page.text and "A <note>." in page.text
    return folder, page


def test_the_answer_comes_first_and_against_dead_reckoning(written: Written) -> None:
    text, report = written[1].text, judge_map(drifting_run())
    best = answer(["given", "eyes"], [report, judge_map(wrong_run())])
    assert best.startswith("given") and f"{report.dead_reckoning.rmse_m:.2f} m" in best
    assert 0 < text.index(best) < text.index("dead reckoning: perfect")


def test_the_figures_are_those_of_the_judge(written: Written) -> None:
    metrics = json.loads((written[0] / "ratslam.json").read_text())
    for run, stored in zip((drifting_run(), wrong_run()), metrics["runs"], strict=True):
        assert stored == json.loads(json.dumps(judge_map(run).metrics()))
    wrong = judge_map(wrong_run())
    assert wrong.false_loops == 1 and wrong.nodes is not None
    table = (written[0] / "ratslam.html").read_text("utf-8").split("</table>")[0]
    rows = re.findall(r"<tr><th scope=\"row\">(.*?)</th>(.*?)</tr>", table, flags=re.DOTALL)
    assert [label for label, _ in rows] == ["dead reckoning: perfect", "given", "eyes"]
    assert f">{wrong.nodes.rmse_m:.3f}<" in rows[2][1]


def test_names_of_pictures_are_short_and_differ_where_runs_differ(tmp_path: Path) -> None:
    odometry = "truth with errors: scale 1.02, rotation scale 1.01, seed"
    runs = [replace(drifting_run(), odometry=f"{odometry} {seed}") for seed in (1, 2)]
    page = read_page(write_ratslam_report(tmp_path, runs))
    names = [path.name for path in tmp_path.glob("*.png")]
    assert all(len(name) < 70 for name in names)
    assert len([name for name in names if name.startswith("ratslam_map_")]) == 2
    assert f"{odometry} 2" in page.text
    # The same runs have the same names again.
    write_ratslam_report(tmp_path, runs)
    assert sorted(path.name for path in tmp_path.glob("*.png")) == sorted(names)


def test_every_picture_of_the_page_lies_beside_it(written: Written) -> None:
    kinds = {path.name.split("_")[1] for path in written[0].glob("*.png")}
    assert kinds == {"map", "maps", "errors", "views", "cells", "way", "times"}
    pictures = [address for address in written[1].addresses if address.startswith("data:image/")]
    assert len(pictures) == len(list(written[0].glob("*.png")))
    for path in written[0].glob("*.png"):
        with image.open(path) as picture:
            picture.load()
            assert picture.width > 600 and path.stat().st_size < 300_000


def test_loops_and_refusals_are_listed_with_what_was_wrong(written: Written) -> None:
    text = written[1].text
    for run in (drifting_run(), wrong_run()):
        assert summarise_run(judged(run)) in text
    assert "odometry stopped for 3.0 s" in text
    table = loop_table(judged(wrong_run()))
    ((when, cells),) = table.rows
    assert [when, *(cell.text for cell in cells)] == ["90.0 s", "2", "0", "14.14", "172", "false"]
    refused = refused_table(judged(drifting_run()))
    assert refused is not None and refused.rows[0][0] == "120.0 s"
    assert [cell.text for cell in refused.rows[0][1]] == [
        *("3", "1", "1.00", "0.50", "5.7", "11.5"),
        *("10.00", "86", "false: prevented"),
    ]


def test_a_long_list_of_refusals_is_cut() -> None:
    refused = [(120.0 + 1e-3 * k, 3, 1) for k in range(MOST + 5)]
    table = refused_table(judged(drifting_run(refused=refused)))
    assert table is not None and len(table.rows) == MOST
    # A stamp that no step has: when it was is known, where the robot was is not.
    assert table.rows[1][0] == "120.0 s" and table.rows[1][1][-2].text == "\N{EN DASH}"


def test_looks_are_counted_by_what_they_led_to_however_the_run_words_it() -> None:
    assert np.flatnonzero(new_views(np.array([-1, 0, 0, 1, -1, 0, 2]))).tolist() == [1, 3, 6]
    views = np.array([0, 1, 2, 3, 0, 1, -1, 3])
    table = look_table(drifting_run(view_ids=views, why=list("abcdefgh")))
    assert [(kind, [cell.text for cell in cells]) for kind, cells in table.rows] == [
        ("new view, node made", ["4", "a"]),
        ("known view, loop refused, arrival at a known node", ["2", "e"]),
        ("no view, arrival at a known node", ["1", "g"]),
        ("known view, arrival at a known node", ["1", "h"]),
    ]


def test_a_map_is_laid_over_the_truth_and_its_loops_are_what_arrivals_made() -> None:
    turned = np.array([(-y + 5.0, x - 7.0, th + np.pi / 2) for x, y, th in CORNERS])
    scene = judged(drifting_run(nodes=turned))
    np.testing.assert_allclose(scene.nodes[:, :2], np.array(CORNERS)[:, :2], atol=1e-9)
    np.testing.assert_allclose(scene.path[:, :2], np.array(CORNERS * 2)[:, :2], atol=1e-9)
    scene = judged(wrong_run())
    assert scene.made.tolist() == [-1, -1, 3, -1]
    assert scene.false.tolist() == [False, False, True, False]
    unknown = judged(wrong_run(truth=None))
    assert unknown.made.tolist() == [-1, -1, 3, -1] and not unknown.false.any()


UNKNOWN = {"nodes": [], "actions": [(0, 0, 0)] * 4, "links": [], "view_ids": np.full(4, -1)}
SINGLE_NODE = {"nodes": HALL[:1], "actions": [(1, 0, 0), *[(0, 0, 0)] * 3], "links": []}
SINGLE_STEP = little_run(HALL[:1], [(1, 0, 0)], HALL[:1], [], step_seconds=np.full((1, 3), 1e-3))


@rows(
    "run, missing, kinds",
    [
        (drifting_run(truth=None), "no-truth", "map views cells way times"),
        (alone(), "no-loop no-times", "map errors views cells way"),
        (alone(**UNKNOWN), "no-view no-node no-times", "views cells"),
        (nodeless(), "no-look no-node no-times", ""),
        (SINGLE_STEP, "single-node", "errors views cells times"),
        (alone(**SINGLE_NODE), "single-node no-times", "errors views cells"),
    ],
)
def test_pages_say_what_is_lacking(
    tmp_path: Path, run: RatSlamRun, missing: str, kinds: str
) -> None:
    page = read_page(write_ratslam_report(tmp_path, run))
    assert "nan" not in page.text.lower().split()
    assert [code for code, words in MISSING.items() if words in page.text] == missing.split()
    assert {path.name.split("_")[1] for path in tmp_path.glob("*.png")} == set(kinds.split())


def test_runs_over_several_drives_stand_apart(tmp_path: Path) -> None:
    runs = [nodeless(name="hall"), nodeless(name="attic"), nodeless(name="hall", views="eyes")]
    page = write_ratslam_report(tmp_path, runs, title="Two houses").read_text("utf-8")
    assert re.findall(r"<h2>(.*?)</h2>", page)[:2] == ["hall", "attic"]
    assert "<title>Two houses</title>" in page and "3 runs of RatSLAM over hall, attic" in page
    assert re.findall(r"<label for=.*?>(.*?)</label>", page) == ["given", "eyes", "given"]


def test_labels_name_what_tells_runs_apart() -> None:
    runs = [alone(), alone(odometry="drifting"), alone(preset="openratslam")]
    assert run_labels(runs[:1]) == ["given"]
    assert run_labels(runs[:2]) == ["given, odometry perfect", "given, odometry drifting"]
    labels = run_labels(runs)
    assert labels[2] == "given, odometry perfect, preset openratslam"
    table = error_table(labels, [judge_map(run) for run in runs])
    rows = [label for label, _ in table.rows]
    assert rows[:2] == ["dead reckoning: perfect", "dead reckoning: drifting"]
    assert rows[2:] == labels


def test_the_stored_runs_are_those_that_were_given(written: Written) -> None:
    stored = sorted((written[0] / "ratslam").glob("*.npz"))
    assert [path.stem for path in stored] == [
        "by-hand_eyes_perfect_robust",
        "by-hand_given_perfect_robust",
    ]
    again = RatSlamRun.load(stored[0])
    assert np.array_equal(again.actions, wrong_run().actions) and again.views == "eyes"


def test_pauses_between_recordings_are_not_drawn(tmp_path: Path) -> None:
    day = drifting_run()
    count = len(day)
    seconds = np.arange(count) * 30.0
    pauses = np.where(np.arange(count) < count // 2, 0, 86_400.0)
    stamps_ns = np.rint((seconds + pauses) * 1e9).astype(np.int64)
    run = replace(day, stamps_ns=stamps_ns)
    driven = seconds[-1] - 30
    time = DrawnTime.of(run)
    assert time.seconds[-1] == pytest.approx(1.03 * driven) and len(time.pauses) == 1
    assert run.seconds[-1] - time.left_out == pytest.approx(time.seconds[-1])
    assert time.at(run, stamps_ns) == pytest.approx(time.seconds)
    for figure in (draw_activity(run), draw_views(judged(run))):
        assert all(axis.get_xlim()[1] < 2 * driven for axis in figure.axes)
    # Without a pause nothing changes, however far apart the steps are.
    for gap in (1.0, 30.0, 3600.0):
        even = replace(day, stamps_ns=np.rint(np.arange(count) * gap * 1e9).astype(np.int64))
        assert DrawnTime.of(even).seconds == pytest.approx(even.seconds)


def test_maps_stand_beside_the_exact_trajectory() -> None:
    figure = map_figure([drifting_run(), wrong_run(), alone()], titles=["one", "two", "three"])
    titles = [axis.get_title(loc="left") for axis in figure.axes]
    names = ["exact trajectory", "one", "two", "three"]
    assert [title.split("\n")[0] for title in titles[:4]] == names
    assert titles[1].endswith("4 nodes, RMSE 0.00 m")
    limits = {(*axis.get_xlim(), *axis.get_ylim()) for axis in figure.axes[:4]}
    assert len(limits) == 1
    assert len(map_figure([alone(truth=None)]).axes) == 1


def test_pictures_that_would_be_empty_are_not_made() -> None:
    blind = alone(truth=None)
    assert draw_errors(judged(blind)) is None
    unseen = nodeless()
    assert draw_activity(unseen) is None
    assert draw_views(judged(unseen)) is None
    figure = draw_map(judged(blind))
    figure.savefig(io.BytesIO(), format="png")
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["dead reckoning", "experience map", "start", "end"]


def test_runs_that_cannot_be_reported_are_refused(tmp_path: Path) -> None:
    nothing = little_run([], [], [], [])
    for runs, reports, code in (
        ([], None, "no-runs"),
        ([wrong_run(), wrong_run()], None, "same-name"),
        (nothing, None, "empty-run"),
        ([wrong_run()], [], "counts-differ"),
    ):
        with pytest.raises(DataError, check=has_code(code)):
            write_ratslam_report(tmp_path, runs, reports)
    assert list(tmp_path.iterdir()) == []
    for runs, titles in (([], None), ([wrong_run()], ["a", "b"])):
        with pytest.raises(DataError, check=has_code("counts-differ")):
            map_figure(runs, titles=titles)


def test_the_start_is_the_first_pose_that_is_on_the_map() -> None:
    actions = [(0, 0, 0), (1, 0, 0), (1, 0, 1), (1, 1, 2)]
    far = np.array([(50.0, 50.0, 0.0), *[(0.0, 0.0, 0.0)] * 3])
    run = alone(actions=actions, nodes=HALL[1:], links=[(0, 1), (1, 2)], offsets=far, truth=None)
    lines = draw_map(judged(run)).axes[0].lines
    (start,) = [line for line in lines if line.get_label() == "start"]
    assert np.ravel(start.get_xydata()).tolist() == [1.0, 0.0]


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
    assert refusals(judged(run)) == ["linked later", "false: prevented"]
    lost = agreed_run(refused=[(180.0, 4, 2)])
    assert refusals(judged(lost)) == ["right: lost"]
    blind = agreed_run(truth=None)
    assert refusals(judged(blind)) == ["linked later", "\N{EN DASH}"]
    found = judged(agreed_run())
    assert found.made.tolist() == [-1, -1, -1, -1, 4, 5] and not found.false.any()
    table = loop_table(found)
    verdicts = [(label, cells[-1].text) for label, cells in table.rows]
    assert verdicts == [("120.0 s", "right, refused at first"), ("150.0 s", "right")]


def test_links_that_fit_have_no_misfit_and_a_moved_node_has_its_own() -> None:
    assert np.allclose(measure_misfits(drifting_run()), 0, atol=1e-9)
    shifts = np.zeros((4, 3))
    shifts[2, :2] = (0.3, 0.4)
    run = replace(drifting_run(), nodes=drifting_run().nodes + shifts)
    assert measure_misfits(run) == pytest.approx([0, 0.5, 0.5, 0], abs=1e-9)
    table = joins_table(["moved"], [judged(run)])
    assert (table.heads[-1][0], table.rows[0][1][-1].text) == ("misfit of links, m", "0.354")


def test_terminal_and_page_count_the_same_by_the_same_words() -> None:
    start = [(0, 0, 0), (0, 0, 0), (1, 0, 0), (1, 0, 1), (1, 1, 2), (2, 2, 0)]
    truth = [CORNERS[0]] * 3 + [*CORNERS[1:3], CORNERS[2]]
    late = judged(little_run(truth, start, CORNERS[:3], [(0, 1), (1, 2), (2, 0)]))
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
    blind = judged(drifting_run(truth=None))
    assert "4 arrivals at known nodes, 2 loops refused" in str(blind.report)


def test_without_truth_there_are_no_errors_and_fewer_columns() -> None:
    blind = judged(drifting_run(truth=None))
    assert error_table(["blind"], [blind.report]) is None
    heads = [name for name, _ in joins_table(["blind"], [blind]).heads]
    assert heads == ["loops", "arrivals", "refused", "nodes", "links", "misfit of links, m"]
    shown = joins_table(["blind", "wrong"], [blind, judged(wrong_run())])
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
    shown = dict(zip((name for name, _ in table.heads), table.rows[0][1], strict=True))
    assert shown["map p50 ms"].text == "3" and shown["map p95 ms"].text == "3.9"
    assert shown["step p50 ms"].text == "8.5" and float(shown["times real time"].text) > 1e3
    figure = draw_step_times(run)
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
