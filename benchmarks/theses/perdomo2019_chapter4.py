# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Chapter 4 of Perdomo 2019 as tables and pictures, with published and measured figures."""

from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.theses.conclusions import Claim, Operand, decide
from benchmarks.theses.config import KITTI_SEQUENCES
from benchmarks.theses.descriptor_study import (
    COLOR_SPACES,
    PROTOCOL,
    TOWN,
    DescriptorStudy,
    Measured,
)
from benchmarks.theses.document import Chapter
from fusionslam.evaluation import CITATION, PrecisionRecall
from fusionslam.evaluation.loops.published import (
    PUBLISHED_COLOR_SPACES,
    PUBLISHED_MATCH_SECONDS,
    PUBLISHED_RECALL,
    PUBLISHED_SECONDS,
)
from fusionslam.report.loops.exports import metrics_of
from fusionslam.report.loops.plots import draw_curves
from fusionslam.report.page.images import Picture, keep
from fusionslam.report.page.tables import Column, build_table

NAMES = {"m2dp": "M2DP", "cm2dp": "c-M2DP", "cshot": "CSHOT"}
SPACES = {"rgb": "RGB", "hsv": "HSV", "lab": "CIELab"}
STORED = "KITTI 06, its author's descriptors"
_SOURCES = {"lidar": "LiDAR and camera", "stereo": "stereo camera"}
_TABLES = {"lidar": ("4.2", "4.4"), "stereo": ("4.3", "4.5")}
_FIRST_FIGURE = {"lidar": 2, "stereo": 6}


def chapters(study: DescriptorStudy, folder: Path) -> list[Chapter]:
    """Build the chapters for sections 4.2 to 4.4."""
    return [_colors(study, folder), _times(study), _recalls(study, folder)]


def _colors(study: DescriptorStudy, folder: Path) -> Chapter:
    chapter = Chapter("Perdomo 2019, 4.2: colour spaces")
    case = _find_colored_case(study)

    columns: list[Column[str]] = []
    for place, precision in enumerate((1.0, 0.9)):
        title = f"recall at {100 * precision:.0f} % precision"
        here = partial(color_recall, study, precision=precision)
        known = {space: recalls[place] for space, recalls in PUBLISHED_COLOR_SPACES.items()}
        columns += [
            Column(title, f"here, on {case}", here, "{:.3f}"),
            Column("thesis, KITTI 06", "as published", known.get, "{:.3f}"),
        ]
    table = build_table(columns, COLOR_SPACES, [SPACES[space] for space in COLOR_SPACES])
    chapter.show(f"c-M2DP on {case}, LiDAR and camera, as its author computes it", table, "colours")
    curves = {SPACES[space]: _color_curve(study, space) for space in COLOR_SPACES}
    caption = f"Figure 4.1: c-M2DP in three colour spaces, on {case}. {_MARKS}"
    chapter.picture(_draw(curves, folder, "descriptors_colors", caption))
    return chapter


def _times(study: DescriptorStudy) -> Chapter:
    chapter = Chapter("Perdomo 2019, 4.3: times")
    case = "KITTI 05" if "KITTI 05" in study.cases else study.cases[0]
    for source in study.sources(case):
        columns: list[Column[str]] = []
        for stage, title, published in (
            ("describe", "computing", PUBLISHED_SECONDS),
            ("match", "matching", PUBLISHED_MATCH_SECONDS),
        ):
            measured = {name: study.find(case, source, name, "author") for name in NAMES}
            here = {name: _mean_time(found, stage) for name, found in measured.items()}
            known = {name: published.get(("05", source, name)) for name in NAMES}
            columns += [
                Column(f"{title}, ms", "mean and deviation", here.get),
                Column("thesis, ms", "mean over KITTI 05", known.get, "{:.1f}", scale=1e3),
            ]
        if source in _TABLES:
            table = build_table(columns, list(NAMES), list(NAMES.values()))
            title = f"Table {_TABLES[source][0]}, {_SOURCES[source]}, here on {case}"
            chapter.show(title, table, "descriptor")
    thinned = (
        " Stereo clouds of the town are thinned to one point in 0.2 m." if TOWN in case else ""
    )
    chapter.say(
        "One frame at a time took this long while as many were worked on as there were jobs; the "
        f"thesis's times are from another machine, an i7 at 2.0 GHz.{thinned}"
    )
    return chapter


