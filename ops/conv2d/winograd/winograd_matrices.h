#pragma once

#include <vector>

namespace slide::ops {

/// The matrices of Winograd's minimal filtering F(m, 3): m outputs of a filter of 3 taps g over m + 2 inputs
/// d with m + 2 multiplications,
///   y = Aᵀ [(G g) ⊙ (Bᵀ d)],
/// and in two dimensions y = Aᵀ [(G g Gᵀ) ⊙ (Bᵀ d B)] A. They are Toom and Cook's interpolation: with the
/// points p_0 .. p_m and ∞, N_k the product of p_k - p_q over q != k,
///   Aᵀ[i][k] = p_k^i,          ∞: 1 where i = m - 1
///   G[k][j]  = p_k^j / N_k,    ∞: 1 where j = 2
///   Bᵀ[k]    = the coefficients of the product of (x - p_q) over q != k, ∞: over all q.
/// (Winograd, "Arithmetic Complexity of Computations", 1980; Lavin and Gray, "Fast Algorithms for
/// Convolutional Neural Networks", 2016.)
///
/// Points are 0 and pairs ±p; frequency 0 belongs to 0, 2k + 1 and 2k + 2 to p_k and -p_k, the last to ∞. The
/// pairs' numbers have few bits, so that the coefficients in which the fast kernels work, p² and powers of p
/// below m, are exact in float32 and cost no accuracy:
///   m = 2: 1
///   m = 4: 181/256 and 181/128, √½ and √2 but for 1.3e-5
///   m = 6: 1/2, 1 and 2; no others of a grid of 1/16 gave an RMS error smaller by more than a few percent
struct WinogradMatrices {
  int tile;         ///< m
  int frequencies;  ///< m + 2
  std::vector<std::vector<double>> at, g, bt;
};

/// The pairs' positive points for an even tile m, m / 2 of them. Throws Error(kInternal) for other tiles than
/// 2, 4 and 6.
[[nodiscard]] const std::vector<double>& winograd_pairs(int tile);

/// The matrices over 0, those pairs and ∞; m = 2·pairs.
[[nodiscard]] WinogradMatrices winograd_matrices(const std::vector<double>& pairs);

/// U = G g Gᵀ of `count` filters of 3 by 3 taps: taps is 9 × count, u is (m + 2)² × count.
void winograd_filters(const WinogradMatrices& matrices, const double* taps, std::size_t count, double* u);

}  // namespace slide::ops
