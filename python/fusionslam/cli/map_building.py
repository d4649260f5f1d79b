# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What ``map build`` and ``demo`` make of a drive: its map, and lines about it."""

import json
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from fusionslam.base.progress import Step, label_progress
from fusionslam.base.texts import counted
from fusionslam.cli import options as opt
from fusionslam.cli.console import during
from fusionslam.cli.data import open_data
from fusionslam.cli.failures import needs_extra
from fusionslam.config import merged
from fusionslam.datasets import Dataset
from fusionslam.errors import ConfigError, DataError, FusionSlamError
from fusionslam.geometry.odometry_noise import DRIFT
from fusionslam.mapping import PlaceMap
from fusionslam.mapping.config import MapConfig
from fusionslam.pipelines.describe import PipelineConfig
from fusionslam.pipelines.place_maps import (
    Built,
    MapOdometry,
    build_map,
    odometry_of,
    true_keyframes,
)
from fusionslam.pipelines.recording import Recording, has_colors
from fusionslam.pipelines.results import delete_page
from fusionslam.registration import Refusal
from fusionslam.report.place_maps import read_drives, write_map_page

MAP = "map.fsmap"
_SESSION = "demo"
_KEYFRAME_DISTANCE_M = {"town": 5.0}
_INDOORS_M = 1.0


def map_drive(
    recording: Recording,
    folder: Path,
    world: str,
    config: PipelineConfig,
    step: Step,
    *,
    jobs: int,
    no_report: bool,
) -> list[str]:
    """Build a map of the demo's drive in its folder, and the page of it; go on with one begun.

    Args:
        recording: the drive.
        folder: of the demo.
        world: name of the world; places indoors are smaller.
        config: of its coloured scans.
        jobs: number of frames read ahead.
        step: progress callback.
        no_report: whether no page is written.

    Returns:
        Lines to print: what is in the map, and its errors; or why there is none.

    Raises:
        DataError: the map cannot be written, or the folder has a map of something else.
    """
    page = folder / Path(MAP).with_suffix(".html")
    try:
        needs_extra("map")
    except FusionSlamError as error:
        delete_page(folder, page.stem)
        return [f"no map of the drive: {error}"]
    dataset = recording.open("lidar")
    own = MapConfig(keyframe_distance=_KEYFRAME_DISTANCE_M.get(world, _INDOORS_M))
    with _open_map(folder / MAP, dataset, config, own) as site:
        build_map(
            site,
            dataset,
            odometry_of(dataset, "truth+noise", errors=DRIFT, step=step),
            bad_frames="skip",
            jobs=jobs,
            progress=label_progress(step, "mapping the drive"),
        )
        warning = site.reason
    if no_report:
        delete_page(folder, page.stem)
    shown = None if no_report else page
    return finish_map(folder / MAP, _SESSION, dataset, "truth+noise", shown, step, warning)


def _open_map(path: Path, dataset: Dataset, config: PipelineConfig, own: MapConfig) -> PlaceMap:
    """Open the map of this drive and configuration; that of an earlier one is replaced."""
    digest = sha256(json.dumps([config.model_dump(), own.model_dump()]).encode())
    for values in (dataset.poses, dataset[0].points):
        digest.update(np.asarray(values).tobytes())
    drive = f"{dataset.name} {digest.hexdigest()[:16]}"

    def open_it() -> PlaceMap:
        return PlaceMap.open(
            path,
            _SESSION,
            descriptor="cm2dp",
            loops=merged(config.loop_closure, {"window": 20}),
            describe=config.descriptors,
            fusion=config.fusion,
            registration=config.registration,
            config=own,
        )

    # The configuration of an earlier one decides whether it is replaced.
    site = PlaceMap.open(path, _SESSION) if path.exists() else open_it()
    try:
        if {session.name for session in site.sessions} - {_SESSION}:
            raise DataError(
                f"{path} is no map of the demo: choose another folder",
                code="other-results",
                fields=(str(path),),
            )
        site.check_recording(drive)
    except ConfigError:  # that of another drive
        site.close()
        for suffix in ("", "-wal", "-shm"):
            Path(f"{path}{suffix}").unlink(missing_ok=True)
        site = open_it()
        site.check_recording(drive)
    except BaseException:
        site.close()
        raise
    return site


def describe_growth(built: Built, window: int) -> str:
    """Say what a map gained, and that no loops may be for the window (in keyframes) being long."""
    left = f", {counted(len(built.skipped), 'frame')} left out" if built.skipped else ""
    if not built.keyframes and not built.loops:
        return f"nothing new{left or ': the map has all of it'}"
    short = ""
    if not built.loops and 4 < built.keyframes <= 2 * window:
        short = (
            f"; keyframes are compared with those {window} and more before them: a map of its own "
            f"with --set loop_closure.window={built.keyframes // 4} has more to compare"
        )
    return f"{counted(built.keyframes, 'keyframe')}, {counted(built.loops, 'loop')}{left}{short}"


_MADE_ODOMETRY = "Odometry is made: true poses with errors (odometry.KEY of the configuration)."


def finish_map(
    path: Path,
    session: str,
    dataset: Dataset,
    odometry: MapOdometry,
    page: Path | None,
    step: Step,
    warning: Refusal | None = None,
) -> list[str]:
    """Describe a map that was built, with its errors where the truth is known; write its page.

    Args:
        path: of the map.
        session: that was built.
        dataset: its recording.
        odometry: where it came from.
        page: path of the page; None for none.
        step: progress callback.
        warning: what is wrong with the map as a whole.

    Returns:
        Lines to print.

    Raises:
        DataError: the map cannot be read, or the page cannot be written.
    """
    with PlaceMap.open(path, read_only=True) as site:
        known = true_keyframes(site, session, dataset)
        truth = {} if known is None else {session: known}
        lines = [site.describe()]
        lines += [
            f"ATE of {drive.name}: {drive.error:.2f} m, of odometry alone "
            f"{drive.odometry_error:.2f} m"
            for drive in read_drives(site, truth)
            if drive.error is not None
        ]
        notes = [_MADE_ODOMETRY] if odometry == "truth+noise" else []
        if page is not None:
            with during(step, "drawing the map"):
                why = [f"{warning}."] if warning else []
                write_map_page(page, site, truth, command=opt.command_line(), notes=[*notes, *why])
    return [*lines, *notes]


def open_for_map(recording: Recording, whole: Any) -> Dataset:
    """Open a recording for a map; of one that a camera coloured, scans may have their own colours.

    Raises:
        DataError: as ``open_data``, or the scans have no colours (code "missing-sensor").
    """
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
