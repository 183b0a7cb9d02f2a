#pragma once

#include <cstdint>
#include <optional>

#include "runtime/graph.h"

namespace slide::graphs {

/// The parameters of soft layering (Jampani et al., ICCV 2021, section 3.2; docs/method.md, section 4). What is
/// not set follows from the largest parallax of the camera path. With beta = P²/12 the visibility is one half
/// where neighbours are pulled sqrt(12·ln 2) = 2.9 pixels apart: less keeps stretching, jumps are cut. The
/// paper blurs (sigma) to smooth its network's steps; here that would only widen the seam (docs/views.md).
struct LayeringParams {
  double parallax = 0;               ///< P, pixels: disparity 1 against disparity 0 over the whole path; >= 0
  std::optional<double> beta = {};   ///< steepness of the visibility; default P²/12
  std::optional<double> gamma = {};  ///< steepness of the disocclusion; default P
  std::optional<double> rho = {};    ///< disparity that one pixel of distance is worth; default 1/P
  std::optional<std::int64_t> radius = {};  ///< m, pixels; default ceil(P)
  double sigma = 0;                         ///< of the conditioning blur, pixels; none by default
  std::int64_t maxpool = 3;                 ///< k of the conditioning max-pool, odd
};

/// The same with every value decided.
struct Layering {
  double parallax;
  double beta;
  double gamma;
  double rho;
  std::int64_t radius;
  double sigma;
  std::int64_t maxpool;
};

/// The largest values that make sense: beyond them a pixel's neighbours cannot be told apart in float32, or a
/// window is larger than any photo.
inline constexpr double kLargestBeta = 1e9;
inline constexpr double kLargestGamma = 1e6;
inline constexpr double kLargestRho = 1e3;
inline constexpr int kLargestLength = 30000;  ///< radius, sigma, maxpool; pixels

/// Fills in the defaults. Throws Error(kUsage) naming the parameter that is negative, not finite, too large,
/// or (maxpool) even. With P = 0 nothing moves: beta = gamma = 0, so A = 1 and S = S_hat = 0.
[[nodiscard]] Layering resolve(const LayeringParams& params);

/// The maps that split a photo into two layers; all 1×1×H×W in [0, 1].
struct LayeringMaps {
  Value disparity;     ///< D1: blurred and max-pooled disparity, the foreground's geometry
  Value visibility;    ///< A (eq. 1), or A' where a matte is given
  Value disocclusion;  ///< S (eq. 3): what lies behind this pixel may come into view
  Value occlusion;     ///< S_hat: this pixel may be covered by a nearer neighbour
  Value hole;          ///< H: 1 where S > 0.05, dilated by one pixel
};

/// D1 = maxpool_k(gauss_sigma(D)).
Value condition_disparity(Value disparity, const Layering& layering);

/// A = exp(-beta·|∇D1|²), the gradient by Sobel (eq. 1).
Value visibility(Value conditioned, const Layering& layering);

/// S = relu(tanh(gamma · max over i of (D1 - D1(i) - rho·K(i)))) along scan lines (eq. 3).
Value disocclusion(Value conditioned, const Layering& layering);

/// S_hat = relu(tanh(gamma · max over i of (D1(i) - D1 - rho·K(i)))), the mirror image of S.
Value occlusion(Value conditioned, const Layering& layering);

/// M above which nothing shows through.
inline constexpr double kOpaque = 0.98;

/// What layering takes of a subject's matte: three maps of SubjectRim in graphs/subject.h.
struct FollowedMatte {
  Value alpha;
  Value part;    ///< p, SubjectRim::moves
  Value opaque;  ///< the disparity without what shows through: what it uncovers and covers
};

/// A' = A + p·(M - A): near the outline the matte is the visibility, and what a subject covers is whole.
Value matte_visibility(Value visibility, const FollowedMatte& matte);

/// S' = max(S, p·[M <= 0.98]): what lies behind a pixel that is see-through is in view.
Value matte_disocclusion(Value disocclusion, const FollowedMatte& matte);

/// The inpainting mask: S > 0.05, dilated by one pixel in all eight directions.
Value hole(Value disocclusion);

/// All of the above; the matte only where something moves. S and S_hat are of the opaque disparity where
/// there is a matte. All inputs are 1×1×H×W in [0, 1].
LayeringMaps soft_layering(Value disparity, const Layering& layering,
                           const std::optional<FollowedMatte>& matte = std::nullopt);

}  // namespace slide::graphs
