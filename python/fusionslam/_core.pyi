"""
The C++ core of fusionslam; its public names are those of the package.
"""
from __future__ import annotations
import collections.abc
import enum
import numpy
import numpy.typing
import os
import typing
__all__: list[str] = ['ActionKind', 'Alignment', 'AlignmentConfig', 'AlignmentIndex', 'BevSpectrumConfig', 'CospairConfig', 'CvfhConfig', 'DescriptorIndex', 'DriftConfig', 'ExperienceMap', 'ExperienceMapConfig', 'GestaltConfig', 'GfhConfig', 'GroundPlaneConfig', 'GroundSegmentsConfig', 'IntensityScanContextConfig', 'IrisConfig', 'M2dpConfig', 'NdtHistogramConfig', 'OdometryTree', 'OurCvfhConfig', 'PoseSheet', 'RangeImage', 'RingConfig', 'ScanContextCartesianConfig', 'ScanContextConfig', 'ScanContextPolarConfig', 'Scene', 'SceneConfig', 'SceneIndex', 'SimilarityConfig', 'SolidConfig', 'StereoConfig', 'VfhConfig', 'above_height', 'align_scenes', 'bev_spectrum', 'build_scene', 'ciede2000', 'cloud_from_disparity', 'cloud_resolution', 'cm2dp', 'cm2dp_signature', 'color_difference', 'colorize', 'colorize_all_round', 'compare_descriptors', 'compare_scan_contexts', 'compare_solid_azimuths', 'cospair', 'count_overlap', 'cscan_context', 'cshot', 'cvfh', 'dbscan', 'demosaic', 'depth_image', 'drift_covariance', 'drop_invalid', 'esf', 'estimate_normals', 'first_singular_vectors', 'gasd_color', 'gestalt', 'gfh', 'intensity_scan_context', 'iris', 'iris_image', 'm2dp', 'm2dp_signature', 'metric_names', 'ndt_histogram', 'nearest', 'nearest_causal', 'nearest_ranges', 'our_cvfh', 'rectify_image', 'remove_ground_plane', 'remove_ground_segments', 'ring', 'scan_context', 'scan_context_cartesian', 'scan_context_polar', 'scene_similarity', 'shot', 'shot_at_centroid', 'simd_level', 'solid', 'solid_parts', 'stereo_disparity', 'vfh', 'voxel_downsample']
class StereoConfig:
    """
    Parameters of stereo matching.
    """
    @staticmethod
    def options() -> list[dict[str, typing.Any]]:
        """
        Every option: name, kind, default, help, unit, range or choices.
        """
    def __getstate__(self) -> dict[str, typing.Any]:
        ...
    def __init__(self, *, preset: str = 'image_undistort', **kwargs: typing.Any) -> None:
        """
        The preset's values (image_undistort or sgbm), with the given options in their place.
        """
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    @property
    def block_size(self) -> int:
        """
        window size, odd [px]
        """
    @property
    def disp12_max_diff(self) -> int:
        """
        left-right check (SGBM); -1 is off [px]
        """
    @property
    def max_range(self) -> float:
        """
        farthest point kept [m]
        """
    @property
    def median_blur(self) -> bool:
        """
        5 x 5 median filter on the disparity image
        """
    @property
    def method(self) -> str:
        """
        OpenCV's StereoBM or StereoSGBM
        """
    @property
    def min_disparity(self) -> int:
        """
        smallest disparity searched [px]
        """
    @property
    def min_range(self) -> float:
        """
        nearest point kept [m]
        """
    @property
    def num_disparities(self) -> int:
        """
        how many disparities are searched, a multiple of 16 [px]
        """
    @property
    def p1(self) -> int:
        """
        smoothness penalty, small changes (SGBM)
        """
    @property
    def p2(self) -> int:
        """
        smoothness penalty, large changes (SGBM)
        """
    @property
    def pre_filter_cap(self) -> int:
        """
        bound of prefiltered values
        """
    @property
    def pre_filter_size(self) -> int:
        """
        prefilter window, odd (StereoBM) [px]
        """
    @property
    def speckle_range(self) -> int:
        """
        disparity change inside one speckle [px]
        """
    @property
    def speckle_window_size(self) -> int:
        """
        largest speckle to remove; 0 is off [px]
        """
    @property
    def texture_threshold(self) -> int:
        """
        least texture of a window (StereoBM)
        """
    @property
    def uniqueness_ratio(self) -> int:
        """
        margin by which the best match must win [%]
        """
class GroundPlaneConfig:
    """
    Parameters of the ground plane.
    """
    @staticmethod
    def options() -> list[dict[str, typing.Any]]:
        """
        Every option: name, kind, default, help, unit, range or choices.
        """
    def __getstate__(self) -> dict[str, typing.Any]:
        ...
    def __init__(self, **kwargs: typing.Any) -> None:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    @property
    def distance(self) -> float:
        """
        points this near to the plane are ground [m]
        """
    @property
    def iterations(self) -> int:
        """
        RANSAC iterations
        """
    @property
    def max_tilt(self) -> float:
        """
        largest angle between the plane's normal and up [deg]
        """
class GroundSegmentsConfig:
    """
    Parameters of the ground fitted segment by segment.
    """
    @staticmethod
    def options() -> list[dict[str, typing.Any]]:
        """
        Every option: name, kind, default, help, unit, range or choices.
        """
    def __getstate__(self) -> dict[str, typing.Any]:
        ...
    def __init__(self, **kwargs: typing.Any) -> None:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    @property
    def distance(self) -> float:
        """
        points below the plane or this little above are ground [m]
        """
    @property
    def driving(self) -> str:
        """
        axis that the robot drives along
        """
    @property
    def iterations(self) -> int:
        """
        how often a plane is fitted to its ground points
        """
    @property
    def lowest(self) -> int:
        """
        lowest points of a segment, whose median height starts it
        """
    @property
    def lowest_share(self) -> float:
        """
        more lowest points in dense segments: at least this share of theirs
        """
    @property
    def max_step(self) -> float:
        """
        largest step from a segment's plane to the next [m]
        """
    @property
    def max_tilt(self) -> float:
        """
        largest angle between a plane's normal and up [deg]
        """
    @property
    def seed_height(self) -> float:
        """
        points this near to that height are the first ground [m]
        """
    @property
    def segments(self) -> int:
        """
        segments of one length along the driving axis
        """
class M2dpConfig:
    """
    Parameters of M2DP and c-M2DP.
    """
    @staticmethod
    def options() -> list[dict[str, typing.Any]]:
        """
        Every option: name, kind, default, help, unit, range or choices.
        """
    def __getstate__(self) -> dict[str, typing.Any]:
        ...
    def __init__(self, *, preset: str = 'robust', **kwargs: typing.Any) -> None:
        """
        The preset's values, with the given options in their place.
        """
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    @property
    def author_lab(self) -> bool:
        """
        convert sRGB to Lab as the c-M2DP author's program, fault included
        """
    @property
    def axes(self) -> str:
        """
        principal axes, or z as it is and x towards the densest azimuth, whose signs are not open: pairs of mirrored bins are then not sorted
        """
    @property
    def axis_signs(self) -> str:
        """
        rule for the signs of the PCA axes; mirror_pairs needs azimuths in fours and an even number of sectors
        """
    @property
    def azimuths(self) -> int:
        """
        azimuth angles of the projection planes (p)
        """
    @property
    def color_bins(self) -> int:
        """
        histogram bins of a colour channel (g)
        """
    @property
    def drop_last_point(self) -> bool:
        """
        leave the last point out of the counts, as the c-M2DP author's program
        """
    @property
    def elevations(self) -> int:
        """
        elevation angles of the projection planes (q)
        """
    @property
    def grey_world(self) -> bool:
        """
        scale each colour channel to one mean, against exposure and tint
        """
    @property
    def outer_radius(self) -> str:
        """
        radius of the outermost ring
        """
    @property
    def rings(self) -> int:
        """
        concentric circles on a plane (l)
        """
    @property
    def sectors(self) -> int:
        """
        sectors of a circle (t)
        """
    @property
    def weighting(self) -> str:
        """
        what the singular vectors are taken of
        """
class ScanContextConfig:
    """
    Parameters of Scan Context.
    """
    @staticmethod
    def options() -> list[dict[str, typing.Any]]:
        """
        Every option: name, kind, default, help, unit, range or choices.
        """
    def __getstate__(self) -> dict[str, typing.Any]:
        ...
    def __init__(self, **kwargs: typing.Any) -> None:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    @property
    def height(self) -> float:
        """
        height of the cloud's origin above the ground, added to every point; points below the ground count as on it [m]
        """
    @property
    def max_range(self) -> float:
        """
        radius of the outermost ring; points beyond are left out [m]
        """
    @property
    def rings(self) -> int:
        """
        rings about the sensor
        """
class BevSpectrumConfig:
    """
    Parameters of bev_spectrum.
    """
    @staticmethod
    def options() -> list[dict[str, typing.Any]]:
        """
        Every option: name, kind, default, help, unit, range or choices.
        """
    def __getstate__(self) -> dict[str, typing.Any]:
        ...
    def __init__(self, **kwargs: typing.Any) -> None:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    @property
    def cell(self) -> float:
        """
        side of the image's cells; points farther than 27.5 cells are left out, and layers are limited by heights in cells [m]
        """
    @property
    def height(self) -> float:
        """
        height of the cloud's origin above the ground [m]
        """
class ScanContextPolarConfig:
    """
    Parameters of scan_context_polar.
    """
    @staticmethod
    def options() -> list[dict[str, typing.Any]]:
        """
        Every option: name, kind, default, help, unit, range or choices.
        """
    def __getstate__(self) -> dict[str, typing.Any]:
        ...
    def __init__(self, **kwargs: typing.Any) -> None:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    @property
    def height(self) -> float:
        """
        height of the cloud's origin above the ground, added to every point [m]
        """
    @property
    def max_range(self) -> float:
        """
        radius of the outermost ring; points beyond are left out [m]
        """
class ScanContextCartesianConfig:
    """
    Parameters of scan_context_cartesian.
    """
    @staticmethod
    def options() -> list[dict[str, typing.Any]]:
        """
        Every option: name, kind, default, help, unit, range or choices.
        """
    def __getstate__(self) -> dict[str, typing.Any]:
        ...
    def __init__(self, **kwargs: typing.Any) -> None:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    @property
    def height(self) -> float:
        """
        height of the cloud's origin above the ground, added to every point [m]
        """
    @property
    def lateral_range(self) -> float:
        """
        how far to the left and to the right columns reach [m]
        """
    @property
    def longitudinal_range(self) -> float:
        """
        how far ahead and back rows reach [m]
        """
