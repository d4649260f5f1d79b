# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Checks whether a small rotation, translation or delay would align scans and images better.

The score is the edge alignment of ``calibration.edges``. A recording is checked, not calibrated:
the result tells users whether their extrinsics or clocks are wrong.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fusionslam.base.archive import save_json
from fusionslam.base.arrays import Floats
from fusionslam.base.parallel import ordered_results
from fusionslam.base.progress import Progress
from fusionslam.calibration.overlay import draw_overlay
from fusionslam.calibration.search import (
    DELAY,
    SHIFTS,
    TURNS,
    CalibrationCheckConfig,
    Recording,
    Search,
    Site,
    Trial,
    sensor_data,
)
from fusionslam.errors import DataError

FORMAT = "fusionslam.calib_check.1"
_FEWEST_POINTS = 100
# With fewer depth edges a score that is no better than chance says nothing.
_PLENTY = 500
# A shift or delay is undetermined if its plausible range covers more of the range tried.
_FLAT = 0.7
# Degrees: an angle is uncertain if a larger error of the present calibration is plausible.
_CERTAIN = 1.0
# An explanation with at least this share of the best one's gain may be the true one.
_NEAR = 0.7
# A gain of this many standard errors is mentioned.
_PERHAPS = 2.0
# A gain of this share of the present score leaves a doubt even if it may be chance.
_MUCH = 0.25


@dataclass(frozen=True, eq=False)
class Curve:
    """Score as a function of one value, all others at the present calibration.

    Attributes:
        name: "roll", "pitch", "yaw" (degrees), "right", "down", "forward" (metres) or "delay" (s).
        values: float64 (K), ascending; 0 is the present calibration.
        scores: float64 (K), mean score of an edge point, -1 to 1.
        low, high: bounds of the values whose score is not significantly worse than the best.
        errors: gain of the best over the present calibration in standard errors.
    """

    name: str
    values: Floats
    scores: Floats
    low: float
    high: float
    errors: float

    @property
    def best(self) -> float:
        """The value with the highest score."""
        return float(self.values[int(np.argmax(self.scores))])

    @property
    def flat(self) -> bool:
        """Whether nearly every value is plausible, so that the value is undetermined."""
        return self.high - self.low > _FLAT * float(self.values[-1] - self.values[0])


@dataclass(frozen=True)
class Turn:
    """The best rotation of the camera, with all three angles varied together.

    Attributes:
        degrees: roll (right side down), pitch (down), yaw (to the left).
        ranges: (low, high) of each among the rotations that are not significantly worse.
        score: mean score of an edge point with it, -1 to 1.
        errors: gain over the present calibration in standard errors.
    """

    degrees: tuple[float, ...]
    ranges: tuple[tuple[float, float], ...]
    score: float
    errors: float


@dataclass(frozen=True, eq=False)
class CalibrationCheck:
    """Result of a calibration check.

    Attributes:
        frames: numbers of the frames used.
        points: number of depth edges used.
        present: score of the present calibration, -1 to 1.
        turn: the best rotation of the camera.
        curves: score as a function of each single value, by name; no "delay" if undetermined.
        verdict: in words.
        fits: whether nothing significantly better was found; None if undecided.
        uncertain: names of the angles of which errors of more than 1 deg may stay unnoticed.
    """

    frames: list[int]
    points: int
    present: float
    turn: Turn
    curves: dict[str, Curve]
    verdict: str
    fits: bool | None
    uncertain: list[str]

    def rows(self) -> list[tuple[str, str, str, str]]:
        """Rows of a table: name, best value, range that is not significantly worse, score."""
        rows = [("present calibration", "", "", f"{self.present:.4f}")]
        turn = self.turn
        for name, best, (low, high) in zip(TURNS, turn.degrees, turn.ranges, strict=True):
            bounds = f"{low:+.1f} .. {high:+.1f}"
            rows.append((f"turn: {name} [deg]", f"{best:+.1f}", bounds, f"{turn.score:.4f}"))
        for curve in (self.curves[name] for name in (*SHIFTS, DELAY) if name in self.curves):
            is_delay = curve.name == DELAY
            label = "images late by [s]" if is_delay else f"shift: {curve.name} [m]"
            digits = 3 if is_delay else 2
            bounds = f"{curve.low:+.{digits}f} .. {curve.high:+.{digits}f}"
            bounds += " (cannot say)" if curve.flat else ""
            rows.append((label, f"{curve.best:+.{digits}f}", bounds, f"{curve.scores.max():.4f}"))
        return rows

    def save(self, path: Path) -> None:
        """Write the result as JSON, curves included."""
        whole = asdict(self)
        for curve in whole["curves"].values():
            curve["values"] = curve["values"].round(6).tolist()
            curve["scores"] = curve["scores"].round(6).tolist()
        save_json(path, FORMAT, whole, indent=1)