def _mean_time(measured: Measured | None, stage: str) -> str | None:
    seconds = None if measured is None else measured.evaluation.run.seconds.get(stage)
    if seconds is None or not len(seconds):
        return None
    return f"{np.mean(seconds) * 1e3:.3g} ± {np.std(seconds) * 1e3:.2g}"


def _recalls(study: DescriptorStudy, folder: Path) -> Chapter:
    chapter = Chapter("Perdomo 2019, 4.4: precision and recall")
    chapter.say(f"Published: {CITATION}. Here: the same protocol; recall ends at 1 by definition.")
    for source in _SOURCES:
        rows = [f"KITTI {name}" for name in KITTI_SEQUENCES]
        rows += [case for case in study.cases if case not in rows]
        if source == "lidar" and study.stored is not None:
            rows.insert(1, STORED)
        columns: list[Column[str]] = []
        for name, title in NAMES.items():
            columns.append(_measured_column(study, source, name, "author", title))
            columns.append(_published_column(source, name))
        for name in ("m2dp", "cm2dp"):
            title = f"ours, {NAMES[name]}"
            columns.append(_measured_column(study, source, name, "robust", title))
        title = f"Table {_TABLES[source][1]}, recall at 100 % precision, {_SOURCES[source]}"
        chapter.show(title, build_table(columns, rows, rows), "sequence")
    if study.cases == [TOWN]:
        chapter.say(
            "KITTI was not given (--kitti), so its rows hold what was published; the town is "
            "simulated and has another difficulty."
        )
    if study.stored is not None:
        _add_stored(chapter, study)
    for case in study.cases:
        for source in study.sources(case):
            chapter.picture(_figure(study, case, source, folder))
    return chapter


def _add_stored(chapter: Chapter, study: DescriptorStudy) -> None:
    stored = study.stored
    assert stored is not None  # checked by the caller
    chapter.say(
        f"From the descriptors of KITTI 06 that their author stored, {stored.equal} of the "
        f"{stored.rows} points of his curve come out to 6 digits (figure 4.2, M2DP)."
    )
    names = list(stored.vectors)
    column: Column[str] = Column(
        "L2 from its author's vector",
        "of the cloud that he described",
        stored.vectors.get,
        "{:.1e}",
    )
    title = "Our vectors of one of his clouds, preset author"
    chapter.show(title, build_table([column], names, names), "vector")


def _measured_column(
    study: DescriptorStudy, source: str, name: str, variant: str, title: str
) -> Column[str]:
    def text(case: str) -> str | None:
        if case == STORED:
            mine = name == "m2dp" and variant == "author" and study.stored is not None
            full = study.stored.curve.recall_at_full_precision if mine and study.stored else None
            return None if full is None else f"{full:.6f}"
        found = study.find(case, source, name, variant)
        full = found.curve.recall_at_full_precision if found and found.curve else None
        return None if full is None else f"{full:.3f}"

    return Column(title, f"here, preset {variant}", text)


def _published_column(source: str, name: str) -> Column[str]:
    def recall(case: str) -> float | None:
        return PUBLISHED_RECALL.get((case.removeprefix("KITTI ")[:2], source, name))

    return Column("thesis", "as published", recall, "{:.6f}")


_MARKS = "Squares: recall at 100 % precision; dots: the largest F1."