class SolidConfig:
    """
    Parameters of solid.
    """
    @staticmethod
    def options() -> list[dict[str, typing.Any]]:
        """
        Every option: name, kind, default, help, unit, range or choices.
        """
    def __getstate__(self) -> dict[str, typing.Any]:
        ...
    def __init__(self, **kwargs: typing.Any) -> None:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    @property
    def elevations(self) -> int:
        """
        bins of elevation
        """
    @property
    def highest_elevation(self) -> float:
        """
        where the highest bin of elevation ends; points above are left out [degrees]
        """
    @property
    def lowest_elevation(self) -> float:
        """
        where the lowest bin of elevation begins; points below are left out [degrees]
        """
    @property
    def max_range(self) -> float:
        """
        horizontal range of the farthest bin; points beyond are left out [m]
        """
    @property
    def voxel(self) -> float:
        """
        side of the cubes whose points are replaced by their mean [m]
        """
class IntensityScanContextConfig:
    """
    Parameters of intensity_scan_context.
    """
    @staticmethod
    def options() -> list[dict[str, typing.Any]]:
        """
        Every option: name, kind, default, help, unit, range or choices.
        """
    def __getstate__(self) -> dict[str, typing.Any]:
        ...
    def __init__(self, **kwargs: typing.Any) -> None:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    @property
    def max_range(self) -> float:
        """
        radius of the outermost ring; points beyond are left out [m]
        """
class IrisConfig:
    """
    Parameters of iris.
    """
    @staticmethod
    def options() -> list[dict[str, typing.Any]]:
        """
        Every option: name, kind, default, help, unit, range or choices.
        """
    def __getstate__(self) -> dict[str, typing.Any]:
        ...
    def __init__(self, **kwargs: typing.Any) -> None:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    @property
    def highest(self) -> float:
        """
        z where the highest slice ends; points from there on are left out [m]
        """
    @property
    def lowest(self) -> float:
        """
        z where the lowest slice begins; points below are left out [m]
        """
    @property
    def max_range(self) -> float:
        """
        radius of the outermost of 80 rings; points beyond are left out [m]
        """
class RingConfig:
    """
    Parameters of ring.
    """
    @staticmethod
    def options() -> list[dict[str, typing.Any]]:
        """
        Every option: name, kind, default, help, unit, range or choices.
        """
    def __getstate__(self) -> dict[str, typing.Any]:
        ...
    def __init__(self, **kwargs: typing.Any) -> None:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    @property
    def height(self) -> float:
        """
        height of the cloud's origin above the ground [m]
        """
    @property
    def least_height(self) -> float:
        """
        height above the ground from which points are drawn [m]
        """
    @property
    def max_range(self) -> float:
        """
        half the side of the image of 120 x 120 cells; points farther from its centre are left out [m]
        """
class NdtHistogramConfig:
    """
    Parameters of ndt_histogram.
    """
    @staticmethod
    def options() -> list[dict[str, typing.Any]]:
        """
        Every option: name, kind, default, help, unit, range or choices.
        """
    def __getstate__(self) -> dict[str, typing.Any]:
        ...
    def __init__(self, **kwargs: typing.Any) -> None:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    @property
    def ambiguity(self) -> float:
        """
        share of the most common direction of walls from which the second one is aligned too
        """
    @property
    def cell(self) -> float:
        """
        side of the cells whose points are taken for one surface [m]
        """
    @property
    def evenness(self) -> float:
        """
        ratio of two eigenvalues up to which the smaller one counts as none
        """
class VfhConfig:
    """
    Parameters of vfh.
    """
    @staticmethod
    def options() -> list[dict[str, typing.Any]]:
        """
        Every option: name, kind, default, help, unit, range or choices.
        """
    def __getstate__(self) -> dict[str, typing.Any]:
        ...
    def __init__(self, **kwargs: typing.Any) -> None:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    @property
    def leaf(self) -> float:
        """
        side of the cubes whose points are replaced by their mean [m]
        """
    @property
    def normal_radius(self) -> float:
        """
        radius of the neighbourhood of a normal; 0 is three leaves [m]
        """
class CvfhConfig:
    """
    Parameters of cvfh.
    """
    @staticmethod
    def options() -> list[dict[str, typing.Any]]:
        """
        Every option: name, kind, default, help, unit, range or choices.
        """
    def __getstate__(self) -> dict[str, typing.Any]:
        ...
    def __init__(self, **kwargs: typing.Any) -> None:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    @property
    def leaf(self) -> float:
        """
        side of the cubes whose points are replaced by their mean [m]
        """
    @property
    def max_angle(self) -> float:
        """
        largest angle between the normals of neighbours in a region [rad]
        """
    @property
    def max_curvature(self) -> float:
        """
        points with a larger curvature belong to no region
        """
    @property
    def min_points(self) -> int:
        """
        points of the smallest region
        """
    @property
    def normal_radius(self) -> float:
        """
        radius of the neighbourhood of a normal; 0 is three leaves [m]
        """
    @property
    def regions(self) -> int:
        """
        how many blocks of 308 there are
        """
class OurCvfhConfig:
    """
    Parameters of our_cvfh.
    """
    @staticmethod
    def options() -> list[dict[str, typing.Any]]:
        """
        Every option: name, kind, default, help, unit, range or choices.
        """
    def __getstate__(self) -> dict[str, typing.Any]:
        ...
    def __init__(self, **kwargs: typing.Any) -> None:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    @property
    def leaf(self) -> float:
        """
        side of the cubes whose points are replaced by their mean [m]
        """
    @property
    def max_angle(self) -> float:
        """
        largest angle between the normals of neighbours in a region [rad]
        """
    @property
    def max_curvature(self) -> float:
        """
        points with a larger curvature belong to no region
        """
    @property
    def min_points(self) -> int:
        """
        points of the smallest region
        """
    @property
    def normal_radius(self) -> float:
        """
        radius of the neighbourhood of a normal; 0 is three leaves [m]
        """
    @property
    def regions(self) -> int:
        """
        how many blocks of 308 there are
        """
class GestaltConfig:
    """
    Parameters of gestalt.
    """
    @staticmethod
    def options() -> list[dict[str, typing.Any]]:
        """
        Every option: name, kind, default, help, unit, range or choices.
        """
    def __getstate__(self) -> dict[str, typing.Any]:
        ...
    def __init__(self, **kwargs: typing.Any) -> None:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    @property
    def keypoints(self) -> int:
        """
        how many keypoints there are at most
        """
    @property
    def leaf(self) -> float:
        """
        side of the cubes whose points are replaced by their mean [m]
        """
    @property
    def min_points(self) -> int:
        """
        points that a keypoint needs in its cylinder
        """
    @property
    def radius(self) -> float:
        """
        radius of the vertical cylinder about a keypoint [m]
        """
class GfhConfig:
    """
    Parameters of gfh.
    """
    @staticmethod
    def options() -> list[dict[str, typing.Any]]:
        """
        Every option: name, kind, default, help, unit, range or choices.
        """
    def __getstate__(self) -> dict[str, typing.Any]:
        ...
    def __init__(self, **kwargs: typing.Any) -> None:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    @property
    def bottom(self) -> float:
        """
        height at which the lowest layer begins; points below are left out [m]
        """
    @property
    def layers(self) -> int:
        """
        bins of height
        """
    @property
    def max_range(self) -> float:
        """
        radius of the outermost ring; points beyond are left out [m]
        """
    @property
    def rings(self) -> int:
        """
        bins of the distance from the vertical axis
        """
    @property
    def sectors(self) -> int:
        """
        bins of azimuth
        """
    @property
    def top(self) -> float:
        """
        height at which the highest layer ends; points above are left out [m]
        """
class CospairConfig:
    """
    Parameters of cospair.
    """
    @staticmethod
    def options() -> list[dict[str, typing.Any]]:
        """
        Every option: name, kind, default, help, unit, range or choices.
        """
    def __getstate__(self) -> dict[str, typing.Any]:
        ...
    def __init__(self, **kwargs: typing.Any) -> None:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    @property
    def leaf(self) -> float:
        """
        side of the cubes whose points are replaced by their mean [m]
        """
    @property
    def normal_radius(self) -> float:
        """
        radius of the neighbourhood of a normal; 0 is three leaves [m]
        """
class DriftConfig:
    """
    How the error of odometry grows with motion.
    """
    @staticmethod
    def options() -> list[dict[str, typing.Any]]:
        """
        Every option: name, kind, default, help, unit, range or choices.
        """
    def __getstate__(self) -> dict[str, typing.Any]:
        ...
    def __init__(self, **kwargs: typing.Any) -> None:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    @property
    def drift_heading(self) -> float:
        """
        standard deviation of its heading after one metre [rad/sqrt(m)]
        """
    @property
    def drift_height(self) -> float:
        """
        standard deviation of its position along z after one metre [m/sqrt(m)]
        """
    @property
    def drift_m(self) -> float:
        """
        standard deviation of odometry's position after one metre, along x and y [m/sqrt(m)]
        """
    @property
    def drift_tilt(self) -> float:
        """
        standard deviation of its roll and pitch after one metre [rad/sqrt(m)]
        """
    @property
    def drift_turn(self) -> float:
        """
        standard deviation of its rotation after a turn of one radian [rad/sqrt(rad)]
        """
class OdometryTree:
    """
    Poses of nodes by odometry alone, and the drift between any two that it connects.
    """
    def __getstate__(self) -> tuple[numpy.ndarray, numpy.ndarray, numpy.ndarray]:
        ...
    def __init__(self) -> None:
        ...
    def __len__(self) -> int:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    def add(self, parent: typing.SupportsInt | typing.SupportsIndex, step: numpy.typing.NDArray[numpy.float64], covariance: numpy.typing.NDArray[numpy.float64], *, backwards: bool = False) -> int:
        """
        Adds the node at the other end of a step parent_from_node (backwards: node_from_parent); returns its number.
        """
    def add_root(self, pose: numpy.typing.NDArray[numpy.float64]) -> int:
        """
        Adds a node at which odometry begins; returns its number.
        """
    def drift(self, a: typing.SupportsInt | typing.SupportsIndex, b: typing.SupportsInt | typing.SupportsIndex) -> numpy.typing.NDArray[numpy.float64]:
        """
        float64 (6, 6), covariance of the error of a_from_b by odometry.
        """
    def fit(self, a: typing.SupportsInt | typing.SupportsIndex, b: typing.SupportsInt | typing.SupportsIndex, error: typing.Annotated[collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex], "FixedSize(6)"], covariance: numpy.typing.NDArray[numpy.float64], sigmas: typing.SupportsFloat | typing.SupportsIndex) -> tuple[float, float, float, float]:
        """
        Compares a measured pose a_from_b with odometry: the values of DriftFit. The error is the small motion from where the measurement has b to where odometry has it.
        """
    def parent(self, node: typing.SupportsInt | typing.SupportsIndex) -> int:
        """
        The node before; of a root, itself.
        """
    def pose(self, node: typing.SupportsInt | typing.SupportsIndex) -> numpy.typing.NDArray[numpy.float64]:
        """
        float64 (4, 4), of a node.
        """
    def root(self, node: typing.SupportsInt | typing.SupportsIndex) -> int:
        """
        The node at which its odometry begins.
        """
    @property
    def poses(self) -> numpy.typing.NDArray[numpy.float64]:
        """
        float64 (n, 4, 4), of all nodes.
        """
    @property
    def roots(self) -> numpy.typing.NDArray[numpy.int64]:
        """
        int64 (n), of all nodes.
        """
