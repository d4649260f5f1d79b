# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``reproduce``: measure every requested part and write one page."""

import os
from pathlib import Path
from typing import Any

from benchmarks.theses import (
    perdomo2019_chapter4 as chapter4,
)
from benchmarks.theses import (
    stastny2022_chapter5 as chapter5,
)
from benchmarks.theses import (
    stastny2022_section58 as chapter58,
)
from benchmarks.theses.conclusions import Claim, view_claims
from benchmarks.theses.config import PARTS, ReproduceConfig, check_config
from benchmarks.theses.descriptor_study import sequences_of_kitti, study_descriptors
from benchmarks.theses.differences import (
    Difference,
    descriptor_differences,
    view_differences,
)
from benchmarks.theses.document import Chapter
from benchmarks.theses.drives import Source, sources
from benchmarks.theses.map_study import study_maps
from benchmarks.theses.page import (
    claims_chapter,
    differences_chapters,
    view_figures,
    write_figures,
    write_page,
)
from benchmarks.theses.view_study import study_views
from benchmarks.theses.work_cache import WorkCache, save_json
from fusionslam.base.progress import Step
from fusionslam.report.page.figures import use_style
from fusionslam.report.page.html import about_report, check_extra


class _Report:
    """Collects the results of all parts.

    Args:
        config: the configuration.
        drives: the drives for the parts of the second thesis.
        folder: folder of the pictures and intermediate results.
        jobs: number of frames processed in parallel.
        step: progress callback.
    """

    def __init__(
        self,
        config: ReproduceConfig,
        drives: list[Source],
        folder: Path,
        jobs: int,
        step: Step | None,
    ) -> None:
        self.config, self.drives, self.folder = config, drives, folder
        self.jobs, self.step = jobs, step
        self.pieces = WorkCache(folder / "pieces")
        self.chapters: list[Chapter] = []
        self.claims: list[Claim] = []
        self.differences: list[Difference] = []
        self.figures: dict[str, Any] = {}

    def views(self) -> None:
        """Sections 5.4 to 5.7 of Stastny 2022."""
        views, folder = self.config.views, self.folder
        study = study_views(self.config, self.drives, self.pieces, self.step)
        self.chapters += [
            chapter5.drives_chapter(study),
            chapter5.accuracy_chapter(study, views, folder),
            chapter5.errors_chapter(study, views, folder),
            chapter5.times_chapter(study, views, folder),
            chapter5.memory_chapter(study, views),
        ]
        self.claims += view_claims(study)
        self.differences += view_differences(study, views)
        self.figures |= view_figures(study)

    def maps(self) -> None:
        """Section 5.8."""
        study = study_maps(self.config, self.drives, self.pieces, self.step)
        self.chapters.append(chapter58.maps_chapter(study, self.folder))
        self.claims += chapter58.map_claims(study)
        self.figures |= chapter58.map_figures(study)

    def descriptors(self) -> None:
        """Chapter 4 of Perdomo 2019."""
        folder = self.folder / "descriptors"
        study = study_descriptors(self.config, folder, self.jobs, self.step)
        self.chapters += chapter4.chapters(study, self.folder)
        self.claims += chapter4.descriptor_claims(study)
        self.differences += descriptor_differences(study)
        self.figures |= chapter4.descriptor_figures(study)


def reproduce(
    config: ReproduceConfig,
    folder: str | os.PathLike[str],
    *,
    jobs: int = 1,
    command: str = "",
    step: Step | None = None,
) -> Path:
    """Repeat the measurements of both theses, and write one page about them.

    Finished results are kept in the folder, so the same call resumes an interrupted one.

    Args:
        config: what to reproduce, with what data.
        folder: created if missing.
        jobs: number of frames processed in parallel.
        command: the command line, for the page.
        step: progress callback.

    Returns:
        The path of ``reproduce.html``.

    Raises:
        ConfigError: an unknown world, method or part.
        DataError: unusable data, or a folder that cannot be written.
        FusionSlamError: a required extra is not installed.
    """
    check_extra()
    check_config(config)
    if config.kitti is not None and "descriptors" in config.parts:
        sequences_of_kitti(Path(config.kitti).expanduser())  # fail early, not after hours of work
    drives, target = sources(config, jobs, step), Path(folder)
    about = about_report("two theses", command, config.model_dump(mode="json"))
    save_json(about, target / "made_with.json")
    report = _Report(config, drives, target, jobs, step)
    with use_style():
        for part in PARTS:
            if part in config.parts:
                getattr(report, part)()
    write_figures(target, report.figures, report.claims, about)
    first = claims_chapter(report.claims)
    chapters = [first, *differences_chapters(report.differences), *report.chapters]
    return write_page(target, chapters, config, about)
