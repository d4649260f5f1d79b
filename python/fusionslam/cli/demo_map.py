# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The map that the demo ends with."""

import json
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

from fusionslam.cli.failures import needs_extra
from fusionslam.errors import ConfigError, DataError, FusionSlamError
from fusionslam.storage.progress import Step, label_progress

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset
    from fusionslam.mapping import PlaceMap
    from fusionslam.mapping.config import MapConfig
    from fusionslam.pipelines.describe import PipelineConfig
    from fusionslam.pipelines.recording import Recording

MAP = "map.fsmap"
_SESSION = "demo"
_KEYFRAME_DISTANCE_M = {"town": 5.0}
_INDOORS_M = 1.0


def map_drive(
    recording: "Recording",
    folder: Path,
    world: str,
    config: "PipelineConfig",
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
    from fusionslam.pipelines.results import delete_page

    page = folder / Path(MAP).with_suffix(".html")
    try:
        needs_extra("map")
    except FusionSlamError as error:
        delete_page(folder, page.stem)
        return [f"no map of the drive: {error}"]
    from fusionslam.cli.maps.build import finish_map
    from fusionslam.geometry.odometry_noise import DRIFT
    from fusionslam.mapping.config import MapConfig
    from fusionslam.pipelines.place_maps import build_map, odometry_of

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


def _open_map(
    path: Path, dataset: "Dataset", config: "PipelineConfig", own: "MapConfig"
) -> "PlaceMap":
    """Open the map of this drive and configuration; that of an earlier one is replaced."""
    import numpy as np

    from fusionslam.config import merged
    from fusionslam.mapping import PlaceMap

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
