# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Write comparison.html: descriptors compared over several recordings."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fusionslam.evaluation import Evaluation
from fusionslam.report.loops.comparison import (
    COSTS_CAPTION,
    Compared,
    comparison_columns,
    draw_costs,
    pair_up,
    table_over,
    write_comparison,
)
from fusionslam.report.loops.labels import source_name
from fusionslam.report.page.figures import use_style
from fusionslam.report.page.html import about_report, check_extra, write_page
from fusionslam.report.page.images import keep
from fusionslam.report.page.tables import Table


def tables_over(recordings: Mapping[str, Sequence[Evaluation]], protocol: str) -> dict[str, Table]:
    """Tables by name of the source: mean and range over the recordings of each descriptor."""
    compared = [pair_up(evaluations) for evaluations in recordings.values()]
    everything = [each for recording in compared for each in recording]
    sources = list(dict.fromkeys(each.key[0] for each in everything))
    columns = comparison_columns(everything, protocol)
    return {
        source_name(source, sources): table_over(
            [_of_source(recording, source) for recording in compared], protocol, columns
        )
        for source in sources
    }


def _of_source(compared: Sequence[Compared], source: str) -> list[Compared]:
    return [each for each in compared if each.key[0] == source]


def write_several(
    folder: str | os.PathLike[str],
    recordings: Mapping[str, Sequence[Evaluation]],
    *,
    protocol: str,
    command: str,
    config: Mapping[str, Any],
    page: bool = True,
) -> Path:
    """Write comparison.csv and, beside it, comparison.html with its picture.

    Args:
        folder: created if missing.
        recordings: evaluations by name of the recording.
        protocol: that judges matches.
        command, config: that the evaluations were made with.
        page: whether to write more than the table.

    Returns:
        The path of the page, or of the table without one.

    Raises:
        DataError: the folder cannot be written.
        FusionSlamError: matplotlib or jinja2 is not installed.
    """
    target = Path(folder)
    compared = {name: pair_up(evaluations) for name, evaluations in recordings.items()}
    path = write_comparison(target, compared, protocol)
    if not page:
        return path
    check_extra()
    with use_style():
        costs = draw_costs([*compared.values()], protocol)
        picture = keep(target, "accuracy_cost", costs, COSTS_CAPTION)
    names = ", ".join(recordings)
    return write_page(
        target / "comparison.html",
        "comparison.html.j2",
        about_report(names, command, config),
        title="Descriptors compared",
        recordings=[*recordings],
        protocol=protocol,
        tables=tables_over(recordings, protocol),
        costs=picture,
    )