class DescriptorIndex:
    """
    Exact, causal nearest neighbours over added descriptors.
    
    A query is answered as if it were the next descriptor to be added, number len(index): candidates
    are older by more than window frames and by more than window_seconds.
    Distances are L2, or those of another of metric_names(). Equal ones go to the lowest index.
    Threads may share an index; processes get copies (pickle).
    """
    @staticmethod
    def load(path: os.PathLike[str] | str | bytes) -> DescriptorIndex:
        """
        Reads an index. Raises DataError if the file is none, of another version, or truncated.
        """
    def __getstate__(self) -> bytes:
        ...
    def __init__(self, dimension: typing.SupportsInt | typing.SupportsIndex, *, window: typing.SupportsInt | typing.SupportsIndex = 0, window_seconds: typing.SupportsFloat | typing.SupportsIndex = 0.0, metric: str = 'l2') -> None:
        ...
    def __len__(self) -> int:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    def add(self, descriptor: numpy.typing.NDArray[numpy.float32], *, stamp_ns: typing.SupportsInt | typing.SupportsIndex | None = None) -> int:
        """
        Adds a descriptor, float32 (D,), and returns its index. A window in seconds needs stamp_ns.
        """
    def descriptor(self, index: typing.SupportsInt | typing.SupportsIndex) -> numpy.typing.NDArray[numpy.float32]:
        """
        A copy of one descriptor, float32 (D,).
        """
    def query(self, descriptor: numpy.typing.NDArray[numpy.float32], *, k: typing.SupportsInt | typing.SupportsIndex = 1, stamp_ns: typing.SupportsInt | typing.SupportsIndex | None = None) -> tuple[numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.float32]]:
        """
        The nearest candidates, nearest first.
        
        Returns:
            (indices int64 (M,), distances float32 (M,)), M <= k.
        
        Raises:
            ShapeError, DataError: wrong length, NaN.
            ConfigError: the window is in seconds and stamp_ns is missing.
        """
    def save(self, path: os.PathLike[str] | str | bytes) -> None:
        """
        Writes one file, whole or not at all, through a symbolic link.
        
        The file keeps its mode; a new one gets what the umask leaves.
        
        Raises:
            DataError: it cannot be written (code "cannot-write", fields: the path).
        """
    @property
    def dimension(self) -> int:
        ...
    @property
    def metric(self) -> str:
        ...
    @property
    def window(self) -> int:
        ...
    @property
    def window_seconds(self) -> float:
        ...
class RangeImage:
    """
    Range and colour of the nearest surface in each direction of a cloud.
    
    Immutable; equal if all cells are.
    """
    def __eq__(self, arg0: typing.Any) -> bool:
        ...
    def __hash__(self) -> int:
        ...
    def __init__(self, cells: numpy.ndarray, azimuth_step: typing.SupportsFloat | typing.SupportsIndex, elevation_step: typing.SupportsFloat | typing.SupportsIndex, sensor: typing.Annotated[collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex], "FixedSize(3)"]) -> None:
        ...
    def __len__(self) -> int:
        ...
    def __reduce__(self) -> tuple[type, tuple[numpy.ndarray, float, float, typing.Any]]:
        ...
    @property
    def azimuth_step(self) -> float:
        """
        Degrees.
        """
    @property
    def cells(self) -> numpy.ndarray:
        """
        Read-only structured array; fields column and row (steps of azimuth to the left and of
        elevation up, from straight ahead), range (cm), color (3) RGB.
        """
    @property
    def elevation_step(self) -> float:
        """
        Degrees.
        """
    @property
    def sensor(self) -> typing.Annotated[list[float], "FixedSize(3)"]:
        """
        Origin of the directions in the frame of the cloud, metres.
        """
class SceneConfig:
    """
    How a coloured cloud becomes a scene.
    """
    @staticmethod
    def options() -> list[dict[str, typing.Any]]:
        """
        Every option: name, kind, default, help, unit, range or choices.
        """
    def __getstate__(self) -> dict[str, typing.Any]:
        ...
    def __init__(self, *, preset: str = 'robust', **kwargs: typing.Any) -> None:
        """
        The preset's values, with the given options in their place.
        """
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    @property
    def azimuth_step(self) -> float:
        """
        width of a cell [deg]
        """
    @property
    def center(self) -> str:
        """
        centre of an object: of its hull or of its box
        """
    @property
    def color(self) -> str:
        """
        colour of an object: mean of its points, or their median, truncated
        """
    @property
    def color_scale(self) -> float:
        """
        distance that one step of a colour channel stands for [m]
        """
    @property
    def elevation_step(self) -> float:
        """
        height of a cell [deg]
        """
    @property
    def eps(self) -> float:
        """
        radius of a neighbourhood [m]
        """
    @property
    def floor(self) -> float:
        """
        leave out points no farther than this from z = 0, a robot's floor; 0 keeps all [m]
        """
    @property
    def image(self) -> bool:
        """
        keep a range image in the scene, which alignment needs
        """
    @property
    def inclusive(self) -> bool:
        """
        count a point exactly eps away as a neighbour
        """
    @property
    def longest_range(self) -> float:
        """
        points beyond are left out [m]
        """
    @property
    def min_points(self) -> int:
        """
        neighbours that make a point a core point (itself included)
        """
    @property
    def min_size(self) -> int:
        """
        fewest points that make a cluster an object
        """
    @property
    def sensor_x(self) -> float:
        """
        position of the sensor in the frame of the cloud [m]
        """
    @property
    def sensor_y(self) -> float:
        """
        position of the sensor in the frame of the cloud [m]
        """
    @property
    def sensor_z(self) -> float:
        """
        position of the sensor in the frame of the cloud [m]
        """
class Scene:
    """
    The objects of a cloud (Stastny 2022, 4.5).
    
    Scenes are values: they do not change, and are equal if all their objects are.
    """
    @staticmethod
    def from_bytes(data: bytes) -> Scene:
        """
        The scene that to_bytes wrote; box_min and box_max of its objects are their centres.
        
        Raises:
            DataError: bytes that are truncated, damaged, foreign or of another version.
        """
    @staticmethod
    def from_json(text: str) -> Scene:
        """
        The scene that to_json wrote.
        
        Raises:
            DataError: no JSON, no scene, or one of another version.
        """
    def __eq__(self, arg0: typing.Any) -> bool:
        ...
    def __hash__(self) -> int:
        ...
    def __init__(self, objects: typing.Any, image: RangeImage | None = None) -> None:
        """
        A scene of given objects, in their order: an array like `objects`.
        
        Raises:
            ShapeError: another kind of array. DataError: NaN, infinity or an object without points.
        """
    def __len__(self) -> int:
        ...
    def __reduce__(self) -> tuple[type, tuple[numpy.ndarray, RangeImage]]:
        ...
    def __repr__(self) -> str:
        ...
    def to_bytes(self, *, image: bool = True) -> bytes:
        """
        The scene in few bytes: about 25 an object and 12 a scene.
        
        Similarities under every preset stay within 1e-4: centres and extents are kept to 0.05 mm, volumes
        to 0.01 dm3, areas to 1 cm2, colours to 1/2048 of a byte, numbers of points exactly. Boxes are not
        kept.
        
        Raises:
            DataError: values that do not fit, such as centres beyond 4e11 m.
        """
    def to_json(self) -> str:
        """
        The scene as JSON, exact, one line an object.
        """
    @property
    def image(self) -> RangeImage:
        """
        The RangeImage, without cells if the configuration asked for none.
        """
    @property
    def objects(self) -> numpy.ndarray:
        """
        Read-only structured array, one row an object, those with most
        points first; fields center (3) m, volume m3, area m2 (of the hull), color (3) RGB 0 to 255,
        extents (3) m along the principal axes, box_min (3), box_max (3) m, points.
        """
class SimilarityConfig:
    """
    How scenes are compared.
    """
    @staticmethod
    def options() -> list[dict[str, typing.Any]]:
        """
        Every option: name, kind, default, help, unit, range or choices.
        """
    def __getstate__(self) -> dict[str, typing.Any]:
        ...
    def __init__(self, *, preset: str = 'robust', **kwargs: typing.Any) -> None:
        """
        The preset's values, with the given options in their place.
        """
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    @property
    def color_a(self) -> float:
        """
        steepness of the colour term
        """
    @property
    def color_difference(self) -> str:
        """
        colour difference: of L*a*b*, of bytes, or of red alone
        """
    @property
    def color_weight(self) -> float:
        """
        weight of the colour term
        """
    @property
    def color_x0(self) -> float:
        """
        colour difference that counts half
        """
    @property
    def distance_a(self) -> float:
        """
        steepness of the distance term [1/m]
        """
    @property
    def distance_weight(self) -> float:
        """
        weight of the distance term
        """
    @property
    def distance_x0(self) -> float:
        """
        distance of centres that counts half [m]
        """
    @property
    def extent_a(self) -> float:
        """
        steepness of the extent term [1/m]
        """
    @property
    def extent_weight(self) -> float:
        """
        weight of the extent term
        """
    @property
    def extent_x0(self) -> float:
        """
        difference of the extents along own axes that counts half [m]
        """
    @property
    def normalized(self) -> bool:
        """
        divide each term by its value at no difference, which makes a scene exactly like itself
        """
    @property
    def range_slack(self) -> float:
        """
        how much more distances and extents may differ per metre from the robot, as a share [1/m]
        """
    @property
    def ratio_a(self) -> float:
        """
        steepness of the ratio term [1/m]
        """
    @property
    def ratio_weight(self) -> float:
        """
        weight of the ratio term
        """
    @property
    def ratio_x0(self) -> float:
        """
        difference of volume / area that counts half [m]
        """
    @property
    def symmetric(self) -> bool:
        """
        compare in both directions: each scene's objects with the other's
        """
    @property
    def volume_a(self) -> float:
        """
        steepness of the volume term [1/m3]
        """
    @property
    def volume_weight(self) -> float:
        """
        weight of the volume term
        """
    @property
    def volume_x0(self) -> float:
        """
        difference of volumes that counts half [m3]
        """
class SceneIndex:
    """
    Many stored scenes, compared with one in a single call.
    
    They are numbered from 0 in the order in which they were added. Threads may share an index.
    """
    def __getstate__(self) -> tuple[SimilarityConfig, numpy.typing.NDArray[numpy.uint64], numpy.typing.NDArray[numpy.float64]]:
        ...
    def __init__(self, config: SimilarityConfig | None = None, *, preset: str = 'robust') -> None:
        """
        Uses the configuration or, without one, the preset.
        """
    def __len__(self) -> int:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    def add(self, scene: Scene) -> int:
        """
        Stores a scene and returns its number. Raises DataError if it holds NaN.
        """
    def remove(self, number: typing.SupportsInt | typing.SupportsIndex) -> None:
        """
        Removes a scene; the numbers of all later ones fall by one. Raises ConfigError if there is none.
        """
    def replace(self, number: typing.SupportsInt | typing.SupportsIndex, scene: Scene) -> None:
        """
        Replaces a stored scene. Raises ConfigError if there is none.
        """
    def similarities(self, current: Scene, *, threads: typing.SupportsInt | typing.SupportsIndex = 1) -> numpy.typing.NDArray[numpy.float64]:
        """
        scene_similarity(current, stored) of every stored scene, float64 (n,), to 1e-6.
        
        Args:
            threads: of this call; 0 is one a core. The result does not depend on it.
        
        Raises:
            DataError: an object that is not finite.
        """
    @property
    def config(self) -> SimilarityConfig:
        ...
