// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The one file that names Qhull.
#include "solid_hull.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <memory>
#include <new>
#include <string>
#include <utility>

#include "fusionslam/errors.hpp"

extern "C" {
#include <libqhull_r/libqhull_r.h>
}

namespace fusionslam::detail {
namespace {

/// Collects Qhull's error messages in memory.
class Complaints {
 public:
  Complaints() : file_(open_memstream(&text_, &size_)) {
    if (file_ == nullptr) throw DataError("no memory for the messages of Qhull");
  }
  Complaints(const Complaints&) = delete;
  Complaints& operator=(const Complaints&) = delete;
  ~Complaints() {
    std::fclose(file_);
    std::free(text_);
  }
  std::FILE* file() { return file_; }
  std::string first_line() {
    std::fflush(file_);
    const std::string text(text_, size_);
    return text.substr(0, text.find('\n'));
  }

 private:
  char* text_ = nullptr;
  std::size_t size_ = 0;
  std::FILE* file_;
};

/// A run of Qhull and its memory.
class QhullRun {
 public:
  explicit QhullRun(Eigen::Matrix3Xd& points) : qhull_(std::make_unique<qhT>()) {
    char options[] = "qhull Qt";  // Qt: every facet a triangle
    qh_zero(qhull_.get(), complaints_.file());
    exit_code_ = qh_new_qhull(qhull_.get(), 3, static_cast<int>(points.cols()), points.data(),
                              False, options, nullptr, complaints_.file());
  }
  QhullRun(const QhullRun&) = delete;
  QhullRun& operator=(const QhullRun&) = delete;
  ~QhullRun() {
    int pieces, bytes;
    qh_freeqhull(qhull_.get(), !qh_ALL);
    qh_memfreeshort(qhull_.get(), &pieces, &bytes);
  }
  int exit_code() const { return exit_code_; }
  std::string complaint() { return complaints_.first_line(); }

  /// Calls visit(a, b, c) with the corners of each triangle, counter-clockwise from outside.
  template <class Visit>
  void for_triangles(Visit&& visit) const {
    const facetT* facet;
    const qhT* qh = qhull_.get();
    FORALLfacets {
      const setT* corners = facet->vertices;
      const auto corner = [&](int i) {
        return Eigen::Vector3d(static_cast<const vertexT*>(corners->e[i].p)->point);
      };
      // Qhull's vertices of a facet are in the order of their making; toporient says the turn.
      if (facet->toporient)
        visit(corner(0), corner(1), corner(2));
      else
        visit(corner(0), corner(2), corner(1));
    }
  }

 private:
  Complaints complaints_;
  std::unique_ptr<qhT> qhull_;
  int exit_code_ = 0;
};

/// Sums over the tetrahedra between the triangles and `inside`, a point of the hull.
Hull measure(const QhullRun& run, const Eigen::Vector3d& inside) {
  Hull hull;
  Eigen::Vector3d moment = Eigen::Vector3d::Zero();
  run.for_triangles(
      [&](const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
        const Eigen::Vector3d normal = (b - a).cross(c - a);
        const double volume = std::fabs(normal.dot(a - inside)) / 6;
        hull.area += normal.norm() / 2;
        hull.volume += volume;
        moment += volume * (a + b + c + inside) / 4;
      });
  Eigen::Vector3d::Map(hull.centroid.data()) = hull.volume > 0 ? moment / hull.volume : inside;
  return hull;
}

}  // namespace

std::optional<Hull> solid_hull(Eigen::Matrix3Xd& points) {
  if (points.cols() > std::numeric_limits<int>::max())
    throw DataError("the cloud has " + std::to_string(points.cols()) +
                    " points, a convex hull takes at most 2^31 - 1");
  QhullRun run(points);
  if (run.exit_code() == qh_ERRsingular || run.exit_code() == qh_ERRprec) return std::nullopt;
  if (run.exit_code() == qh_ERRmem) throw std::bad_alloc();
  if (run.exit_code() != qh_ERRnone) throw DataError("convex hull: " + run.complaint());
  return measure(run, points.rowwise().mean());
}

}  // namespace fusionslam::detail
