# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tuning: what is tried, what is kept, and that an interrupted search comes to the same end."""

import sys
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fusionslam.cli.system_config import SystemConfig
from fusionslam.config import merged, with_file
from fusionslam.errors import ConfigError, DataError, FusionSlamError
from fusionslam.evaluation import judge_views
from fusionslam.pipelines import tuning
from fusionslam.pipelines.tuning import (
    BOUNDS,
    TuningConfig,
    TuningResult,
    TuningState,
    tune,
    with_numbers,
    write_tuning,
)
from fusionslam.pipelines.views import run_views
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.presets import load_preset, preset_names, preset_path
from fusionslam.views.recognisers import ViewMatcherConfig, similarity_config
from refusals import refuses
from rows import rows
from scenes import LAPS, drive

pytest.importorskip("pymoo")

AUTHOR = ViewMatcherConfig(method="objects", preset="author")
# With these values nothing matches: there is something to find.
BAD = merged(AUTHOR, {"threshold": 0.99})
DRIVE = drive(LAPS)


def quick(**values: Any) -> TuningConfig:
    return TuningConfig(**{"population": 6, "generations": 4, "seed": 1, **values})


def outcome(result: TuningResult) -> tuple[Any, ...]:
    return result.config, result.value, result.best_values.tolist()


def test_the_thesis_looks_for_thirteen_numbers_in_its_bounds() -> None:
    bounds = BOUNDS["thesis"]
    assert len(bounds) == 13
    x0 = {"color_x0": 15, "distance_x0": 1, "volume_x0": 1, "ratio_x0": 20}
    expected = {**x0, **{f"{name[:-3]}_a": 25 for name in x0}}
    expected |= {f"{name[:-3]}_weight": 1 for name in x0} | {"threshold": 1}
    assert bounds == {name: (0, high) for name, high in expected.items()}


@rows("algorithm, numbers", product(("ga", "de"), ("thesis", "robust")))
def test_what_is_found_is_better_and_in_its_bounds(algorithm: str, numbers: str) -> None:
    config = quick(algorithm=algorithm, numbers=numbers, population=10)
    result = tune([DRIVE], BAD, config)
    assert result.value < result.best_values[0] or result.value == 0
    assert np.all(np.diff(result.best_values) <= 0)
    values = result.config.similarity.model_dump() | {"threshold": result.config.threshold}
    for name, (low, high) in BOUNDS[numbers].items():
        assert low <= values[name] <= high


def test_the_value_is_what_the_judge_says_of_the_matcher_with_these_numbers() -> None:
    config = quick(false_positives=2.0, false_negatives=0.5, loop_recall=0.3, loop_precision=0.1)
    result = tune([DRIVE], BAD, config)
    ids = run_views(DRIVE, ViewMatcher(result.config)).ids
    report = judge_views(ids, DRIVE.true_poses(), DRIVE.seconds)
    (own,) = result.reports
    assert np.array_equal(own.ids, ids)
    wrong = (2 * report.false_positives + 0.5 * report.false_negatives) / len(DRIVE)
    recall = 1.0 if report.loop_recall is None else report.loop_recall
    precision = 1.0 if report.loop_precision is None else report.loop_precision
    assert result.value == pytest.approx(wrong + 0.3 * (1 - recall) + 0.1 * (1 - precision))


def test_the_numbers_to_begin_with_are_tried_so_the_end_is_no_worse() -> None:
    good = ViewMatcherConfig(method="objects")
    ids = run_views(DRIVE, ViewMatcher(good)).ids
    report = judge_views(ids, DRIVE.true_poses(), DRIVE.seconds)
    assert report.accuracy == 1
    result = tune([DRIVE], good, quick(numbers="robust", generations=1))
    assert result.value == 0
    assert result.config.threshold == pytest.approx(ViewMatcher(good).threshold)
    # What is found is for objects, whatever the default compares.
    result = tune([DRIVE], ViewMatcherConfig(), quick(numbers="robust", generations=1))
    assert result.config.method == "objects" and result.config.threshold == 0.74


def test_several_drives_count_alike() -> None:
    short = drive((0, 1, 0, 1))
    both = tune([DRIVE, short], BAD, quick())
    values = []
    for scenes in (DRIVE, short):
        ids = run_views(scenes, ViewMatcher(both.config)).ids
        report = judge_views(ids, scenes.true_poses(), scenes.seconds)
        values.append((report.false_positives + report.false_negatives) / len(scenes))
    assert both.value == pytest.approx(np.mean(values)) and len(both.reports) == 2


def test_the_seed_decides_and_the_number_of_jobs_does_not() -> None:
    one, same, two, other = (
        tune([DRIVE], BAD, quick(seed=seed, generations=2), jobs=jobs)
        for seed, jobs in ((1, 1), (1, 1), (1, 2), (2, 1))
    )
    assert outcome(one) == outcome(same) == outcome(two)
    assert outcome(one)[0] != outcome(other)[0]


