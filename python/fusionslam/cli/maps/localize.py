# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command map localize: where on a map each frame of a recording is."""

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import OPENING, progress
from fusionslam.cli.failures import needs_extra
from fusionslam.cli.recordings import build_recording, open_data
from fusionslam.errors import ConfigError, DataError
from fusionslam.storage.progress import label_progress

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset
    from fusionslam.pipelines.recording import Recording


@opt.options_of(build_recording=build_recording, read_config=opt.read_config)
def localize(
    path: Annotated[
        Path, typer.Option("--map", metavar="MAP", help="The map's file (.fsmap).")
    ] = Path("out/site.fsmap"),
    output: Annotated[Path, typer.Option("--output", "-o", help="CSV file for the poses.")] = Path(
        "out/localizations.csv"
    ),
    *,
    build_recording: "Callable[[], Recording]",
    read_config: "Callable[[], Any]",
    skip_bad_frames: opt.SkipBad = False,
    jobs: opt.Jobs = None,
) -> None:
    """Find each frame of DATA on a map, without any guess. Recorded odometry helps."""
    needs_extra("map")
    opt.check_output(output, path, build_recording, read_config)
    from fusionslam.config import merged
    from fusionslam.mapping import PlaceMap
    from fusionslam.pipelines.place_maps import (
        has_odometry,
        localize_recording,
        odometry_of,
        write_localizations,
    )

    with PlaceMap.open(path, read_only=True) as site, progress() as step:
        config = read_config()
        for key in sorted(config.fusion.model_fields_set):
            if getattr(config.fusion, key) != (own := getattr(site.fusion, key)):
                raise ConfigError(
                    f"fusion.{key} is {getattr(config.fusion, key)}, but clouds are made as those "
                    f"of the map, where it is {own}: leave it out",
                    code="other-config",
                    fields=(f"fusion.{key}",),
                )
        whole = merged(config, {"fusion": site.fusion.model_dump()})
        step(OPENING, 0, 1)
        dataset = _open(build_recording(), whole)
        step(OPENING, 1, 1)
        poses = odometry_of(dataset, "recorded") if has_odometry(dataset) else None
        found = [
            *localize_recording(
                site,
                dataset,
                poses,
                bad_frames=opt.bad_frames(skip_bad_frames),
                jobs=opt.cores(jobs),
                progress=label_progress(step, "localising"),
            )
        ]
    write_localizations(output, found)
    fixes = sum(each.pose is not None for *_, each in found)
    reasons = Counter(each.reason.code for *_, each in found if each.pose is None and each.reason)
    print(f"{fixes} of {len(found)} frames found", end="")
    print(*(f"; {count} not: {code}" for code, count in reasons.most_common()), sep="")
    print(output)


def _open(recording: "Recording", whole: Any) -> "Dataset":
    """Open a recording for a map; of one that a camera coloured, scans may have their own colours.

    Raises:
        DataError: as ``open_data``, or the scans have no colours (code "missing-sensor").
    """
    from fusionslam.config import merged
    from fusionslam.pipelines.recording import has_colors

    try:
        return open_data(recording, whole)[0]
    except DataError as error:
        if error.code != "missing-sensor" or whole.fusion.source != "lidar":
            raise
        dataset, _ = open_data(recording, merged(whole, {"fusion": {"source": "cloud"}}))
        if has_colors(dataset):
            return dataset
        raise DataError(
            f"{error}: clouds of this map are coloured: expected images of a camera with its "
            "calibration, or scans with colours",
            code=error.code,
            fields=error.fields,
        ) from error
