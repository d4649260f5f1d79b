# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Configuration of loop detection, and the thresholds that were fitted."""

from pathlib import Path

from fusionslam.base import texts
from fusionslam.base.argument_types import checked
from fusionslam.config import Section, option
from fusionslam.descriptors import DescriptorConfig, with_preset
from fusionslam.errors import ConfigError

_THRESHOLDS = Path(__file__).with_name("thresholds.yaml")


class LoopConfig(Section):
    """Which frames are compared, and what makes a loop of two."""

    threshold: float | None = option(None, texts.THRESHOLD, ge=0, allow_inf_nan=False)
    window: int = option(50, texts.LOOP_WINDOW, unit="frames", ge=0)
    window_seconds: float = option(
        0.0, "candidates are older than this; 0 is off", unit="s", ge=0, allow_inf_nan=False
    )
    max_frames: int = option(
        100_000,
        "most frames kept for comparison; at this number a quarter is forgotten, of the frames "
        "outside the window those most like an older one; 0 is no limit",
        ge=0,
    )
    verify: bool | None = option(
        None,
        "whether loops are proven by registration; none is yes unless a threshold is given",
    )
    candidates: int = option(10, "nearest frames of each descriptor that are verified", ge=1)
    voters: tuple[str, ...] = option(
        ("bev_spectrum", "scan_context"),
        "verified: descriptors whose nearest frames are candidates beside those of the detector's "
        "own; of the whole scan where there is one",
    )
    refined: int = option(
        3,
        "verified: candidates that are registered, of those whose images correlate most; without "
        "registration.gravity all are, and this many, the nearest, thoroughly",
        ge=1,
    )
    max_distance: float = option(
        9.0, "verified: poses of one place are at most this far apart", unit="m", gt=0
    )
    min_probability: float = option(
        0.95, "verified: a loop at least this probable counts at once", ge=0, le=1
    )
    min_supported: float = option(
        0.9,
        "verified: a loop at least this probable counts if one of the last three frames' loops "
        "agrees with it, by odometry",
        ge=0,
        le=1,
    )
    false_rate: float | None = option(
        None,
        "verified: largest share of false loops in a drive, which calibration holds in 95 % of the "
        "drives like those it knows; asks for more than the two least probabilities where these do "
        "not suffice. None promises nothing",
        gt=0,
        lt=1,
    )
    drift: float = option(
        0.05, "verified: error of odometry, as a share of the way", ge=0, allow_inf_nan=False
    )
    drift_angle: float = option(
        1.0, "verified: error of odometry's heading", unit="deg/m", ge=0, allow_inf_nan=False
    )


def fitted_threshold(
    descriptor: str, describe: DescriptorConfig | None = None, source: str = "lidar"
) -> float | None:
    """Return the threshold fitted to a descriptor, its preset and a source of clouds, or None.

    Raises:
        ConfigError: unknown descriptor.
    """
    import yaml

    name = with_preset(descriptor, describe or DescriptorConfig())
    by_source = yaml.safe_load(_THRESHOLDS.read_text(encoding="utf-8"))
    if source not in by_source:
        raise ConfigError(f"source is {source!r}, expected one of {', '.join(by_source)}")
    fitted: float | None = by_source[source].get(name)
    return fitted


@checked
def default_threshold(
    descriptor: str, describe: DescriptorConfig | None = None, source: str = "lidar"
) -> float:
    """Return the threshold that was fitted to a descriptor, its preset and a source of clouds.

    docs/stages/loop_closure.md says how, and how right the loops are that it accepts.

    Raises:
        ConfigError: unknown descriptor, or one that none was fitted to (code "no-threshold").
    """
    fitted = fitted_threshold(descriptor, describe, source)
    if fitted is None:
        raise ConfigError(
            f"no threshold was fitted to {descriptor} and {source} clouds: give a distance "
            "(threshold), one of a run of fusionslam bench (--threshold FOLDER), or verify loops, "
            "which needs none",
            code="no-threshold",
            fields=(descriptor, source),
        )
    return fitted