def check_calibration(
    recording: Recording,
    config: CalibrationCheckConfig | None = None,
    progress: Progress = lambda done, total: None,
    *,
    jobs: int = 1,
) -> CalibrationCheck:
    """Try other calibrations on a few frames of a recording, ``jobs`` of which are read at a time.

    Raises:
        DataError: there are no scans, images or calibration, or too few depth edges in view.
    """
    config = config or CalibrationCheckConfig()
    indices = frames_of(recording, config.frames)
    sites = []
    with ordered_results(lambda index: Site(recording, index, config), indices, jobs) as made:
        for done, site in enumerate(made, 1):
            sites.append(site)
            progress(done, len(indices))
    points = sum(len(site.view.points) for site in sites)
    if points < _FEWEST_POINTS:
        raise DataError(
            f"{recording.name}: {points} depth edges lie in the images of {len(sites)} frames, "
            f"expected {_FEWEST_POINTS} or more: there is too little structure, or "
            "rectified_from_points, which maps points of a scan to the camera, is wholly wrong",
            code="few-edges",
            fields=(str(points),),
        )
    search = Search(sites, config)
    turn = _turn(search)
    trials = {name: search.single(name) for name in (*TURNS, *SHIFTS, DELAY)}
    curves = {name: _curve(name, trial) for name, trial in trials.items() if trial is not None}
    present = float(search.present.scores[0])
    remedy = "record more of a scene with posts, doors or furniture"
    if len(indices) < len(recording):
        remedy = f"try more frames (calib_check.frames, {len(recording)} at most)"
    if points >= _PLENTY and search.present.above_chance < _PERHAPS:
        remedy = (
            f"{points} depth edges meet edges of the images no better than by chance: perhaps the "
            "extrinsics are wholly wrong, for example inverted (rectified_from_points maps points "
            f"of a scan to the camera), or there is too little structure: then {remedy}"
        )
    verdict, fits = _verdict(present, turn, curves, config, remedy)
    numbers = recording.numbers[indices].tolist()
    uncertain = _uncertain(turn, config)
    return CalibrationCheck(numbers, points, present, turn, curves, verdict, fits, uncertain)


def write_overlays(recording: Recording, indices: Sequence[int], folder: Path) -> list[Path]:
    """Write a picture ``overlay_NUMBER.png`` of each of these frames: its scan over its image."""
    paths = []
    for index in indices:
        points, image, camera = sensor_data(recording, index, recording[index])
        paths.append(folder / f"overlay_{recording.numbers[index]:06d}.png")
        draw_overlay(paths[-1], points, image, camera, size=3.0)
    return paths


def frames_of(recording: Recording, most: int) -> list[int]:
    """Indices of at most ``most`` frames, evenly spaced."""
    count = min(most, len(recording))
    return sorted({int(n) for n in np.linspace(0, len(recording) - 1, count).round()})


def _turn(search: Search) -> Turn:
    trial = search.turns()
    likely = trial.values[trial.plausible]
    return Turn(
        degrees=tuple(round(float(v), 6) for v in trial.values[trial.best]),
        ranges=tuple((float(v.min()), float(v.max())) for v in likely.T),
        score=float(trial.scores[trial.best]),
        errors=_gain(trial, search.present.parts[0]),
    )


def _curve(name: str, trial: Trial) -> Curve:
    likely = trial.values[trial.plausible]
    present = trial.parts[int(np.argmin(np.abs(trial.values)))]
    low, high = float(likely.min()), float(likely.max())
    return Curve(name, trial.values, trial.scores, low, high, _gain(trial, present))


def _gain(trial: Trial, present: Floats) -> float:
    """Gain of the best over the present calibration, in standard errors."""
    now = Trial(trial.values[:1], present[None], trial.weight)
    return float(now.errors(trial.parts[trial.best])[0])


class _Better(NamedTuple):
    """A change that would fit better: its score, gain in standard errors, and description."""

    score: float
    errors: float
    words: str