def _figure(study: DescriptorStudy, case: str, source: str, folder: Path) -> Picture | None:
    curves = {
        f"{NAMES[name]}{', ours' if variant == 'robust' else ''}": found.curve
        for variant in ("author", "robust")
        for name in NAMES
        if (found := study.find(case, source, name, variant)) is not None
    }
    sequence = case.removeprefix("KITTI ")
    where = "The like of figures 4.2 to 4.9"
    if sequence in KITTI_SEQUENCES and source in _FIRST_FIGURE:
        where = f"Figure 4.{_FIRST_FIGURE[source] + KITTI_SEQUENCES.index(sequence)}"
    caption = f"{where}: {case}, {_SOURCES.get(source, source)}. {_MARKS}"
    return _draw(curves, folder, f"descriptors_{case}_{source}", caption)


def _draw(
    curves: dict[str, PrecisionRecall | None], folder: Path, name: str, caption: str
) -> Picture | None:
    """Draw the curves that have a correct match; None if none has."""
    known = {title: curve for title, curve in curves.items() if curve and curve.n_correct}
    return keep(folder, name, draw_curves(known), caption) if known else None


def recall_at(curve: PrecisionRecall | None, precision: float) -> float | None:
    """Return the largest recall with at least this precision; None if recall is undefined."""
    if curve is None or not curve.n_correct:
        return None
    reached = curve.recall[curve.precision >= precision]
    return float(reached.max()) if reached.size else 0.0


def color_recall(study: DescriptorStudy, space: str, precision: float) -> float | None:
    """Return the largest recall of c-M2DP in a colour space with at least this precision."""
    return recall_at(_color_curve(study, space), precision)


def _color_curve(study: DescriptorStudy, space: str) -> PrecisionRecall | None:
    found = study.find(_find_colored_case(study), "lidar", "cm2dp", space)
    return None if found is None else found.curve


def _find_colored_case(study: DescriptorStudy) -> str:
    return next(one.case for one in study.measured if one.variant in COLOR_SPACES)


def descriptor_claims(study: DescriptorStudy) -> list[Claim]:
    """Decide the conclusions of chapter 4 on the available data."""
    cases = {
        f"{case}, {source}": (case, source)
        for case in study.cases
        for source in study.sources(case)
    }

    colored = _find_colored_case(study)
    figures = {"recall": full_recall, "describe_ms": describe_ms}

    def value(case: str, name: str, operand: Operand) -> float | None:
        descriptor, variant = str(operand).split()
        if variant in COLOR_SPACES:
            return color_recall(study, variant, 1.0) if case == colored else None
        found = study.find(*cases[case], descriptor, variant) if case in cases else None
        return None if found is None else figures[name](found)

    formats = {"recall": "{:.3f}", "describe_ms": "{:.1f} ms"}
    claims = decide("descriptors", [*cases, colored], value, formats)
    if study.stored is not None:
        claims.append(_decide_stored(study))
    return claims


def _decide_stored(study: DescriptorStudy) -> Claim:
    assert study.stored is not None  # checked by the caller
    full = study.stored.curve.recall_at_full_precision or 0.0
    known = PUBLISHED_RECALL["06", "lidar", "m2dp"]
    case = "KITTI 06"
    return Claim(
        "From the author's stored descriptors comes the published recall, to 6 digits",
        {case: f"{full:.6f} and {known:.6f}"},
        {case: f"{full:.6f}" == f"{known:.6f}"},
    )


def full_recall(measured: Measured | None) -> float | None:
    """Return the recall at 100 % precision; None if not measured or undefined."""
    return None if measured is None else recall_at(measured.curve, 1.0)


def describe_ms(measured: Measured | None) -> float | None:
    """Return the mean time to describe a cloud; None if not measured."""
    if measured is None:
        return None
    seconds = measured.evaluation.run.seconds.get("describe", np.empty(0))
    return float(np.mean(seconds) * 1e3) if len(seconds) else None


def descriptor_figures(study: DescriptorStudy) -> dict[str, Any]:
    """Collect all results on descriptors."""
    stored = study.stored and {
        "curve": study.stored.curve.metrics(),
        **{k: v for k, v in asdict(study.stored).items() if k != "curve"},
    }
    return {
        "descriptors": [
            {"case": one.case, "variant": one.variant, **metrics_of(one.evaluation)}
            for one in study.measured
        ],
        "protocol": PROTOCOL,
        "stored": stored,
    }
