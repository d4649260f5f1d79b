# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command fuse: coloured clouds of a recording."""

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import progress
from fusionslam.cli.failures import keep, needs_extra
from fusionslam.storage.progress import Step, label_progress

if TYPE_CHECKING:
    from fusionslam.fusion import FusionConfig
    from fusionslam.pipelines.recording import Recording

logger = logging.getLogger(__name__)


@opt.reading_options()
def fuse(
    ctx: typer.Context,
    *,
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="Folder for the clouds, or a bag: .bag, .db3, .mcap."),
    ],
    source: opt.Source = None,
    format: Annotated[
        str | None,
        typer.Option("--format", help="Of a folder: ply (default), pcd, or bin, without colours."),
    ] = None,
    recording: "Recording",
    pictures: Annotated[
        int, typer.Option("--pictures", metavar="N", min=0, help="Draw the steps of N frames.")
    ] = 0,
    settings: opt.Settings = None,
    config: opt.ConfigFile = None,
    jobs: opt.Jobs = None,
    verbose: opt.Verbose = False,
) -> None:
    """Write DATA's coloured clouds as a folder or bag to open again.

    Their times and poses, if there are any, lie beside them. Pictures of the steps go to the
    folder's pictures/, or beside the bag.
    """
    from fusionslam.pipelines.describe import for_source

    chosen = opt.pipeline_config(config, settings)
    asked_for = source is not None or "source" in chosen.fusion.model_fields_set
    chosen = for_source(chosen, opt.source_of(source, chosen, recording))
    if chosen.fusion.source == "cloud" and not asked_for:
        _warn_of_missing_colors(recording)
    if pictures:
        needs_extra("report")
    with progress() as step:
        count = _write_fused(ctx, recording, output, chosen.fusion, format, opt.cores(jobs), step)
        if pictures:
            _draw_stages(recording, output, chosen.fusion, pictures, step)
    print(f"{output}: {count} frames")


def _warn_of_missing_colors(recording: "Recording") -> None:
    """Warn that clouds stay without colours unless the user chose that."""
    from contextlib import suppress

    from fusionslam.errors import DataError

    # Errors in a frame are reported when it is fused.
    with suppress(DataError):
        if recording.open("cloud")[0].colors is None:
            logger.warning(
                "%s has no images with a calibration (CameraInfo): clouds have no colours "
                "(source cloud)",
                recording.path,
            )


def _write_fused(
    ctx: typer.Context,
    recording: "Recording",
    output: Path,
    config: "FusionConfig",
    format: str | None,
    jobs: int,
    step: Step,
) -> int:
    """Write the clouds; return the number of frames written."""
    from fusionslam.errors import ConfigError
    from fusionslam.pipelines.export_bag import BAG_SUFFIXES, write_cloud_bag
    from fusionslam.pipelines.export_folder import write_clouds

    count = 0

    def show(done: int, total: int) -> None:
        nonlocal count
        count = done
        step("fusing", done, total)

    if output.suffix.lower() in BAG_SUFFIXES:
        if format is not None:
            raise ConfigError(f"--format {format} is for folders of clouds, {output} is a bag")
        needs_extra("bags")
        write_cloud_bag(recording, output, config, jobs=jobs, progress=show)
        return count
    keep(ctx, output)
    write_clouds(
        recording,
        output,
        config,
        format=format or "ply",
        jobs=jobs,
        command=opt.command_line(),
        progress=show,
    )
    return count


def _draw_stages(
    recording: "Recording", output: Path, config: "FusionConfig", count: int, step: Step
) -> None:
    from fusionslam.pipelines.export_bag import BAG_SUFFIXES
    from fusionslam.report.fusion_stages import write_stages

    is_bag = output.suffix.lower() in BAG_SUFFIXES
    folder = output.with_suffix(".pictures") if is_bag else output / "pictures"
    dataset = recording.open(config.source)
    write_stages(dataset, folder, config, count, label_progress(step, "drawing"))
