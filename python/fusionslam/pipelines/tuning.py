# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tune the similarity parameters on recorded drives (Stastny 2022, 4.6).

The thesis uses a genetic algorithm, its author's program differential evolution, both from pymoo.
"""

import json
import math
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import yaml

from fusionslam.base.archive import load_archive, save_archive
from fusionslam.base.arrays import Floats
from fusionslam.base.files import write_file
from fusionslam.config import Section, merged, option
from fusionslam.errors import ConfigError, DataError, needing
from fusionslam.evaluation import ViewJudge, ViewReport
from fusionslam.pipelines.views import views_of
from fusionslam.views.comparison import View
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.recognisers import ViewMatcherConfig, scene_config, similarity_config
from fusionslam.views.scene_set import SceneSet

if TYPE_CHECKING:
    from pymoo.core.algorithm import Algorithm

Bounds = dict[str, tuple[float, float]]

BOUNDS: dict[str, Bounds] = {
    name: {key: (low, high) for key, (low, high) in bounds.items()}
    for name, bounds in yaml.safe_load(
        Path(__file__).with_name("tuning.yaml").read_text(encoding="utf-8")
    ).items()
}
"""Parameters to tune and their bounds, by name: those of Stastny's thesis and of our preset."""
_DIGITS = 6
"""Significant digits of each parameter; the values written are exactly those tried."""
_STATE_FORMAT = "fusionslam.tuning.1"
_WORST = 1e6
"""The objective for invalid parameters, such as weights that are all 0."""


class TuningConfig(Section):
    """How to search for parameters, and how to rate a run."""

    algorithm: Literal["ga", "de"] = option(
        "ga", "ga: genetic algorithm (Stastny 2022); de: differential evolution (his program)"
    )
    numbers: Literal["thesis", "robust"] = option(
        "thesis",
        "parameters to search for: thesis: colour, distance, volume, ratio and the "
        "threshold; robust: colour, distance, extents, range_slack and the threshold",
    )
    population: int = option(40, "runs per generation", ge=4)
    generations: int = option(100, "number of generations", ge=1)
    seed: int = option(0, "seed of the random choices", ge=0)
    false_positives: float = option(1.0, "weight of the share of false positives", ge=0)
    false_negatives: float = option(1.0, "weight of the share of false negatives", ge=0)
    loop_recall: float = option(0.0, "weight of 1 - loop recall", ge=0)
    loop_precision: float = option(0.0, "weight of 1 - loop precision", ge=0)
    rule: Literal["paper", "author"] = option("paper", "how views are judged")


@dataclass(frozen=True, eq=False)
class TuningResult:
    """The best parameters found.

    Attributes:
        config: of the matcher, with the best parameters.
        value: minimum of the objective.
        reports: evaluation of the run over each set.
        best_values: float64 (generations,), the best value so far.
    """

    config: ViewMatcherConfig
    value: float
    reports: Sequence[ViewReport]
    best_values: Floats


@dataclass(frozen=True, eq=False)
class Generation:
    """Parameters that were tried, float64 (k, d), and their values, float64 (k,)."""

    numbers: Floats
    values: Floats


class TuningState:
    """The generations of a tuning, in a file or, without a path, in memory.

    Args:
        path: of the file, which need not exist.
    """

    def __init__(self, path: str | os.PathLike[str] | None = None) -> None:
        self.path = None if path is None else Path(path)
        self.generations: list[Generation] = []
        self._identity = ""

    def begin(self, identity: dict[str, Any]) -> None:
        """Load the generations in the file.

        Raises:
            DataError: the file is truncated, of another version, or of a tuning with other data
                or settings.
        """
        self._identity = json.dumps(identity, sort_keys=True)
        if self.path is None or not self.path.exists():
            return
        with load_archive(self.path, _STATE_FORMAT, "the state of a tuning") as (about, arrays):
            edges = np.cumsum(arrays["sizes"])[:-1]
            parts = (np.split(arrays[name], edges) for name in ("numbers", "values"))
            generations = [Generation(*pair) for pair in zip(*parts, strict=True)]
        stored, self.generations = str(about["identity"]), generations
        if stored != self._identity:
            differing = _differences(json.loads(stored), identity)
            raise DataError(
                f"{self.path} belongs to a tuning with other {', '.join(differing)}: delete it, or "
                "write to another file",
                code="other-tuning",
                fields=differing,
            )

    def add(self, generation: Generation) -> None:
        """Store a generation. Raises DataError if the file cannot be written."""
        self.generations.append(generation)
        if self.path is None:
            return
        sizes = np.array([len(each.values) for each in self.generations], np.int64)
        arrays = {
            "sizes": sizes,
            "numbers": np.concatenate([each.numbers for each in self.generations]),
            "values": np.concatenate([each.values for each in self.generations]),
        }
        save_archive(self.path, _STATE_FORMAT, {"identity": self._identity}, arrays)


