# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``reproduce``: every part that is asked for, one page."""

import os
from pathlib import Path
from typing import Any

from fusionslam.report.assembly import about_report, check_extra
from fusionslam.report.plots import styled
from fusionslam.reproduce import chapter4, chapter5, chapter58, descriptor_study
from fusionslam.reproduce.blocks import Chapter
from fusionslam.reproduce.claims import Claim, view_claims
from fusionslam.reproduce.config import ReproduceConfig, checked
from fusionslam.reproduce.map_study import study_maps
from fusionslam.reproduce.page import claims_chapter, view_figures, write_figures, write_page
from fusionslam.reproduce.pieces import Pieces, save_json
from fusionslam.reproduce.sources import sources
from fusionslam.reproduce.view_study import study_views
from fusionslam.views.drives import Step


class _Report:
    """What the parts add up to."""

    def __init__(self) -> None:
        self.chapters: list[Chapter] = []
        self.claims: list[Claim] = []
        self.figures: dict[str, Any] = {}


def reproduce(
    config: ReproduceConfig,
    folder: str | os.PathLike[str],
    *,
    jobs: int = 1,
    command: str = "",
    step: Step | None = None,
) -> Path:
    """Measure what both theses measured, and write one page about it.

    What is finished is kept in the folder: the same call goes on where an earlier one stopped.

    Args:
        config: what is reproduced, with what data.
        folder: made if need be.
        jobs: frames worked on at a time.
        command: what was typed.
        step: told about progress.

    Returns:
        The path of ``reproduce.html``.

    Raises:
        ConfigError: an unknown world, way or part.
        DataError: data that cannot be used, or a folder that cannot be written.
        FusionSlamError: an extra that is needed is not installed.
    """
    check_extra()
    checked(config)
    target = Path(folder)
    about = about_report("two theses", command, config.model_dump(mode="json"))
    save_json(about, target / "made_with.json")
    report = _Report()
    with styled():
        if "views" in config.parts:
            _views(report, config, target, jobs, step)
        if "maps" in config.parts:
            _maps(report, config, target, jobs, step)
        if "descriptors" in config.parts:
            _descriptors(report, config, target, jobs, step)
    write_figures(target, report.figures, report.claims, about)
    return write_page(target, [claims_chapter(report.claims), *report.chapters], config, about)


def _views(
    report: _Report, config: ReproduceConfig, folder: Path, jobs: int, step: Step | None
) -> None:
    drives = sources(config, jobs, step)
    study = study_views(config, drives, Pieces(folder / "pieces"), step)
    report.chapters += [
        chapter5.drives_chapter(study),
        chapter5.accuracy_chapter(study, config.views, folder),
        chapter5.errors_chapter(study, config.views, folder),
        chapter5.times_chapter(study, config.views, folder),
        chapter5.memory_chapter(study, config.views),
    ]
    report.claims += view_claims(study)
    report.figures |= view_figures(study)


def _maps(
    report: _Report, config: ReproduceConfig, folder: Path, jobs: int, step: Step | None
) -> None:
    drives = sources(config, jobs, step)
    study = study_maps(config, drives, Pieces(folder / "pieces"), step)
    report.chapters.append(chapter58.maps_chapter(study, folder))
    report.claims += chapter58.map_claims(study)
    report.figures |= chapter58.map_figures(study)


def _descriptors(
    report: _Report, config: ReproduceConfig, folder: Path, jobs: int, step: Step | None
) -> None:
    study = descriptor_study.study_descriptors(config, folder / "descriptors", jobs, step)
    report.chapters += chapter4.chapters(study, folder)
    report.claims += chapter4.descriptor_claims(study)
    report.figures |= chapter4.descriptor_figures(study)
