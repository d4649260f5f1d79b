// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "range_image_bytes.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

namespace fusionslam::detail {
namespace {

// Orders of the Golomb codes that suit the differences between neighbours.
constexpr int range_order = 3;
constexpr int color_order = 1;
constexpr int run_order = 2;
// A cell's range and its three colours take at least one bit more than their orders each.
constexpr std::size_t least_cell_bits = range_order + 1 + 3 * (color_order + 1);

/// The cells' box.
struct Box {
  int first_row = 0, first_column = 0, rows = 0, columns = 0;
};

Box box_of(const std::vector<RangeImage::Cell>& cells) {
  const auto columns = std::minmax_element(
      cells.begin(), cells.end(), [](const auto& a, const auto& b) { return a.column < b.column; });
  const int first = columns.first->column, first_row = cells.front().row;
  return {first_row, first, cells.back().row - first_row + 1, columns.second->column - first + 1};
}

/// Lengths of alternating runs of empty and filled cells, row by row.
void write_runs(BitWriter& writer, const RangeImage& image, const Box& box) {
  auto next = image.cells.begin();
  bool filled = false;
  std::uint64_t run = 0;
  for (int i = 0; i < box.rows * box.columns; ++i) {
    const bool here = next != image.cells.end() && next->row == box.first_row + i / box.columns &&
                      next->column == box.first_column + i % box.columns;
    if (here != filled) {
      writer.write_small(run, run_order);
      filled = here;
      run = 0;
    }
    ++run;
    if (here) ++next;
  }
  writer.write_small(run, run_order);
}

std::vector<RangeImage::Cell> read_runs(BitReader& reader, const Box& box) {
  std::vector<RangeImage::Cell> cells;
  const auto total = static_cast<std::uint64_t>(box.rows) * static_cast<std::uint64_t>(box.columns);
  bool filled = false;
  for (std::uint64_t at = 0; at < total; filled = !filled) {
    const std::uint64_t run = reader.read_small(run_order);
    if (run > total - at) refuse_bytes("more cells than the range image has");
    if (filled && cells.size() + run > reader.bits_left() / least_cell_bits)
      refuse_bytes("too short for its cells");
    for (std::uint64_t i = at; filled && i < at + run; ++i) {
      const auto width = static_cast<std::uint64_t>(box.columns);
      cells.push_back({static_cast<std::int16_t>(box.first_column + static_cast<int>(i % width)),
                       static_cast<std::int16_t>(box.first_row + static_cast<int>(i / width)),
                       0,
                       {}});
    }
    at += run;
  }
  return cells;
}

void write_values(BitWriter& writer, const std::vector<RangeImage::Cell>& cells) {
  RangeImage::Cell before;
  for (const RangeImage::Cell& cell : cells) {
    writer.write_small(fold(std::int64_t{cell.range} - before.range), range_order);
    for (std::size_t i = 0; i < 3; ++i)
      writer.write_small(
          fold((std::int64_t{cell.color[i]} - before.color[i]) / RangeImage::color_step),
          color_order);
    before = cell;
  }
}

void read_values(BitReader& reader, std::vector<RangeImage::Cell>& cells) {
  std::int64_t range = 0;
  std::array<std::int64_t, 3> color{};
  for (RangeImage::Cell& cell : cells) {
    range += unfold(reader.read_small(range_order));
    if (range < 0 || range > std::numeric_limits<std::uint16_t>::max())
      refuse_bytes("a range out of range");
    cell.range = static_cast<std::uint16_t>(range);
    for (std::size_t i = 0; i < 3; ++i) {
      color[i] += unfold(reader.read_small(color_order)) * RangeImage::color_step;
      if (color[i] < 0 || color[i] > 255) refuse_bytes("a colour out of range");
      cell.color[i] = static_cast<std::uint8_t>(color[i]);
    }
  }
}

float read_float(BitReader& reader) {
  const auto value = std::bit_cast<float>(static_cast<std::uint32_t>(reader.read(32)));
  if (!std::isfinite(value)) refuse_bytes("a value that is not finite");
  return value;
}

void check_box(const Box& box, const RangeImage& image) {
  // Rows and columns are degrees apart: more than these would go round more than twice.
  const auto fits = [](int count, float step) {
    return count > 0 && static_cast<float>(count) <= 720 / step + 2;
  };
  if (!image.has_possible_steps() || !fits(box.rows, image.elevation_step) ||
      !fits(box.columns, image.azimuth_step) || std::abs(box.first_row) > 10000 ||
      std::abs(box.first_column) > 10000)
    refuse_bytes("a range image of impossible size");
}

}  // namespace

Bytes image_to_bytes(const RangeImage& image) {
  Bytes bytes;
  BitWriter writer(bytes);
  for (const float value : {image.azimuth_step, image.elevation_step, image.sensor[0],
                            image.sensor[1], image.sensor[2]})
    writer.write(std::bit_cast<std::uint32_t>(value), 32);
  const Box box = box_of(image.cells);
  writer.write_small(fold(box.first_row), 4);
  writer.write_small(fold(box.first_column), 6);
  writer.write_small(static_cast<std::uint64_t>(box.rows), 4);
  writer.write_small(static_cast<std::uint64_t>(box.columns), 6);
  write_runs(writer, image, box);
  write_values(writer, image.cells);
  return bytes;
}

RangeImage image_from_bytes(std::span<const std::uint8_t> bytes) {
  BitReader reader(bytes);
  RangeImage image;
  image.azimuth_step = read_float(reader);
  image.elevation_step = read_float(reader);
  for (float& value : image.sensor) value = read_float(reader);
  Box box;
  box.first_row = static_cast<int>(unfold(reader.read_small(4)));
  box.first_column = static_cast<int>(unfold(reader.read_small(6)));
  box.rows = static_cast<int>(reader.read_small(4));
  box.columns = static_cast<int>(reader.read_small(6));
  check_box(box, image);
  image.cells = read_runs(reader, box);
  read_values(reader, image.cells);
  if (reader.bytes_used() != bytes.size()) refuse_bytes("longer than its range image");
  check_range_image(image);
  return image;
}

}  // namespace fusionslam::detail
