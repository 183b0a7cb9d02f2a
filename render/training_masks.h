#pragma once

#include <cstdint>

#include "render/image.h"

namespace slide {

/// The masks that the inpainting network is trained with; 1 inside the hole.

/// The occlusion mask of a photo: S_hat > 0.05, the places that something nearer may cover.
[[nodiscard]] Image occlusion_mask(const Image& occlusion);

/// Random brush strokes as DeepFillv2 draws them (Yu et al., ICCV 2019, section 3.4): up to four strokes of 4
/// to 12 vertices each, turning by about 2π/5 in alternating directions, 12 to 40 pixels wide at 256 pixels
/// (scaled with the image's shorter side), their joints round, flipped at random. The same seed gives the
/// same mask everywhere.
[[nodiscard]] Image stroke_mask(int width, int height, std::uint64_t seed);

}  // namespace slide