class AlignmentConfig:
    """
    How scenes are aligned.
    """
    @staticmethod
    def options() -> list[dict[str, typing.Any]]:
        """
        Every option: name, kind, default, help, unit, range or choices.
        """
    def __getstate__(self) -> dict[str, typing.Any]:
        ...
    def __init__(self, **kwargs: typing.Any) -> None:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    @property
    def candidates(self) -> int:
        """
        stored views that are aligned, those with the most similar thumbnails
        """
    @property
    def first_scale(self) -> float:
        """
        distance weighted one half in the first step [m]
        """
    @property
    def iterations(self) -> int:
        """
        Gauss-Newton steps from each start
        """
    @property
    def last_scale(self) -> float:
        """
        distance weighted one half in the last step [m]
        """
    @property
    def points(self) -> int:
        """
        cells of the current view that are compared with the stored one
        """
    @property
    def reach(self) -> float:
        """
        views farther apart are different views [m]
        """
    @property
    def tolerance(self) -> float:
        """
        distance up to which surfaces agree, plus 1 % of the range [m]
        """
    @property
    def turn(self) -> float:
        """
        views rotated by more against each other are different views [deg]
        """
class Alignment:
    """
    The alignment of one scene with another.
    """
    def __getstate__(self) -> tuple[float, float, float, float, typing.Annotated[list[float], "FixedSize(12)"], typing.Annotated[list[float], "FixedSize(9)"]]:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    @property
    def evidence(self) -> dict[str, float]:
        """
        The numbers from which the probability is computed, by name.
        """
    @property
    def information(self) -> numpy.typing.NDArray[numpy.float64]:
        """
        float64 (3, 3): information of x, y, yaw in metres and radians, as if the residuals of the cells were independent; zeros if nothing could be aligned.
        """
    @property
    def probability(self) -> float:
        """
        Probability that both scans were taken within 0.8 m and 22.9 deg of each other; 0 beyond reach and turn of the configuration.
        """
    @property
    def x(self) -> float:
        """
        x of the current robot in the frame of the stored one, metres.
        """
    @property
    def y(self) -> float:
        """
        Metres.
        """
    @property
    def yaw(self) -> float:
        """
        Radians.
        """
class AlignmentIndex:
    """
    Stored scenes; those that look like the current one are aligned with it.
    
    They are numbered from 0 in the order in which they were added. Threads may share an index.
    """
    def __getstate__(self) -> tuple[AlignmentConfig, list[RangeImage]]:
        ...
    def __init__(self, config: AlignmentConfig | None = None) -> None:
        ...
    def __len__(self) -> int:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    def add(self, scene: Scene) -> int:
        """
        Stores a scene and returns its number.
        """
    def query(self, current: Scene, *, threads: typing.SupportsInt | typing.SupportsIndex = 1) -> list[tuple[int, Alignment]]:
        """
        The stored scenes most similar to the current one, each aligned with it.
        
        Args:
            threads: of this call; 0 is one a core. The result does not depend on it.
        
        Returns:
            list of (number, Alignment), most probable first, of equal ones the lowest number first.
        """
    def query_near(self, current: Scene, near: collections.abc.Sequence[typing.SupportsInt | typing.SupportsIndex], most: typing.SupportsInt | typing.SupportsIndex, *, threads: typing.SupportsInt | typing.SupportsIndex = 1) -> list[tuple[int, Alignment]]:
        """
        As query, with at most so many scenes: those near, and the most similar others.
        
        Args:
            near: numbers of scenes that are aligned however much they differ in their thumbnails.
            most: of all scenes that are aligned.
        
        Raises:
            ConfigError: a number that is not stored.
        """
    def remove(self, number: typing.SupportsInt | typing.SupportsIndex) -> None:
        """
        Removes a scene; the numbers of all later ones fall by one. Raises ConfigError if there is none.
        """
    @property
    def config(self) -> AlignmentConfig:
        ...
class PoseSheet:
    """
    The sheet of pose cells: float64 (36, n, n) by heading, y and x, wrapped on all axes.
    
    It starts with all activity in the middle cell. Threads may share it.
    
    Raises:
        ConfigError: a size that is not 7 to 1000.
    """
    def __getstate__(self) -> tuple[int, numpy.typing.NDArray[numpy.float64]]:
        ...
    def __init__(self, size: typing.SupportsInt | typing.SupportsIndex) -> None:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    def assign(self, activity: numpy.typing.NDArray[numpy.float64]) -> None:
        """
        Takes over stored activity, of any shape with as many cells.
        
        Raises:
            ShapeError: another number of cells. DataError: a cell that is negative or not finite, or a sum
            that is 0 or not finite. The sheet is then as before.
        """
    def decode(self) -> tuple[float, float, float]:
        """
        Where the packet is: x, y and th in cells.
        
        The circular means over the box of seven cells a side around the largest cell, the first one of
        equally large ones.
        """
    def inject(self, x: typing.SupportsFloat | typing.SupportsIndex, y: typing.SupportsFloat | typing.SupportsIndex, th: typing.SupportsFloat | typing.SupportsIndex, energy: typing.SupportsFloat | typing.SupportsIndex) -> None:
        """
        Adds energy at a place in cells: to the eight cells round it, whose mean it is.
        
        Raises:
            DataError: a number that is not finite, or negative energy.
        """
    def move(self, x: numpy.typing.NDArray[numpy.float64], y: numpy.typing.NDArray[numpy.float64], layers: typing.SupportsFloat | typing.SupportsIndex) -> None:
        """
        Moves activity, exactly over whole cells and linearly between them.
        
        Args:
            x, y: float64 (36,), cells that each layer moves by, finite and of any length.
            layers: that everything then moves by along the headings.
        
        Raises:
            ShapeError: not 36 ways. DataError: one that is not finite.
        """
    def settle(self, global_inhibition: typing.SupportsFloat | typing.SupportsIndex) -> None:
        """
        One step of the attractor: excitation, inhibition, and the sum 1.
        
        Raises:
            ConfigError: no activity is left; the sheet is then as before.
        """
    @property
    def activity(self) -> numpy.typing.NDArray[numpy.float64]:
        """
        float64 (36, n, n) by heading, y and x; not negative: a copy.
        """
class ActionKind(enum.IntEnum):
    """
    What happens to the map; the values are those of OpenRatSLAM.
    """
    CREATE_EDGE = ...
    CREATE_NODE = ...
    NONE = ...
class ExperienceMapConfig:
    """
    How the map is corrected.
    """
    @staticmethod
    def options() -> list[dict[str, typing.Any]]:
        """
        Every option: name, kind, default, help, unit, range or choices.
        """
    def __getstate__(self) -> dict[str, typing.Any]:
        ...
    def __init__(self, **kwargs: typing.Any) -> None:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    @property
    def agreed_sigmas(self) -> float:
        """
        reject a loop beyond this many standard deviations, whatever agrees with it
        """
    @property
    def agreeing(self) -> int:
        """
        beyond `sigmas`, accept a loop only if at least this many loops agree (itself included)
        """
    @property
    def agreement_m(self) -> float:
        """
        loops agree only if the drift between them is at most this [m]
        """
    @property
    def correction(self) -> float:
        """
        openratslam: share of a link's error that each of its ends moves by
        """
    @property
    def drift_heading(self) -> float:
        """
        standard deviation of its heading after one metre [rad/sqrt(m)]
        """
    @property
    def drift_m(self) -> float:
        """
        standard deviation of odometry's position after one metre [m/sqrt(m)]
        """
    @property
    def drift_turn(self) -> float:
        """
        standard deviation of its heading after a turn of one radian [rad/sqrt(rad)]
        """
    @property
    def initial_heading(self) -> float:
        """
        heading of the robot at the start [rad]
        """
    @property
    def loops(self) -> int:
        """
        openratslam: relaxation sweeps after each action
        """
    @property
    def outlier(self) -> float:
        """
        standard deviations from which on a loop's link pulls no harder
        """
    @property
    def place_m(self) -> float:
        """
        standard deviation of the position that a recognised view gives [m]
        """
    @property
    def place_rad(self) -> float:
        """
        standard deviation of the heading that it gives [rad]
        """
    @property
    def preset(self) -> str:
        """
        robust (ours) or openratslam (as the program of Ball et al. 2013)
        """
    @property
    def rejoin(self) -> int:
        """
        after an interruption of odometry, accept a loop beyond `sigmas` if at least this many loops since then agree (itself included)
        """
    @property
    def sigmas(self) -> float:
        """
        accept a loop up to this many standard deviations from odometry
        """
    @property
    def tolerance(self) -> float:
        """
        stop relaxing when no node moves farther than this [m]
        """
    @property
    def work(self) -> int:
        """
        work limit per action: this many nodes plus 2 % of the map
        """
class ExperienceMap:
    """
    Places and links; fusionslam.ratslam.ExperienceMap is for users. Threads may share a map.
    """
    def __getstate__(self) -> tuple[ExperienceMapConfig, dict[str, numpy.ndarray]]:
        ...
    def __init__(self, config: ExperienceMapConfig) -> None:
        ...
    def __len__(self) -> int:
        ...
    def __setstate__(self, arg0: typing.Any) -> None:
        ...
    def apply(self, kind: typing.SupportsInt | typing.SupportsIndex, source: typing.SupportsInt | typing.SupportsIndex, target: typing.SupportsInt | typing.SupportsIndex, relative_rotation: typing.SupportsFloat | typing.SupportsIndex, relative_place: tuple[typing.SupportsFloat | typing.SupportsIndex, typing.SupportsFloat | typing.SupportsIndex]) -> None:
        """
        Does what the pose cells say.
        """
    def check(self, kind: typing.SupportsInt | typing.SupportsIndex, source: typing.SupportsInt | typing.SupportsIndex, target: typing.SupportsInt | typing.SupportsIndex, relative_rotation: typing.SupportsFloat | typing.SupportsIndex, relative_place: tuple[typing.SupportsFloat | typing.SupportsIndex, typing.SupportsFloat | typing.SupportsIndex]) -> tuple[bool, float, float, float, float, str]:
        """
        Whether a loop fits odometry: the values of LoopCheck.
        """
    def mark_interruption(self) -> None:
        """
        Notes that the robot may have been carried since odometry's last pose.
        """
    def mark_interruption_before(self, node: typing.SupportsInt | typing.SupportsIndex) -> None:
        """
        Notes that the robot may have been carried before a node was made.
        """
    def on_odometry(self, v: typing.SupportsFloat | typing.SupportsIndex, w: typing.SupportsFloat | typing.SupportsIndex, dt: typing.SupportsFloat | typing.SupportsIndex) -> None:
        """
        Moves on: metres and radians a second, seconds.
        """
    def relax(self, whole: bool) -> tuple[float, float, float, int, int, bool]:
        """
        Moves nodes until links fit: the values of Relaxation.
        """
    def rescale_odometry(self, way: typing.SupportsFloat | typing.SupportsIndex, turn: typing.SupportsFloat | typing.SupportsIndex) -> None:
        """
        Multiplies what odometry has measured so far by factors.
        """
    def restore(self, state: dict[str, numpy.ndarray]) -> None:
        """
        Puts the map into a state that state() gave.
        """
    def set_odometry_deviations(self, way: typing.SupportsFloat | typing.SupportsIndex, turn: typing.SupportsFloat | typing.SupportsIndex) -> None:
        """
        Standard deviations of the factors that odometry may be off by.
        """
    def state(self) -> dict[str, numpy.ndarray]:
        ...
    @property
    def current(self) -> int:
        ...
    @property
    def links(self) -> numpy.ndarray:
        ...
    @property
    def nodes(self) -> numpy.typing.NDArray[numpy.float64]:
        ...
    @property
    def offset(self) -> tuple[float, float, float]:
        ...
    @property
    def pose(self) -> tuple[float, float, float]:
        ...
