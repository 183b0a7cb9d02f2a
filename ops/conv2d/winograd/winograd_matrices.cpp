#include "ops/conv2d/winograd/winograd_matrices.h"

#include <cmath>
#include <string>

#include "runtime/error.h"

namespace slide::ops {
namespace {

/// The coefficients, lowest first, of the product of (x - root) over all roots but number `without`.
std::vector<double> polynomial(const std::vector<double>& roots, std::size_t without) {
  std::vector<double> p = {1};
  for (std::size_t k = 0; k < roots.size(); ++k) {
    if (k == without) continue;
    p.insert(p.begin(), 0);
    for (std::size_t i = 0; i + 1 < p.size(); ++i) p[i] -= roots[k] * p[i + 1];
  }
  return p;
}

}  // namespace

const std::vector<double>& winograd_pairs(int tile) {
  static const std::vector<double> two = {1};
  static const std::vector<double> four = {181.0 / 256, 181.0 / 128};
  static const std::vector<double> six = {0.5, 1, 2};
  if (tile == 2) return two;
  if (tile == 4) return four;
  if (tile == 6) return six;
  throw Error(ErrorKind::kInternal, "Winograd tiles of " + std::to_string(tile) + " are not known");
}

WinogradMatrices winograd_matrices(const std::vector<double>& pairs) {
  std::vector<double> points = {0};
  for (const double p : pairs) {
    points.push_back(p);
    points.push_back(-p);
  }
  const std::size_t m = 2 * pairs.size();
  const std::size_t n = m + 2;
  WinogradMatrices w{static_cast<int>(m), static_cast<int>(n), {}, {}, {}};
  w.at.assign(m, std::vector<double>(n, 0));
  w.g.assign(n, std::vector<double>(3, 0));
  w.bt.assign(n, std::vector<double>(n, 0));
  for (std::size_t k = 0; k < points.size(); ++k) {
    double norm = 1;
    for (std::size_t q = 0; q < points.size(); ++q)
      if (q != k) norm *= points[k] - points[q];
    for (std::size_t i = 0; i < m; ++i) w.at[i][k] = std::pow(points[k], static_cast<double>(i));
    for (std::size_t j = 0; j < 3; ++j) w.g[k][j] = std::pow(points[k], static_cast<double>(j)) / norm;
    const std::vector<double> row = polynomial(points, k);
    for (std::size_t i = 0; i < row.size(); ++i) w.bt[k][i] = row[i];
  }
  w.at[m - 1][n - 1] = 1;
  w.g[n - 1][2] = 1;
  w.bt[n - 1] = polynomial(points, points.size());
  return w;
}

void winograd_filters(const WinogradMatrices& w, const double* taps, std::size_t count, double* u) {
  std::vector<double> rows(3 * count);
  for (const std::vector<double>& gi : w.g) {
    for (std::size_t v = 0; v < 3; ++v)
      for (std::size_t n = 0; n < count; ++n)
        rows[v * count + n] = gi[0] * taps[v * count + n] + gi[1] * taps[(3 + v) * count + n] +
                              gi[2] * taps[(6 + v) * count + n];
    for (const std::vector<double>& gj : w.g) {
      for (std::size_t n = 0; n < count; ++n)
        u[n] = gj[0] * rows[n] + gj[1] * rows[count + n] + gj[2] * rows[2 * count + n];
      u += count;
    }
  }
}

}  // namespace slide::ops
