# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Write the results as an HTML page, as Markdown, and every figure as JSON."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.theses.conclusions import Claim, claims_table
from benchmarks.theses.config import QUICK_EACH, ReproduceConfig
from benchmarks.theses.differences import Difference, differences_table, met_sentence
from benchmarks.theses.document import Chapter, as_markdown
from benchmarks.theses.view_study import ViewStudy
from benchmarks.theses.work_cache import save_json
from fusionslam.base.files import atomic_path
from fusionslam.base.texts import counted
from fusionslam.report.page.html import write_page as write_html

FORMAT = "fusionslam.reproduce.1"
PAGE = "reproduce.html"
TITLE = "Two theses, measured again"


def claims_chapter(claims: Sequence[Claim]) -> Chapter:
    """Build the first chapter: which conclusions hold and which do not."""
    chapter = Chapter("What the theses conclude, and what came out here")
    table = claims_table(claims)
    chapter.show("Decided by the figures below", table, "conclusion", worded=True)
    return chapter


def differences_chapters(differences: Sequence[Difference]) -> list[Chapter]:
    """Build the chapter on figures that differ from the published ones; none without comparison."""
    if not differences:
        return []
    chapter = Chapter("Where it differs from what was published")
    table = differences_table(differences)
    chapter.say(met_sentence(differences))
    if table.rows:
        chapter.show("In the theses' own set-ups", table, "figure", worded=True)
    return [chapter]


def lead(config: ReproduceConfig, about: Mapping[str, Any]) -> str:
    """Describe the page in a sentence or two."""
    machine = about["machine"]
    text = (
        "The experiments of Perdomo 2019 (c-M2DP) and Stastny 2022 (LiDAR-camera RatSLAM), run by "
        f"one command on {about['date']}, {counted(machine['cores'], 'core')} of {machine['cpu']}."
    )
    if config.quick:
        text += (
            f" Quick: only one scan of {QUICK_EACH}, no stereo clouds and no CSHOT. Figures of a "
            "quick run are no results: run the command without --quick for these."
        )
    return text


def write_page(
    folder: Path, chapters: Sequence[Chapter], config: ReproduceConfig, about: Mapping[str, Any]
) -> Path:
    """Write ``reproduce.html``, which opens offline, and ``reproduce.md``. Raises DataError."""
    first = lead(config, about)
    with atomic_path(folder / "reproduce.md") as temporary:
        head = f"# {TITLE}\n\n{first}\n\n```\n{about['command']}\n```\n\n"
        temporary.write_text(head + as_markdown(chapters), encoding="utf-8")
    template = (Path(__file__).parent / "page.html.j2").read_text(encoding="utf-8")
    write_html(folder / PAGE, template, about, title=TITLE, lead=first, chapters=chapters)
    return folder / PAGE


def write_figures(
    folder: Path, content: Mapping[str, Any], claims: Sequence[Claim], about: Mapping[str, Any]
) -> None:
    """Write ``reproduce.json``: every figure; undefined ones are null. Raises DataError."""
    told = [asdict(claim) | {"verdict": claim.verdict} for claim in claims]
    save_json({"format": FORMAT, **about, "claims": told, **content}, folder / "reproduce.json")


def view_figures(study: ViewStudy) -> dict[str, Any]:
    """Collect all results on views."""
    return {
        "drives": [asdict(drive) for drive in study.drives],
        "views": [
            {
                "world": outcome.world,
                "frame": outcome.frame,
                "method": outcome.method,
                "note": outcome.note,
                "figures": outcome.row,
                "config": outcome.run.config if outcome.run else {},
            }
            for outcome in study.outcomes
        ],
    }
