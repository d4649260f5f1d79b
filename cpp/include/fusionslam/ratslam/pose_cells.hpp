// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The sheet of pose cells of RatSLAM: a packet of activity that says where the robot is (Milford &
// Wyeth 2004; Ball et al. 2013).
#pragma once

#include <span>
#include <vector>

namespace fusionslam {

/// A pose on the sheet in cells: x and y of 0 to its size, th of 0 to PoseSheet::headings.
struct SheetPlace {
  double x, y, th;
};

/// Cells P[th, y, x], all three axes wrapped: headings ten degrees apart, size by size places.
/// They are not negative. Every instruction set gives the same bits.
/// Threads may share it through const members while none changes it.
class PoseSheet {
 public:
  static constexpr int headings = 36;

  /// All activity in the middle cell. Throws ConfigError for a size under 7, where the box that is
  /// decoded would overlap itself, or over 1000.
  explicit PoseSheet(int size);

  int size() const { return size_; }
  /// By th, y, x.
  std::span<const double> activity() const { return cells_; }
  /// Takes over stored activity. Throws ShapeError for another number of cells, DataError for
  /// values that are not finite or negative, or a sum that is 0 or not finite. The sheet is then
  /// unchanged.
  void assign(std::span<const double> activity);

  /// One step of the attractor: P = P * E; P = P - P * I; P = max(P - global_inhibition, 0), scaled
  /// to the sum 1. E and I are wrapped Gaussians of the sum 1, 7 and 5 wide, of deviations 1 and 2.
  /// Throws ConfigError, and leaves the sheet as it is, if no activity is left, or no finite one.
  void settle(double global_inhibition);

  /// Moves each layer by its own way, in cells of any length, bilinearly, then all of them by
  /// `layers` along th, linearly. `x` and `y` hold one number a layer. Throws ShapeError for
  /// another number of ways, DataError if one is not finite; the sheet is then unchanged.
  void move(std::span<const double> x, std::span<const double> y, double layers);

  /// Adds energy at a place: to the eight cells round it, so that it is their mean. The place
  /// may lie outside of the sheet, where it wraps. Throws DataError for numbers that are not finite
  /// or negative energy; the sheet is then unchanged.
  void inject(const SheetPlace& place, double energy);

  /// The place of the packet: the circular means of the cells around the largest one, three to each
  /// side. Of equally large ones the first counts.
  SheetPlace decode() const;

 private:
  std::size_t layer_size() const;

  int size_;
  std::vector<double> cells_, next_, blurred_, layers_, padded_;
};

}  // namespace fusionslam