def above_height(points: numpy.typing.NDArray[numpy.float32], height: typing.SupportsFloat | typing.SupportsIndex, *, up: str = 'z') -> numpy.typing.NDArray[numpy.int64]:
    """
    Indices, int64 (M,), of the points above height metres along up (x, y, z, -x, -y, -z).
    """
def align_scenes(current: Scene, stored: Scene, *, config: AlignmentConfig | None = None) -> Alignment:
    """
    Aligns two scenes' range images and computes the probability that they show one place.
    
    Point-to-plane ICP with projective data association, in the plane, from several starts. The
    probability is calibrated: docs/stages/views/alignment.md says on what.
    
    Args:
        config: an AlignmentConfig.
    
    Returns:
        An Alignment; of probability 0 if a scene has no range image, or one of fewer than ten cells.
    """
def bev_spectrum(points: numpy.typing.NDArray[numpy.float32], *, height: typing.SupportsFloat | typing.SupportsIndex | None = None, config: BevSpectrumConfig = ...) -> numpy.typing.NDArray[numpy.float32]:
    """
    Amplitude spectrum of a cloud seen from above, over direction.
    
    A move of the sensor changes an amplitude spectrum little, and a turn shifts it over direction
    (Reddy and Chatterji 1996). What rises above the ground is drawn in three layers by height. Of each
    image, blurred, the descriptor holds log(1 + amplitude) at 24 frequencies in each of 60 directions
    of half a turn, less the frequency's mean, each direction scaled to length 1.
    compare_scan_contexts compares two at every turn; its yaw is then twice that of the clouds, which
    may also be half a turn more.
    
    Args:
        points: float32 (N, 3), metres, in a frame whose z axis points up.
        height: of the frame's origin above the ground, metres; None is that of config, 2.
        config: a BevSpectrumConfig.
    
    Returns:
        float32 (4320,): direction after direction, of each the layers from the lowest upwards.
    
    Raises:
        DataError: NaN or infinity, or no point above the ground within range.
        ShapeError, ConfigError: wrong array, value out of range.
    """
def build_scene(points: numpy.typing.NDArray[numpy.float32], colors: numpy.typing.NDArray[numpy.uint8] | None, *, preset: str = 'robust', config: SceneConfig | None = None) -> Scene:
    """
    The objects of a cloud: clusters, and the convex hull of each (Stastny 2022, 4.5).
    
    Args:
        points: float32 (N, 3), metres, without ground.
        colors: uint8 (N, 3), RGB.
        preset: "robust" (default), "paper" (the thesis's text) or "author" (its program).
        config: a SceneConfig, used instead of the preset.
    
    Returns:
        Scene, without objects for a cloud without clusters or points.
    
    Raises:
        DataError: NaN, infinity, no colours. ShapeError: wrong arrays. ConfigError: unknown preset.
    """
def ciede2000(a: typing.Any, b: typing.Any) -> float:
    """
    CIEDE2000 of two colours (L*, a*, b*), all factors 1 (Sharma, Wu, Dalal 2005).
    
    Raises:
        DataError: NaN or infinity. ShapeError: not three numbers.
    """
def cloud_from_disparity(disparity: numpy.typing.NDArray[numpy.float32], image: numpy.typing.NDArray[numpy.uint8], left_projection: numpy.typing.NDArray[numpy.float64], right_projection: numpy.typing.NDArray[numpy.float64], *, cloud_from_rectified: numpy.typing.NDArray[numpy.float64] | None = None, config: StereoConfig = ...) -> tuple[numpy.typing.NDArray[numpy.float32], numpy.typing.NDArray[numpy.uint8], numpy.typing.NDArray[numpy.int64]]:
    """
    Coloured cloud of a disparity image.
    
    Args:
        disparity: float32 (H, W), pixels of the left image, 0 where there is none.
        image: the left colours, uint8 (H, W, 3) RGB or (H, W).
        left_projection, right_projection: float64 (3, 4) of the rectified pair.
        cloud_from_rectified: float64 (4, 4), the frame wanted; None is the rectified camera frame.
    
    Returns:
        (points float32 (M, 3), colors uint8 (M, 3), indices int64 (M,): row-major pixels).
    
    Raises:
        DataError: projections that are no rectified pair. ShapeError: sizes that differ.
    """
def cloud_resolution(points: numpy.typing.NDArray[numpy.float32]) -> float:
    """
    Mean distance from a point to its nearest neighbour, metres.
    """
def cm2dp(points: numpy.typing.NDArray[numpy.float32], colors: numpy.typing.NDArray[numpy.uint8], *, color_space: str = 'rgb', preset: str = 'robust', config: M2dpConfig | None = None, threads: typing.SupportsInt | typing.SupportsIndex = 1) -> numpy.typing.NDArray[numpy.float32]:
    """
    c-M2DP descriptor of a coloured cloud (Perdomo 2019, chapter 3).
    
    Args:
        points: float32 (N, 3), metres, any frame; N >= 4.
        colors: uint8 (N, 3), RGB.
        color_space: "rgb" (the published choice), "hsv" or "lab".
        preset, config, threads: as m2dp.
    
    Returns:
        float32 (576,): first left (64) and right (512) singular vectors of the signature matrix.
    
    Raises:
        DataError, ShapeError, ConfigError: as m2dp, and if there is not one colour a point.
    """
def cm2dp_signature(points: numpy.typing.NDArray[numpy.float32], colors: numpy.typing.NDArray[numpy.uint8], *, color_space: str = 'rgb', preset: str = 'robust', config: M2dpConfig | None = None, threads: typing.SupportsInt | typing.SupportsIndex = 1) -> numpy.typing.NDArray[numpy.float64]:
    """
    Signature matrix of c-M2DP: float64 (64, 512), counts / n: 128 shape bins, then
    8 rings x 16 bins for each colour channel. Arguments and errors as cm2dp.
    """
def color_difference(a: typing.Any, b: typing.Any, kind: str = 'ciede2000') -> float:
    """
    The difference of two colours.
    
    Args:
        a, b: RGB, three numbers from 0 to 255.
        kind: "ciede2000" or "cie76" (L*a*b* of sRGB with white D65), "rgb" (Euclidean distance) or
            "author" (sqrt(3) times the difference of red, as the program of Stastny 2022 has it).
    
    Raises:
        DataError: NaN, or channels outside. ShapeError: not three numbers. ConfigError: unknown kind.
    """
def colorize(points: numpy.typing.NDArray[numpy.float32], image: numpy.typing.NDArray[numpy.uint8], projection: numpy.typing.NDArray[numpy.float64], *, interpolation: str = 'nearest') -> tuple[numpy.typing.NDArray[numpy.float32], numpy.typing.NDArray[numpy.uint8], numpy.typing.NDArray[numpy.int64]]:
    """
    Colours points with the pixels they project to (Perdomo 2019, 3.3.1).
    
    Args:
        points: float32 (N, 3), metres.
        image: uint8 (H, W, 3) RGB or (H, W).
        projection: float64 (3, 4), maps homogeneous points to pixels.
        interpolation: "nearest" or "bilinear".
    
    Returns:
        (points float32 (M, 3), colors uint8 (M, 3), indices int64 (M,)) of the points in front of
        the camera whose nearest pixel lies inside the image.
    
    Raises:
        DataError: singular projection, NaN or infinity in a point, empty image.
    """
def colorize_all_round(points: numpy.typing.NDArray[numpy.float32], images: collections.abc.Sequence[numpy.typing.NDArray[numpy.uint8]], projections: collections.abc.Sequence[numpy.typing.NDArray[numpy.float64]], *, balance: bool = True, interpolation: str = 'nearest') -> tuple[numpy.typing.NDArray[numpy.float32], numpy.typing.NDArray[numpy.uint8], numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.uint8], numpy.typing.NDArray[numpy.float64]]:
    """
    Colours points with the pixels of several cameras, each as colorize does.
    
    A point that several cameras see takes the colour of the one to whose image's centre it is
    nearest, across in half widths of the image and down in half heights.
    
    Args:
        points: float32 (N, 3), metres.
        images: of each of 1 to 255 cameras: uint8 (H, W, 3) RGB or (H, W).
        projections: of each camera: float64 (3, 4), maps homogeneous points to pixels.
        balance: multiply red, green and blue of each camera by gains that give cameras the same
            median colour where two of them see the same points, at least 30; by least squares of the
            gains' logarithms, whose mean is 0 over linked cameras. Gains are limited to 1/2 and 2;
            cameras that share no points keep 1.
        interpolation: "nearest" or "bilinear".
    
    Returns:
        (points float32 (M, 3), colors uint8 (M, 3), indices int64 (M,), cameras uint8 (M,): the
        number of the camera of each, gains float64 (K, 3)) of the points that some camera sees.
    
    Raises:
        DataError: as colorize, or no camera. ShapeError: not as many images as projections.
    """
def compare_descriptors(query: numpy.typing.NDArray[numpy.float32], match: numpy.typing.NDArray[numpy.float32], metric: str) -> tuple[float, float | None]:
    """
    How alike two descriptors are, as an index of the metric has it.
    
    Args:
        query, match: float32 (D,).
        metric: one of metric_names().
    
    Returns:
        (distance; yaw of the query's frame in the match's, radians, or None where the metric finds no
        turn).
    
    Raises:
        ShapeError, DataError: other lengths, NaN, values that have no meaning in the metric.
        ConfigError: unknown metric.
    """
def compare_scan_contexts(query: numpy.typing.NDArray[numpy.float32], match: numpy.typing.NDArray[numpy.float32]) -> tuple[float, float]:
    """
    How alike two Scan Contexts are (Kim, Kim, IROS 2018), and the turn between them.
    
    The distance is 1 - the sum over the sectors of their cosines, divided by the sectors that are
    filled in the fuller one, at the turn where that is least. The paper divides by the sectors that
    are filled in both, which is the same for scans of the full circle; of narrow ones it takes any two
    slivers for one place.
    
    Args:
        query, match: float32 (60 R,), of scan_context or cscan_context, or of bev_spectrum, for which
            the yaw returned is twice that of the clouds.
    
    Returns:
        (distance, 0 to 1; yaw of the query's frame in the match's, radians).
    
    Raises:
        ShapeError, DataError: other lengths, NaN.
    """
