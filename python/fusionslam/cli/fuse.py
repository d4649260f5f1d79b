# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command fuse: coloured clouds of a recording."""

import logging
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import progress
from fusionslam.cli.failures import keep, keep_partial, needs_extra
from fusionslam.cli.recordings import build_recording
from fusionslam.help_texts import counted
from fusionslam.storage.progress import label_progress

if TYPE_CHECKING:
    from fusionslam.pipelines.describe import PipelineConfig
    from fusionslam.pipelines.recording import Recording

logger = logging.getLogger(__name__)


@opt.options_of(build_recording=build_recording, pipeline_config=opt.pipeline_config)
def fuse(
    ctx: typer.Context,
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="Folder for the clouds, or a bag: .bag, .db3, .mcap."),
    ] = Path("out/fuse"),
    source: opt.Source = None,
    format: Annotated[
        str | None,
        opt.one_of(
            "--format",
            names=opt.FORMATS,
            check=False,
            help="Of clouds in a folder, by default ply; bin has no colours.",
        ),
    ] = None,
    *,
    build_recording: "Callable[[], Recording]",
    pictures: Annotated[
        int, typer.Option("--pictures", metavar="N", min=0, help="Draw the steps of N frames.")
    ] = 0,
    pipeline_config: "Callable[[], PipelineConfig]",
    skip_bad_frames: opt.SkipBad = False,
    jobs: opt.Jobs = None,
) -> None:
    """Write DATA's coloured clouds as a folder or bag to open again.

    Times, and poses if known, are written beside them; pictures of the steps go to pictures/ in
    the folder, or beside the bag.
    """
    from fusionslam.errors import ConfigError
    from fusionslam.pipelines.describe import for_source
    from fusionslam.pipelines.export_bag import BAG_SUFFIXES, write_cloud_bag
    from fusionslam.pipelines.export_folder import write_clouds

    chosen = pipeline_config()
    asked_for = source is not None or "source" in chosen.fusion.model_fields_set
    is_bag = output.suffix.lower() in BAG_SUFFIXES
    if is_bag:
        if format is not None:
            raise ConfigError(f"--format {format} is for folders of clouds, {output} is a bag")
        needs_extra("bags")
    elif format is None:
        opt.check_folder_name(output, BAG_SUFFIXES, "--format ply")
    if pictures:
        needs_extra("report", module="matplotlib")
    recording, bad_frames = build_recording(), opt.bad_frames(skip_bad_frames)
    chosen = for_source(chosen, opt.choose_source(source, chosen, recording))
    if chosen.fusion.source == "cloud" and not asked_for:
        _warn_of_missing_colors(recording)
    with progress() as step:
        show = label_progress(step, "fusing")
        if is_bag:
            keep_partial(ctx, output)
            count = write_cloud_bag(
                recording,
                output,
                chosen.fusion,
                jobs=opt.cores(jobs),
                bad_frames=bad_frames,
                progress=show,
            )
        else:
            keep(ctx, output)
            count = write_clouds(
                recording,
                output,
                chosen.fusion,
                format=format or "ply",
                jobs=opt.cores(jobs),
                bad_frames=bad_frames,
                command=opt.command_line(),
                progress=show,
            )
        if pictures:
            from fusionslam.report.fusion_stages import write_stages

            folder = output.with_suffix(".pictures") if is_bag else output / "pictures"
            dataset = recording.open(chosen.fusion.source)
            show = label_progress(step, "drawing")
            write_stages(dataset, folder, chosen.fusion, pictures, show)
    print(f"{output}: {counted(count, 'frame')}")


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
