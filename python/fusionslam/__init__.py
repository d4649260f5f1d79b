# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Place recognition and loop closing for robots that carry a LiDAR and a camera.

import fusionslam

dataset = fusionslam.open_dataset("kitti/sequences/06")       # sensors
detector = fusionslam.LoopDetector("cm2dp")                    # descriptors, matching
for frame in dataset:
    points, colors, kept = fusionslam.colorize(                # fusion
        frame.points, frame.images["left"], frame.cameras["left"].projection_from_points)
    loop = detector.add(fusionslam.Cloud(points, colors))      # loop closure
    if loop:
        print(f"frame {loop.query} is at the place of frame {loop.match}")
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fusionslam import evaluation as evaluation
    from fusionslam import mapping as mapping
    from fusionslam import ratslam as ratslam
    from fusionslam import registration as registration
    from fusionslam import views as views
    from fusionslam._core import BevSpectrumConfig as BevSpectrumConfig
    from fusionslam._core import CospairConfig as CospairConfig
    from fusionslam._core import CvfhConfig as CvfhConfig
    from fusionslam._core import DescriptorIndex as DescriptorIndex
    from fusionslam._core import GestaltConfig as GestaltConfig
    from fusionslam._core import GfhConfig as GfhConfig
    from fusionslam._core import GroundPlaneConfig as GroundPlaneConfig
    from fusionslam._core import GroundSegmentsConfig as GroundSegmentsConfig
    from fusionslam._core import IntensityScanContextConfig as IntensityScanContextConfig
    from fusionslam._core import IrisConfig as IrisConfig
    from fusionslam._core import M2dpConfig as M2dpConfig
    from fusionslam._core import NdtHistogramConfig as NdtHistogramConfig
    from fusionslam._core import OurCvfhConfig as OurCvfhConfig
    from fusionslam._core import RingConfig as RingConfig
    from fusionslam._core import ScanContextCartesianConfig as ScanContextCartesianConfig
    from fusionslam._core import ScanContextConfig as ScanContextConfig
    from fusionslam._core import ScanContextPolarConfig as ScanContextPolarConfig
    from fusionslam._core import SolidConfig as SolidConfig
    from fusionslam._core import StereoConfig as StereoConfig
    from fusionslam._core import VfhConfig as VfhConfig
    from fusionslam._core import __version__ as __version__
    from fusionslam._core import above_height as above_height
    from fusionslam._core import bev_spectrum as bev_spectrum
    from fusionslam._core import cloud_from_disparity as cloud_from_disparity
    from fusionslam._core import cloud_resolution as cloud_resolution
    from fusionslam._core import cm2dp as cm2dp
    from fusionslam._core import cm2dp_signature as cm2dp_signature
    from fusionslam._core import colorize as colorize
    from fusionslam._core import colorize_all_round as colorize_all_round
    from fusionslam._core import compare_descriptors as compare_descriptors
    from fusionslam._core import compare_scan_contexts as compare_scan_contexts
    from fusionslam._core import compare_solid_azimuths as compare_solid_azimuths
    from fusionslam._core import cospair as cospair
    from fusionslam._core import cscan_context as cscan_context
    from fusionslam._core import cshot as cshot
    from fusionslam._core import cvfh as cvfh
    from fusionslam._core import demosaic as demosaic
    from fusionslam._core import depth_image as depth_image
    from fusionslam._core import deskew as deskew
    from fusionslam._core import drop_invalid as drop_invalid
    from fusionslam._core import esf as esf
    from fusionslam._core import estimate_normals as estimate_normals
    from fusionslam._core import first_singular_vectors as first_singular_vectors
    from fusionslam._core import gasd_color as gasd_color
    from fusionslam._core import gestalt as gestalt
    from fusionslam._core import gfh as gfh
    from fusionslam._core import intensity_scan_context as intensity_scan_context
    from fusionslam._core import iris as iris
    from fusionslam._core import iris_image as iris_image
    from fusionslam._core import m2dp as m2dp
    from fusionslam._core import m2dp_signature as m2dp_signature
    from fusionslam._core import metric_names as metric_names
    from fusionslam._core import ndt_histogram as ndt_histogram
    from fusionslam._core import nearest as nearest
    from fusionslam._core import nearest_causal as nearest_causal
    from fusionslam._core import our_cvfh as our_cvfh
    from fusionslam._core import rectify_image as rectify_image
    from fusionslam._core import remove_ground_plane as remove_ground_plane
    from fusionslam._core import remove_ground_segments as remove_ground_segments
    from fusionslam._core import ring as ring
    from fusionslam._core import scan_context as scan_context
    from fusionslam._core import scan_context_cartesian as scan_context_cartesian
    from fusionslam._core import scan_context_polar as scan_context_polar
    from fusionslam._core import shot as shot
    from fusionslam._core import shot_at_centroid as shot_at_centroid
    from fusionslam._core import simd_level as simd_level
    from fusionslam._core import solid as solid
    from fusionslam._core import solid_parts as solid_parts
    from fusionslam._core import stereo_disparity as stereo_disparity
    from fusionslam._core import vfh as vfh
    from fusionslam._core import voxel_downsample as voxel_downsample
    from fusionslam.datasets import Dataset as Dataset
    from fusionslam.datasets import open_dataset as open_dataset
    from fusionslam.descriptors import DescriptorConfig as DescriptorConfig
    from fusionslam.descriptors import describe as describe
    from fusionslam.errors import ConfigError as ConfigError
    from fusionslam.errors import DataError as DataError
    from fusionslam.errors import FusionSlamError as FusionSlamError
    from fusionslam.errors import ShapeError as ShapeError
    from fusionslam.fusion import FusionConfig as FusionConfig
    from fusionslam.fusion import fuse as fuse
    from fusionslam.loop_closure.config import LoopConfig as LoopConfig
    from fusionslam.loop_closure.detector import LoopDetector as LoopDetector
    from fusionslam.loop_closure.loop import Loop as Loop
    from fusionslam.mapping.config import MapConfig as MapConfig
    from fusionslam.mapping.edge import Edge as Edge
    from fusionslam.mapping.localization import Localization as Localization
    from fusionslam.mapping.map_writer import MapStep as MapStep
    from fusionslam.mapping.place_map import PlaceMap as PlaceMap
    from fusionslam.mapping.pose_graph import PoseGraph as PoseGraph
    from fusionslam.mapping.pose_graph import Solution as Solution
    from fusionslam.pipelines.describe import PipelineConfig as PipelineConfig
    from fusionslam.pipelines.describe import describe_dataset as describe_dataset
    from fusionslam.sensors.frame import Camera as Camera
    from fusionslam.sensors.frame import Cloud as Cloud
    from fusionslam.sensors.frame import Frame as Frame
    from fusionslam.sensors.frame_builder import FrameBuilder as FrameBuilder
    from fusionslam.sensors.frame_builder import OnlineConfig as OnlineConfig
    from fusionslam.sensors.synchronizer import SyncConfig as SyncConfig
    from fusionslam.sensors.synchronizer import Synchronizer as Synchronizer
    from fusionslam.sensors.transforms import TransformTree as TransformTree