def compare_solid_azimuths(query: numpy.typing.NDArray[numpy.float32], match: numpy.typing.NDArray[numpy.float32]) -> tuple[float, float]:
    """
    The turn between two clouds, from the azimuths of solid_parts.
    
    Args:
        query, match: float32 (60,).
    
    Returns:
        (distance, yaw): the least sum of absolute differences over all shifts by 6 degrees, and the
        turn of the query's frame in the match's, radians, above -pi to pi.
    
    Raises:
        ShapeError, DataError: wrong array, NaN or infinity.
    """
def cospair(points: numpy.typing.NDArray[numpy.float32], colors: numpy.typing.NDArray[numpy.uint8], *, config: CospairConfig = ..., threads: typing.SupportsInt | typing.SupportsIndex = 1) -> numpy.typing.NDArray[numpy.float32]:
    """
    CoSPAIR at the centroid (after Logoglu, Kalkan, Temizel, Robotics and Autonomous Systems 2016).
    
    Args:
        points: float32 (N, 3), metres, the sensor at the origin.
        colors: uint8 (N, 3), RGB.
        config: a CospairConfig.
        threads: threads of this call; 0 is one a core. The result does not depend on it.
    
    Returns:
        float32 (378,): for each of 7 shells about the centroid, 9 bins each of theta, alpha, phi
        between the mean normal and the points' and of CIELab L, a, b; each histogram sums to 1.
    
    Raises:
        DataError: NaN or infinity, or fewer than 3 points with a normal.
        ShapeError, ConfigError: wrong array, value out of range, or not one colour a point.
    """
def count_overlap(points: numpy.typing.NDArray[numpy.float32], other: numpy.typing.NDArray[numpy.float32], other_ranges: numpy.typing.NDArray[numpy.float32], other_from_points: numpy.typing.NDArray[numpy.float64], *, distance: typing.SupportsFloat | typing.SupportsIndex = 0.5) -> dict[str, int]:
    """
    Counts the points of a cloud by what another sensor saw where they are.
    
    Args:
        points: float32 (N, 3), metres.
        other: float32 (M, 3), points of the other cloud, its sensor at the origin.
        other_ranges: nearest_ranges of all that the other sensor saw.
        other_from_points: float64 (4, 4), rigid.
        distance: metres. Points this near agree, and points this much nearer than the nearest range
            in their direction and the eight about it are before it.
    
    Returns:
        Number of points by name: "agreeing" (a point of the other cloud is near); of the rest "before"
        (in space that the other sensor saw to be free), "open" (in its view, where nothing came back),
        "behind" (hidden by a surface, or at its edge), "outside" (of its view or range).
    
    Raises:
        ConfigError: distance is not in (0, 100]. ShapeError: arrays of other shapes.
        DataError: NaN or infinity in a point; a range that is negative or not finite; a transform that
            is not rigid.
    """
def cscan_context(points: numpy.typing.NDArray[numpy.float32], colors: numpy.typing.NDArray[numpy.uint8], *, height: typing.SupportsFloat | typing.SupportsIndex | None = None, config: ScanContextConfig = ...) -> numpy.typing.NDArray[numpy.float32]:
    """
    Scan Context of a coloured cloud: heights, and beside them the hue of each bin.
    
    Of each sector, first the heights of its rings, divided by the root mean square of all filled bins;
    then the mean CIELab a of the points above the ground in each ring; then b. Colours are scaled to a
    grey world, against exposure and tint; a and b are multiplied by 2 / (chroma + 5), so that hue
    counts more than saturation, and colours about as much as heights.
    
    Args:
        points, height, config: as scan_context.
        colors: uint8 (N, 3), RGB.
    
    Returns:
        float32 (3600,): sector after sector; compare_scan_contexts compares two.
    
    Raises:
        DataError, ShapeError, ConfigError: as scan_context, and if there is not one colour a point.
    """
def cshot(points: numpy.typing.NDArray[numpy.float32], colors: numpy.typing.NDArray[numpy.uint8], *, normal_radius: typing.SupportsFloat | typing.SupportsIndex | None = None, threads: typing.SupportsInt | typing.SupportsIndex = 1) -> numpy.typing.NDArray[numpy.float32]:
    """
    Global CSHOT: SHOT with colour (Tombari, Salti, Di Stefano 2011; Perdomo 2019, 4.1).
    
    Args:
        colors: uint8 (N, 3), RGB; the rest as shot.
    
    Returns:
        float32 (1344,).
    """
def cvfh(points: numpy.typing.NDArray[numpy.float32], *, config: CvfhConfig = ..., threads: typing.SupportsInt | typing.SupportsIndex = 1) -> numpy.typing.NDArray[numpy.float32]:
    """
    Clustered Viewpoint Feature Histogram (Aldoma et al., ICCV Workshops 2011).
    
    Args:
        points: float32 (N, 3), metres, the sensor at the origin.
        config: a CvfhConfig.
        threads: threads of this call; 0 is one a core. The result does not depend on it.
    
    Returns:
        float32 (regions * 308,): the VFH of the whole cloud about the centroid and normal of each
        smooth region, the largest region first; blocks without a region are zero.
    
    Raises:
        DataError: NaN or infinity, fewer than 3 points with a normal, no smooth region.
        ShapeError, ConfigError: wrong array, value out of range.
    """
def dbscan(points: numpy.typing.NDArray[numpy.float32], colors: numpy.typing.NDArray[numpy.uint8] | None = None, *, eps: typing.SupportsFloat | typing.SupportsIndex, min_points: typing.SupportsInt | typing.SupportsIndex, color_scale: typing.SupportsFloat | typing.SupportsIndex = 0.001, inclusive: bool = False) -> numpy.typing.NDArray[numpy.int32]:
    """
    Clusters of points by density in (x, y, z, s r, s g, s b) (Ester et al. 1996).
    
    Args:
        points: float32 (N, 3), metres, any frame.
        colors: uint8 (N, 3), RGB; None clusters in x, y, z only.
        eps: radius of a neighbourhood, metres.
        min_points: neighbours that make a point a core point, itself among them.
        color_scale: s, metres a step of a colour channel.
        inclusive: whether a point exactly eps away is a neighbour (as in scikit-learn).
    
    Returns:
        int32 (N,): clusters from 0 in the order of their first core points, -1 for noise. A border
        point belongs to the first of the clusters that reach it.
    
    Raises:
        DataError: NaN or infinity. ShapeError: wrong arrays. ConfigError: values out of range.
    """
def demosaic(image: numpy.typing.NDArray[numpy.uint8], pattern: str) -> numpy.typing.NDArray[numpy.uint8]:
    """
    The RGB image behind a Bayer mosaic: means of the nearest pixels, by OpenCV.
    
    Args:
        image: uint8 (H, W), at least 4 pixels a side.
        pattern: colours of the upper left 2 x 2 pixels, row by row: "rggb", "bggr", "gbrg", "grbg".
    
    Returns:
        uint8 (H, W, 3), RGB; the outermost pixels are copies of their inner neighbours.
    
    Raises:
        ShapeError: an image with three channels. DataError: too small. ConfigError: unknown pattern.
    """
def depth_image(points: numpy.typing.NDArray[numpy.float32], projection: numpy.typing.NDArray[numpy.float64], *, width: typing.SupportsInt | typing.SupportsIndex, height: typing.SupportsInt | typing.SupportsIndex) -> numpy.typing.NDArray[numpy.float32]:
    """
    Depth along the optical axis of the nearest point in each pixel: float32 (height, width),
    metres, 0 where there is none. Arguments and errors as colorize.
    """
def drift_covariance(config: DriftConfig, motion: numpy.typing.NDArray[numpy.float64]) -> numpy.typing.NDArray[numpy.float64]:
    """
    Covariance of odometry's error over a motion.
    
    Args:
        config: how the error grows.
        motion: float64 (4, 4), rigid: from where the robot was to where it is.
    
    Returns:
        float64 (6, 6), as that of an ``Edge``.
    """
def drop_invalid(points: numpy.typing.NDArray[numpy.float32]) -> numpy.typing.NDArray[numpy.int64]:
    """
    Indices, int64 (M,), of the points without NaN or infinity.
    """
def esf(points: numpy.typing.NDArray[numpy.float32]) -> numpy.typing.NDArray[numpy.float32]:
    """
    Ensemble of Shape Functions (Wohlkinger, Vincze, ROBIO 2011), with PCL's weights.
    
    Twenty thousand triangles of points are drawn by a generator with a fixed seed: the same array has
    the same ESF, the same points in another order one that differs by the error of sampling.
    
    Args:
        points: float32 (N, 3), metres, any frame; N >= 3.
    
    Returns:
        float32 (640,), sums to 1: 64 bins each of angles, square roots of areas, and lengths, for lines
        on the surface, off it and both; then of the share of the surface in lines that are both.
    
    Raises:
        DataError: NaN or infinity, fewer than 3 points, points all equal or on one line.
        ShapeError: wrong array.
    """
def estimate_normals(points: numpy.typing.NDArray[numpy.float32], *, radius: typing.SupportsFloat | typing.SupportsIndex, threads: typing.SupportsInt | typing.SupportsIndex = 1) -> tuple[numpy.typing.NDArray[numpy.float32], numpy.typing.NDArray[numpy.float32], numpy.typing.NDArray[numpy.int64]]:
    """
    Least-squares normals (PCL), turned towards the origin.
    
    Args:
        points: float32 (N, 3), metres.
        radius: of the neighbourhood, metres.
    
    Returns:
        (normals float32 (M, 3), curvatures float32 (M,), indices int64 (M,)) of the points with at
        least three neighbours.
    """
def first_singular_vectors(matrix: numpy.typing.NDArray[numpy.float32]) -> numpy.typing.NDArray[numpy.float32]:
    """
    First left and right singular vectors of a matrix of entries >= 0, both >= 0.
    
    What m2dp and cm2dp make of a signature: iterated with a test of convergence; where the two
    largest singular values are close, eigenvectors of A A^T in double precision.
    
    Args:
        matrix: float32 (R, C).
    
    Returns:
        float32 (R + C,): left, then right, each of length 1.
    
    Raises:
        DataError: negative, infinite or NaN entries, or all zero.
        ShapeError: wrong array.
    """
def gasd_color(points: numpy.typing.NDArray[numpy.float32], colors: numpy.typing.NDArray[numpy.uint8]) -> numpy.typing.NDArray[numpy.float32]:
    """
    GASD with colour (Lima, Teichrieb, SIBGRAPI 2016).
    
    Args:
        points: float32 (N, 3), metres, any frame; N >= 4.
        colors: uint8 (N, 3), RGB.
    
    Returns:
        float32 (984,): in the frame of the principal axes, percent of the points in 6 x 6 x 6 cells,
        then in 12 bins of hue in each of 4 x 4 x 4 cells.
    
    Raises:
        DataError: fewer than 4 points, NaN or infinity, points all equal or on one line.
        ShapeError: wrong array, or not one colour a point.
    """
