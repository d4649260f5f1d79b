// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The Python module fusionslam_peers: what benchmarks/speed compares fusionslam with.
#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <Eigen/SVD>
#include <array>
#include <optional>
#include <stdexcept>
#include <string>

#include "opencv_peers.hpp"
#include "paper_m2dp.hpp"
#include "pcl_peers.hpp"

namespace py = pybind11;
using namespace py::literals;

namespace {

// noconvert() everywhere: a benchmark that copies its input unnoticed measures the copy.
using Floats = py::array_t<float, py::array::c_style>;
using Bytes = py::array_t<std::uint8_t, py::array::c_style>;
using Doubles = py::array_t<double, py::array::c_style>;
using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

void expect(bool fine, const char* message) {
  if (!fine) throw std::invalid_argument(message);
}

std::size_t rows_of_three(const py::array& array) {
  expect(array.ndim() == 2 && array.shape(1) == 3, "expected three columns");
  return static_cast<std::size_t>(array.shape(0));
}

template <class Value>
py::array_t<Value> to_numpy(const std::vector<Value>& values) {
  return py::array_t<Value>(static_cast<py::ssize_t>(values.size()), values.data());
}

template <class Value>
py::array_t<Value> in_threes(const std::vector<Value>& values) {
  return to_numpy(values).reshape({static_cast<py::ssize_t>(values.size() / 3), py::ssize_t{3}});
}

paper::AlignedCloud aligned(const Floats& points) {
  const auto size = static_cast<Eigen::Index>(rows_of_three(points));
  return paper::AlignedCloud(
      Eigen::Map<const Eigen::Matrix3Xf>(points.data(), 3, size).cast<double>());
}

paper::Colors colors_of(const Bytes& colors) {
  const auto size = static_cast<Eigen::Index>(rows_of_three(colors));
  return Eigen::Map<const paper::Colors>(colors.data(), 3, size);
}

void bind_paper(py::module_& module) {
  module.def(
      "paper_m2dp_signature",
      [](const Floats& points) { return paper::m2dp_signature(aligned(points)); },
      "points"_a.noconvert());
  module.def(
      "paper_cm2dp_signature",
      [](const Floats& points, const Bytes& colors) {
        return paper::cm2dp_signature(aligned(points), colors_of(colors));
      },
      "points"_a.noconvert(), "colors"_a.noconvert());
  module.def(
      "paper_m2dp",
      [](const Floats& points) {
        return paper::descriptor(paper::m2dp_signature(aligned(points)));
      },
      "points"_a.noconvert());
  module.def(
      "paper_cm2dp",
      [](const Floats& points, const Bytes& colors) {
        return paper::descriptor(paper::cm2dp_signature(aligned(points), colors_of(colors)));
      },
      "points"_a.noconvert(), "colors"_a.noconvert());
}

template <class Svd>
py::tuple first_vectors(const Eigen::Ref<const Matrix>& matrix) {
  const Svd svd(matrix, Eigen::ComputeThinU | Eigen::ComputeThinV);
  return py::make_tuple(Eigen::VectorXd(svd.matrixU().col(0)),
                        Eigen::VectorXd(svd.matrixV().col(0)));
}

void bind_eigen(py::module_& module) {
  module.def("jacobi_svd", &first_vectors<Eigen::JacobiSVD<Eigen::MatrixXd>>,
             "matrix"_a.noconvert());
  module.def("bdc_svd", &first_vectors<Eigen::BDCSVD<Eigen::MatrixXd>>, "matrix"_a.noconvert());
}

void bind_pcl(py::module_& module) {
  py::class_<peers::PclCloud>(module, "PclCloud")
      .def(py::init([](const Floats& points, const std::optional<Bytes>& colors) {
             const std::size_t size = rows_of_three(points);
             expect(!colors || rows_of_three(*colors) == size, "expected one colour a point");
             return peers::PclCloud(points.data(), colors ? colors->data() : nullptr, size);
           }),
           "points"_a.noconvert(), "colors"_a.noconvert() = py::none());
  py::class_<peers::PclSurface>(module, "PclSurface")
      .def(py::init<const peers::PclCloud&, double, int>(), "cloud"_a, py::kw_only(), "radius"_a,
           "threads"_a = 1)
      .def("normals", [](const peers::PclSurface& self) { return in_threes(self.normals()); })
      .def("indices", [](const peers::PclSurface& self) { return to_numpy(self.indices()); });
  module.def("pcl_shot",
             [](const peers::PclSurface& surface) { return to_numpy(peers::pcl_shot(surface)); });
  module.def("pcl_cshot",
             [](const peers::PclSurface& surface) { return to_numpy(peers::pcl_cshot(surface)); });
}

using ProjectionArray = std::array<double, 12>;

std::size_t colorize(const peers::PclCloud& cloud, const Bytes& image, const Doubles& projection,
                     peers::ColoredPoints* result) {
  expect(image.ndim() == 3 && image.shape(2) == 3, "expected an image of three channels");
  expect(projection.ndim() == 2 && projection.shape(0) == 3 && projection.shape(1) == 4,
         "expected a 3x4 projection");
  ProjectionArray matrix{};
  std::copy_n(projection.data(), matrix.size(), matrix.begin());
  return peers::pcl_colorize(cloud, image.data(), static_cast<int>(image.shape(1)),
                             static_cast<int>(image.shape(0)), matrix, result);
}

void bind_colouring(py::module_& module) {
  module.def(
      "pcl_colorize",
      [](const peers::PclCloud& cloud, const Bytes& image, const Doubles& projection) {
        return colorize(cloud, image, projection, nullptr);
      },
      "cloud"_a, "image"_a.noconvert(), "projection"_a.noconvert(),
      "Number of points coloured; the coloured cloud stays in PCL's type and is dropped.");
  module.def(
      "pcl_colored_points",
      [](const peers::PclCloud& cloud, const Bytes& image, const Doubles& projection) {
        peers::ColoredPoints result;
        colorize(cloud, image, projection, &result);
        return py::make_tuple(in_threes(result.xyz), in_threes(result.rgb));
      },
      "cloud"_a, "image"_a.noconvert(), "projection"_a.noconvert());
}

void expect_pair(const Bytes& left, const Bytes& right) {
  expect(left.ndim() == 2 && right.ndim() == 2 && left.shape(0) == right.shape(0) &&
             left.shape(1) == right.shape(1),
         "expected two grey images of one size");
}

void bind_opencv(py::module_& module) {
  module.def("set_opencv_threads", &peers::set_opencv_threads);
  module.def(
      "opencv_nearest",
      [](const Floats& queries, const Floats& rows) {
        expect(queries.ndim() == 2 && rows.ndim() == 2 && queries.shape(1) == rows.shape(1),
               "expected two tables of one width");
        const auto found = peers::opencv_nearest(
            queries.data(), static_cast<std::size_t>(queries.shape(0)), rows.data(),
            static_cast<std::size_t>(rows.shape(0)), static_cast<std::size_t>(rows.shape(1)));
        return py::make_tuple(to_numpy(found.first), to_numpy(found.second));
      },
      "queries"_a.noconvert(), "rows"_a.noconvert());
  module.def(
      "opencv_disparity",
      [](const Bytes& left, const Bytes& right) {
        expect_pair(left, right);
        const auto found =
            peers::opencv_disparity(left.data(), right.data(), static_cast<int>(left.shape(1)),
                                    static_cast<int>(left.shape(0)));
        return to_numpy(found).reshape({left.shape(0), left.shape(1)});
      },
      "left"_a.noconvert(), "right"_a.noconvert());
  module.def(
      "opencv_stereo_cloud",
      [](const Bytes& left, const Bytes& right, double focal, double center_x, double center_y,
         double baseline, double min_range, double max_range) {
        expect_pair(left, right);
        const auto cloud =
            peers::opencv_stereo_cloud(left.data(), right.data(), static_cast<int>(left.shape(1)),
                                       static_cast<int>(left.shape(0)),
                                       {focal, center_x, center_y, baseline, min_range, max_range});
        return py::make_tuple(in_threes(cloud.first), to_numpy(cloud.second));
      },
      "left"_a.noconvert(), "right"_a.noconvert(), py::kw_only(), "focal"_a, "center_x"_a,
      "center_y"_a, "baseline"_a, "min_range"_a, "max_range"_a);
}

py::dict build() {
  py::dict facts;
  facts["pcl"] = peers::pcl_version();
  facts["opencv"] = peers::opencv_version();
  facts["eigen"] = std::to_string(EIGEN_WORLD_VERSION) + "." + std::to_string(EIGEN_MAJOR_VERSION) +
                   "." + std::to_string(EIGEN_MINOR_VERSION);
  facts["compiler"] = PEER_COMPILER;
  facts["peer_flags"] = PEER_FLAGS;
  facts["core_flags"] = CORE_FLAGS;
  return facts;
}

}  // namespace

PYBIND11_MODULE(fusionslam_peers, module) {
  module.doc() = "Other programs for what fusionslam does, for its benchmark.";
  module.def("build", &build, "Versions of the libraries, compiler and flags.");
  bind_paper(module);
  bind_eigen(module);
  bind_pcl(module);
  bind_colouring(module);
  bind_opencv(module);
}