def _verdict(
    present: float,
    turn: Turn,
    curves: dict[str, Curve],
    config: CalibrationCheckConfig,
    remedy: str,
) -> tuple[str, bool | None]:
    """The verdict, best explanation first, and whether the calibration fits."""
    better = sorted(_improvements(turn, curves, config), key=lambda each: -each.score)
    sure = next((each for each in better if each.errors > config.sure), None)
    # A rotation that gains far more, even if by chance, leaves room for another explanation.
    if sure and sure.score - present >= _NEAR * (turn.score - present):
        near = [
            each.words
            for each in better
            if each is not sure and each.score - present > _NEAR * (sure.score - present)
        ]
        also = f"; nearly as well: {'; '.join(near)}" if near else ""
        return f"{sure.words}{also}", False
    uncertain = _uncertain(turn, config)
    # Roll moves little in the middle of an image and may stay undetermined.
    if {"pitch", "yaw"} & {*uncertain}:
        return f"cannot say: too little to tell {' and '.join(uncertain)} by; {remedy}", None
    maybe = sure or next((each for each in better if each.errors > _PERHAPS), None)
    if maybe:
        return f"cannot say: perhaps {maybe.words}, or that is chance; {remedy}", None
    if doubt := _doubt(present, turn, curves, config, remedy):
        return f"cannot say: {doubt}", None
    uncertain += [name for name, curve in curves.items() if name == DELAY and curve.flat]
    about = f" (little can be said about {' and '.join(uncertain)})" if uncertain else ""
    # A best value may differ from 0 for sure and still be too small to matter.
    within = f"{config.turn_tolerance:g} deg, {config.shift_tolerance:g} m"
    if DELAY in curves:
        within += f", {config.delay_tolerance:g} s"
    return f"calibration fits{about}; tolerances: {within}", True


def _doubt(
    present: float,
    turn: Turn,
    curves: dict[str, Curve],
    config: CalibrationCheckConfig,
    remedy: str,
) -> str:
    """Doubts about a calibration although nothing is significantly better; empty if none."""
    far = [
        (name, angle)
        for name, angle in zip(TURNS, turn.degrees, strict=True)
        if abs(angle) > config.turn_tolerance
    ]
    edges = [name for name, angle in far if _or_more(abs(angle), config.turn)]
    if edges:
        return (
            f"the best {' and '.join(edges)} lies at the edge of what was tried; "
            f"{remedy}, or a larger calib_check.turn"
        )
    scores = [(turn.score, ", ".join(f"{n} {angle:+.1f} deg" for n, angle in far))]
    scores += [
        (float(curve.scores.max()), words)
        for curve in curves.values()
        if curve.name not in TURNS and not curve.flat and (words := _describe(curve, config))
    ]
    score, words = max((each for each in scores if each[1]), default=(present, ""))
    if not words or score - present <= _MUCH * abs(present):
        return ""
    return f"{words} scores {score:.4f} against {present:.4f}, or that is chance; {remedy}"


def _uncertain(turn: Turn, config: CalibrationCheckConfig) -> list[str]:
    """Names of the angles whose errors may be large without a significantly worse score."""
    certain = max(_CERTAIN, config.turn_tolerance) + 1e-6
    ranges = zip(TURNS, turn.ranges, strict=True)
    return [name for name, (low, high) in ranges if max(-low, high) > certain]


def _improvements(
    turn: Turn, curves: dict[str, Curve], config: CalibrationCheckConfig
) -> Iterator[_Better]:
    """Yield each kind of change whose best value exceeds its tolerance."""
    angles = [
        (name, angle)
        for name, angle, (low, high) in zip(TURNS, turn.degrees, turn.ranges, strict=True)
        if abs(angle) > config.turn_tolerance and not low <= 0 <= high
    ]
    if angles:
        words = ", ".join(f"{name} {angle:+.1f} deg" for name, angle in angles)
        more = _or_more(max(abs(angle) for _, angle in angles), config.turn)
        yield _Better(turn.score, turn.errors, f"turn the camera by {words}{more}")
    for curve in curves.values():
        if curve.name not in TURNS and not curve.flat and (words := _describe(curve, config)):
            words += _or_more(abs(curve.best), float(curve.values[-1]))
            yield _Better(float(curve.scores.max()), curve.errors, words)


def _describe(curve: Curve, config: CalibrationCheckConfig) -> str:
    """Describe a shift or a delay; empty if it is small."""
    if curve.name == DELAY:
        side = "late" if curve.best > 0 else "early"
        large = abs(curve.best) > config.delay_tolerance
        return f"images are {side} by {abs(curve.best):.3g} s" if large else ""
    large = abs(curve.best) > config.shift_tolerance
    return f"move the camera {curve.name} by {curve.best:+.2f} m" if large else ""


def _or_more(value: float, largest: float) -> str:
    return " or more (the largest that was tried)" if value > 0.999 * largest else ""