def gestalt(points: numpy.typing.NDArray[numpy.float32], *, config: GestaltConfig = ..., threads: typing.SupportsInt | typing.SupportsIndex = 1) -> numpy.typing.NDArray[numpy.float32]:
    """
    3D Gestalt descriptors at keypoints (Bosse, Zlot, ICRA 2013).
    
    Args:
        points: float32 (N, 3), metres, in a frame whose z axis points up.
        config: a GestaltConfig.
        threads: threads of this call; 0 is one a core. The result does not depend on it.
    
    Returns:
        float32 (keypoints * 66,): of each keypoint mean height (32, metres) and variance of the height
        (32, square metres) in 4 rings x 8 sectors about it, then its x and y (metres); blocks without a
        keypoint are zero.
    
    Raises:
        DataError: NaN or infinity, or a cloud without a keypoint.
        ShapeError, ConfigError: wrong array, value out of range.
    """
def gfh(points: numpy.typing.NDArray[numpy.float32], *, config: GfhConfig = ...) -> numpy.typing.NDArray[numpy.float32]:
    """
    Global Fourier Histogram (Chen et al. 2014).
    
    Args:
        points: float32 (N, 3), metres, in a frame whose z axis points up, the sensor on its z axis.
        config: a GfhConfig.
    
    Returns:
        float32 (rings * layers * (sectors // 2 + 1),) of length 1: amplitudes of the Fourier transform,
        over azimuth, of the number of points in each ring and layer.
    
    Raises:
        DataError: NaN or infinity, or no point in the cylinder.
        ShapeError, ConfigError: wrong array, value out of range.
    """
def intensity_scan_context(points: numpy.typing.NDArray[numpy.float32], intensities: numpy.typing.NDArray[numpy.float32], *, config: IntensityScanContextConfig = ...) -> numpy.typing.NDArray[numpy.float32]:
    """
    Intensity Scan Context of a cloud (Wang, Wang, Xie, ICRA 2020).
    
    The largest intensity in each bin, divided by the largest within range: 0 in bins without points, at
    least 1 / 255 in others. A turn about z by a sector of 6 degrees moves the sectors by one. Compared
    with metric="intensity_scan_context".
    
    Args:
        points: float32 (N, 3), metres, in a frame whose z axis points up.
        intensities: float32 (N,), finite and >= 0, in any unit.
        config: an IntensityScanContextConfig.
    
    Returns:
        float32 (1200,): 60 sectors from x towards y, each with 20 rings outwards to 60 m.
    
    Raises:
        DataError: NaN or infinity, a negative intensity, or no intensity > 0 within range.
        ShapeError, ConfigError: wrong array, not one intensity a point, value out of range.
    """
def iris(points: numpy.typing.NDArray[numpy.float32], *, config: IrisConfig = ...) -> numpy.typing.NDArray[numpy.float32]:
    """
    LiDAR Iris of a cloud (Wang, Sun, Xu, Sarma, Yang, Kong, IROS 2020).
    
    Signs of the real and imaginary responses of four LoG-Gabor filters along the rings of iris_image. A
    turn about z by a degree moves the columns by one. Compared with metric="iris".
    
    Args:
        points: float32 (N, 3), metres, in a frame whose z axis points up and whose origin is the
            scanner.
        config: an IrisConfig.
    
    Returns:
        float32 (28800,), whole numbers from 0 to 65535: of each of 360 columns 40 words of code, then
        40 of mask. Bit 8 (ring % 2) + 2 filter + part (0 real, 1 imaginary) of word ring / 2 is set in
        the code if the response is > 0, in the mask if it is strong enough to count.
    
    Raises:
        DataError: NaN or infinity, or no point within range and slices.
        ShapeError, ConfigError: wrong array, value out of range.
    """
def iris_image(points: numpy.typing.NDArray[numpy.float32], *, config: IrisConfig = ...) -> numpy.typing.NDArray[numpy.uint8]:
    """
    LiDAR-Iris image of a cloud; arguments and errors as iris.
    
    Returns:
        uint8 (80, 360), rings outwards to 80 m and columns of a degree from x towards y: bit i is set
        where there is a point in slice i, upwards, of the 8 from z = -3 to 5 m.
    """
def m2dp(points: numpy.typing.NDArray[numpy.float32], *, preset: str = 'robust', config: M2dpConfig | None = None, threads: typing.SupportsInt | typing.SupportsIndex = 1) -> numpy.typing.NDArray[numpy.float32]:
    """
    M2DP descriptor of a cloud (He, Wang, Zhang, IROS 2016).
    
    Args:
        points: float32 (N, 3), metres, any frame; N >= 4.
        preset: "robust" (default), "upright" (robust about the vertical: z has to point up), "paper"
            (He's MATLAB) or "author" (Perdomo's C++).
        config: an M2dpConfig, used instead of the preset.
        threads: threads of this call; 0 is one a core. The result does not depend on it.
    
    Returns:
        float32 (192,): first left (64) and right (128) singular vectors of the signature matrix.
    
    Raises:
        DataError: fewer than 4 points, NaN or infinity, points all equal or on one line.
        ShapeError, ConfigError: wrong array, unknown preset.
    """
def m2dp_signature(points: numpy.typing.NDArray[numpy.float32], *, preset: str = 'robust', config: M2dpConfig | None = None, threads: typing.SupportsInt | typing.SupportsIndex = 1) -> numpy.typing.NDArray[numpy.float64]:
    """
    Signature matrix of M2DP: float64 (64, 128), one row a projection plane, counts / n.
    
    Arguments and errors as m2dp.
    """
def metric_names() -> tuple[str, ...]:
    """
    The metrics by which descriptors can be compared; documented in docs/stages/matching.md.
    """
def ndt_histogram(points: numpy.typing.NDArray[numpy.float32], *, config: NdtHistogramConfig = ...) -> numpy.typing.NDArray[numpy.float32]:
    """
    Surface-shape histograms of a cloud (Magnusson, Andreasson, Nuechter, Lilienthal, ICRA 2009).
    
    Cells of points are counted as lines, planes of 9 directions or round, in 5 shells of distance. The
    set of up to four histograms, each of the cloud turned so that a common direction of walls lies
    along x, does not change as the cloud is turned about z. Compared with metric="nearest_of_set".
    
    Args:
        points: float32 (N, 3), metres, in a frame whose z axis points up and whose origin is the
            scanner.
        config: an NdtHistogramConfig.
    
    Returns:
        float32 (220,): four histograms of 5 shells x 11 classes with the sum 1, unused ones 0.
    
    Raises:
        DataError: NaN or infinity, or no cell with 5 points.
        ShapeError, ConfigError: wrong array, value out of range.
    """
def nearest(queries: numpy.typing.NDArray[numpy.float32], descriptors: numpy.typing.NDArray[numpy.float32], *, k: typing.SupportsInt | typing.SupportsIndex = 1, threads: typing.SupportsInt | typing.SupportsIndex = 0, metric: str = 'l2') -> tuple[numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.float32]]:
    """
    The k nearest descriptors of each query, exactly; equal distances go to the lowest row.
    
    Args:
        queries, descriptors: float32 (N, D) and (M, D).
        metric: one of metric_names().
    
    Returns:
        (indices int64 (N, k), -1 where there is none; distances float32 (N, k), infinite there).
    
    Raises:
        ShapeError, DataError: other lengths, NaN, values that have no meaning in the metric.
        ConfigError: unknown metric.
    """
def nearest_causal(descriptors: numpy.typing.NDArray[numpy.float32], *, window: typing.SupportsInt | typing.SupportsIndex, k: typing.SupportsInt | typing.SupportsIndex = 1, threads: typing.SupportsInt | typing.SupportsIndex = 0, metric: str = 'l2') -> tuple[numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.float32]]:
    """
    For each row i the k nearest rows j < i - window, as an online run would find them.
    
    Args:
        descriptors: float32 (N, D).
        metric: as nearest.
    
    Returns:
        (indices int64 (N, k), -1 where there is none; distances float32 (N, k), infinite there).
    """
def nearest_ranges(points: numpy.typing.NDArray[numpy.float32], *, step: typing.SupportsFloat | typing.SupportsIndex = 2.0) -> numpy.typing.NDArray[numpy.float32]:
    """
    Range of the nearest point in each direction, seen from the origin.
    
    Args:
        points: float32 (N, 3), metres.
        step: width and height of a direction, degrees, 0.1 to 30.
    
    Returns:
        float32 (rows, columns), metres: rows of elevation from -90 deg up, columns of azimuth from
        -180 deg to the left; 0 where there is no point.
    
    Raises:
        ConfigError: another step. DataError: NaN or infinity in a point.
    """
def our_cvfh(points: numpy.typing.NDArray[numpy.float32], *, config: OurCvfhConfig = ..., threads: typing.SupportsInt | typing.SupportsIndex = 1) -> numpy.typing.NDArray[numpy.float32]:
    """
    OUR-CVFH (Aldoma, Tombari, Rusu, Vincze, DAGM 2012).
    
    Args:
        points: float32 (N, 3), metres, the sensor at the origin.
        config: an OurCvfhConfig.
        threads: threads of this call; 0 is one a core. The result does not depend on it.
    
    Returns:
        float32 (regions * 308,): for each frame of reference of each smooth region, the largest region
        first, 135 angle bins as in cvfh, 8 x 13 distance bins in octants, 69 viewpoint bins; blocks
        without a region are zero.
    
    Raises:
        DataError, ShapeError, ConfigError: as cvfh.
    """
def rectify_image(image: numpy.typing.NDArray[numpy.uint8], *, camera_matrix: numpy.typing.NDArray[numpy.float64], distortion: numpy.typing.NDArray[numpy.float64], model: str, rectification: numpy.typing.NDArray[numpy.float64], projection: numpy.typing.NDArray[numpy.float64], size: tuple[typing.SupportsInt | typing.SupportsIndex, typing.SupportsInt | typing.SupportsIndex]) -> numpy.typing.NDArray[numpy.uint8]:
    """
    The image as a pinhole camera would have taken it (sensor_msgs/CameraInfo), by OpenCV.
    
    Args:
        image: uint8 (H, W, 3) RGB or (H, W), as taken.
        camera_matrix: float64 (3, 3), K.
        distortion: float64 (K,): 4 or 5 for plumb_bob, 8 for rational_polynomial (both also 0, for
            no distortion), 4 for equidistant, 0 for none.
        model: "plumb_bob", "rational_polynomial", "equidistant", "none" or "".
        rectification: float64 (3, 3), R, rectified_from_camera.
        projection: float64 (3, 4), P of the rectified image.
        size: (width, height) that the calibration is for.
    
    Returns:
        uint8, of the image's shape, read bilinearly; black where the camera did not see.
    
    Raises:
        DataError: matrices that are no camera's (zeros, NaN), another number of coefficients.
        ShapeError: an image of another size. ConfigError: unknown model.
    """
