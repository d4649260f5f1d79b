// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "row_chunks.hpp"

#include <new>

#if defined(__linux__)
#include <sys/mman.h>
#endif

namespace fusionslam::detail {
namespace {

constexpr std::size_t cache_line = 64;
constexpr std::size_t huge_page = std::size_t{1} << 21;

std::align_val_t alignment_of(std::size_t bytes) {
  return std::align_val_t{bytes >= huge_page ? huge_page : cache_line};
}

}  // namespace

void* allocate_lines(std::size_t bytes) {
  void* data = ::operator new(bytes, alignment_of(bytes));
#if defined(__linux__)
  if (bytes >= huge_page) ::madvise(data, bytes, MADV_HUGEPAGE);  // where refused: small pages
#endif
  return data;
}

void free_lines(void* data, std::size_t bytes) { ::operator delete(data, alignment_of(bytes)); }

}  // namespace fusionslam::detail
