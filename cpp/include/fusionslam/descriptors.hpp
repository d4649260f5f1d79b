// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "fusionslam/config.hpp"
#include "fusionslam/sensors.hpp"

namespace fusionslam {

enum class ColorSpace { rgb, hsv, lab };

template <>
struct ChoiceNames<ColorSpace> {
  static constexpr std::array<std::string_view, 3> value{"rgb", "hsv", "lab"};
};

/// Axes of a cloud's own frame.
enum class CloudAxes {
  principal,  ///< those of PCA, longest first
  upright,    ///< z as it is, x towards the densest azimuth: for clouds whose z points up
};

template <>
struct ChoiceNames<CloudAxes> {
  static constexpr std::array<std::string_view, 2> value{"principal", "upright"};
};

/// Rules for the signs of the principal axes, which PCA itself leaves open.
enum class AxisSigns {
  largest_entry,  ///< the entry of largest magnitude is positive (MATLAB's pca)
  pcl,            ///< as Eigen's float solver returns them, third axis = first x second (PCL's PCA)
  mirror_pairs,   ///< for each pair of bins that mirror each other: the fuller one is positive
};

template <>
struct ChoiceNames<AxisSigns> {
  static constexpr std::array<std::string_view, 3> value{"largest_entry", "pcl", "mirror_pairs"};
};

/// Radius of the outermost ring.
enum class OuterRadius {
  farthest_point,  ///< distance of the farthest point from the mean
  three_rms,       ///< three times the root mean square distance: single points do not move it
};

template <>
struct ChoiceNames<OuterRadius> {
  static constexpr std::array<std::string_view, 2> value{"farthest_point", "three_rms"};
};

/// Matrix whose singular vectors are computed.
enum class Weighting {
  counts,       ///< the signature matrix itself
  square_root,  ///< its square roots, so that full bins do not outweigh sparse ones
};

template <>
struct ChoiceNames<Weighting> {
  static constexpr std::array<std::string_view, 2> value{"counts", "square_root"};
};

/// Parameters of M2DP (He, Wang, Zhang, IROS 2016) and c-M2DP (Perdomo 2019, chapter 3); the
/// defaults are those of the "robust" preset.
struct M2dpConfig {
  static constexpr const char* section = "m2dp";

  int azimuths = 8;
  int elevations = 8;
  int rings = 8;
  int sectors = 16;
  int color_bins = 16;
  CloudAxes axes = CloudAxes::principal;
  AxisSigns axis_signs = AxisSigns::mirror_pairs;
  OuterRadius outer_radius = OuterRadius::three_rms;
  Weighting weighting = Weighting::square_root;
  bool grey_world = true;
  bool drop_last_point = false;
  bool author_lab = false;

  template <class Config, class Visitor>
  static void visit(Config& config, Visitor&& visitor) {
    visitor("azimuths", config.azimuths,
            OptionInfo{"azimuth angles of the projection planes (p)", "", 1, 64});
    visitor("elevations", config.elevations,
            OptionInfo{"elevation angles of the projection planes (q)", "", 1, 64});
    visitor("rings", config.rings, OptionInfo{"concentric circles on a plane (l)", "", 1, 64});
    visitor("sectors", config.sectors, OptionInfo{"sectors of a circle (t)", "", 1, 64});
    visitor("color_bins", config.color_bins,
            OptionInfo{"histogram bins of a colour channel (g)", "", 1, 64});
    visitor("axes", config.axes,
            OptionInfo{"principal axes, or z as it is and x towards the densest azimuth, whose "
                       "signs are not open: pairs of mirrored bins are then not sorted"});
    visitor("axis_signs", config.axis_signs,
            OptionInfo{"rule for the signs of the PCA axes; mirror_pairs needs azimuths in fours "
                       "and an even number of sectors"});
    visitor("outer_radius", config.outer_radius, OptionInfo{"radius of the outermost ring"});
    visitor("weighting", config.weighting, OptionInfo{"what the singular vectors are taken of"});
    visitor("grey_world", config.grey_world,
            OptionInfo{"scale each colour channel to one mean, against exposure and tint"});
    visitor("drop_last_point", config.drop_last_point,
            OptionInfo{"leave the last point out of the counts, as the c-M2DP author's program"});
    visitor("author_lab", config.author_lab,
            OptionInfo{"convert sRGB to Lab as the c-M2DP author's program, fault included"});
  }