# Loaded on first use: the command line must answer --help before any of this is loaded.
_HOMES = {
    "_core": (
        "BevSpectrumConfig CospairConfig CvfhConfig DescriptorIndex GestaltConfig GfhConfig "
        "GroundPlaneConfig GroundSegmentsConfig IntensityScanContextConfig IrisConfig "
        "M2dpConfig NdtHistogramConfig OurCvfhConfig RingConfig ScanContextCartesianConfig "
        "ScanContextConfig ScanContextPolarConfig SolidConfig StereoConfig VfhConfig "
        "__version__ above_height bev_spectrum cloud_from_disparity cloud_resolution cm2dp "
        "cm2dp_signature colorize colorize_all_round compare_descriptors compare_scan_contexts "
        "compare_solid_azimuths cospair cscan_context cshot cvfh demosaic depth_image deskew "
        "drop_invalid esf estimate_normals first_singular_vectors gasd_color gestalt gfh "
        "intensity_scan_context iris iris_image m2dp m2dp_signature metric_names ndt_histogram "
        "nearest nearest_causal our_cvfh rectify_image remove_ground_plane "
        "remove_ground_segments ring scan_context scan_context_cartesian scan_context_polar "
        "shot shot_at_centroid simd_level solid solid_parts stereo_disparity vfh "
        "voxel_downsample"
    ),
    "datasets": "Dataset open_dataset",
    "descriptors": "DescriptorConfig describe",
    "errors": "ConfigError DataError FusionSlamError ShapeError",
    "fusion": "FusionConfig fuse",
    "loop_closure.config": "LoopConfig",
    "loop_closure.detector": "LoopDetector",
    "loop_closure.loop": "Loop",
    "mapping.config": "MapConfig",
    "mapping.edge": "Edge",
    "mapping.localization": "Localization",
    "mapping.map_writer": "MapStep",
    "mapping.place_map": "PlaceMap",
    "mapping.pose_graph": "PoseGraph Solution",
    "sensors.frame_builder": "FrameBuilder OnlineConfig",
    "pipelines.describe": "PipelineConfig describe_dataset",
    "sensors.frame": "Camera Cloud Frame",
    "sensors.synchronizer": "SyncConfig Synchronizer",
    "sensors.transforms": "TransformTree",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}

_PACKAGES = ("evaluation", "mapping", "ratslam", "registration", "views")

__all__ = sorted([*_HOME_OF, *_PACKAGES])


def __getattr__(name: str) -> Any:
    if name in _PACKAGES:
        return import_module(f"fusionslam.{name}")
    if name not in _HOME_OF:
        raise AttributeError(f"module 'fusionslam' has no attribute {name!r}")
    value = getattr(import_module(f"fusionslam.{_HOME_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
