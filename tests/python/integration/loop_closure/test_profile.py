# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What the first cloud says of a sensor is what detectors take its clouds by."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from clouds import scan_blocks
from fusionslam import Cloud, DescriptorConfig, FusionConfig, LoopDetector
from fusionslam.errors import DataError
from fusionslam.loop_closure import LoopConfig
from fusionslam.loop_closure.observation import FrameObserver
from fusionslam.loop_closure.profile import SensorProfile, profile_sensor
from fusionslam.registration import RegistrationConfig
from fusionslam.sensors.frame import Frame
from fusionslam.sensors.undone_motion import Deskew
from rows import rows
from streets import at, changed

STREET = Cloud(scan_blocks(at(0, 0, 20), 0, 15_000))
CLOUDS = FusionConfig(source="cloud")


def profile(given: Cloud | Frame) -> SensorProfile:
    observer = FrameObserver(
        {}, DescriptorConfig(), CLOUDS, RegistrationConfig(), fits_lengths=True
    )
    return profile_sensor(given, observer.verifying(LoopConfig().voters))


def ahead(cloud: Cloud, degrees: float) -> Cloud:
    turns = np.degrees(np.arctan2(cloud.points[:, 1], cloud.points[:, 0]))
    return Cloud(np.ascontiguousarray(cloud.points[np.abs(turns) < degrees / 2]))


@rows(
    "cloud, degrees, joins",
    [(STREET, 360, False), (ahead(STREET, 70), 70, True), (ahead(STREET, 240), 240, True)],
)
def test_a_profile_says_what_a_detector_fits(cloud: Cloud, degrees: float, joins: bool) -> None:
    found = profile(cloud)
    assert found.degrees == pytest.approx(degrees, abs=4)
    assert bool(found.registration.local_map) == joins
    detector = LoopDetector("m2dp", fusion=CLOUDS)
    detector.add(cloud)
    assert detector.registration_config == found.registration
    assert detector.describe_config == found.describe
    assert found.chosen.keys() >= {"descriptors.bev_spectrum.cell"}
    assert ("registration.local_map" in found.chosen) == joins
    labels = dict(found.rows())
    assert labels["shows"].startswith("all round" if degrees == 360 else f"{found.degrees:.0f} deg")
    assert labels["local maps"].startswith("of " if joins else "none")


def test_a_profile_says_the_tilt_and_the_time_of_a_sweep() -> None:
    turn = Rotation.from_euler("y", 20, degrees=True).as_matrix().astype(np.float32)
    tilted = np.ascontiguousarray(STREET.points @ turn)
    seconds = np.linspace(-0.1, 0, len(tilted))
    frame = Frame(number=0, stamp_ns=10**9, points=tilted, point_seconds=seconds)
    labels = dict(profile(frame).rows())
    assert labels["tilt"].startswith("20.") and labels["tilt"].endswith("is levelled")
    said = "0.100 s, from -0.100 s of the stamp on; motion within it "
    assert labels["sweep"] == f"{said}stays"
    undone = Deskew("odometry", (-0.1, 0.0), np.tile(np.eye(4), (33, 1, 1)))
    labels = dict(profile(changed(frame, deskew=undone)).rows())
    assert labels["sweep"] == f"{said}is undone by odometry"
    once = dict(profile(changed(frame, point_seconds=0 * seconds)).rows())
    assert once["sweep"].startswith("all points have one time")
    plain = dict(profile(changed(frame, point_seconds=None)).rows())
    assert plain["sweep"].startswith("points have no times")


def test_a_cloud_that_cannot_be_taken_has_no_profile() -> None:
    with pytest.raises(DataError, match="point 0 is"):
        profile(Cloud(np.full((100, 3), np.nan, np.float32)))