  int planes() const { return azimuths * elevations; }
  int shape_columns() const { return rings * sectors; }
  int color_columns() const { return rings * 3 * color_bins; }
};

/// "paper": He's MATLAB program. "author": Perdomo's C++ program, quirks included.
/// "robust", the default: turned, shifted and mirrored clouds get the same descriptor, small
/// changes of a cloud or of the exposure change it little. "upright": the same about axes of which
/// z is that of the cloud, which has to point up, and x points towards the densest azimuth, so that
/// clouds turned about z get the same descriptor and mirrored ones another. Throws ConfigError for
/// any other name.
M2dpConfig m2dp_preset(std::string_view name);

/// A signature matrix, row-major: one row a projection plane, values are counts / n.
struct Signature {
  int rows = 0;
  int columns = 0;
  std::vector<double> values;
};

/// Signature matrix A of M2DP (64 x 128 with the default sizes); every preset's entries sum to the
/// number of rows.
/// Throws DataError for fewer than 4 points, NaN or infinity, and equal or collinear points.
Signature m2dp_signature(PointsView points, const M2dpConfig& config = {}, int threads = 1);

/// Signature matrix of c-M2DP: the shape columns, then rings x color_bins for each channel (64 x
/// 512). Throws as m2dp_signature, and ShapeError if there is not one colour a point.
Signature cm2dp_signature(PointsView points, ColorsView colors,
                          ColorSpace color_space = ColorSpace::rgb, const M2dpConfig& config = {},
                          int threads = 1);

/// M2DP: first left (64) and right (128) singular vectors of the signature matrix, both >= 0.
std::vector<float> m2dp(PointsView points, const M2dpConfig& config = {}, int threads = 1);

/// c-M2DP: the same of the coloured signature matrix (64 + 512 floats).
std::vector<float> cm2dp(PointsView points, ColorsView colors,
                         ColorSpace color_space = ColorSpace::rgb, const M2dpConfig& config = {},
                         int threads = 1);

/// Parameters of Scan Context (Kim, Kim, IROS 2018, section III).
struct ScanContextConfig {
  static constexpr const char* section = "scan_context";

  int rings = 20;
  double max_range = 80;
  double height = 2;

  template <class Config, class Visitor>
  static void visit(Config& config, Visitor&& visitor) {
    visitor("rings", config.rings, OptionInfo{"rings about the sensor", "", 1, 1000});
    visitor("max_range", config.max_range,
            OptionInfo{"radius of the outermost ring; points beyond are left out", "m", 1e-3, 1e6});
    visitor(
        "height", config.height,
        OptionInfo{"height of the cloud's origin above the ground, added to every point; points "
                   "below the ground count as on it",
                   "m", -1e6, 1e6});
  }
};

/// Scan Context of a cloud whose z axis points up: for each of 60 sectors of azimuth, from x
/// towards y, and of its rings the height of the highest point above the ground, 0 where there is
/// none (sector after sector, 60 x 20 floats with the default rings). DescriptorIndex compares them
/// with Metric::scan_context. Throws DataError for NaN or infinity and for a cloud without a point
/// above the ground within `max_range`.
std::vector<float> scan_context(PointsView points, const ScanContextConfig& config = {});

/// Scan Context of a coloured cloud: of each sector the heights of its rings, divided by the root
/// mean square of all filled bins, then the mean CIELab a of the points above the ground in each
/// ring, then b (60 x 3 x 20 floats with the default rings). Colours are scaled to a grey world; a
/// and b are multiplied by 2 / (chroma + 5), so that hue counts more than saturation and colours
/// about as much as heights. Compared as scan_context; throws as it does, and ShapeError if there
/// is not one colour a point.
std::vector<float> cscan_context(PointsView points, ColorsView colors,
                                 const ScanContextConfig& config = {});

/// Parameters of bev_spectrum().
struct BevSpectrumConfig {
  static constexpr const char* section = "bev_spectrum";

  double cell = 2;
  double height = 2;

