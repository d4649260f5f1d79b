# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command views show: a picture of a scan as a scene, or of two scenes and their matches."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.failures import needs_extra
from fusionslam.cli.recordings import build_recording, open_data

if TYPE_CHECKING:
    from fusionslam.pipelines.recording import Recording


@opt.options_of(build_recording=partial(build_recording, gt=None), views_config=opt.views_config)
def show(
    frame: Annotated[
        int, typer.Option("--frame", metavar="N", help="Number of the scan, as in matches.csv.")
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="The picture, a .png.")],
    against: Annotated[
        int | None,
        typer.Option("--against", metavar="M", help="Number of a scan to compare it with."),
    ] = None,
    *,
    build_recording: "Callable[[], Recording]",
    views_config: Callable[[], Any],
) -> None:
    """Draw a scan and its objects, or the matching objects of two scans."""
    from fusionslam.errors import ConfigError
    from fusionslam.pipelines import scenes
    from fusionslam.report.views.scene_figures import write_pair_picture, write_scene_picture
    from fusionslam.views import recognisers
    from fusionslam.views.clusters import ClusteredScan, cluster_scan

    if output.suffix.lower() != ".png":
        raise ConfigError(f"--output is {output}, expected the name of a .png")
    needs_extra("report", module="matplotlib")
    opt.check_output(output, build_recording, views_config)
    dataset, whole = open_data(build_recording(), views_config())

    def scan(number: int) -> ClusteredScan:
        cloud = scenes.record_cloud(dataset, number, fusion=whole.fusion, recording=whole.recording)
        return cluster_scan(number, cloud, recognisers.scene_config(whole.views))

    if against is None:
        write_scene_picture(output, scan(frame))
    else:
        similarity = recognisers.similarity_config(whole.views)
        is_aligned = recognisers.method_of(whole.views) == "alignment"
        alignment = recognisers.alignment_config(whole.views) if is_aligned else None
        write_pair_picture(output, scan(frame), scan(against), similarity, alignment)
    print(output)
