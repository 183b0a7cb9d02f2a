#include <doctest/doctest.h>

#include <algorithm>
#include <bit>
#include <cinttypes>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <string>
#include <vector>

#include "ops/simd/array_math.h"
#include "runtime/cpu.h"

using namespace slide;

namespace {

/// The distance between two neighbouring float32 at |y|; that of the denormals below the normal range.
double ulp(double y) {
  const int exponent = y == 0 ? -126 : std::max(std::ilogb(y), -126);
  return std::ldexp(1.0, exponent - 23);
}

/// |y - exact| in ULP; beyond the largest finite float32 plus half an ULP only infinity is right.
double error_in_ulp(float y, double exact) {
  if (std::isnan(exact)) return std::isnan(y) ? 0 : INFINITY;
  if (std::fabs(exact) >= 0x1.ffffffp127)
    return std::isinf(y) && std::signbit(y) == std::signbit(exact) ? 0 : INFINITY;
  if (!std::isfinite(y)) return INFINITY;
  return std::fabs(static_cast<double>(y) - exact) / ulp(exact);
}

struct Function {
  const char* name;
  ops::ArrayMath::Function ops::ArrayMath::*fast;
  double (*exact)(double);
  double bound;  // ULP, as stated in ops/simd/math.h
};

const Function kFunctions[] = {
    {"exp", &ops::ArrayMath::exp, [](double x) { return std::exp(x); }, 1.0},
    {"elu", &ops::ArrayMath::elu, [](double x) { return x < 0 ? std::expm1(x) : x; }, 1.0},
    {"sigmoid", &ops::ArrayMath::sigmoid, [](double x) { return 1 / (1 + std::exp(-x)); }, 2.5},
    {"tanh", &ops::ArrayMath::tanh, [](double x) { return std::tanh(x); }, 2.5},
    {"silu", &ops::ArrayMath::silu, [](double x) { return x < -800 ? -0.0 : x / (1 + std::exp(-x)); }, 4},
    {"gelu", &ops::ArrayMath::gelu,
     [](double x) { return x < -40 ? -0.0 : 0.5 * x * std::erfc(-x / std::sqrt(2.0)); }, 14},
};

/// Every how many bit patterns are tested; SLIDE_TEST_STRIDE=1 tests all 2^32.
std::uint64_t stride() {
  const char* text = std::getenv("SLIDE_TEST_STRIDE");
  return text != nullptr ? std::max<std::uint64_t>(1, std::strtoull(text, nullptr, 10)) : 1999;
}

/// The bit patterns first <= bits < last: all, or part K of N with SLIDE_TEST_PART=K/N, K from 0 on.
struct Part {
  std::uint64_t first = 0, last = std::uint64_t{1} << 32;
};
Part part() {
  const char* text = std::getenv("SLIDE_TEST_PART");
  std::uint64_t index = 0, count = 1;
  if (text != nullptr && std::sscanf(text, "%" SCNu64 "/%" SCNu64, &index, &count) != 2) count = 0;
  REQUIRE(index < count);
  return {(index << 32) / count, ((index + 1) << 32) / count};
}

}  // namespace

TEST_CASE("exp, elu, sigmoid, tanh, silu and gelu keep their ULP bounds over the whole line at every level") {
  constexpr std::uint64_t kBlock = 4093;  // odd, so that the last, partial vector is met
  std::vector<float> x;
  std::vector<float> y(kBlock);
  const auto [first, last] = part();
  const std::uint64_t step = stride();
  for (const Isa isa : available_isas()) {
    const ops::ArrayMath& math = ops::array_math(isa);
    CHECK(runs_at(math.isa, isa));
    if (math.isa != isa) continue;  // those of the level below
    for (const Function& f : kFunctions) {
      double worst = 0;
      float worst_x = 0;
      for (std::uint64_t bits = first; bits < last;) {
        x.clear();
        for (; x.size() < kBlock && bits < last; bits += step)
          x.push_back(std::bit_cast<float>(static_cast<std::uint32_t>(bits)));
        std::fill(y.begin(), y.end(), -7.0F);
        (math.*f.fast)(x.data(), y.data(), x.size());
        for (std::size_t i = 0; i < x.size(); ++i) {
          const double error = error_in_ulp(y[i], f.exact(static_cast<double>(x[i])));
          if (error > worst) {
            worst = error;
            worst_x = x[i];
          }
        }
      }
      INFO(std::string(name_of(isa)), " ", std::string(f.name), "(", worst_x, ") is ", worst, " ULP off");
      CHECK(worst <= f.bound);
      if (std::getenv("SLIDE_TEST_STRIDE") != nullptr)
        MESSAGE(std::string(name_of(isa)), " ", std::string(f.name), ": worst ", worst, " ULP at ", worst_x);
    }
  }
}

TEST_CASE("the elementary functions are exact at their special points") {
  constexpr float kInf = std::numeric_limits<float>::infinity();
  constexpr float kTiny = std::numeric_limits<float>::denorm_min();
  const std::vector<float> x = {
      0.0F, -0.0F, kInf, -kInf, kTiny, -kTiny, std::numeric_limits<float>::quiet_NaN()};
  std::vector<float> y(x.size() + 1, -7.0F);
  for (const Isa isa : available_isas()) {
    const ops::ArrayMath& math = ops::array_math(isa);
    const auto run = [&](ops::ArrayMath::Function f) {
      f(x.data(), y.data(), x.size());
      CHECK(std::isnan(y[6]));
      CHECK(y[7] == -7.0F);  // nothing is written beyond the end
      return std::vector<float>(y.begin(), y.begin() + 6);
    };
    CHECK(run(math.exp) == std::vector<float>{1, 1, kInf, 0, 1, 1});
    CHECK(run(math.sigmoid) == std::vector<float>{0.5F, 0.5F, 1, 0, 0.5F, 0.5F});
    CHECK(run(math.elu) == std::vector<float>{0, 0, kInf, -1, kTiny, -kTiny});
    CHECK(std::signbit(y[1]));
    CHECK(run(math.tanh) == std::vector<float>{0, 0, 1, -1, kTiny, -kTiny});
    CHECK(std::signbit(y[1]));
    CHECK(!std::signbit(y[0]));
  }
}
