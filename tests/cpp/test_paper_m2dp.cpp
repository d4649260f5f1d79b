// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Our `paper` preset against the publications word by word (benchmarks/peers/paper_m2dp.hpp): the
// two may only disagree about points on the edge between two bins.
#include <doctest/doctest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "clouds.hpp"
#include "fusionslam/descriptors.hpp"
#include "paper_m2dp.hpp"

namespace fusionslam {
namespace {

using testing::Cloud;
using VoteTable = Eigen::Matrix<long, Eigen::Dynamic, Eigen::Dynamic>;

constexpr double on_edge = 1e-5;  // in widths of a bin

paper::Points paper_points(const Cloud& cloud) {
  return Eigen::Map<const Eigen::Matrix3Xf>(cloud.points.data(), 3,
                                            static_cast<Eigen::Index>(cloud.points.size() / 3))
      .cast<double>();
}

paper::Colors paper_colors(const Cloud& cloud) {
  return Eigen::Map<const paper::Colors>(cloud.colors.data(), 3,
                                         static_cast<Eigen::Index>(cloud.colors.size() / 3));
}

VoteTable votes(const Eigen::MatrixXd& signature, std::size_t size) {
  return (signature * static_cast<double>(size)).array().round().cast<long>();
}

VoteTable votes(const Signature& signature, std::size_t size) {
  using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  return votes(Eigen::Map<const Rows>(signature.values.data(), signature.rows, signature.columns),
               size);
}

/// For each plane and shape bin: how many points of the reference lie on an edge of that bin.
VoteTable edge_votes(const paper::AlignedCloud& cloud) {
  VoteTable table = VoteTable::Zero(paper::planes, paper::shape_columns);
  for (int plane = 0; plane < paper::planes; ++plane) {
    const paper::PlaneAxes axes = paper::plane_axes(plane);
    for (Eigen::Index i = 0; i < cloud.size(); ++i) {
      const paper::Place place = cloud.place(axes, i);
      if (place.edge_distance() <= on_edge)
        ++table(plane, place.ring_bin() * paper::sectors + place.sector_bin());
    }
  }
  return table;
}

void check_against_paper(const Cloud& cloud) {
  const std::size_t size = cloud.points.size() / 3;
  const paper::AlignedCloud aligned(paper_points(cloud));
  const VoteTable expected = votes(paper::cm2dp_signature(aligned, paper_colors(cloud)), size);
  const VoteTable ours = votes(cm2dp_signature(cloud.points_view(), cloud.colors_view(),
                                               ColorSpace::rgb, m2dp_preset("paper")),
                               size);
  REQUIRE(ours.sum() == expected.sum());
  const VoteTable moved = (expected - ours).cwiseMax(0);  // out of the bin that the paper says
  const double pairs = static_cast<double>(paper::planes) * static_cast<double>(size);
  const VoteTable moved_shape = moved.leftCols(paper::shape_columns);
  CHECK(static_cast<double>(moved_shape.sum()) <= pairs / 1e5);
  CHECK((edge_votes(aligned) - moved_shape).minCoeff() >= 0);
  // Only a point that changed its ring takes its three colours along.
  CHECK(moved.rightCols(paper::color_columns).sum() <= paper::channels * moved_shape.sum());

  CHECK(votes(m2dp_signature(cloud.points_view(), m2dp_preset("paper")), size) ==
        ours.leftCols(paper::shape_columns));
  CHECK(votes(paper::m2dp_signature(aligned), size) == expected.leftCols(paper::shape_columns));
}

TEST_CASE("the paper preset counts as the papers say, but for points on the edges of bins") {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    INFO("seed ", seed);
    check_against_paper(testing::random_cloud(20000, seed));
  }
}

TEST_CASE("the paper preset counts as the papers say for any number of points") {
  for (const std::size_t size : {4, 5, 15, 16, 17, 239, 240, 241, 1000}) {
    INFO(size, " points");
    check_against_paper(testing::random_cloud(size));
  }
}

/// A KITTI scan with its reflectance as a grey colour; empty where there are no test data.
Cloud kitti_scan() {
  const char* named = std::getenv("FUSIONSLAM_TEST_DATA");
  const std::filesystem::path data = named ? named : FUSIONSLAM_SHARED_DATA;
  std::ifstream file(data / "kitti/sequences/00/velodyne/000000.bin", std::ios::binary);
  Cloud cloud;
  for (float point[4]; file.read(reinterpret_cast<char*>(point), sizeof point);) {
    cloud.points.insert(cloud.points.end(), point, point + 3);
    cloud.colors.insert(cloud.colors.end(), 3, static_cast<std::uint8_t>(255 * point[3]));
  }
  return cloud;
}

TEST_CASE("the paper preset counts a KITTI scan as the papers say") {
  const Cloud cloud = kitti_scan();
  if (cloud.points.empty()) {
    MESSAGE("skipped: no test data, FUSIONSLAM_TEST_DATA can name them");
    return;
  }
  check_against_paper(cloud);
}

void check_descriptor(const std::vector<float>& ours, const Eigen::VectorXd& expected) {
  const std::vector<float> reference(expected.begin(), expected.end());
  CHECK(testing::distance(ours, reference) <= 1e-5);
}

TEST_CASE("the paper preset's vectors are the first ones of a Jacobi SVD") {
  const Cloud cloud = testing::random_cloud(20000);
  const paper::AlignedCloud aligned(paper_points(cloud));
  check_descriptor(m2dp(cloud.points_view(), m2dp_preset("paper")),
                   paper::descriptor(paper::m2dp_signature(aligned)));
  check_descriptor(
      cm2dp(cloud.points_view(), cloud.colors_view(), ColorSpace::rgb, m2dp_preset("paper")),
      paper::descriptor(paper::cm2dp_signature(aligned, paper_colors(cloud))));
}

TEST_CASE("the distance from an edge is counted in widths of a bin") {
  CHECK(paper::Place{2.25, 3.5}.edge_distance() == doctest::Approx(0.25));
  CHECK(paper::Place{2.5, 3.9}.edge_distance() == doctest::Approx(0.1));
  CHECK(paper::Place{0.01, 3.5}.edge_distance() == doctest::Approx(0.5));
  CHECK(paper::Place{7.99, 3.4}.edge_distance() == doctest::Approx(0.4));
  CHECK(paper::Place{2.5, 15.95}.edge_distance() == doctest::Approx(0.05));
  CHECK(paper::Place{8, 16}.ring_bin() == 7);
  CHECK(paper::Place{8, 16}.sector_bin() == 15);
}

}  // namespace
}  // namespace fusionslam
