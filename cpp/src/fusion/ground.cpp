// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <pcl/sample_consensus/ransac.h>
#include <pcl/sample_consensus/sac_model_perpendicular_plane.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <numbers>
#include <optional>

#include "../detail/checks.hpp"
#include "../detail/interrupt.hpp"
#include "../detail/pcl.hpp"
#include "fusionslam/fusion.hpp"
#include "up_axis.hpp"

namespace fusionslam {
namespace {

Eigen::Vector3f direction(UpAxis up) {
  const detail::Axis axis = detail::axis_of(up);
  Eigen::Vector3f result = Eigen::Vector3f::Zero();
  result[static_cast<Eigen::Index>(axis.coordinate)] = static_cast<float>(axis.sign);
  return result;
}

using PlaneModel = pcl::SampleConsensusModelPerpendicularPlane<pcl::PointXYZ>;

/// Looks for an interrupt whenever a candidate plane is counted, which is where the time goes. No
/// exception may pass through PCL's search, so after an interrupt it only hurries to its end.
class InterruptiblePlane : public PlaneModel {
 public:
  using PlaneModel::PlaneModel;

  std::size_t countWithinDistance(const Eigen::VectorXf& plane, double threshold) const override {
    try {
      if (!interrupt_) detail::check_interrupt();
    } catch (...) {
      interrupt_ = std::current_exception();
    }
    return interrupt_ ? 0 : PlaneModel::countWithinDistance(plane, threshold);
  }
  void rethrow() const {
    if (interrupt_) std::rethrow_exception(interrupt_);
  }

 private:
  mutable std::exception_ptr interrupt_;
};

/// Coefficients of the plane with most points near it, fitted to these; nothing if there is none.
std::optional<Eigen::VectorXf> fit(const pcl::PointCloud<pcl::PointXYZ>::Ptr& cloud, UpAxis up,
                                   const GroundPlaneConfig& config) {
  const auto model = pcl::make_shared<InterruptiblePlane>(cloud, false);  // false: a fixed seed
  model->setAxis(direction(up));
  // PCL takes 0 for no limit at all, and its float angles are good to some 1e-4.
  model->setEpsAngle(std::max(config.max_tilt * std::numbers::pi / 180, 1e-3));
  pcl::RandomSampleConsensus<pcl::PointXYZ> search(model, config.distance);
  search.setMaxIterations(config.iterations);
  const detail::QuietPcl quiet;
  const bool found = search.computeModel();
  model->rethrow();
  if (!found) return std::nullopt;
  pcl::Indices inliers;
  Eigen::VectorXf coarse, fitted;
  search.getInliers(inliers);
  search.getModelCoefficients(coarse);
  model->optimizeModelCoefficients(inliers, coarse, fitted);
  if (!fitted.allFinite())
    throw DataError("the points lie too far apart for a ground plane in single precision");
  return fitted;
}

double signed_distance(const std::array<double, 4>& plane, const float* p) {
  return plane[0] * p[0] + plane[1] * p[1] + plane[2] * p[2] + plane[3];
}

}  // namespace

std::vector<std::int64_t> above_height(PointsView points, double height, UpAxis up) {
  if (!std::isfinite(height)) throw ConfigError("ground height is not finite");
  detail::check_points(points, 0, "ground removal");
  const detail::Axis axis = detail::axis_of(up);
  std::vector<std::int64_t> kept;
  for (std::size_t i = 0; i < points.size; ++i)
    if (axis.sign * points[i][axis.coordinate] > height)
      kept.push_back(static_cast<std::int64_t>(i));
  return kept;
}

GroundPlane remove_ground_plane(PointsView points, UpAxis up, const GroundPlaneConfig& config) {
  validate(config);
  detail::check_points(points, 3, "the ground plane");
  const auto fitted = fit(detail::pcl_cloud(points), up, config);
  GroundPlane ground;
  if (fitted) {
    const detail::Axis axis = detail::axis_of(up);
    const auto value = [&](std::size_t i) { return (*fitted)[static_cast<Eigen::Index>(i)]; };
    const double sign = axis.sign * value(axis.coordinate) < 0 ? -1 : 1;
    for (std::size_t i = 0; i < 4; ++i) ground.coefficients[i] = sign * value(i);
  }
  for (std::size_t i = 0; i < points.size; ++i)
    if (!fitted || std::fabs(signed_distance(ground.coefficients, points[i])) > config.distance)
      ground.kept.push_back(static_cast<std::int64_t>(i));
  return ground;
}

}  // namespace fusionslam
