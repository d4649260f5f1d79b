# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The whole configuration: a section for each stage and for the simulator."""

from fusionslam.calibration.search import CalibrationCheckConfig
from fusionslam.config import option
from fusionslam.datasets.range_recording import RecordingConfig
from fusionslam.fleet.config import FleetConfig
from fusionslam.geometry.odometry_noise import DRIFT, OdometryConfig
from fusionslam.mapping.config import MapConfig
from fusionslam.odometry import LidarOdometryConfig
from fusionslam.pipelines.describe import PipelineConfig
from fusionslam.pipelines.tuning import TuningConfig
from fusionslam.ratslam.slam import RatSlamConfig
from fusionslam.ratslam.visual_odometry import VisualOdometryConfig
from fusionslam.service.config import ServiceConfig
from fusionslam.sim import SimConfig
from fusionslam.views.recognisers import ViewMatcherConfig
from fusionslam.views.visual_templates import VisualTemplatesConfig


class SystemConfig(PipelineConfig):
    """The whole configuration."""

    sim: SimConfig = option(SimConfig(), "the simulated drive of the demo")
    calib_check: CalibrationCheckConfig = option(CalibrationCheckConfig(), "what calib-check tries")
    views: ViewMatcherConfig = option(ViewMatcherConfig(), "scenes to views")
    recording: RecordingConfig = option(
        RecordingConfig(), "how scans of a .npz recording become clouds"
    )
    tuning: TuningConfig = option(TuningConfig(), "how parameters of views are looked for")
    ratslam: RatSlamConfig = option(RatSlamConfig(), "views and odometry to a map")
    visual_templates: VisualTemplatesConfig = option(
        VisualTemplatesConfig(), "ratslam: views of images, --views visual_templates"
    )
    visual_odometry: VisualOdometryConfig = option(
        VisualOdometryConfig(), "ratslam: speed out of images, --odometry visual"
    )
    lidar_odometry: LidarOdometryConfig = option(
        LidarOdometryConfig(), "odometry, and ratslam --odometry lidar: scans to a path"
    )
    odometry: OdometryConfig = option(
        DRIFT, "ratslam, map build: how far odometry is off, --odometry truth+noise"
    )
    mapping: MapConfig = option(MapConfig(), "map build: keyframes, and how odometry drifts")
    fleet: FleetConfig = option(FleetConfig(), "fleet describe: work and places")
    service: ServiceConfig = option(ServiceConfig(), "serve: where it listens, and its limits")
