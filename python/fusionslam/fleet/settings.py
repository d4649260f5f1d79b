# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Settles what all places of a folder share, by the first recording that can be described."""

from collections.abc import Sequence
from pathlib import Path

from fusionslam.base.files import make_folder
from fusionslam.base.write_lock import lock_folder
from fusionslam.config import Section, merged
from fusionslam.datasets import Dataset
from fusionslam.datasets.base import CloudDataset
from fusionslam.descriptors import describe, find_descriptor, for_clouds, with_fitted
from fusionslam.errors import ConfigError, DataError, FusionSlamError
from fusionslam.fleet.config import FILE, FleetConfig, FleetSettings
from fusionslam.fleet.recordings import Found
from fusionslam.fusion import fuse
from fusionslam.loop_closure.observation import fusion_of_scans
from fusionslam.pipelines.describe import (
    PipelineConfig,
    first_that_works,
    fit_descriptors,
    for_source,
)
from fusionslam.pipelines.recording import settle_frame
from fusionslam.registration import (
    RegistrationConfig,
    fit_lengths,
    has_lengths,
    without_lengths,
)

_SHOWN = 3
"""Recordings that a message names."""


def settle_settings(
    found: Found,
    names: Sequence[str],
    config: PipelineConfig,
    fleet: FleetConfig,
    folder: Path,
    *,
    source: str | None = None,
) -> FleetSettings:
    """Return the settings of a folder: those that it has, or new ones, which are stored.

    What depends on the data, such as the source of clouds, the radius of normals and the lengths
    of registration, is that of the first recording that can be described.

    Args:
        found: the recordings.
        names: descriptors, the first for the database.
        config: sections fusion, descriptors and registration count.
        fleet: how work is cut.
        folder: of the results.
        source: of clouds; None for the first that the recording allows.

    Raises:
        ConfigError: the folder was made with others (code "other-configuration"), or an unknown
            descriptor.
        DataError: no recording can be described, or the folder not be written.
    """
    for name in names:
        find_descriptor(name)
    if not (folder / FILE).exists():
        fitted = _fit_first(found, names, config, source)
        new = FleetSettings.of(tuple(names), fitted, fleet)
        with make_folder(folder):
            lock = lock_folder(folder)
            try:
                if not (folder / FILE).exists():  # else another process has just made it
                    new.save(folder)
                    return new
            finally:
                lock.release()
    stored = FleetSettings.load(folder)
    asked = FleetSettings.of(tuple(names), _take_fitted(config, stored, source), fleet)
    stored.check_same(asked, folder)
    return asked


def _take_fitted(
    config: PipelineConfig, stored: FleetSettings, source: str | None
) -> PipelineConfig:
    """Return a configuration with what was fitted to the data when the folder was made."""
    config = for_source(config, source or stored.fusion.source)
    changes: dict[str, Section] = {"fusion": merged(config.fusion, {"frame": stored.fusion.frame})}
    if not has_lengths(config.registration):
        fitted = stored.registration.model_dump() | without_lengths(config.registration)
        changes["registration"] = RegistrationConfig(**fitted)
    changes["descriptors"] = with_fitted(config.descriptors, stored.descriptors)
    return config.model_copy(update=changes)


def _fit_first(
    found: Found, names: Sequence[str], config: PipelineConfig, source: str | None
) -> PipelineConfig:
    """Fit a configuration to the first recording that can be described."""
    problems = list(map(str, found.refused.values()))
    for each in found.recordings:
        try:
            chosen = source or each.recording.sources()[0]
            return _fit(each.recording.open(chosen), names, config, chosen)
        except FusionSlamError as error:
            if isinstance(error, ConfigError):
                raise
            problems.append(f"{each.session}: {error}")
    shown = "; ".join(problems[:_SHOWN]) or "there is none"
    more = f"; and {len(problems) - _SHOWN} more" if len(problems) > _SHOWN else ""
    raise DataError(f"no recording can be described: {shown}{more}", code="no-recording")


def _fit(
    dataset: Dataset, names: Sequence[str], config: PipelineConfig, source: str
) -> PipelineConfig:
    """Fix what follows from the first frame that can be described."""
    config = for_source(config, source)
    if not isinstance(dataset, CloudDataset):
        config = config.model_copy(update={"fusion": settle_frame(config.fusion, dataset)})
    config = fit_descriptors(dataset, names, config, "skip")

    def describe_one(index: int) -> None:
        frame = dataset[index]
        how = for_clouds(config.descriptors, names[0], config.fusion, frame)
        describe(fuse(frame, config.fusion), names[0], how)

    first_that_works(dataset, describe_one, "skip")
    if has_lengths(config.registration) or config.registration.method == "planar":
        return config
    scans = fusion_of_scans(config.fusion, config.registration)
    cloud = first_that_works(dataset, lambda index: fuse(dataset[index], scans), "skip")
    return config.model_copy(update={"registration": fit_lengths([cloud], config.registration)})
