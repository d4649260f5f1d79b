// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The bytes: magic, version, sections (kind, length, content), checksum. Readers pass over sections
// they do not know. The objects are whole multiples of a step, column by column, each column in as
// many bits as its greatest value needs.
#include <algorithm>
#include <bit>
#include <cmath>
#include <sstream>
#include <string>

#include "bit_stream.hpp"
#include "fusionslam/errors.hpp"
#include "fusionslam/views/scene.hpp"
#include "range_image_bytes.hpp"

namespace fusionslam {
namespace {

using namespace detail;

constexpr std::uint8_t magic = 0x5c;
constexpr std::uint8_t version = 1;
constexpr std::uint64_t objects_section = 1;
constexpr std::uint64_t image_section = 2;
constexpr std::size_t checksum_size = 2;
constexpr int width_bits = 6;
constexpr std::uint64_t most_objects = 1'000'000;  // in bytes they can be a thousand times smaller
constexpr double greatest_value = 9007199254740992.0;  // 2^53: whole numbers are exact up to here

/// CRC-16/CCITT: finds damage, is not meant against forgery.
std::uint16_t checksum(std::span<const std::uint8_t> bytes) {
  unsigned value = 0xffff;
  for (const std::uint8_t byte : bytes) {
    value ^= static_cast<unsigned>(byte) << 8;
    for (int bit = 0; bit < 8; ++bit) value = (value & 0x8000) ? (value << 1) ^ 0x1021 : value << 1;
  }
  return static_cast<std::uint16_t>(value);
}

/// Numbers of an object that share a step and a width.
struct Column {
  const char* name;
  double step;
  bool is_signed;
  std::span<double> (*values)(SceneObject&);
};

const Column columns[] = {
    {"center", 1e-4, true, [](SceneObject& o) { return std::span<double>(o.center); }},
    {"volume", 2e-5, false, [](SceneObject& o) { return std::span<double>(&o.volume, 1); }},
    {"area", 2e-4, false, [](SceneObject& o) { return std::span<double>(&o.area, 1); }},
    {"color", 1.0 / 1024, false, [](SceneObject& o) { return std::span<double>(o.color); }},
    {"extents", 1e-4, false, [](SceneObject& o) { return std::span<double>(o.extents); }},
};

std::uint64_t steps_of(const Column& column, double value) {
  const double steps = std::round(value / column.step);
  if (!(std::fabs(steps) <= greatest_value) || (steps < 0 && !column.is_signed)) {
    std::ostringstream message;
    message << "a scene whose " << column.name << " is " << value << " cannot be stored";
    throw DataError(message.str());
  }
  const auto whole = static_cast<std::int64_t>(steps);
  if (!column.is_signed) return static_cast<std::uint64_t>(whole);
  return fold(whole);
}

double value_of(const Column& column, std::uint64_t steps) {
  if (!column.is_signed) return static_cast<double>(steps) * column.step;
  return static_cast<double>(unfold(steps)) * column.step;
}

void write_column(BitWriter& writer, const std::vector<std::uint64_t>& values) {
  const std::uint64_t greatest = *std::max_element(values.begin(), values.end());
  const int width = std::bit_width(greatest);
  writer.write(static_cast<std::uint64_t>(width), width_bits);
  for (const std::uint64_t value : values) writer.write(value, width);
}

Bytes objects_to_bytes(std::vector<SceneObject> objects) {
  Bytes bytes;
  if (objects.size() > most_objects)
    throw DataError("a scene of " + std::to_string(objects.size()) +
                    " objects cannot be stored, expected at most " + std::to_string(most_objects));
  append_varint(bytes, objects.size());
  if (objects.empty()) return bytes;
  BitWriter writer(bytes);
  std::vector<std::uint64_t> values;
  for (const SceneObject& object : objects)
    values.push_back(static_cast<std::uint64_t>(object.points));
  write_column(writer, values);
  for (const Column& column : columns) {
    values.clear();
    for (SceneObject& object : objects)
      for (const double value : column.values(object)) values.push_back(steps_of(column, value));
    write_column(writer, values);
  }
  return bytes;
}

int read_width(BitReader& reader) {
  const auto width = static_cast<int>(reader.read(width_bits));
  if (width > 55) refuse_bytes("damaged width");
  return width;
}

std::vector<SceneObject> objects_from_bytes(std::span<const std::uint8_t> bytes) {
  const std::uint64_t count = take_varint(bytes);
  if (count > 8 * bytes.size() || count > most_objects)
    refuse_bytes("too short for its objects, or too many of them");
  std::vector<SceneObject> objects(count);
  if (count == 0) return objects;
  BitReader reader(bytes);
  const int points_width = read_width(reader);
  for (SceneObject& object : objects) {
    object.points = static_cast<std::int64_t>(reader.read(points_width));
    if (object.points < 1) refuse_bytes("an object without points");
  }
  for (const Column& column : columns) {
    const int width = read_width(reader);
    for (SceneObject& object : objects)
      for (double& value : column.values(object)) value = value_of(column, reader.read(width));
  }
  if (reader.bytes_used() != bytes.size()) refuse_bytes("longer than its objects");
  for (SceneObject& object : objects) object.box_min = object.box_max = object.center;
  return objects;
}

std::span<const std::uint8_t> check_bytes(std::span<const std::uint8_t> bytes) {
  if (bytes.empty() || bytes[0] != magic) refuse_bytes("these are none");
  if (bytes.size() >= 2 && bytes[1] != version)
    refuse_bytes("version " + std::to_string(bytes[1]) + ", this program reads version " +
                 std::to_string(version));
  if (bytes.size() < 2 + checksum_size) refuse_bytes("cut off");
  const auto content = bytes.first(bytes.size() - checksum_size);
  const std::uint16_t sum = checksum(content);
  const auto stored = bytes.last(checksum_size);
  if (stored[0] != (sum & 0xff) || stored[1] != sum >> 8)
    refuse_bytes("damaged or cut off: the checksum does not fit");
  return content.subspan(2);
}

void append_section(Bytes& bytes, std::uint64_t kind, const Bytes& content) {
  append_varint(bytes, kind);
  append_varint(bytes, content.size());
  bytes.insert(bytes.end(), content.begin(), content.end());
}

}  // namespace

Bytes scene_to_bytes(const Scene& scene, bool with_image) {
  Bytes bytes{magic, version};
  append_section(bytes, objects_section, objects_to_bytes(scene.objects));
  if (with_image && !scene.image.cells.empty())
    append_section(bytes, image_section, image_to_bytes(scene.image));
  const std::uint16_t sum = checksum(bytes);
  bytes.push_back(static_cast<std::uint8_t>(sum & 0xff));
  bytes.push_back(static_cast<std::uint8_t>(sum >> 8));
  return bytes;
}

Scene scene_from_bytes(std::span<const std::uint8_t> bytes) {
  std::span<const std::uint8_t> rest = check_bytes(bytes);
  Scene scene;
  while (!rest.empty()) {
    const std::uint64_t kind = take_varint(rest);
    const std::uint64_t size = take_varint(rest);
    if (size > rest.size()) refuse_bytes("cut off");
    if (kind == objects_section) scene.objects = objects_from_bytes(rest.first(size));
    if (kind == image_section) scene.image = image_from_bytes(rest.first(size));
    rest = rest.subspan(size);
  }
  return scene;
}

}  // namespace fusionslam