@pytest.mark.parametrize("algorithm", ["ga", "de"])
def test_an_interrupted_search_goes_on_and_comes_to_the_same_end(
    algorithm: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = quick(algorithm=algorithm)
    whole = tune([DRIVE], BAD, config)
    tried: list[float] = []
    right = tuning.Trial.value

    def counted(self: tuning.Trial, numbers: Any) -> float:
        if len(tried) == 15:
            raise KeyboardInterrupt
        tried.append(right(self, numbers))
        return tried[-1]

    with monkeypatch.context() as patch:
        patch.setattr(tuning.Trial, "value", counted)
        with pytest.raises(KeyboardInterrupt):
            tune([DRIVE], BAD, config, state=TuningState(tmp_path / "state"))
        kept = TuningState(tmp_path / "state")
        kept.begin(tuning._Search(BAD, config).identity([DRIVE]))
        assert len(kept.generations) == 2
        tried[:] = [0.0] * 16  # from here on none is stopped
        # The method need not be named: only scenes have numbers to look for.
        unnamed = BAD.model_copy(update={"method": None})
        resumed = tune([DRIVE], unnamed, config, state=TuningState(tmp_path / "state"))
    assert outcome(resumed) == outcome(whole)
    assert len(tried) - 16 == 12


def test_more_generations_go_on_from_those_kept(tmp_path: Path) -> None:
    state = tmp_path / "state"
    tune([DRIVE], BAD, quick(generations=2), state=TuningState(state))
    seen: list[tuple[int, int]] = []
    kept = TuningState(state)
    more = tune([DRIVE], BAD, quick(), state=kept, progress=lambda *step: seen.append(step[:2]))
    assert outcome(more) == outcome(tune([DRIVE], BAD, quick()))
    assert seen == [(1, 4), (2, 4), (3, 4), (4, 4)]


def test_a_state_of_another_search_or_that_is_cut_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "state"
    tune([DRIVE], BAD, quick(generations=1), state=TuningState(path))
    for scenes, start, config, field in (
        (DRIVE, BAD, quick(seed=2), "tuning.seed"),
        (drive((0, 1, 0)), BAD, quick(), "sets"),
        (DRIVE, AUTHOR, quick(), "views.threshold"),
    ):
        with pytest.raises(DataError) as refused:
            tune([scenes], start, config, state=TuningState(path))
        assert field in refused.value.fields
    path.write_bytes(path.read_bytes()[:-50])
    with pytest.raises(DataError, match="state"):
        tune([DRIVE], BAD, quick(), state=TuningState(path))


def test_what_cannot_be_tuned_is_refused() -> None:
    with refuses("no-poses"):
        tune([drive(LAPS, poses=False)], BAD, quick())
    with refuses("no-scans"):
        tune([], BAD, quick())
    with pytest.raises(ConfigError, check=lambda error: error.fields == ("views.method",)):
        tune([DRIVE], ViewMatcherConfig(method="cm2dp"), quick())


def test_weights_that_are_all_zero_are_the_worst() -> None:
    config = quick()
    trial = tuning.Trial(tuning.drives_of([DRIVE], AUTHOR, "paper"), AUTHOR, config)
    numbers = np.array([0.0 if "weight" in name else 1.0 for name in BOUNDS["thesis"]])
    assert trial.value(numbers) > 1000


def test_without_pymoo_the_line_that_installs_it_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.split(".")[0] == "pymoo"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "pymoo", None)
    with pytest.raises(FusionSlamError, check=lambda error: error.fields == ("tune",)):
        tune([DRIVE], BAD, quick())


def test_what_was_found_is_written_with_all_values_and_read_again(tmp_path: Path) -> None:
    result = tune([DRIVE], BAD, quick())
    path = tmp_path / "best.yaml"
    write_tuning(path, result, quick(), [DRIVE], "fusionslam tune boxes.npz")
    read: Any = with_file(SystemConfig(), path)
    assert np.array_equal(
        run_views(DRIVE, ViewMatcher(read.views)).ids,
        run_views(DRIVE, ViewMatcher(result.config)).ids,
    )
    core, again = similarity_config(result.config), similarity_config(read.views)
    names = [entry["name"] for entry in type(core).options()]
    assert [getattr(core, name) for name in names] == [getattr(again, name) for name in names]
    text = path.read_text()
    for noted in ("# fusionslam tune boxes.npz", "seed 1", "# boxes: accuracy"):
        assert noted in text


def test_the_values_that_come_along_are_read_and_say_how_they_were_made() -> None:
    assert preset_names()
    for name in preset_names():
        config = load_preset(name)
        assert config.threshold is not None and ViewMatcher(config).threshold == config.threshold
        assert preset_path(name).read_text().startswith("# fusionslam tune ")
    with pytest.raises(ConfigError, match="'mine'"):
        preset_path("mine")


def test_numbers_are_rounded_as_they_are_written() -> None:
    numbers = np.linspace(0.123456789, 0.987654321, 13)
    config = with_numbers(AUTHOR, "thesis", numbers)
    assert config.threshold == 0.987654
    assert config.similarity.model_dump()["color_x0"] == 0.123457
