// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "gicp_kernel.hpp"

#include <cmath>
#include <cstring>

#include "../detail/simd.hpp"
#include "../detail/vectors.hpp"

namespace fusionslam::detail {
namespace {

/// Variance across a surface where that along it is 1 (Segal et al., section III-B).
constexpr float flatness = 1e-3F;

template <class Vectors>
constexpr std::size_t lanes = sizeof(typename Vectors::Floats) / sizeof(float);

/// A few queries, as many as a vector has lanes.
template <class Vector>
struct Queries {
  Vector x, y, z;

  FUSIONSLAM_INLINE Queries(const PointBlock& block, std::size_t first) {
    std::memcpy(&x, block.x + first, sizeof x);
    std::memcpy(&y, block.y + first, sizeof y);
    std::memcpy(&z, block.z + first, sizeof z);
  }
};

template <class Vectors, std::size_t most>
FUSIONSLAM_INLINE void insert_smallest_of(const PointBlock& queries, const PointBlock& other,
                                          std::size_t count, float (*smallest)[block_size]) {
  using Vector = Vectors::Floats;
  for (std::size_t first = 0; first < block_size; first += lanes<Vectors>) {
    const Queries<Vector> q(queries, first);
    Vector known[most];
    for (std::size_t k = 0; k < count; ++k)
      std::memcpy(known + k, smallest[k] + first, sizeof(Vector));
    for (std::size_t j = 0; j < block_size; ++j) {
      const Vector x = q.x - other.x[j], y = q.y - other.y[j], z = q.z - other.z[j];
      Vector squared = x * x + y * y + z * z;
      for (std::size_t k = 0; k < count; ++k) {
        const Vector one = squared;
        squared = one < known[k] ? known[k] : one;
        known[k] = one < known[k] ? one : known[k];
      }
    }
    for (std::size_t k = 0; k < count; ++k)
      std::memcpy(smallest[k] + first, known + k, sizeof(Vector));
  }
}

/// Ten, the usual number, fit into the registers of every level.
template <class Vectors>
FUSIONSLAM_INLINE void insert_smallest(const PointBlock& queries, const PointBlock& other,
                                       std::size_t count, float (*smallest)[block_size]) {
  if (count == 10)
    insert_smallest_of<Vectors, 10>(queries, other, 10, smallest);
  else
    insert_smallest_of<Vectors, most_neighbors>(queries, other, count, smallest);
}

template <class Vectors>
FUSIONSLAM_INLINE void add_neighbors(const PointBlock& queries, const PointBlock& other,
                                     const float* limit, NeighborSums& sums) {
  using Vector = Vectors::Floats;
  for (std::size_t first = 0; first < block_size; first += lanes<Vectors>) {
    const Queries<Vector> q(queries, first);
    const Vector zero{};
    Vector near;
    std::memcpy(&near, limit + first, sizeof near);
    Vector s[10];
    for (std::size_t k = 0; k < 10; ++k) std::memcpy(s + k, sums.values[k] + first, sizeof(Vector));
    for (std::size_t j = 0; j < block_size; ++j) {
      Vector x = other.x[j] - q.x, y = other.y[j] - q.y, z = other.z[j] - q.z;
      const auto inside = x * x + y * y + z * z < near;  // not where a place is unused
      x = inside ? x : zero;
      y = inside ? y : zero;
      z = inside ? z : zero;
      s[0] += inside ? zero + 1 : zero;
      s[1] += x;
      s[2] += y;
      s[3] += z;
      s[4] += x * x;
      s[5] += x * y;
      s[6] += x * z;
      s[7] += y * y;
      s[8] += y * z;
      s[9] += z * z;
    }
    for (std::size_t k = 0; k < 10; ++k) std::memcpy(sums.values[k] + first, s + k, sizeof(Vector));
  }
}

template <class Vectors>
FUSIONSLAM_INLINE void lower_nearest(const PointBlock& queries, const PointBlock& other,
                                     std::uint32_t first_place, Nearest& nearest) {
  using Vector = Vectors::Floats;
  using Places = Vectors::Integers;
  for (std::size_t first = 0; first < block_size; first += lanes<Vectors>) {
    const Queries<Vector> q(queries, first);
    Vector least, second;
    Places places;
    std::memcpy(&least, nearest.squared + first, sizeof least);
    std::memcpy(&second, nearest.second + first, sizeof second);
    std::memcpy(&places, nearest.place + first, sizeof places);
    for (std::size_t j = 0; j < block_size; ++j) {
      const Vector x = q.x - other.x[j], y = q.y - other.y[j], z = q.z - other.z[j];
      const Vector squared = x * x + y * y + z * z;
      const Vector rest = squared < second ? squared : second;
      const auto nearer = squared < least;
      second = nearer ? least : rest;
      least = nearer ? squared : least;
      places = nearer ? Places{} + (static_cast<std::int32_t>(first_place + j)) : places;
    }
    std::memcpy(nearest.squared + first, &least, sizeof least);
    std::memcpy(nearest.second + first, &second, sizeof second);
    std::memcpy(nearest.place + first, &places, sizeof places);
  }
}

using Lanes = float[block_size];

/// One of Jacobi's rotations of symmetric 3 x 3 matrices, which makes the element `pq` zero; p and
/// q are the columns of the eigenvectors so far.
FUSIONSLAM_INLINE void rotate(Lanes& pp, Lanes& qq, Lanes& pq, Lanes& rp, Lanes& rq, Lanes* p,
                              Lanes* q) {
  for (std::size_t i = 0; i < block_size; ++i) {
    const bool done = pq[i] == 0;
    const float ratio = (qq[i] - pp[i]) / (2 * (done ? 1.0F : pq[i]));
    const float size = ratio < 0 ? -ratio : ratio;
    const float root = 1 / (size + std::sqrt(size * size + 1));
    const float tangent = done ? 0.0F : (ratio < 0 ? -root : root);
    const float c = 1 / std::sqrt(tangent * tangent + 1), s = tangent * c;
    pp[i] -= tangent * pq[i];
    qq[i] += tangent * pq[i];
    pq[i] = 0;
    const float one = rp[i], other = rq[i];
    rp[i] = c * one - s * other;
    rq[i] = s * one + c * other;
    for (std::size_t k = 0; k < 3; ++k) {
      const float of_p = p[k][i], of_q = q[k][i];
      p[k][i] = c * of_p - s * of_q;
      q[k][i] = s * of_p + c * of_q;
    }
  }
}

FUSIONSLAM_INLINE void find_normals(const NeighborSums& sums, PointBlock& normals) {
  const auto& v = sums.values;
  Lanes xx, xy, xz, yy, yz, zz;
  Lanes axes[3][3];  // columns of the eigenvectors
  for (std::size_t i = 0; i < block_size; ++i) {
    const float count = v[0][i] > 0 ? v[0][i] : 1.0F;  // none where a place is unused
    xx[i] = v[4][i] - v[1][i] * v[1][i] / count;
    xy[i] = v[5][i] - v[1][i] * v[2][i] / count;
    xz[i] = v[6][i] - v[1][i] * v[3][i] / count;
    yy[i] = v[7][i] - v[2][i] * v[2][i] / count;
    yz[i] = v[8][i] - v[2][i] * v[3][i] / count;
    zz[i] = v[9][i] - v[3][i] * v[3][i] / count;
    for (std::size_t column = 0; column < 3; ++column)
      for (std::size_t row = 0; row < 3; ++row) axes[column][row][i] = column == row ? 1.0F : 0.0F;
  }
  constexpr int sweeps = 5;  // they converge quadratically
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    rotate(xx, yy, xy, xz, yz, axes[0], axes[1]);
    rotate(xx, zz, xz, xy, yz, axes[0], axes[2]);
    rotate(yy, zz, yz, xy, xz, axes[1], axes[2]);
  }
  for (std::size_t i = 0; i < block_size; ++i) {
    const bool first = xx[i] < yy[i] && xx[i] < zz[i], second = yy[i] < zz[i];
    const auto flattest = [&](std::size_t row) {
      const float rest = second ? axes[1][row][i] : axes[2][row][i];
      return first ? axes[0][row][i] : rest;
    };
    normals.x[i] = flattest(0);
    normals.y[i] = flattest(1);
    normals.z[i] = flattest(2);
  }
}

FUSIONSLAM_INLINE bool move(const PointBlock& points, const Motion& motion,
                            const PointBlock& before, const float* limit, PointBlock& moved,
                            float* squared) {
  const float* r = motion.rotation;
  const float* t = motion.shift;
  int farther = 0;
  for (std::size_t i = 0; i < block_size; ++i) {
    const float x = points.x[i], y = points.y[i], z = points.z[i];
    moved.x[i] = r[0] * x + r[1] * y + r[2] * z + t[0];
    moved.y[i] = r[3] * x + r[4] * y + r[5] * z + t[1];
    moved.z[i] = r[6] * x + r[7] * y + r[8] * z + t[2];
    const float dx = moved.x[i] - before.x[i], dy = moved.y[i] - before.y[i];
    const float dz = moved.z[i] - before.z[i];
    squared[i] = dx * dx + dy * dy + dz * dz;
    farther |= squared[i] > limit[i];
  }
  return farther != 0;
}

/// Points of a source block with their errors and the normals there, all in the source's frame.
struct Errors {
  Lanes x, y, z;     ///< of the points
  Lanes ex, ey, ez;  ///< from the point to its target
  Lanes nx, ny, nz;  ///< normal at the target
  Lanes mx, my, mz;  ///< normal at the point
  Lanes weight;      ///< 0 without a target
};

FUSIONSLAM_INLINE void find_errors(const Pairing& pairing, const Motion& motion, std::size_t block,
                                   Errors& e) {
  const std::uint32_t* places = pairing.places + block * block_size;
  Lanes qx, qy, qz, nx, ny, nz;
  for (std::size_t i = 0; i < block_size; ++i) {
    const std::size_t place = places[i] == no_place ? 0 : places[i];
    const PointBlock& target = pairing.target[place / block_size];
    const PointBlock& normals = pairing.target_normals[place / block_size];
    qx[i] = target.x[place % block_size];
    qy[i] = target.y[place % block_size];
    qz[i] = target.z[place % block_size];
    nx[i] = normals.x[place % block_size];
    ny[i] = normals.y[place % block_size];
    nz[i] = normals.z[place % block_size];
  }
  const PointBlock& p = pairing.source[block];
  const float* r = motion.rotation;
  const float* t = motion.shift;
  for (std::size_t i = 0; i < block_size; ++i) {
    const bool has_target = places[i] != no_place;
    e.weight[i] = has_target ? 1.0F : 0.0F;
    e.x[i] = has_target ? p.x[i] : 0.0F;  // unused places hold NaN
    e.y[i] = has_target ? p.y[i] : 0.0F;
    e.z[i] = has_target ? p.z[i] : 0.0F;
    const float x = qx[i] - t[0], y = qy[i] - t[1], z = qz[i] - t[2];
    e.ex[i] = r[0] * x + r[3] * y + r[6] * z - e.x[i];
    e.ey[i] = r[1] * x + r[4] * y + r[7] * z - e.y[i];
    e.ez[i] = r[2] * x + r[5] * y + r[8] * z - e.z[i];
    e.nx[i] = r[0] * nx[i] + r[3] * ny[i] + r[6] * nz[i];
    e.ny[i] = r[1] * nx[i] + r[4] * ny[i] + r[7] * nz[i];
    e.nz[i] = r[2] * nx[i] + r[5] * ny[i] + r[8] * nz[i];
  }
  const PointBlock& m = pairing.source_normals[block];
  for (std::size_t i = 0; i < block_size; ++i) {
    e.mx[i] = m.x[i];
    e.my[i] = m.y[i];
    e.mz[i] = m.z[i];
  }
}

/// Information of each error, upper triangles: xx, xy, xz, yy, yz, zz.
///
/// The covariances of two planes with unit normals n and m sum up to 2 I - (1 - f)(n n' + m m'),
/// with f the flatness. By Woodbury's identity their inverse is
/// (I + (k (n n' + m m') + c (n m' + m n')) / (k^2 - c^2)) / 2, c = n'm and k = (1 + f) / (1 - f).
FUSIONSLAM_INLINE void weigh(const Errors& e, Lanes* w) {
  constexpr float k = (1 + flatness) / (1 - flatness);
  for (std::size_t i = 0; i < block_size; ++i) {
    const float nx = e.nx[i], ny = e.ny[i], nz = e.nz[i];
    const float mx = e.mx[i], my = e.my[i], mz = e.mz[i];
    const float c = nx * mx + ny * my + nz * mz, half = e.weight[i] / 2;
    const float scale = half / ((k - c) * (k + c)), a = scale * k, b = scale * c;
    w[0][i] = half + a * (nx * nx + mx * mx) + 2 * b * (nx * mx);
    w[1][i] = a * (nx * ny + mx * my) + b * (nx * my + mx * ny);
    w[2][i] = a * (nx * nz + mx * mz) + b * (nx * mz + mx * nz);
    w[3][i] = half + a * (ny * ny + my * my) + 2 * b * (ny * my);
    w[4][i] = a * (ny * nz + my * mz) + b * (ny * mz + my * nz);
    w[5][i] = half + a * (nz * nz + mz * mz) + 2 * b * (nz * mz);
  }
}

/// Weighed errors and half their squared lengths.
FUSIONSLAM_INLINE void apply(const Lanes* w, const Errors& e, Lanes& fx, Lanes& fy, Lanes& fz,
                             Lanes& half_square) {
  for (std::size_t i = 0; i < block_size; ++i) {
    fx[i] = w[0][i] * e.ex[i] + w[1][i] * e.ey[i] + w[2][i] * e.ez[i];
    fy[i] = w[1][i] * e.ex[i] + w[3][i] * e.ey[i] + w[4][i] * e.ez[i];
    fz[i] = w[2][i] * e.ex[i] + w[4][i] * e.ey[i] + w[5][i] * e.ez[i];
    half_square[i] = (fx[i] * e.ex[i] + fy[i] * e.ey[i] + fz[i] * e.ez[i]) / 2;
  }
}

/// What each point adds: the upper triangle of J'WJ (21), -J'We (6), the error and 1. A small
/// motion (v, u) of the source changes the error by -v - u x p, so that J is [-I, [p]x].
constexpr std::size_t term_count = 29;

FUSIONSLAM_INLINE void find_terms(const Lanes* w, const Errors& e, Lanes* terms) {
  Lanes fx, fy, fz;
  apply(w, e, fx, fy, fz, terms[27]);
  for (std::size_t i = 0; i < block_size; ++i) {
    const float x = e.x[i], y = e.y[i], z = e.z[i];
    const float xx = w[0][i], xy = w[1][i], xz = w[2][i], yy = w[3][i], yz = w[4][i], zz = w[5][i];
    // Rows of -W [p]x: the cross products of p and the rows of W.
    const float b00 = y * xz - z * xy, b01 = z * xx - x * xz, b02 = x * xy - y * xx;
    const float b10 = y * yz - z * yy, b11 = z * xy - x * yz, b12 = x * yy - y * xy;
    const float b20 = y * zz - z * yz, b21 = z * xz - x * zz, b22 = x * yz - y * xz;
    terms[0][i] = xx;
    terms[1][i] = xy;
    terms[2][i] = xz;
    terms[3][i] = b00;
    terms[4][i] = b01;
    terms[5][i] = b02;
    terms[6][i] = yy;
    terms[7][i] = yz;
    terms[8][i] = b10;
    terms[9][i] = b11;
    terms[10][i] = b12;
    terms[11][i] = zz;
    terms[12][i] = b20;
    terms[13][i] = b21;
    terms[14][i] = b22;
    // And of p and its columns: [p]x' W [p]x.
    terms[15][i] = y * b20 - z * b10;
    terms[16][i] = y * b21 - z * b11;
    terms[17][i] = y * b22 - z * b12;
    terms[18][i] = z * b01 - x * b21;
    terms[19][i] = z * b02 - x * b22;
    terms[20][i] = x * b12 - y * b02;
    terms[21][i] = fx[i];
    terms[22][i] = fy[i];
    terms[23][i] = fz[i];
    terms[24][i] = y * fz[i] - z * fy[i];
    terms[25][i] = z * fx[i] - x * fz[i];
    terms[26][i] = x * fy[i] - y * fx[i];
    terms[28][i] = e.weight[i];
  }
}

FUSIONSLAM_INLINE double total(const double* lanes) {
  double sum = 0;
  for (std::size_t i = 0; i < block_size; ++i) sum += lanes[i];
  return sum;
}

FUSIONSLAM_INLINE void linearize(const Pairing& pairing, const Motion& motion,
                                 float squared_distance, std::uint32_t* pairs,
                                 NormalEquations& equations) {
  double sums[term_count][block_size] = {};
  Errors e;
  Lanes w[6], terms[term_count];
  for (std::size_t block = 0; block < pairing.blocks; ++block) {
    find_errors(pairing, motion, block, e);
    const std::uint32_t* places = pairing.places + block * block_size;
    std::uint32_t* kept = pairs + block * block_size;
    for (std::size_t i = 0; i < block_size; ++i) {
      const float squared = e.ex[i] * e.ex[i] + e.ey[i] * e.ey[i] + e.ez[i] * e.ez[i];
      const bool near = squared <= squared_distance;
      e.weight[i] = near ? e.weight[i] : 0.0F;
      kept[i] = near ? places[i] : no_place;
    }
    weigh(e, w);
    find_terms(w, e, terms);
    for (std::size_t k = 0; k < term_count; ++k)
      for (std::size_t i = 0; i < block_size; ++i) sums[k][i] += static_cast<double>(terms[k][i]);
  }
  for (std::size_t k = 0; k < 21; ++k) equations.information[k] = total(sums[k]);
  for (std::size_t k = 0; k < 6; ++k) equations.gradient[k] = total(sums[21 + k]);
  equations.error = total(sums[27]);
  equations.inliers = total(sums[28]);
}

FUSIONSLAM_INLINE double sum_error(const Pairing& pairing, const Motion& motion) {
  double sums[block_size] = {};
  Errors e;
  Lanes w[6], fx, fy, fz, half_square;
  for (std::size_t block = 0; block < pairing.blocks; ++block) {
    find_errors(pairing, motion, block, e);
    weigh(e, w);
    apply(w, e, fx, fy, fz, half_square);
    for (std::size_t i = 0; i < block_size; ++i) sums[i] += static_cast<double>(half_square[i]);
  }
  return total(sums);
}

}  // namespace

GicpKernels gicp_kernels(SimdLevel level) {
  return {
      choose(level, Levels<insert_smallest<Vectors16>>::baseline,
             Levels<insert_smallest<Vectors32>>::avx2, Levels<insert_smallest<Vectors64>>::avx512),
      choose(level, Levels<add_neighbors<Vectors16>>::baseline,
             Levels<add_neighbors<Vectors32>>::avx2, Levels<add_neighbors<Vectors64>>::avx512),
      compiled_for<find_normals>(level),
      compiled_for<move>(level),
      choose(level, Levels<lower_nearest<Vectors16>>::baseline,
             Levels<lower_nearest<Vectors32>>::avx2, Levels<lower_nearest<Vectors64>>::avx512),
      compiled_for<linearize>(level),
      compiled_for<sum_error>(level)};
}

}  // namespace fusionslam::detail