def _differences(before: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """Return the names of the differing values, such as "tuning.seed" and "sets"."""
    names = []
    for key, value in now.items():
        other = before.get(key)
        if isinstance(value, dict) and isinstance(other, dict):
            names += [f"{key}.{name}" for name in value if other.get(name) != value[name]]
        elif other != value:
            names.append(key)
    return names


Progress = Callable[[int, int, float], None]


def tune(
    sets: Sequence[SceneSet],
    base: ViewMatcherConfig,
    config: TuningConfig | None = None,
    *,
    state: TuningState | None = None,
    jobs: int = 1,
    progress: Progress | None = None,
) -> TuningResult:
    """Search for the parameters with which a matcher does best on average over scene sets.

    The parameters of ``base`` are in the first generation, so the result is no worse. The result
    depends on the seed, not on ``jobs``.

    Args:
        sets: with ground-truth poses, and clouds or scenes.
        base: the matcher's configuration, whose parameters are changed.
        config: how to search.
        state: keeps the generations, so that an interrupted call resumes, with the same result.
        jobs: number of processes that evaluate parameters.
        progress: called with (generations done, total generations, best value).

    Raises:
        DataError: a set has no poses, or the state belongs to other data or settings.
        ConfigError: the matcher does not compare scenes. FusionSlamError: pymoo is missing.
    """
    config = config or TuningConfig()
    if base.method not in (None, "objects"):
        raise ConfigError(
            f"views.method is {base.method!r}: tuning needs 'objects'", fields=("views.method",)
        )
    base = merged(base, {"method": "objects"})
    if not sets:
        raise DataError("there is no scene set to tune on", code="no-scans")
    search = _Search(base, config)
    trial = Trial(drives_of(sets, base, config.rule), base, config)
    kept = state or TuningState()
    kept.begin(search.identity(sets))
    done: list[Generation] = []
    with _workers(trial, jobs) as values_of:
        for generation in search.generations(kept.generations, values_of):
            if len(done) >= len(kept.generations):
                kept.add(generation)
            done.append(generation)
            if progress is not None:
                best = min(float(each.values.min()) for each in done)
                progress(len(done), config.generations, best)
    return _result(done, trial)


Drive = tuple[list[View], ViewJudge]


def drives_of(sets: Sequence[SceneSet], base: ViewMatcherConfig, rule: str) -> list[Drive]:
    """Return the parts of scene sets that do not depend on the parameters: views and judges."""
    drives = []
    for scenes in sets:
        judge = ViewJudge(scenes.true_poses(), scenes.seconds, rule=rule)
        drives.append((views_of(scenes, ViewMatcher(base)), judge))
    return drives


@dataclass(frozen=True)
class Trial:
    """Evaluates parameters on drives."""

    drives: Sequence[Drive]
    base: ViewMatcherConfig
    config: TuningConfig

    def value(self, numbers: Floats) -> float:
        """Return the objective for one parameter vector."""
        try:
            reports = self.reports(numbers)
        except ConfigError:
            return _WORST
        return float(np.mean([self._badness(report) for report in reports]))

    def reports(self, numbers: Floats) -> list[ViewReport]:
        """Return the evaluated runs. Raises ConfigError for invalid parameters."""
        config = with_numbers(self.base, self.config.numbers, numbers)
        reports = []
        for views, judge in self.drives:
            matcher = ViewMatcher(config)
            ids = [matcher.process(view).id for view in views]
            reports.append(judge.judge(np.array(ids, np.int64)))
        return reports

    def _badness(self, report: ViewReport) -> float:
        config = self.config
        wrong = (
            config.false_positives * report.false_positives
            + config.false_negatives * report.false_negatives
        )
        # A drive without loops offers none to find or to miss.
        missed = 1 - (1.0 if report.loop_recall is None else report.loop_recall)
        false = 1 - (1.0 if report.loop_precision is None else report.loop_precision)
        return (
            wrong / max(report.n, 1) + config.loop_recall * missed + config.loop_precision * false
        )


def with_numbers(base: ViewMatcherConfig, which: str, numbers: Floats) -> ViewMatcherConfig:
    """Return the configuration with parameters given in the order of ``BOUNDS[which]``."""
    values = {
        name: float(f"{number:.{_DIGITS}g}")
        for name, number in zip(BOUNDS[which], numbers.tolist(), strict=True)
    }
    threshold = values.pop("threshold")
    similarity = base.similarity.model_copy(update=values)
    return base.model_copy(update={"similarity": similarity, "threshold": threshold})


class _Search:
    """Asks the algorithm for parameters and tells it their values, generation by generation."""

    def __init__(self, base: ViewMatcherConfig, config: TuningConfig) -> None:
        self.base, self.config = base, config
        self.low, self.high = np.array([*BOUNDS[config.numbers].values()], np.float64).T

    def identity(self, sets: Sequence[SceneSet]) -> dict[str, Any]:
        """Return what identifies a search; the number of generations is not part of it."""
        return {
            "views": self.base.model_dump(mode="json"),
            "tuning": self.config.model_dump(mode="json", exclude={"generations"}),
            "sets": [scenes.digest() for scenes in sets],
        }

    def generations(
        self, known: Sequence[Generation], values_of: Callable[[Floats], Floats]
    ) -> Iterator[Generation]:
        """Yield each generation: the known ones are replayed, the others evaluated.

        The algorithm asks for the same parameters as long as it is told the same values, so its
        internal state need not be stored.

        Raises:
            DataError: the algorithm asks for parameters that differ from the known ones.
        """
        algorithm = self._algorithm()
        for number in range(self.config.generations):
            asked = algorithm.ask()
            numbers = np.array(asked.get("X"), np.float64)
            if number < len(known):
                if not np.array_equal(numbers, known[number].numbers):
                    raise DataError(
                        f"generation {number} of the stored tuning cannot be repeated, perhaps "
                        "because pymoo changed: delete the state and start again",
                        code="other-tuning",
                    )
                values = known[number].values
            else:
                values = values_of(numbers)
            asked.set("F", values[:, None])
            algorithm.tell(infills=asked)
            yield Generation(numbers, values)

    def _algorithm(self) -> "Algorithm":
        with needing("tune", "tuning needs pymoo"):
            from pymoo.algorithms.soo.nonconvex.de import DE
            from pymoo.algorithms.soo.nonconvex.ga import GA
            from pymoo.core.problem import Problem
            from pymoo.core.termination import NoTermination
        problem = Problem(n_var=len(self.low), n_obj=1, xl=self.low, xu=self.high)
        kinds = {"ga": GA, "de": DE}
        # The parameters of the base, then uniformly random ones: float64 (population, d).
        rng = np.random.default_rng([self.config.seed, 0x7E])
        first = rng.uniform(self.low, self.high, (self.config.population, len(self.low)))
        core, threshold = similarity_config(self.base), ViewMatcher(self.base).threshold
        own = [
            threshold if name == "threshold" else getattr(core, name)
            for name in BOUNDS[self.config.numbers]
        ]
        first[0] = np.clip(own, self.low, self.high)
        algorithm = kinds[self.config.algorithm](pop_size=len(first), sampling=first)
        algorithm.setup(problem, termination=NoTermination(), seed=self.config.seed, verbose=False)
        return algorithm


def _result(done: Sequence[Generation], trial: Trial) -> TuningResult:
    values = np.concatenate([generation.values for generation in done])
    numbers = np.concatenate([generation.numbers for generation in done])
    best = int(values.argmin())
    per_generation = np.array([generation.values.min() for generation in done])
    return TuningResult(
        config=with_numbers(trial.base, trial.config.numbers, numbers[best]),
        value=float(values[best]),
        reports=trial.reports(numbers[best]),
        best_values=np.minimum.accumulate(per_generation),
    )


@contextmanager
def _workers(trial: Trial, jobs: int) -> Iterator[Callable[[Floats], Floats]]:
    """Yield a function from parameters, float64 (k, d), to their values, float64 (k,)."""
    if jobs <= 1:
        yield lambda numbers: np.array([trial.value(row) for row in numbers])
        return
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    # Processes, because a run spends as much time in Python as in the core; spawned, because
    # forking is unsafe beside threads.
    pool = ProcessPoolExecutor(
        jobs,
        mp_context=get_context("spawn"),
        initializer=_begin,
        initargs=(trial.drives, trial.base.model_dump(), trial.config.model_dump()),
    )
    try:
        yield lambda numbers: np.array(
            list(pool.map(_value, numbers, chunksize=math.ceil(len(numbers) / (4 * jobs))))
        )
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


_trials: list[Trial] = []
"""The trial of this process, if it is a worker."""


def _begin(drives: Sequence[Drive], base: dict[str, Any], config: dict[str, Any]) -> None:
    import signal

    # Ctrl-C reaches all processes: the parent ends the workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _trials[:] = [Trial(drives, merged(ViewMatcherConfig(), base), TuningConfig(**config))]


def _value(numbers: Floats) -> float:
    return _trials[0].value(numbers)


def write_tuning(
    path: str | os.PathLike[str],
    result: TuningResult,
    config: TuningConfig,
    sets: Sequence[SceneSet],
    command: str,
) -> None:
    """Write the result as YAML, with all values of scenes and similarity.

    A comment says how it was made and how well it does.

    Raises:
        DataError: the file cannot be written.
    """
    settings = ", ".join(f"{key} {value}" for key, value in config.model_dump().items())
    lines = [f"# {command}", f"# {settings}", f"# value {result.value:.6f}"]
    for scenes, report in zip(sets, result.reports, strict=True):
        made = scenes.source.get("command")
        lines += [f"# {scenes.name}: {made}"] if made else []
        lines += [f"# {scenes.name}: {line.strip()}" for line in str(report).splitlines()]
    # Every value that affects the ids, so that later changes of presets do not.
    found = result.config
    values = found.model_dump(mode="json", exclude_unset=True)
    for name, core in (("scene", scene_config(found)), ("similarity", similarity_config(found))):
        options = type(core).options()
        values[name] = {entry["name"]: getattr(core, entry["name"]) for entry in options}
    values = {"preset": found.preset, "threshold": found.threshold, **values}
    text = yaml.safe_dump({"views": values}, sort_keys=False)
    write_file(path, "\n".join([*lines, text]))