  template <class Config, class Visitor>
  static void visit(Config& config, Visitor&& visitor) {
    visitor(
        "cell", config.cell,
        OptionInfo{"side of the image's cells; points farther than 27.5 cells are left out, and "
                   "layers are limited by heights in cells",
                   "m", 1e-3, 1e6});
    visitor("height", config.height,
            OptionInfo{"height of the cloud's origin above the ground", "m", -1e6, 1e6});
  }
};

/// Amplitude spectrum of a cloud seen from above, which a move of the sensor changes little, over
/// direction, which a turn about z shifts (after Reddy and Chatterji 1996). What rises above the
/// ground is drawn in three layers by height; of each image, blurred, log(1 + amplitude) at 24
/// frequencies in each of 60 directions of half a turn, less the frequency's mean, each direction
/// scaled to length 1 (direction after direction, 60 x 72 floats). DescriptorIndex compares them
/// with Metric::scan_context: one of its steps is then 3 degrees, and turns that differ by half a
/// turn are not told apart. Throws DataError for NaN or infinity and for a cloud without a point
/// above the ground within range.
std::vector<float> bev_spectrum(PointsView points, const BevSpectrumConfig& config = {});

/// The parameters of bev_spectrum() that suit a cloud like this one, z up: cells so wide that 99 %
/// of what it shows, seen from above, is within range, of 0.125 to 2 m in steps of the root of 2;
/// height by the lowest points of what it shows, of which a quarter is lower, and a tenth of a cell
/// more. Throws DataError for NaN or infinity and for an empty cloud.
BevSpectrumConfig fit_bev_spectrum(PointsView points);

/// First left (rows) and right (columns) singular vectors of a row-major matrix of entries >= 0,
/// both of length 1 and >= 0, as m2dp and cm2dp compute them of a signature. Iterates until
/// convergence; if the two largest singular values are close, uses eigenvectors of A A^T in double.
/// Throws ShapeError for another number of values, DataError for negative, infinite or NaN
/// entries and a matrix of zeros.
std::vector<float> first_singular_vectors(std::span<const float> matrix, int rows, int columns);

/// Mean distance from a point to its nearest neighbour, in metres.
/// Throws DataError for fewer than 2 points, NaN, infinity and coordinates beyond 1e15.
double cloud_resolution(PointsView points);

/// Unit normals, turned towards the origin, of the points that have enough neighbours.
struct Normals {
  std::vector<float> normals;         ///< x, y, z
  std::vector<float> curvatures;      ///< smallest eigenvalue over the sum of all three
  std::vector<std::int64_t> indices;  ///< of the points they belong to
};

/// Least-squares normals over all neighbours within `radius` metres, to the last bit those of PCL;
/// points with fewer than three neighbours are left out. The result does not depend on `threads`.
/// Throws as cloud_resolution, and DataError for fewer than 3 points.
Normals estimate_normals(PointsView points, double radius, int threads = 1);

/// Global SHOT (352 floats): SHOT as in PCL at the centroid with the whole cloud as support
/// (Tombari, Salti, Di Stefano 2010; Perdomo 2019, 4.1). `normal_radius` in metres; without it
/// 5 x cloud_resolution(points). Throws DataError if the cloud has no normals or no local frame.
std::vector<float> shot(PointsView points, std::optional<double> normal_radius = std::nullopt,
                        int threads = 1);

/// Global CSHOT (1344 floats): the same with colour (Tombari, Salti, Di Stefano 2011).
std::vector<float> cshot(PointsView points, ColorsView colors,
                         std::optional<double> normal_radius = std::nullopt, int threads = 1);

/// SHOT, or with colours CSHOT, of points whose unit normals are known, one each; without colours
/// `colors` is empty. Throws ShapeError if the counts differ, otherwise as shot.
std::vector<float> shot_at_centroid(PointsView points, PointsView normals, ColorsView colors = {},
                                    int threads = 1);

}  // namespace fusionslam

// Descriptors with a header of their own.
#include "fusionslam/descriptors/cospair.hpp"
#include "fusionslam/descriptors/cvfh.hpp"
#include "fusionslam/descriptors/esf.hpp"
#include "fusionslam/descriptors/gasd_color.hpp"
#include "fusionslam/descriptors/gestalt.hpp"
#include "fusionslam/descriptors/gfh.hpp"
#include "fusionslam/descriptors/intensity_scan_context.hpp"
#include "fusionslam/descriptors/iris.hpp"
#include "fusionslam/descriptors/ndt_histogram.hpp"
#include "fusionslam/descriptors/our_cvfh.hpp"
#include "fusionslam/descriptors/ring.hpp"
#include "fusionslam/descriptors/scan_context_plus.hpp"
#include "fusionslam/descriptors/solid.hpp"
#include "fusionslam/descriptors/vfh.hpp"