def remove_ground_plane(points: numpy.typing.NDArray[numpy.float32], *, up: str = 'z', config: GroundPlaneConfig = ...) -> tuple[numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.float64]]:
    """
    Finds the ground plane by RANSAC (PCL, seeded) and drops its points.
    
    Returns:
        (indices kept int64 (M,), plane float64 (4,): a x + b y + c z + d = 0 with the normal up;
        zeros, and every point kept, where there is none).
    """
def remove_ground_segments(points: numpy.typing.NDArray[numpy.float32], *, up: str = 'z', config: GroundSegmentsConfig = ...) -> tuple[numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.float64]]:
    """
    Fits the ground from the lowest points up, segment by segment along the driving axis
    (Zermas, Izzat, Papanikolopoulos, ICRA 2017), and drops what is not above it.
    
    A segment without a ground of its own (few points, a wall, a step) takes its neighbour's plane.
    
    Args:
        points: float32 (N, 3), metres.
        up: x, y, z, -x, -y or -z.
    
    Returns:
        (indices kept int64 (M,), planes float64 (S, 4): a x + b y + c z + d = 0 with the normal up,
        borders float64 (S + 1,) of the segments along the driving axis). Planes are zeros, and every
        point is kept, where no segment shows any ground.
    
    Raises:
        ConfigError: the driving axis points up. DataError: NaN or infinity in a point.
    """
def ring(points: numpy.typing.NDArray[numpy.float32], *, config: RingConfig = ...) -> numpy.typing.NDArray[numpy.float32]:
    """
    RING of a cloud (Lu, Xu, Yin, Chen, Xiong, Wang, IROS 2022): a spectrum of its sinogram.
    
    What rises above the ground is drawn from above, in 120 x 120 cells, and summed along lines at 120
    angles of half a turn; the amplitudes of the sums' frequencies do not change as the sensor moves,
    but for what enters and leaves the image and how it falls into cells. A turn about z by 1.5 degrees
    moves the angles around by one; half a turn changes nothing. Compared with metric="ring".
    
    Args:
        points: float32 (N, 3), metres, in a frame whose z axis points up.
        config: a RingConfig.
    
    Returns:
        float32 (7200,): 120 angles from x towards y, each with the frequencies 1 to 60.
    
    Raises:
        DataError: NaN or infinity, or no point above the ground within range.
        ShapeError, ConfigError: wrong array, value out of range.
    """
def scan_context(points: numpy.typing.NDArray[numpy.float32], *, height: typing.SupportsFloat | typing.SupportsIndex | None = None, config: ScanContextConfig = ...) -> numpy.typing.NDArray[numpy.float32]:
    """
    Scan Context of a cloud (Kim, Kim, IROS 2018).
    
    Of 60 sectors of azimuth, from x towards y, and 20 rings up to 80 m the height of the highest point
    above the ground, 0 where there is none. compare_scan_contexts compares two, at every turn.
    
    Args:
        points: float32 (N, 3), metres, in a frame whose z axis points up.
        height: of the frame's origin above the ground, metres; None is that of config, 2.
        config: a ScanContextConfig.
    
    Returns:
        float32 (1200,): sector after sector, from the innermost ring outwards.
    
    Raises:
        DataError: NaN or infinity, or no point above the ground within range.
        ShapeError, ConfigError: wrong array, value out of range.
    """
def scan_context_cartesian(points: numpy.typing.NDArray[numpy.float32], *, config: ScanContextCartesianConfig = ...) -> numpy.typing.NDArray[numpy.float32]:
    """
    Cartesian Context of Scan Context++ (Kim, Choi, Kim, T-RO 2022).
    
    The height above the ground of the highest point of each of 40 x 40 cells, 0 without one. A move to
    the side by the width of a column, 2 m, moves the columns by one; half a turn about z reverses the
    values. Compared with metric="aligned_cartesian".
    
    Args:
        points: float32 (N, 3), metres, in a frame whose x axis points ahead and whose z axis points up.
        config: a ScanContextCartesianConfig.
    
    Returns:
        float32 (1600,): 40 columns along y from -40 to 40 m, each with 40 cells along x from -100 to
        100 m.
    
    Raises:
        DataError: NaN or infinity, or no point above the ground within range.
        ShapeError, ConfigError: wrong array, value out of range.
    """
def scan_context_polar(points: numpy.typing.NDArray[numpy.float32], *, config: ScanContextPolarConfig = ...) -> numpy.typing.NDArray[numpy.float32]:
    """
    Polar Context of Scan Context++ (Kim, Choi, Kim, T-RO 2022).
    
    The heights of scan_context with 20 rings; what is new is how two are compared, with
    metric="aligned_polar". A turn about z by a sector of 6 degrees moves the sectors by one.
    
    Args:
        points: float32 (N, 3), metres, in a frame whose z axis points up.
        config: a ScanContextPolarConfig.
    
    Returns:
        float32 (1200,): 60 sectors from x towards y, each with 20 rings outwards.
    
    Raises:
        DataError: NaN or infinity, or no point above the ground within range.
        ShapeError, ConfigError: wrong array, value out of range.
    """
def scene_similarity(current: Scene, stored: Scene, *, preset: str = 'robust', config: SimilarityConfig | None = None) -> float:
    """
    The similarity of two scenes, 0 to 1 (Stastny 2022, 4.6).
    
    Every object of the current scene takes its best similarity to an object of the stored one; the
    mean of these, weighted by numbers of points, is the similarity. The robust preset takes the mean
    with the same seen from the stored scene. Two empty scenes are alike (1), one empty one is not (0).
    
    Args:
        preset: "robust" (default), "paper" or "author".
        config: a SimilarityConfig, used instead of the preset.
    
    Raises:
        ConfigError: unknown preset, all weights 0. DataError: an object that is not finite.
    """
def shot(points: numpy.typing.NDArray[numpy.float32], *, normal_radius: typing.SupportsFloat | typing.SupportsIndex | None = None, threads: typing.SupportsInt | typing.SupportsIndex = 1) -> numpy.typing.NDArray[numpy.float32]:
    """
    Global SHOT: PCL's SHOT at the centroid, the whole cloud its support
    (Tombari, Salti, Di Stefano 2010; Perdomo 2019, section 4.1).
    
    Args:
        points: float32 (N, 3), metres.
        normal_radius: metres; None is 5 x cloud_resolution(points).
        threads: threads of this call; the result does not depend on it.
    
    Returns:
        float32 (352,).
    
    Raises:
        DataError: NaN or infinity, equal points, or fewer than 5 points with a normal.
    """
def shot_at_centroid(points: numpy.typing.NDArray[numpy.float32], normals: numpy.typing.NDArray[numpy.float32], colors: numpy.typing.NDArray[numpy.uint8] | None = None, *, threads: typing.SupportsInt | typing.SupportsIndex = 1) -> numpy.typing.NDArray[numpy.float32]:
    """
    Global SHOT, or with colours CSHOT, of points whose normals are known.
    
    Args:
        points: float32 (N, 3), metres; N >= 5.
        normals: float32 (N, 3), unit length.
        colors: uint8 (N, 3), RGB, or None.
        threads: threads of this call; 0 is one a core. The result does not depend on it.
    
    Returns:
        float32 (352,) without colours, (1344,) with them.
    
    Raises:
        DataError: NaN or infinity, or no local reference frame.
        ShapeError: not one normal and one colour a point.
    """
def simd_level() -> str:
    """
    Name of the instruction set the hot loops use: baseline, avx2 or avx512.
    
    It is the best the machine has, or what the environment variable FUSIONSLAM_SIMD said at the first
    use. Results do not depend on it.
    
    Raises:
        ConfigError: FUSIONSLAM_SIMD names no level, or one this machine lacks.
    """
def solid(points: numpy.typing.NDArray[numpy.float32], *, config: SolidConfig = ...) -> numpy.typing.NDArray[numpy.float32]:
    """
    SOLiD of a cloud: its part over range (Kim, Choi, Sim, Kim, Cho, RA-L 2024).
    
    The mean points of voxels are counted over range and elevation; a bin of elevation weighs its count,
    scaled to [0, 1]. Of length 1, so that L2 orders as the paper's cosine does. Turns about z change it
    only as far as points fall into other voxels.
    
    Args:
        points: float32 (N, 3), metres, in a frame whose z axis points up and whose origin is the
            scanner.
        config: a SolidConfig.
    
    Returns:
        float32 (40,): bins of horizontal range, outwards.
    
    Raises:
        DataError: NaN or infinity, or no point within range and elevations.
        ShapeError, ConfigError: wrong array, value out of range.
    """
def solid_parts(points: numpy.typing.NDArray[numpy.float32], *, config: SolidConfig = ...) -> tuple[numpy.typing.NDArray[numpy.float32], numpy.typing.NDArray[numpy.float32]]:
    """
    Both parts of SOLiD; arguments and errors as solid.
    
    Returns:
        (R-SOLiD, float32 (40,), by horizontal range; A-SOLiD, float32 (60,), by azimuth, from x towards
        y).
    """
def stereo_disparity(left: numpy.typing.NDArray[numpy.uint8], right: numpy.typing.NDArray[numpy.uint8], *, config: StereoConfig = ...) -> numpy.typing.NDArray[numpy.float32]:
    """
    Disparity of a rectified pair by OpenCV: float32 (H, W), pixels, 0 where there is none.
    
    Args:
        left, right: uint8 (H, W) or (H, W, 3) RGB of the same size.
    
    Raises:
        ShapeError: images of different size. ConfigError: sizes that OpenCV refuses.
    """
def vfh(points: numpy.typing.NDArray[numpy.float32], *, config: VfhConfig = ..., threads: typing.SupportsInt | typing.SupportsIndex = 1) -> numpy.typing.NDArray[numpy.float32]:
    """
    Viewpoint Feature Histogram (Rusu, Bradski, Thibaux, Hsu, IROS 2010), binned as in PCL.
    
    Args:
        points: float32 (N, 3), metres, the sensor at the origin.
        config: a VfhConfig.
        threads: threads of this call; 0 is one a core. The result does not depend on it.
    
    Returns:
        float32 (308,), no entry negative: 45 bins each of theta, alpha, phi and distance between the
        centroid, with the mean normal, and the points, then 128 of the angle between normals and the
        direction to the origin; each histogram sums to about 100.
    
    Raises:
        DataError: NaN or infinity, or fewer than 3 points with a normal.
        ShapeError, ConfigError: wrong array, value out of range.
    """
def voxel_downsample(points: numpy.typing.NDArray[numpy.float32], colors: numpy.typing.NDArray[numpy.uint8] | None = None, *, size: typing.SupportsFloat | typing.SupportsIndex) -> tuple[numpy.typing.NDArray[numpy.float32], numpy.typing.NDArray[numpy.uint8], numpy.typing.NDArray[numpy.int64]]:
    """
    One point for each cube of size metres: mean position and colour.
    
    Returns:
        (points float32 (M, 3), colors uint8 (M, 3), or (0, 3) without colours, indices int64 (M,):
        the first point of each cube).
    """
__version__: str
