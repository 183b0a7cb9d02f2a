#include "benchmarks/eval/image_metrics.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "benchmarks/eval/flip.h"

using namespace slide;
using namespace slide::eval;

// Numbers of tests/oracles/make_image_metrics.py: SciPy in float64, FLIP by its authors' program in float32.
namespace {

constexpr int kWidth = 100;
constexpr int kHeight = 84;

int triangle(int t, int half) { return std::abs(t % (2 * half) - half) * 255 / half; }

int value(int x, int y, int c) { return (triangle(x * (c + 2) + y, 23) + triangle(3 * y + x * c, 37)) / 2; }

struct Pictures {
  Image a{kWidth, kHeight, 3};
  Image b{kWidth, kHeight, 3};
  Image everywhere{kWidth, kHeight, 1, 1};
  Image inside = without_border(everywhere, 0.2);

  Pictures() {
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x)
        for (int c = 0; c < 3; ++c) {
          const int noise = (x * 7919 + y * 104729 + c * 31) % 41 - 20;
          const int other = value(x + 1, y, c) + noise + (x > 60 ? 30 : 0);
          a.at(x, y, c) = static_cast<float>(value(x, y, c)) / 255;
          b.at(x, y, c) = static_cast<float>(std::clamp(other, 0, 255)) / 255;
        }
  }
};

/// The pictures are float32, the numbers of pictures in float64.
void check_near(double is, double wanted) {
  CAPTURE(is);
  CHECK(std::fabs(is - wanted) <= 2e-6 * std::fabs(wanted));
}

}  // namespace

TEST_CASE("PSNR, SSIM, MS-SSIM and GMSD are SciPy's") {
  const Pictures p;
  check_near(psnr(p.a, p.b, p.everywhere), 19.2740928789257);
  check_near(ssim(p.a, p.b, p.everywhere), 0.804946144868236);
  check_near(ms_ssim(p.a, p.b, p.everywhere), 0.917799675787258);
  check_near(gmsd(p.a, p.b, p.everywhere), 0.0986780376025966);
  check_near(gmsd(p.a, p.b, p.everywhere, GradientScale::kFull), 0.106404923345898);
}

TEST_CASE("a mask weighs the means at every scale") {
  const Pictures p;
  check_near(psnr(p.a, p.b, p.inside), 19.646247256707);
  check_near(ssim(p.a, p.b, p.inside), 0.791008467889373);
  check_near(ms_ssim(p.a, p.b, p.inside), 0.894023224067006);
  check_near(gmsd(p.a, p.b, p.inside), 0.104851691087661);
  check_near(gmsd(p.a, p.b, p.inside, GradientScale::kFull), 0.112343106728735);
}

TEST_CASE("FLIP is its authors' to what float32 computes") {
  const Pictures p;
  CHECK(std::fabs(flip(p.a, p.b, p.everywhere) - 0.387988) < 1e-5);
  CHECK(std::fabs(flip(p.a, p.b, p.inside) - 0.3823685) < 1e-5);
  const Plane map = flip_map(p.a, p.b);
  struct Place {
    int x, y;
    double error;
  };
  for (const Place place : {Place{0, 0, 0.3909937}, Place{50, 40, 0.3264883}, Place{61, 40, 0.6005999},
                            Place{99, 83, 0.3666404}, Place{30, 10, 0.3811864}}) {
    CAPTURE(place.x);
    CHECK(std::fabs(map.at(place.x, place.y) - place.error) < 3e-5);
  }
}

TEST_CASE("of equal pictures, and of none, the metrics say so") {
  const Pictures p;
  CHECK(std::isinf(psnr(p.a, p.a, p.everywhere)));
  CHECK(ssim(p.a, p.a, p.everywhere) == doctest::Approx(1).epsilon(1e-12));
  CHECK(ms_ssim(p.a, p.a, p.everywhere) == doctest::Approx(1).epsilon(1e-12));
  CHECK(gmsd(p.a, p.a, p.everywhere) < 1e-12);
  CHECK(flip(p.a, p.a, p.everywhere) == 0);
  const Image none(kWidth, kHeight, 1);
  for (const double v : {psnr(p.a, p.b, none), ssim(p.a, p.b, none), ms_ssim(p.a, p.b, none),
                         gmsd(p.a, p.b, none), flip(p.a, p.b, none)})
    CHECK(std::isnan(v));
}

TEST_CASE("the picture without its border is what the mask without it shows") {
  const Pictures p;
  const Image cut = cropped(p.a, 0.2);
  CHECK(cut.width == 60);
  CHECK(cut.height == 50);
  CHECK(cut.at(0, 0, 1) == p.a.at(20, 17, 1));
  CHECK(cut.at(59, 49, 2) == p.a.at(79, 66, 2));
  CHECK(mask_fraction(p.inside) == doctest::Approx(60.0 * 50 / (kWidth * kHeight)));
}
