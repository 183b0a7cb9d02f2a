#include "render/training_masks.h"

#include <doctest/doctest.h>

#include <numeric>

using namespace slide;

TEST_CASE("the occlusion mask is S_hat above 0.05") {
  Image s(3, 1, 1);
  s.data = {0.0F, 0.05F, 0.0501F};
  CHECK(occlusion_mask(s).data == std::vector<float>{0, 0, 1});
}

TEST_CASE("strokes are binary, repeatable, differ by seed, and cover a part of the image") {
  double covered = 0;
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    const Image mask = stroke_mask(256, 192, seed);
    for (const float v : mask.data) REQUIRE((v == 0.0F || v == 1.0F));
    const double part =
        std::accumulate(mask.data.begin(), mask.data.end(), 0.0) / static_cast<double>(mask.pixels());
    CHECK(part > 0.005);
    CHECK(part < 0.9);
    covered += part / 50;
  }
  CHECK(covered > 0.1);
  CHECK(covered < 0.6);
  CHECK(stroke_mask(64, 64, 7).data == stroke_mask(64, 64, 7).data);
  CHECK(stroke_mask(64, 64, 7).data != stroke_mask(64, 64, 8).data);
}
