# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Write report.html and metrics.json from the runs stored in a folder."""

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Points
from fusionslam.base.machine import machine, versions
from fusionslam.config import merged
from fusionslam.errors import DataError
from fusionslam.evaluation import Evaluation, VerifiedRun
from fusionslam.evaluation.loops.protocols import DEFAULTS
from fusionslam.fusion import FusionConfig, fuse
from fusionslam.loop_closure import fusion_of_scans
from fusionslam.mapping import PlaceMap
from fusionslam.pipelines.compare_descriptors import DEMO_NOTE, evaluate_stored, stored_config
from fusionslam.pipelines.place_maps import true_keyframes
from fusionslam.pipelines.recording import Recording
from fusionslam.pipelines.results import Work
from fusionslam.registration import PreparedCloud, RegistrationConfig
from fusionslam.report.loops.comparison import pair_up, write_comparison
from fusionslam.report.loops.exports import metrics_of
from fusionslam.report.loops.page import MAP_PAGE, write_report
from fusionslam.report.page.html import write_figures
from fusionslam.report.place_maps import MapLead, lead_of
from fusionslam.sensors.frame import Cloud, Frame

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset


def write_stored_metrics(
    folder: str | os.PathLike[str],
    evaluations: Sequence[Evaluation],
    *,
    command: str = "",
    protocol: str = DEFAULTS.protocol,
) -> Path:
    """Write ``folder/metrics.json``, every figure under every protocol, and comparison.csv.

    The latter is of one protocol. Raises DataError.
    """
    dataset = evaluations[0].run.dataset
    about = {"dataset": dataset, "command": command, "versions": versions(), "machine": machine()}
    path = Path(folder) / "metrics.json"
    write_figures(path, about, [metrics_of(evaluation) for evaluation in evaluations])
    compared = pair_up(evaluations)
    if compared:
        write_comparison(Path(folder), {dataset: compared}, protocol)
    return path


def write_stored_report(
    folder: str | os.PathLike[str],
    evaluations: Sequence[Evaluation] | None = None,
    *,
    output: str | os.PathLike[str] | None = None,
    protocol: str | None = None,
) -> Path:
    """Write report.html for the runs in a folder, with pictures if the recording is still there.

    Args:
        folder: folder that ``benchmark`` wrote.
        evaluations: evaluations of these runs; None computes them.
        output: None writes the report into ``folder``.
        protocol: protocol that judges the loops; None for that of the stored configuration.

    Raises:
        DataError: no runs, or the output cannot be written.
        FusionSlamError: matplotlib or jinja2 is not installed.
    """
    if evaluations is None:
        evaluations, _ = evaluate_stored(folder)
    work = Work.load(folder)
    runs = [evaluation.run for evaluation in evaluations]
    fusion = {run.source: merged(FusionConfig(), run.config["fusion"]) for run in runs}
    registered = {
        run.source: merged(RegistrationConfig(), run.config.get("registration", {}))
        for run in runs
        if isinstance(run, VerifiedRun)
    }
    frames = _FrameReader(work.recording, fusion, registered) if work else None
    target = Path(output or folder)
    drive_map = _lead_of_map(target, work.recording if work else None)
    return write_report(
        evaluations,
        target,
        dataset_name=runs[0].dataset,
        command=work.command if work else "",
        config={f"{run.source} / {run.name}": run.config for run in runs},
        protocol=protocol or stored_config(folder).protocol,
        clouds=frames.read_cloud if frames else None,
        images=frames.read_image if frames else None,
        scans=frames.read_scan if frames else None,
        notes=[DEMO_NOTE] if work and work.demo and "cloud" in fusion else [],
        drive_map=drive_map,
    )


def _lead_of_map(folder: Path, recording: Recording | None) -> MapLead | None:
    """What the map of the same drive shows; None where there is no page of one."""
    path = folder / MAP_PAGE
    if not path.exists():
        return None
    with PlaceMap.open(path.with_suffix(".fsmap"), read_only=True) as site:
        known, session = None, site.sessions[0].name
        with suppress(DataError):  # the recording may be gone
            if recording is not None:
                known = true_keyframes(site, session, recording.open("lidar"))
        return lead_of(site, {} if known is None else {session: known})


class _FrameReader:
    """Reads frames of a recording by their number in the file names, for the report's pictures."""

    def __init__(
        self,
        recording: Recording,
        fusion: Mapping[str, FusionConfig],
        registration: Mapping[str, RegistrationConfig],
    ) -> None:
        # Gaps do not matter here: the number identifies the frame.
        self.recording, self.fusion = replace(recording, gaps="skip"), fusion
        self.registration = registration
        self._opened: dict[str, tuple[Dataset, dict[int, int]]] = {}

    def read_cloud(self, source: str, number: int) -> Cloud:
        return fuse(self._read(source, number), self.fusion[source])

    def read_scan(self, source: str, number: int) -> Points:
        """Return the points that registration compared, float32 (N, 3)."""
        config = self.registration[source]
        fusion = fusion_of_scans(self.fusion[source], config)
        scan = fuse(self._read(source, number), fusion)
        if config.method == "planar":
            return scan.points
        return PreparedCloud(scan, config).above_ground

    def read_image(self, source: str, number: int) -> NDArray[np.uint8]:
        """Return the left image; clouds without images take it from a source that has one."""
        for other in ("lidar", "stereo"):
            with suppress(DataError):
                return self._read(other, number).images["left"]
        self._open(source)  # an error of the recording itself is the better reason
        raise DataError(f"{self.recording.path}, frame {number}: no left image")

    def _read(self, source: str, number: int) -> Frame:
        dataset, places = self._open(source)
        if number not in places:
            raise DataError(f"{self.recording.path}: frame {number} is not there")
        return dataset[places[number]]

    def _open(self, source: str) -> "tuple[Dataset, dict[int, int]]":
        if source not in self._opened:
            found = self.recording.open(source)
            places = {number: i for i, number in enumerate(found.numbers.tolist())}
            self._opened[source] = found, places
        return self._opened[source]
